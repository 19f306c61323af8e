"""The files of a run: metrics.json, trace.csv and figures, all of them or none."""

from __future__ import annotations

import csv
import importlib.metadata
import json
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.session.outcome import ArmOutcome, Outcome, RobotOutcome

__all__ = ["checked_folder", "trace_columns", "write_report"]

Array = NDArray[np.float64]

SOFTWARE = ("rehab_opt", "casadi", "numpy", "ruckig")


def checked_folder(folder: Path) -> Path:
    """Refuse, before a run, a folder that cannot take its files.

    Raises
    ------
    ConfigurationError : it, or the nearest folder above that exists, is a file or cannot be written to.
    """
    existing = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    if not existing.is_dir() or not os.access(existing, os.W_OK | os.X_OK):
        raise ConfigurationError("--out", str(folder), "a folder that can be written to")
    return folder


def write_report(outcome: Outcome, folder: Path) -> tuple[Path, ...]:
    """Write every file of a run beside `folder`, then move them into it; files of other names there stay.

    Raises
    ------
    ConfigurationError : the folder cannot be made or written to.
    """
    from rehab_opt.session.figures import figures  # noqa: PLC0415  (loads matplotlib)

    drawn = figures(outcome)
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f".{folder.name}-", dir=folder.parent) as scratch:
            written = Path(scratch)
            (written / "metrics.json").write_text(metrics_json(outcome), encoding="utf-8")
            write_trace(outcome, written / "trace.csv")
            for name, figure in drawn.items():
                figure.savefig(written / f"{name}.png")
            folder.mkdir(exist_ok=True)
            return tuple(path.replace(folder / path.name) for path in sorted(written.iterdir()))
    except OSError as problem:
        raise ConfigurationError(
            "--out", str(folder), f"a folder that can be written to ({problem.strerror})"
        ) from problem


def metrics_json(outcome: Outcome) -> str:
    """All numbers and notes of a run as strict JSON: no NaN, no infinity."""
    content = {
        "problem": outcome.name,
        "title": outcome.title,
        "notes": list(outcome.notes),
        "metrics": outcome.metrics,
        "software": {name: _version(name) for name in SOFTWARE},
    }
    return json.dumps(content, indent=2, allow_nan=False) + "\n"


def write_trace(outcome: Outcome, path: Path) -> None:
    """One row a sample, one column a quantity, its unit at the end of its name."""
    columns = dict(trace_columns(outcome))
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        for row in zip(*columns.values(), strict=True):
            writer.writerow(f"{cell:.9g}" if isinstance(cell, float) else cell for cell in row)


def trace_columns(outcome: Outcome) -> Iterator[tuple[str, list[float] | list[int] | tuple[str, ...]]]:
    """Header and samples of every column of trace.csv."""
    yield "t_s", outcome.time.tolist()
    if isinstance(outcome, ArmOutcome):
        yield from _points("path", outcome.path)
        if outcome.reachable is not None:
            yield "reachable", outcome.reachable.astype(int).tolist()
        for run in outcome.laws:
            yield from _points(f"{run.law}_hand", run.hand)
            yield f"{run.law}_position_error_m", run.position_error.tolist()
            yield f"{run.law}_handle_tilt_rad", run.handle_tilt.tolist()
            yield f"{run.law}_status", run.status
            yield f"{run.law}_solve_time_s", run.seconds.tolist()
            yield from _joints(f"{run.law}", outcome, run.q, "rad")
            yield from _joints(f"{run.law}_smoothed", outcome, run.smooth, "rad")
    elif isinstance(outcome, RobotOutcome):
        yield from _points("reference", outcome.reference)
        yield from _points("tool", outcome.tool)
        yield "position_error_m", outcome.position_error.tolist()
        yield "orientation_error_rad", outcome.orientation_error.tolist()
        yield "status", outcome.status
        yield from _joints("joint", outcome, outcome.q, "rad")
        yield from _joints("command", outcome, outcome.command, "rad_s")


def _points(name: str, points: Array) -> Iterator[tuple[str, list[float]]]:
    for axis, column in zip("xyz", points.T, strict=True):
        yield f"{name}_{axis}_m", column.tolist()


def _joints(name: str, outcome: Outcome, values: Array, unit: str) -> Iterator[tuple[str, list[float]]]:
    for joint, column in zip(outcome.chain.names, values.T, strict=True):
        yield f"{name}_{joint}_{unit}", column.tolist()


def _version(name: str) -> str | None:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:  # run from a checkout that is not installed
        return None
