"""Studies by seed for tests and benches: people, sessions, trials with numbers that say what they must be."""

from __future__ import annotations

import sys
import time
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


def checked_sum(study: Study) -> int:
    """How many trials there are, each of which must be as whole as `write_on` made it."""
    trials = study.rows(
        "SELECT t.id, t.number, count(m.value), sum(m.value), (SELECT count(*) FROM bounds b WHERE b.trial = t.id), "
        "(SELECT count(*) FROM outlines o WHERE o.trial = t.id) FROM trials t LEFT JOIN measures m ON m.trial = t.id "
        "GROUP BY t.id"
    )
    for _, number, count, total, bounds, outlines in trials:
        assert (count, bounds, outlines) == (20, 1, 1)
        assert total == 20 * (number % 1000)
    assert study.rows("PRAGMA integrity_check") == [("ok",)]
    assert study.rows("PRAGMA foreign_key_check") == []
    return len(trials)


def write_on(file: Path, person: str, count: int) -> None:
    """Write trials one after another and say so on standard output, each once it is finished."""
    with Study(file) as study:
        (done,) = study.rows(
            "SELECT count(t.id) FROM trials t JOIN sessions s ON s.id = t.session JOIN people p ON p.id = s.person "
            "WHERE p.name = ?",
            (person,),
        )[0]
        for number in range(done + 1, done + count + 1):
            measures = [Measure(f"m{i}", float(number % 1000), "1") for i in range(20)]
            trial = Trial("live", measures, bounds=[Bound("f", 1.0, 2.0, "N")], outline=[(0, 0), (1, 0), (0, 1)])
            study.add(Session(person, "s"), trial)
            print(number, flush=True)


if __name__ == "__main__":
    time.sleep(float(sys.argv[4]) if len(sys.argv) > 4 else 0.0)
    write_on(Path(sys.argv[1]), sys.argv[2], int(sys.argv[3]))
