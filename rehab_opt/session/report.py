"""The files of a run: metrics.json, trace.csv, figures and films; either all or none are written."""

from __future__ import annotations

import csv
import importlib.metadata
import itertools
import json
import math
import os
import platform
import tempfile
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

from rehab_opt.errors import ConfigurationError
from rehab_opt.session.outcome import Outcome
from rehab_opt.session.systems import system_named

__all__ = ["FIGURE_FORMATS", "METRICS", "checked_folder", "free_folder", "write_report", "write_results"]

METRICS = "metrics.json"
FIGURE_FORMATS = ("pdf", "svg")
"""Formats besides PNG, which is always written."""
SOFTWARE = ("rehab_opt", "casadi", "numpy", "scipy", "shapely", "ruckig", "mujoco")


def checked_folder(folder: Path, *, argument: str = "--out") -> Path:
    """Refuse, before a run, a folder that cannot be written to; `argument` is its name in errors.

    Raises
    ------
    ConfigurationError : the folder, or its nearest existing parent, is a file or cannot be written to.
    """
    existing = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    if not existing.is_dir() or not os.access(existing, os.W_OK | os.X_OK):
        raise ConfigurationError(argument, str(folder), "a folder that can be written to")
    return folder


def free_folder(folder: Path) -> Path:
    """`folder`, or if it holds files of an earlier run, the first free one of `folder-2`, `folder-3` and so on."""
    numbered = (folder.with_name(f"{folder.name}-{number}") for number in itertools.count(2))
    return next(each for each in itertools.chain([folder], numbered) if not (each / METRICS).exists())


def write_report(outcome: Outcome, folder: Path, *, also: Sequence[str] = ()) -> tuple[Path, ...]:
    """Write every file of a run into a scratch folder, then move them into `folder`; other files there stay.

    Parameters
    ----------
    also : formats of `FIGURE_FORMATS` for figures, besides PNG.

    Raises
    ------
    ConfigurationError : the folder cannot be created or written to.
    """
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        beside = folder if folder.is_dir() else folder.parent  # one that is there may be mounted: no file moves into it
        with tempfile.TemporaryDirectory(prefix=f".{folder.name}-", dir=beside) as scratch:
            written = write_results(outcome, Path(scratch), also=also)
            folder.mkdir(exist_ok=True)
            return tuple(path.replace(folder / path.name) for path in written)
    except OSError as problem:
        raise ConfigurationError(
            "--out", str(folder), f"a folder that can be written to ({problem.strerror})"
        ) from problem


def write_results(outcome: Outcome, folder: Path, *, also: Sequence[str] = ()) -> list[Path]:
    """Write every file of a run directly into an existing folder; raises OSError if that fails."""
    from rehab_opt.session.drawing import fitted  # noqa: PLC0415  (loads matplotlib)

    system = system_named(outcome.system)
    drawn = system.figures(outcome)
    (folder / METRICS).write_text(metrics_json(outcome), encoding="utf-8")
    write_trace(outcome, folder / "trace.csv")
    for name, figure in drawn.items():
        fitted(figure)
        for suffix in ("png", *also):
            figure.savefig(folder / f"{name}.{suffix}")
    return sorted(folder.iterdir())


def metrics_json(outcome: Outcome) -> str:
    """All numbers and notes of a run with its date and inputs, as strict JSON: no NaN, no infinity."""
    content = {
        "problem": outcome.name,
        "title": outcome.title,
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "inputs": outcome.inputs,
        "options": outcome.options,
        "notes": list(outcome.notes),
        "metrics": outcome.metrics,
        "software": {"python": platform.python_version()} | {name: _version(name) for name in SOFTWARE},
    }
    return json.dumps(content, indent=2, allow_nan=False) + "\n"


def write_trace(outcome: Outcome, path: Path) -> None:
    """One column for each quantity, with its unit at the end of its name; a missing number (NaN) is an empty cell."""
    columns = dict(outcome.trace())
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        for row in zip(*columns.values(), strict=True):
            writer.writerow(_cell(cell) for cell in row)


def _cell(value: float | int | str) -> float | int | str:
    if not isinstance(value, float):
        return value
    return "" if math.isnan(value) else f"{value:.9g}"


def _version(name: str) -> str | None:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:  # an extra that is not there, or a checkout that is not installed
        return None
