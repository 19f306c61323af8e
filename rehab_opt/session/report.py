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
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from rehab_opt.errors import ConfigurationError
from rehab_opt.session.outcome import Outcome
from rehab_opt.session.systems import system_named

if TYPE_CHECKING:
    from matplotlib.figure import Figure

METRICS = "metrics.json"
CAPTIONS = "captions.md"
FIGURE_FORMATS = ("png", "pdf")
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


def write_report(outcome: Outcome, folder: Path) -> tuple[Path, ...]:
    """Write every file of a run into a scratch folder, then move them into `folder`; other files there stay.

    Raises
    ------
    ConfigurationError : the folder cannot be created or written to.
    """
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        beside = folder if folder.is_dir() else folder.parent  # a mounted folder takes no file from outside it
        with tempfile.TemporaryDirectory(prefix=f".{folder.name}-", dir=beside) as scratch:
            written = write_results(outcome, Path(scratch))
            folder.mkdir(exist_ok=True)
            return tuple(path.replace(folder / path.name) for path in written)
    except OSError as problem:
        raise ConfigurationError(
            "--out", str(folder), f"a folder that can be written to ({problem.strerror})"
        ) from problem


def write_results(outcome: Outcome, folder: Path) -> list[Path]:
    """Write every file of a run directly into an existing folder; raises OSError if that fails."""
    from rehab_opt.session.drawing import styled  # noqa: PLC0415  (loads matplotlib)

    (folder / METRICS).write_text(metrics_json(outcome), encoding="utf-8")
    write_trace(outcome, folder / "trace.csv")
    with styled():
        write_figures(system_named(outcome.system).figures(outcome), folder, outcome.title)
    return sorted(folder.iterdir())


def write_figures(figures: Mapping[str, Figure], folder: Path, title: str) -> list[Path]:
    """Write figures as PNG and PDF, and captions.md with a paragraph for each; `title` is that of the problem."""
    from rehab_opt.session.drawing import fitted, styled  # noqa: PLC0415  (loads matplotlib)

    captions, written = folder / CAPTIONS, list[Path]()
    with styled():
        for name, figure in figures.items():
            fitted(figure)
            for suffix in FIGURE_FORMATS:
                written.append(folder / f"{name}.{suffix}")
                figure.savefig(written[-1])
                figure.set_layout_engine("none")  # do not compute the layout again for the next format
    paragraphs = [f"**{name}.** {title}. {figure.get_label()}\n" for name, figure in figures.items()]
    captions.write_text("\n".join(paragraphs), encoding="utf-8")
    return [*written, captions]


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
    except importlib.metadata.PackageNotFoundError:  # a missing extra, or a checkout that is not installed
        return None
