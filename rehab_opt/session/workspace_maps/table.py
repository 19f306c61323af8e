"""The audits of maps between workspaces as a table for the terminal."""

from __future__ import annotations

from rich.table import Table
from rich.text import Text

from rehab_opt.session.cells import Numbers, Rows
from rehab_opt.session.workspace_maps.outcome import MapOutcome

__all__ = ["map_table"]


def map_table(outcome: MapOutcome) -> Table:
    """A section for each direction, a column for each rule."""
    table = Table(title=Text(outcome.title), caption=Text(_caption(outcome)), caption_justify="left")
    table.add_column("quantity")
    for made in outcome.directions[0].maps:
        table.add_column(f"{made.rule} rule", justify="right")
    for direction in outcome.directions:
        columns: list[Numbers] = [outcome.metrics["maps"][direction.key][made.rule] for made in direction.maps]
        table.add_section()
        table.add_row(Text(f"{direction.start.name} -> {direction.end.name}", style="bold"))
        for label, value in MAP_ROWS:
            cells = ("-" if "samples" not in numbers and label != VERDICT else value(numbers) for numbers in columns)
            table.add_row(label, *map(Text, cells))
    return table


def _caption(outcome: MapOutcome) -> str:
    sets = outcome.metrics["sets"].values()
    areas = "; ".join(f"{numbers['name']} {1e4 * numbers['area_m2']:.4g} cm^2" for numbers in sets)
    return f"{areas}. The notes say why a map is refused"


def _round_trip(of: Numbers) -> str:
    error = of["round_trip_max_m"]
    return "no inverse somewhere" if error is None else f"{1e9 * error:.2g}"


def _proof(of: Numbers) -> str:
    proof = of["certificate"]
    if not proof["valid"]:
        return "NOT PROVEN"
    return f"det J >= {proof['determinant_min']:.2g}, {1e3 * proof['margin_m']:.2g} mm inside"


VERDICT = "may go to a controller"
MAP_ROWS: Rows = (
    (VERDICT, lambda of: "yes" if of["passed"] else "NO"),
    ("folded, % of the set", lambda of: f"{100 * of['folded_share']:.3g}"),
    ("mapped outside, % of the set", lambda of: f"{100 * of['outside_share']:.3g}"),
    ("stretch, least to largest", lambda of: f"{of['stretch_min']:.3g} to {of['stretch_max']:.3g}"),
    (
        "   in overall ratios",
        lambda of: (
            f"{of['stretch_min_relative']:.2g} to {of['stretch_max_relative']:.3g} (x {of['overall_ratio']:.3g})"
        ),
    ),
    ("proven everywhere, one-to-one", _proof),
    ("there and back, nm", _round_trip),
    ("share of the other set used, %", lambda of: f"{100 * of['coverage_share']:.1f}"),
    ("landmarks; mean turn, deg", lambda of: f"{of['landmarks']}; {of['rotation_deg']:.1f}"),
    ("time to make it, s", lambda of: f"{of['seconds']:.2f}"),
)
