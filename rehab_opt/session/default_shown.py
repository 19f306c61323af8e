"""A result of any kind of problem: its numbers as a table, its columns over time as a figure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from rich.table import Table
from rich.text import Text

from rehab_opt.session.drawing import GRID, framed
from rehab_opt.session.outcome import Outcome

__all__ = ["figures", "table"]

TIME = "t_s"


def table(outcome: Outcome) -> Table:
    """A row for each number, those of a section below its name; what the problem says itself is left out."""
    made = Table(title=Text(outcome.title))
    made.add_column("quantity")
    made.add_column("value", justify="right")
    for label, value in _rows({key: value for key, value in outcome.metrics.items() if key != "parameters"}):
        made.add_row(Text(label), Text(value))
    return made


def figures(outcome: Outcome) -> dict[str, Figure]:
    """Every column of numbers over time, a panel for each unit; none where there is no time."""
    units: dict[str, list[str]] = {}
    for name, cells in outcome.columns.items():
        if name != TIME and np.asarray(cells).dtype.kind in "fi":
            units.setdefault(name.rpartition("_")[2], []).append(name)
    if TIME not in outcome.columns or not units:
        return {}
    figure = framed(outcome.title, 9.0, 1.0 + 2.5 * len(units))
    grid = figure.subplots(len(units), 1, sharex=True, squeeze=False)[:, 0]
    for axes, (unit, names) in zip(grid, units.items(), strict=True):
        for name in names:
            axes.plot(outcome.columns[TIME], outcome.columns[name], label=name)
        axes.set_ylabel(f"[{unit}]")
        axes.grid(**GRID)
        axes.legend(fontsize=8)
    grid[-1].set_xlabel("time [s]")
    return {"trace": figure}


def _rows(numbers: Mapping[str, Any], indent: str = "") -> Iterator[tuple[str, str]]:
    for key, value in numbers.items():
        label = indent + key.replace("_", " ")
        if isinstance(value, Mapping):
            yield label, ""
            yield from _rows(value, indent + "   ")
        else:
            yield label, f"{value:.4g}" if isinstance(value, float) else str(value)
