"""Numbers of a run as cells of its table, the table of laws, and what is shown of a kind that says nothing of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from rich.table import Table
from rich.text import Text

from rehab_opt.session.drawing import GRID, framed
from rehab_opt.session.outcome import Outcome

__all__ = [
    "ROUNDING_DEG",
    "Cell",
    "Numbers",
    "Rows",
    "counts",
    "figures",
    "law_table",
    "length",
    "margin",
    "millimetres",
    "speed",
    "spread",
    "statuses",
    "table",
    "times",
]


Numbers = Mapping[str, Any]
Cell = Callable[[Numbers], str]
Rows = tuple[tuple[str, Cell], ...]
"""Label, with its unit, and what to write there."""

ROUNDING_DEG = 1e-4  # tilts that differ by less are the same tilt
SMALL = 1e-3  # [mm] what is less is no length of a hand's path


def spread(name: str, unit: str) -> Callable[[Numbers], str]:
    """Mean, 95th percentile and maximum."""
    return lambda of: " / ".join(f"{of[f'{name}_{part}_{unit}']:.3g}" for part in ("mean", "p95", "max"))


def millimetres(name: str) -> Callable[[Numbers], str]:
    """Mean, 95th percentile and maximum of a length."""

    def cell(of: Numbers) -> str:
        of_all = [1e3 * of[f"{name}_{part}_m"] for part in ("mean", "p95", "max")]
        return f"all < {SMALL:g}" if max(of_all) < SMALL else " / ".join(length(part) for part in of_all)

    return cell


def length(millimetres: float) -> str:
    """A length, or that it is next to nothing."""
    return f"{millimetres:.3g}" if millimetres >= SMALL or millimetres == 0 else f"< {SMALL:g}"


def times(name: str) -> Callable[[Numbers], str]:
    """Median, 99th percentile and maximum of durations."""
    return lambda of: " / ".join(f"{of[f'{name}_{part}_ms']:.3g}" for part in ("median", "p99", "max"))


def margin(of: Numbers) -> str:
    """Least distance to a joint limit."""
    margin, joint = of["joint_limit_margin_min_deg"], of["joint_limit_margin_joint"]
    if margin is None:
        return "no limits"
    return f"{margin + 0.0 if abs(margin) >= 5e-4 else 0.0:.3f} ({joint.replace('_', ' ')})"


def speed(of: Numbers) -> str:
    """Speed of the fastest joint."""
    percent, joint = 100 * of["joint_speed_max_fraction_of_limit"], of["joint_speed_max_joint"].replace("_", " ")
    return f"{of['joint_speed_max_deg_s']:.3g} ({percent:.0f} % of limit, {joint})"


def statuses(of: Numbers) -> str:
    """How often each status occurred."""
    said = counts(of["status"])
    refuted = of.get("status_refuted", 0)
    return f"{said} ({refuted} REFUTED)" if refuted else said


def counts(counts: Mapping[str, int]) -> str:
    """How often each thing occurred."""
    return ", ".join(f"{count} {what}" for what, count in counts.items())


TIME = "t_s"


def law_table(title: str, of: Mapping[str, Numbers], rows: Rows = (), *, caption: str = "") -> Table:
    """Rows of quantities with their units, a column for each law, set or drive, whose numbers are `of` its name."""
    grid = Table(title=Text(title), caption=Text(caption) if caption else None, caption_justify="left")
    grid.add_column("quantity")
    for name in of:
        grid.add_column(Text(name), justify="right")
    for label, value in rows:
        grid.add_row(label, *map(value, of.values()))
    return grid


def table(outcome: Outcome) -> Table:
    """A row for each number, those of a section below its name; what the problem says itself is left out."""
    numbers = {key: value for key, value in outcome.metrics.items() if key != "parameters"}
    made = law_table(outcome.title, {"value": {}})
    for label, value in _rows(numbers):
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
