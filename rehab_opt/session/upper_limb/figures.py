"""Figures of a followed path: what was asked, what the arm did, where its limits are."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rehab_opt.session.drawing import ACROSS, FORWARD, GRID, MISSED, MM, REFERENCE, framed, legend_below
from rehab_opt.session.joint_figure import LAW_STYLES, joint_figure
from rehab_opt.session.upper_limb.outcome import ArmOutcome, LawResult

__all__ = ["arm_figures"]

Array = NDArray[np.float64]

SEEN = 1.0  # [mm] from which a height off the plane is worth a word


def arm_figures(outcome: ArmOutcome) -> dict[str, Figure]:
    """The figures of a run by file name (without suffix)."""
    joints = {f"{run.law} law": (run.q, LAW_STYLES[run.law]) for run in outcome.laws}
    return {"hand_path": _hand_path(outcome), "joints": joint_figure(outcome, joints), "error": _arm_error(outcome)}


def _hand_path(outcome: ArmOutcome) -> Figure:
    depth = -float(outcome.path[0, 2])
    where = f"{abs(depth):g} m {'below' if depth >= 0 else 'above'} the shoulder"
    figure = framed(f"{outcome.title}\nHand path seen from above, in the plane {where}", 7.5, 6.5)
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
    axes.set_xlabel(ACROSS)
    axes.set_ylabel(FORWARD)
    axes.grid(**GRID)
    legend_below(figure, axes, 2)
    return figure


def _off_plane(run: LawResult) -> str:
    """How far the hand leaves the plane that the figure shows."""
    height = MM * run.metrics["height_off_plane_max_m"]
    return f" (up to {height:.0f} mm off the plane)" if height >= SEEN else ""


def _arm_error(outcome: ArmOutcome) -> Figure:
    figure = framed(f"{outcome.title}\nHow far the hand is from the path, and the handle from the vertical", 9.0, 6.0)
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
        axes.grid(**GRID)
    top = max(1.0, 1.08 * max(float(MM * run.position_error.max()) for run in outcome.laws))
    distance.set_ylim(0, top)
    tilt.set_ylim(0, max(1.25 * limit, tilt.dataLim.y1 * 1.08))
    legend_below(figure, distance, 3)
    return figure


def _shade_missed(axes: Axes, time: Array, missed: NDArray[np.bool_]) -> None:
    edges = np.flatnonzero(np.diff(np.concatenate(([False], missed, [False])).astype(int)))
    half = (time[1] - time[0]) / 2
    for first, after in list(pairwise(edges))[::2]:
        axes.axvspan(time[first] - half, time[after - 1] + half, color=MISSED, alpha=0.3, linewidth=0, zorder=0)
