"""A followed pose shown: numbers as a table, what was asked and what the robot did as figures."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from rich.table import Table

from rehab_opt.session import shown
from rehab_opt.session.drawing import (
    GRID,
    LAW_STYLES,
    MM,
    REFERENCE,
    framed,
    joint_figure,
    label_times,
    legend_below,
    servo_figure,
)
from rehab_opt.session.pose_tracking.run import RobotOutcome

__all__ = ["brief", "figures", "table"]


def figures(outcome: RobotOutcome) -> dict[str, Figure]:
    """The figures of a run by file name (without suffix)."""
    drawn = {
        "tool_path": _tool_path(outcome),
        "joints": joint_figure(outcome, {TRACKER: (outcome.q, LAW_STYLES["optimised"])}),
        "error": _robot_error(outcome),
    }
    if outcome.motion is not None:
        drawn["servos"] = servo_figure(outcome.title, outcome.chain.names, outcome.motion)
    if outcome.near is not None:
        drawn["clearance"] = outcome.near.figure(outcome.title)
    return drawn


def _tool_path(outcome: RobotOutcome) -> Figure:
    figure = framed(f"{outcome.title}\nTool path seen from above, from the side and from behind", 11.0, 4.5)
    panels = figure.subplots(1, 3)
    for axes, (a, b), labels in zip(panels, ((0, 1), (0, 2), (1, 2)), ("xy", "xz", "yz"), strict=True):
        reference, tool = MM * outcome.reference, MM * outcome.tool
        axes.plot(reference[:, a], reference[:, b], color=REFERENCE, linewidth=4.5, alpha=0.25, label="reference path")
        axes.plot(tool[:, a], tool[:, b], **LAW_STYLES["optimised"], label="tool")
        axes.plot(reference[0, a], reference[0, b], "o", color=REFERENCE, markersize=6, label="start")
        axes.set(aspect="equal", adjustable="datalim", xlabel=f"{labels[0]} [mm]", ylabel=f"{labels[1]} [mm]")
        axes.grid(**GRID)
    return legend_below(figure, panels[0], 3)


def _robot_error(outcome: RobotOutcome) -> Figure:
    figure = framed(f"{outcome.title}\nTracking error, and how much of the joints' speed is used", 9.0, 7.0)
    distance, angle, speed = figure.subplots(3, 1, sharex=True)
    distance.plot(outcome.time, MM * outcome.position_error, **LAW_STYLES["optimised"], label=TRACKER)
    angle.plot(outcome.time, np.rad2deg(outcome.orientation_error), **LAW_STYLES["optimised"])
    used = 100 * (np.abs(outcome.command) / outcome.chain.velocity).max(axis=1)
    speed.plot(outcome.time, used, **LAW_STYLES["optimised"])
    speed.axhline(100, color=REFERENCE, linewidth=1, linestyle=":")
    speed.annotate("speed limit", (0.995, 100), xycoords=("axes fraction", "data"), ha="right", va="top", fontsize=9)
    labels = "position error [mm]", "orientation error [deg]", "fastest joint [% of limit]"
    label_times((distance, angle, speed), *labels, from_zero=True)
    return legend_below(figure, distance, 1)


TRACKER = "PoseTracker"
SHARE_SHOWN = 0.05  # [%] shares that differ by less look the same


def table(outcome: RobotOutcome) -> Table:
    """Rows of quantities with their units."""
    return shown.law_table(outcome.title, {TRACKER: outcome.metrics["optimised"]}, (*FIRST_ROWS, *MORE_ROWS))


def brief(outcome: RobotOutcome) -> Table:
    """The first of them."""
    return shown.law_table(outcome.title, {TRACKER: outcome.metrics["optimised"]}, FIRST_ROWS)


def _delivered(of: shown.Numbers) -> str:
    least, moving = 100 * of["scale_min"], of["scale_min_moving"]
    if moving is None or 100 * moving - least < SHARE_SHOWN:
        return f"{least:.1f}"
    return f"{100 * moving:.1f} ({least:.1f} below 1 mm/s)"


FIRST_ROWS: shown.Rows = (
    ("position error mean / p95 / max, mm", shown.millimetres("position_error")),
    ("orientation error mean / p95 / max, deg", shown.spread("orientation_error", "deg")),
    ("smallest joint-limit margin, deg", shown.margin),
    ("smallest fraction of the commanded motion delivered, %", _delivered),
    ("ticks by status", shown.statuses),
)
MORE_ROWS: shown.Rows = (
    ("parameters", lambda of: f"solver {of['parameters']['solver']}"),
    ("fastest joint, deg/s (share of limit)", shown.speed),
    ("tick time median / p99 / max, ms", shown.times("tick")),
    ("ticks in which something was relaxed", lambda of: shown.counts(of["relaxed"]) or "0"),
)
