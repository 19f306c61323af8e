"""A mirrored motion as a table for the terminal: a column for each law."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from rich.table import Table

from rehab_opt.session.mirror.outcome import MirrorOutcome
from rehab_opt.session.shown import (
    Cell,
    Numbers,
    Rows,
    counts,
    law_table,
    margin,
    millimetres,
    speed,
    spread,
    statuses,
    times,
)

__all__ = ["brief", "table"]


def table(outcome: MirrorOutcome) -> Table:
    """Rows of quantities with their units; A* is a path without times and without a robot that follows it."""
    return _table(outcome, (*FIRST_ROWS, *MORE_ROWS))


def brief(outcome: MirrorOutcome) -> Table:
    """The first of them."""
    return _table(outcome, FIRST_ROWS)


def _table(outcome: MirrorOutcome, rows: Rows) -> Table:
    numbers = outcome.metrics
    reference, astar = numbers["reference"], numbers["astar"]
    caption = (
        f"floor {outcome.floor:g} of the robot's largest manipulability; reference of {reference['duration_s']:.1f} s, "
        f"up to {reference['speed_max_m_s']:.2g} m/s, above the cap "
        f"{100 * reference['faster_than_cap_share_of_time']:.0f} % of the time; "
        f"filter lag {1e3 * reference['filter_lag_s']:.0f} ms"
    )
    laws = dict(numbers["laws"])
    if astar is not None:
        name = f"A*, {numbers['parameters']['astar']['resolution_mm']:g} mm"
        laws[name] = astar
        rows = tuple((label, _of_astar(label, value, astar)) for label, value in rows)
    return law_table(outcome.title, laws, rows, caption=caption)


def _of_astar(label: str, value: Cell, astar: Numbers) -> Cell:
    """The cell of a law, or of A*, which has few of them."""
    own = ASTAR_CELLS[label](astar) if label in ASTAR_CELLS else "-"
    return lambda of: own if of is astar else value(of)


def _passed(of: Numbers) -> str:
    return f"{100 * of['passed_share_of_time']:.0f}"


def _ends(of: Numbers) -> str:
    return f"{of['drive']['duration_s']:.1f}{'' if of['complete'] else ' INCOMPLETE'}"


def _law(of: Numbers) -> str:
    return f"{millimetres('deviation')(of)}; {of['duration_s']:.1f}"


def _seconds(of: Numbers, *causes: str) -> str:
    return " / ".join(f"{of['drive']['seconds_by_cause'][cause]:.1f}" for cause in causes)


def _kept_off(of: Numbers) -> str:
    short = {cause: of["drive"]["seconds_by_cause"][cause] for cause in SHORT}
    most = max(short, key=lambda cause: short[cause])
    return f"{_seconds(of, 'late', 'stopped')} / {sum(short.values()):.1f}" + (f", {most}" if short[most] else "")


def _acceleration(of: Numbers) -> str:
    return f"{of['joint_acceleration_max_share_of_limit']:.2f} ({of['joint_acceleration_above_limit_ticks']})"


def _ticks(of: Numbers) -> str:
    return times("tick")(of) if "tick_median_ms" in of else "-"


SHORT = ("person's arm", "floor", "keep-out", "robot's reach")
DISTANCE = "   distance to the reference mean / p95 / max, mm"
ASTAR_CELLS: Mapping[str, Callable[[Numbers], str]] = {
    "   least manipulability, share of largest": lambda of: f"{of['manipulability_min']:.4f}",
    DISTANCE: millimetres("deviation"),
    "   duration, s": lambda of: "no times" if of["complete"] else "no times, INCOMPLETE",
    "computing time, s": lambda of: f"{of['computing_s']:.3g}",
    "events": lambda of: f"{of['expanded']} expanded, {of['blocked']} blocked",
}
FIRST_ROWS: Rows = (
    ("reference passed by a drive, within 5 mm and 5 deg, %", lambda of: _passed(of["drive"])),
    (DISTANCE, lambda of: millimetres("deviation")(of["drive"])),
    ("   duration, s", _ends),
    ("   least manipulability, share of largest", lambda of: f"{of['drive']['manipulability_min']:.4f}"),
    ("time below the floor, %", lambda of: f"{100 * of['below_floor_share_of_time']:.1f}"),
    ("seconds late / stopped / short, most for", _kept_off),
    ("smallest joint-limit margin, deg", margin),
    ("ticks by status", statuses),
)
MORE_ROWS: Rows = (
    ("seconds followed / late / stopped", lambda of: _seconds(of, "followed", "late", "stopped")),
    ("seconds short for person's arm / floor / keep-out / reach", lambda of: _seconds(of, *SHORT)),
    (
        "lag mean / max / at the end, s",
        lambda of: " / ".join(f"{of['drive'][f'lag_{k}_s']:.2f}" for k in ("mean", "max", "at_end")),
    ),
    ("fastest tool, m/s", lambda of: f"{of['drive']['tool_speed_max_m_s']:.4f}"),
    ("reference passed by the law before a drive, %", _passed),
    ("   distance mean / p95 / max, mm; duration, s", _law),
    ("turn from the reference mean / p95 / max, deg", spread("turn", "deg")),
    ("reference held back, s", lambda of: f"{of['reference_held_back_s']:.2f}"),
    ("fastest joint, deg/s (share of limit)", speed),
    ("largest joint acceleration, share of limit (ticks above)", _acceleration),
    ("ticks in which something yielded", lambda of: counts(of["yielded"]) or "0"),
    ("events", lambda of: counts({key: n for key, n in of["counts"].items() if n}) or "none"),
    ("tick time median / p99 / max, ms", _ticks),
    ("computing time, s", lambda of: f"{of['computing_s']:.3g}"),
)
