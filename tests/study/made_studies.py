"""Studies by seed for tests and benches: people, sessions, trials with numbers that say what they must be."""

from __future__ import annotations

import datetime
import json
import sys
from pathlib import Path

import numpy as np

from rehab_opt.measures.score import Measure
from rehab_opt.study.store import Study
from rehab_opt.study.trial import Bound, Event, ProblemText, Session, StoredFile, Trial

UNITS = {
    "movement_time": "s", "speed_mean": "m/s", "speed_peak": "m/s", "velocity_peaks": "1", "sparc": "1",
    "log_dimensionless_jerk": "1", "path_length": "m", "path_ratio": "1", "end_error": "m", "workspace_area": "m^2",
}  # fmt: skip


def made_trial(
    rng: np.random.Generator, *, better: float = 0.0, condition: str | None = None, files: tuple[StoredFile, ...] = ()
) -> Trial:
    """A trial of a reach; `better` in 0..1 is how far the person has come."""
    noise = rng.normal(size=len(UNITS))
    middle = [1.6, 0.25, 0.5, 4.0, -3.0, -8.0, 0.3, 1.6, 0.02, 0.04]
    gain = [-0.7, 0.1, 0.2, -2.5, 1.3, 1.5, -0.02, -0.4, -0.012, 0.05]
    values = [m * (1 + 0.12 * e) + better * g for m, g, e in zip(middle, gain, noise, strict=True)]
    angle = np.linspace(0, 2 * np.pi, 13)[:-1]
    size = np.sqrt(abs(values[-1]) / np.pi) * (1 + 0.1 * rng.normal(size=12))
    force = float(8 + rng.normal())
    return Trial(
        "score",
        [Measure(name, float(value), unit) for (name, unit), value in zip(UNITS.items(), values, strict=True)],
        condition=condition,
        files=files,
        problem=ProblemText("reach", 'system = "scenario"'),
        software="rehab_opt 0",
        bounds=[Bound("force_commanded", force, 10.0, "N")],
        events=[Event("braking", 3.0)] if rng.random() < 0.05 else [],
        outline=[(float(x), float(y)) for x, y in np.column_stack((size * np.cos(angle), size * np.sin(angle)))],
    )


def made_folders(root: Path, people: int, sessions: int, trials: int, *, seed: int = 20261130) -> dict[str, float]:
    """Write a study as `docs/capabilities/studies.md` has it on the disk; by group the mean of `movement_time`.

    Nothing of the library writes here: the folders are what it is to read.
    """
    rng, begin = np.random.default_rng(seed), datetime.date(2026, 1, 5)
    (root / "study.json").parent.mkdir(mode=0o700)
    (root / "study.json").write_text("{}")
    trace = "t_s,x_m\n" + "".join(f"{k / 100:.2f},{np.sin(k / 9):.9f}\n" for k in range(55))  # 1 kB
    means: dict[str, list[float]] = {"stroke": [], "control": []}
    for i in range(people):
        group = ("stroke", "control")[i % 2]
        own = root / f"P{i:04}"
        own.mkdir()
        (own / "person.json").write_text(json.dumps({"group": group}))
        for k in range(sessions):
            session = own / f"week {k + 1}"
            session.mkdir()
            date = (begin + datetime.timedelta(weeks=k)).isoformat()
            (session / "session.json").write_text(json.dumps({"visit": k + 1, "date": date}))
            values = rng.normal(size=(trials, len(UNITS))).round(6)
            for number, row in enumerate(values.tolist(), start=1):
                trial = {
                    "kind": "score", "condition": ("assisted", "unassisted")[number % 2], "status": "done",
                    "measures": [[name, value, unit] for (name, unit), value in zip(UNITS.items(), row, strict=True)],
                    "bounds": [["force_commanded", 8 + row[0], 10.0, "N"]],
                    "events": [["braking", 3.0, "ticks"]] if number == 1 and k == 0 else [],
                    "outline": [[0.0, 0.0], [0.1 + 0.01 * k, 0.0], [0.0, 0.1]],
                }  # fmt: skip
                folder = session / f"{number:03}"
                folder.mkdir()
                (folder / "trial.json").write_text(json.dumps(trial))
                (folder / "trace.csv").write_text(trace)
            means[group].append(float(values[:, 0].mean()))
    return {group: float(np.mean(of)) for group, of in means.items() if of}


def checked_sum(root: Path) -> int:
    """How many trials there are on the disk, each of which must be as whole as `write_on` made it."""
    found = sorted(root.glob("*/*/[0-9]*"))
    for folder in found:
        trial = json.loads((folder / "trial.json").read_text())
        assert [value for _, value, _ in trial["measures"]] == [int(folder.name) % 1000] * 20
        assert (folder / "trace.csv").read_text() == "t_s,x_m\n0.0,1.0\n0.1,2.0\n"
    return len(found)


def write_on(folder: Path, person: str, count: int) -> None:
    """Write trials one after another and say so on standard output, each once it is finished."""
    with Study(folder) as study:
        done = len([*folder.glob(f"{person}/s/[0-9]*")])
        for number in range(done + 1, done + count + 1):
            measures = [Measure(f"m{i}", float(number % 1000), "1") for i in range(20)]
            trial = Trial("live", measures, trace={"t_s": np.array([0.0, 0.1]), "x_m": [1.0, 2.0]})
            study.add(Session(person, "s"), trial)
            print(number, flush=True)


if __name__ == "__main__":
    write_on(Path(sys.argv[1]), sys.argv[2], int(sys.argv[3]))
