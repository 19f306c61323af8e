"""Figures of a run, drawn to be read by a therapist: what was asked, what the arm did, where its limits are.

Colours are those of Okabe and Ito, told apart by all common kinds of colour vision; line styles differ as well. Nothing
here touches pyplot, so that no state is shared and no window is opened.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.session.outcome import ArmOutcome, LawResult, Outcome, RobotOutcome
from rehab_opt.session.table import TRACKER

__all__ = ["figures"]

Array = NDArray[np.float64]

REFERENCE, MISSED, LIMIT = "#000000", "#CC79A7", "#BBBBBB"
LAW_STYLES: Mapping[str, Mapping[str, Any]] = {
    "optimised": {"color": "#0072B2", "linestyle": "-", "linewidth": 2.0},
    "published": {"color": "#D55E00", "linestyle": "--", "linewidth": 1.5},
}
MM = 1e3
SEEN = 1.0  # [mm] from which a height off the plane is worth a word


def figures(outcome: Outcome) -> dict[str, Figure]:
    """The figures of a run by file name (without suffix)."""
    if isinstance(outcome, ArmOutcome):
        joints = {f"{run.law} law": (run.q, LAW_STYLES[run.law]) for run in outcome.laws}
        return {
            "hand_path": _hand_path(outcome),
            "joints": _joints(outcome, joints),
            "error": _arm_error(outcome),
        }
    if isinstance(outcome, RobotOutcome):
        return {
            "tool_path": _tool_path(outcome),
            "joints": _joints(outcome, {TRACKER: (outcome.q, LAW_STYLES["optimised"])}),
            "error": _robot_error(outcome),
        }
    raise TypeError(outcome)


def _figure(title: str, width: float, height: float) -> Figure:
    figure = Figure(figsize=(width, height), dpi=150, layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(title, fontsize=12)
    return figure


def _legend_below(figure: Figure, axes: Axes, columns: int) -> None:
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=columns, frameon=False, fontsize=9)


def _hand_path(outcome: ArmOutcome) -> Figure:
    depth = -float(outcome.path[0, 2])
    where = f"{abs(depth):g} m {'below' if depth >= 0 else 'above'} the shoulder"
    figure = _figure(f"{outcome.title}\nHand path seen from above, in the plane {where}", 7.5, 6.5)
    axes = figure.add_subplot()
    path = MM * outcome.path
    axes.plot(path[:, 0], path[:, 1], color=REFERENCE, linewidth=4.5, alpha=0.25, label="path asked for")
    axes.plot(*path[0, :2], "o", color=REFERENCE, markersize=6, label="start")
    if outcome.reachable is not None and not outcome.reachable.all():
        missed = path[~outcome.reachable]
        share = 100 * (1 - outcome.metrics["reachable_share_of_length"])
        label = f"out of this arm's reach ({share:.0f} % of the path)"
        axes.plot(missed[:, 0], missed[:, 1], "x", color=MISSED, markersize=5, label=label)
    for run in outcome.laws:
        label = f"hand, {run.law} law{_off_plane(run)}"
        axes.plot(MM * run.hand[:, 0], MM * run.hand[:, 1], **LAW_STYLES[run.law], label=label)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("left of the shoulder (negative) or right of it (positive) [mm]")
    axes.set_ylabel("in front of the shoulder [mm]")
    axes.grid(visible=True, color="#DDDDDD", linewidth=0.6)
    _legend_below(figure, axes, 2)
    return figure


def _off_plane(run: LawResult) -> str:
    """How far the hand leaves the plane that the figure shows."""
    height = MM * run.metrics["height_off_plane_max_m"]
    return f" (up to {height:.0f} mm off the plane)" if height >= SEEN else ""


def _joints(outcome: Outcome, joints: Mapping[str, tuple[Array, Mapping[str, Any]]]) -> Figure:
    chain = outcome.chain
    rows = math.ceil(chain.n / 2)
    figure = _figure(outcome.title, 9.0, 1.3 + 1.9 * rows)
    grid = np.atleast_1d(figure.subplots(rows, 2, sharex=True)).ravel()
    limits_seen = False
    for joint, axes in enumerate(grid[: chain.n]):
        for label, (q, style) in joints.items():
            axes.plot(outcome.time, np.rad2deg(q[:, joint]), **style, label=label)
        limits_seen |= _shade_limits(axes, chain, joint)
        axes.set_title(chain.names[joint].replace("_", " "), fontsize=9, loc="left")
        axes.set_ylabel("angle [deg]", fontsize=8)
        axes.tick_params(labelsize=8)
    for axes in grid[chain.n - 2 : chain.n]:
        axes.set_xlabel("time [s]", fontsize=9)
    for axes in grid[chain.n :]:
        axes.set_visible(False)
    what = (
        "Joint angles and the limits near them" if limits_seen else "Joint angles; all limits lie outside these panels"
    )
    figure.suptitle(f"{outcome.title}\n{what}", fontsize=12)
    if limits_seen:
        grid[0].plot([], [], color=LIMIT, linewidth=8, alpha=0.6, label="outside the joint's range")
    _legend_below(figure, grid[0], 4)
    return figure


def _shade_limits(axes: Axes, chain: SerialChain, joint: int) -> bool:
    """Grey where the joint may not be, and whether that is in the panel.

    Limits beyond half a turn are left out, so that the motion can be seen.
    """
    lower, upper = np.rad2deg(chain.lower[joint]), np.rad2deg(chain.upper[joint])
    low, high = axes.dataLim.intervaly
    for limit in (lower, upper):
        if abs(limit) < 180 or lower == upper:
            low, high = min(low, limit), max(high, limit)
    margin = max(0.12 * (high - low), 1.5)
    axes.set_ylim(low - margin, high + margin)
    for outside in ((-1e4, lower), (upper, 1e4)):
        axes.axhspan(*outside, color=LIMIT, alpha=0.6, linewidth=0, zorder=0)
    if chain.locked[joint]:
        axes.annotate("locked: a range of zero width", (0.98, 0.06), xycoords="axes fraction", ha="right", fontsize=7)
    return bool(lower > low - margin or upper < high + margin)


def _arm_error(outcome: ArmOutcome) -> Figure:
    figure = _figure(f"{outcome.title}\nHow far the hand is from the path, and the handle from the vertical", 9.0, 6.0)
    distance, tilt = figure.subplots(2, 1, sharex=True)
    for run in outcome.laws:
        distance.plot(outcome.time, MM * run.position_error, **LAW_STYLES[run.law], label=f"{run.law} law")
        tilt.plot(outcome.time, np.rad2deg(run.handle_tilt), **LAW_STYLES[run.law])
    limit = math.degrees(outcome.handle_tilt_limit)
    tilt.axhline(limit, color=REFERENCE, linewidth=1, linestyle=":")
    tilt.annotate(f"limit {limit:g} deg", (0.995, limit), xycoords=("axes fraction", "data"), ha="right", va="bottom")
    if outcome.reachable is not None and not outcome.reachable.all():
        for axes in (distance, tilt):
            _shade_missed(axes, outcome.time, ~outcome.reachable)
        distance.plot([], [], color=MISSED, linewidth=8, alpha=0.3, label="path out of this arm's reach")
    distance.set_ylabel("position error [mm]")
    tilt.set_ylabel("handle tilt [deg]")
    tilt.set_xlabel("time [s]")
    for axes in (distance, tilt):
        axes.set_ylim(bottom=0)
        axes.margins(x=0.01)
        axes.grid(visible=True, color="#DDDDDD", linewidth=0.6)
    top = max(1.0, 1.08 * max(float(MM * run.position_error.max()) for run in outcome.laws))
    distance.set_ylim(0, top)
    tilt.set_ylim(0, max(1.25 * limit, tilt.dataLim.y1 * 1.08))
    _legend_below(figure, distance, 3)
    return figure


def _shade_missed(axes: Axes, time: Array, missed: NDArray[np.bool_]) -> None:
    edges = np.flatnonzero(np.diff(np.concatenate(([False], missed, [False])).astype(int)))
    half = (time[1] - time[0]) / 2
    for first, after in list(pairwise(edges))[::2]:
        axes.axvspan(time[first] - half, time[after - 1] + half, color=MISSED, alpha=0.3, linewidth=0, zorder=0)


def _tool_path(outcome: RobotOutcome) -> Figure:
    figure = _figure(f"{outcome.title}\nTool path seen from above and from the side", 9.0, 5.5)
    above, side = figure.subplots(1, 2)
    for axes, (a, b), labels in ((above, (0, 1), ("x", "y")), (side, (0, 2), ("x", "z"))):
        reference, tool = MM * outcome.reference, MM * outcome.tool
        axes.plot(reference[:, a], reference[:, b], color=REFERENCE, linewidth=4.5, alpha=0.25, label="path asked for")
        axes.plot(tool[:, a], tool[:, b], **LAW_STYLES["optimised"], label="tool")
        axes.plot(reference[0, a], reference[0, b], "o", color=REFERENCE, markersize=6, label="start")
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_xlabel(f"{labels[0]} [mm]")
        axes.set_ylabel(f"{labels[1]} [mm]")
        axes.grid(visible=True, color="#DDDDDD", linewidth=0.6)
    _legend_below(figure, above, 3)
    return figure


def _robot_error(outcome: RobotOutcome) -> Figure:
    figure = _figure(f"{outcome.title}\nTracking error, and how much of the joints' speed is used", 9.0, 7.0)
    distance, angle, speed = figure.subplots(3, 1, sharex=True)
    distance.plot(outcome.time, MM * outcome.position_error, **LAW_STYLES["optimised"], label=TRACKER)
    angle.plot(outcome.time, np.rad2deg(outcome.orientation_error), **LAW_STYLES["optimised"])
    used = 100 * (np.abs(outcome.command) / outcome.chain.velocity).max(axis=1)
    speed.plot(outcome.time, used, **LAW_STYLES["optimised"])
    speed.axhline(100, color=REFERENCE, linewidth=1, linestyle=":")
    speed.annotate("speed limit", (0.995, 100), xycoords=("axes fraction", "data"), ha="right", va="top", fontsize=9)
    distance.set_ylabel("position error [mm]")
    angle.set_ylabel("orientation error [deg]")
    speed.set_ylabel("fastest joint [% of limit]")
    speed.set_xlabel("time [s]")
    for axes in (distance, angle, speed):
        axes.set_ylim(bottom=0)
        axes.margins(x=0.01)
        axes.grid(visible=True, color="#DDDDDD", linewidth=0.6)
    _legend_below(figure, distance, 1)
    return figure
