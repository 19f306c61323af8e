"""The workspaces of an arm as a table for the terminal."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rich.table import Table
from rich.text import Text

from rehab_opt.session.cells import Numbers, Rows
from rehab_opt.session.workspaces.outcome import WorkspaceOutcome
from rehab_opt.session.workspaces.reached import handle_words, plane_words

__all__ = ["AREA_ROWS", "percent", "set_columns", "workspace_table"]


def workspace_table(outcome: WorkspaceOutcome) -> Table:
    """Rows of quantities with their units, a column for each range of motion."""
    sets = outcome.metrics["sets"]
    caption = f"plane {plane_words(outcome.section)}, {handle_words(outcome.section)}"
    table = set_columns(outcome.title, sets, caption)
    for label, value in AREA_ROWS:
        table.add_row(label, *(value(numbers) for numbers in sets.values()))
    for other in sets if len(sets) > 1 else ():
        shares = (numbers["share_inside"].get(other) for numbers in sets.values())
        table.add_row(Text(f"share of it inside {other}, %"), *map(percent, shares))
    table.add_row("time to find it, s", *(f"{numbers['seconds']:.2f}" for numbers in sets.values()))
    volumes = outcome.metrics["volumes"]
    for key, label in (("handle_held", "volume, handle held as above, l"), ("handle_free", "volume, handle free, l")):
        if any(key in numbers for numbers in volumes.values()):
            table.add_row(label, *(_litres(volumes[name].get(key)) for name in sets))
    return table


def set_columns(title: str, names: Any, caption: str) -> Table:
    """An empty table with a column for each named set."""
    table = Table(title=Text(title), caption=Text(caption), caption_justify="left")
    table.add_column("quantity")
    for name in names:
        table.add_column(Text(name), justify="right")
    return table


def _extent(axis: str) -> Callable[[Numbers], str]:
    def cell(of: Numbers) -> str:
        low, high = of[f"{axis}_min_m"], of[f"{axis}_max_m"]
        return "-" if low is None else f"{1e3 * low:.0f} to {1e3 * high:.0f}"

    return cell


def _area(of: Numbers) -> str:
    return "0 (empty)" if of["empty"] else f"{1e4 * of['area_m2']:.4g}"


def percent(share: float | None) -> str:
    """A share, or that there is none."""
    return "-" if share is None else f"{100 * share:.1f}"


def _litres(of: Numbers | None) -> str:
    return "-" if of is None else f"{1e3 * of['volume_m3']:.3g} +- {1e3 * of['volume_bound_m3']:.2g}"


AREA_ROWS: Rows = (
    ("area, cm^2", _area),
    ("separate parts; holes", lambda of: f"{of['components']}; {of['holes']}"),
    ("extent to the right, x, mm", _extent("x")),
    ("extent forwards, y, mm", _extent("y")),
    ("accuracy of the boundary, mm", lambda of: f"{1e3 * of['accuracy_m']:.2g}"),
)
