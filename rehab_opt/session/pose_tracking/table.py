"""The result of a followed pose as a table for the terminal."""

from __future__ import annotations

from rich.table import Table
from rich.text import Text

from rehab_opt.session.cells import Numbers, Rows, counts, margin, millimetres, speed, spread, statuses, times
from rehab_opt.session.pose_tracking.outcome import RobotOutcome

__all__ = ["TRACKER", "robot_table"]

TRACKER = "PoseTracker"
SHARE_SHOWN = 0.05  # [%] shares that differ by less look the same


def robot_table(outcome: RobotOutcome) -> Table:
    """Rows of quantities with their units."""
    table = Table(title=Text(outcome.title))
    table.add_column("quantity")
    table.add_column(TRACKER, justify="right")
    for label, value in ROBOT_ROWS:
        table.add_row(label, value(outcome.metrics["optimised"]))
    return table


def _delivered(of: Numbers) -> str:
    least, moving = 100 * of["scale_min"], of["scale_min_moving"]
    if moving is None or 100 * moving - least < SHARE_SHOWN:
        return f"{least:.1f}"
    return f"{100 * moving:.1f} ({least:.1f} below 1 mm/s)"


ROBOT_ROWS: Rows = (
    ("parameters", lambda of: f"solver {of['parameters']['solver']}"),
    ("position error mean / p95 / max, mm", millimetres("position_error")),
    ("orientation error mean / p95 / max, deg", spread("orientation_error", "deg")),
    ("smallest joint-limit margin, deg", margin),
    ("fastest joint, deg/s (share of limit)", speed),
    ("least share of the asked motion delivered, %", _delivered),
    ("tick time median / p99 / max, ms", times("tick")),
    ("ticks by status", statuses),
    (
        "ticks in which something yielded",
        lambda of: counts(of["yielded"]) or "0",
    ),
)
