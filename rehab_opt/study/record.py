"""Convert a run, a row of a batch, or a scored recording to trials of a study."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rehab_opt.measures.score import Measure
from rehab_opt.recordings.recording import Recording
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.inputs import inputs_digest, software_digest
from rehab_opt.session.many.participant import flat_numbers
from rehab_opt.session.outcome import Outcome
from rehab_opt.session.schema import Problem
from rehab_opt.session.scoring import Scored
from rehab_opt.study.trial import Bound, Event, ProblemText, StoredFile, Trial
from rehab_opt.text_file import MAX_RECORDING_SIZE, file_content
from rehab_opt.version import __version__

__all__ = ["metric_trials", "outline", "run_trials", "score_trials", "versions"]

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

UNITS = {
    "m": "m", "m2": "m^2", "m3": "m^3", "m_s": "m/s", "mm": "mm", "deg": "deg", "deg_s": "deg/s", "rad": "rad",
    "s": "s", "ms": "ms", "N": "N", "N_s": "N/s", "J": "J",
}  # fmt: skip
"""Unit of a number in metrics.json, by the last part of the number's key."""
_UNIT = re.compile(rf"(.+?)_({'|'.join(sorted(UNITS, key=len, reverse=True))})")
COUNTED = {"status": "ticks", "reasons": "ticks", "relaxed": "ticks", "status_fraction": "% of ticks"}
"""Keys of metrics.json whose tables count events, with the unit of the count."""
USUAL = "ok"
SHARE, OF_LIMIT = "_fraction", "_fraction_of_limit"
TRACE = "trace.csv"


def run_trials(
    config: ProblemFile[Problem],
    outcome: Outcome,
    options: Mapping[str, str | None],
    *,
    files: Sequence[Path],
    seconds: float,
) -> tuple[Trial, ...]:
    """The trials of a run.

    Parameters
    ----------
    config : the problem file. outcome : result of the run.
    options : options of the run; None counts as not given.
    files : files that the run has written.
    seconds : computing time [s].
    """
    given = {key: value for key, value in options.items() if value is not None}
    text = config.path.read_text(encoding="utf-8")
    said = [f"# --{key} {value}" for key, value in given.items()]
    if ".toml" in text:  # a recording's .toml adds keys that are not in the text
        said.append(f"# as it was read: {config.problem.model_dump_json(exclude_defaults=True)}")
    text = "\n".join([*said, text])
    run = Trial(
        "run",
        digest=" ".join([inputs_digest(config), *(f"{key}={value}" for key, value in given.items())]),
        problem=ProblemText(config.name, text),
        software=versions(),
        notes=outcome.notes,
        seconds=seconds,
    )
    return metric_trials(outcome.metrics, run, files=files)


def metric_trials(metrics: Mapping[str, Any], trial: Trial, *, files: Sequence[Path] = ()) -> tuple[Trial, ...]:
    """The trials in a run's metrics: one trial, or for a scenario one for each trial of each controller.

    Parameters
    ----------
    metrics : metrics of an outcome, as in metrics.json.
    trial : content that all trials share. A controller's name becomes the condition.
    files : files that the run has written.
    """
    stored = [*trial.files, *(StoredFile(path) for path in files)]
    trace = next((path for path in files if path.name == TRACE), None)
    laws = metrics.get("laws")
    if not isinstance(laws, Mapping) or not all(
        isinstance(law, Mapping) and law.get("trials") for law in laws.values()
    ):
        return (replace(trial, **_numbers(metrics), trace=trace, files=stored),)
    limit = metrics.get("parameters", {}).get("assistance", {}).get("force_limit_N")
    return tuple(
        replace(
            trial,
            condition=law,
            **_numbers(numbers, force_limit=limit),
            digest=trial.digest and f"{trial.digest} {law} {number}",
            trace=trace,
            files=stored,
        )
        for law, of in laws.items()
        for number, numbers in enumerate(of["trials"], start=1)
    )


def score_trials(scored: Scored, how: Mapping[str, Any]) -> list[Trial]:
    """The trials of scored recordings; `how` has the arguments of the scoring.

    Raises
    ------
    ProblemFileError : a recording can no longer be read.
    """
    trials = []
    contents: dict[str, str] = {}
    for source, number, recording, score in scored.trials:
        if source.file not in contents:
            content = file_content(source.path, source.file, max_size=MAX_RECORDING_SIZE)
            contents[source.file] = hashlib.sha256(content).hexdigest()
        text = json.dumps({**how, "reading": source.reading}, sort_keys=True)
        depends = " ".join([text, software_digest(), contents[source.file], str(number)])
        trials.append(
            Trial(
                "score", score.measures, digest=hashlib.sha256(depends.encode()).hexdigest(), notes=score.notes,
                problem=ProblemText("score", text), software=versions(), trace=_samples(recording),
                files=[StoredFile(source.path, "recording")], outline=outline(score.movement),
            )
        )  # fmt: skip
    return trials


def _samples(of: Recording) -> dict[str, Array]:
    """Columns of a recording by name: time [s], hand [m], joint angles [deg], forces [N]."""
    columns = {"t_s": of.time, **{f"{axis}_m": values for axis, values in zip("xyz", of.points.T, strict=False)}}
    columns |= {f"{name}_deg": np.degrees(angles) for name, angles in of.joints.items()}
    return columns | {f"f{axis}_N": values for axis, values in zip("xyz", of.forces.T, strict=False)}


def versions() -> str:
    """Text with the version of rehab_opt and one digest of its source and the numerical libraries' versions."""
    return f"rehab_opt {__version__} {software_digest()}"


def outline(points: Array) -> list[tuple[float, float]]:
    """Corners [m] of the points' convex hull, seen along the axis with the smallest extent; empty for a line."""
    from shapely import MultiPoint, Polygon  # noqa: PLC0415

    axes = np.sort(np.argsort(np.ptp(points, axis=0), kind="stable")[-2:])
    hull = MultiPoint(points[:, axes]).convex_hull
    return [(x, y) for x, y in hull.exterior.coords[:-1]] if isinstance(hull, Polygon) else []


def _numbers(metrics: Mapping[str, Any], *, force_limit: float | None = None) -> dict[str, Any]:
    """Measures, bounds and events in the metrics of a trial, as arguments of `Trial`."""
    known = {key: value for key, value in metrics.items() if key != "parameters"}
    numbers = {
        key: float(value)
        for key, value in flat_numbers(known)
        if isinstance(value, bool | int | float) and not {*key.split(".")[:-1]} & {*COUNTED, "parameters"}
    }
    bounds = list(_bounds(numbers))
    if force_limit is not None:
        bounds.append(Bound("force_commanded", numbers["force_commanded_max_N"], force_limit, "N"))
    measures = [Measure(*_named(key, value)) for key, value in numbers.items()]
    return {"measures": measures, "bounds": bounds, "events": list(_events(known))}


def _named(key: str, value: float) -> tuple[str, float, str]:
    found = _UNIT.fullmatch(key)
    if key.endswith(SHARE):
        return key, value, "1"
    return (key, value, "") if found is None else (found[1], value, UNITS[found[2]])


def _bounds(numbers: Mapping[str, float]) -> Iterator[Bound]:
    """Bounds in metrics: from keys `x_max_u` and `x_limit_u` (quantity x, unit u), or from a fraction of a limit."""
    for key, value in numbers.items():
        name, _, unit = key.rpartition("_max_")
        limit = numbers.get(f"{name}_limit_{unit}")
        if name and limit is not None:
            yield Bound(name, value, limit, UNITS.get(unit, unit))
        elif key.endswith(OF_LIMIT):
            yield Bound(key.removesuffix(OF_LIMIT).removesuffix("_max"), value, 1.0, "of the limit")


def _events(metrics: Mapping[str, Any], above: str = "") -> Iterator[Event]:
    """Events in metrics: counts of ticks with a status other than "ok", of relaxed bounds and of released forces."""
    for key, value in metrics.items():
        if key in COUNTED and isinstance(value, Mapping):
            fraction = key.endswith(SHARE)
            for what, times in value.items():
                if what != USUAL and times:
                    yield Event(f"{above}{what}", 100.0 * times if fraction else times, COUNTED[key])
        elif isinstance(value, Mapping):
            if key != "parameters":
                yield from _events(value, f"{above}{key}: ")
        elif key in ("releases", "status_refuted") and value:
            yield Event(f"{above}{'force let go' if key == 'releases' else 'status refuted'}", value, "times")
