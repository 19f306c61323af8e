"""A followed path shown: numbers as a table, what was asked and what the arm did as figures."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rehab_opt.session.drawing import (
    ACROSS,
    FORWARD,
    GRID,
    LAW_STYLES,
    MISSED,
    MM,
    REFERENCE,
    framed,
    joint_figure,
    label_times,
    legend_below,
)
from rehab_opt.session.outcome import Array
from rehab_opt.session.upper_limb.outcome import ArmOutcome, DrivenArm

__all__ = ["figures"]


SEEN = 1.0  # [mm] from which a height off the plane is worth a word


def figures(outcome: ArmOutcome) -> dict[str, Figure]:
    """The figures of a run by file name (without suffix)."""
    joints = {
        f"{law} law, driven": (drive.path.times, drive.path.positions, LAW_STYLES[law])
        for law, drive in _drives(outcome)
    }
    return {
        "hand_path": _hand_path(outcome),
        "joints": joint_figure(outcome.title, outcome.chain, joints),
        "error": _arm_error(outcome),
    }


def _drives(outcome: ArmOutcome) -> Iterator[tuple[str, DrivenArm]]:
    """Each law that was driven: the figures show what a drive would do."""
    for run in outcome.laws:
        if run.drive is not None:
            yield run.law, run.drive


def _hand_path(outcome: ArmOutcome) -> Figure:
    depth = -float(outcome.path[0, 2])
    where = f"{abs(depth):g} m {'below' if depth >= 0 else 'above'} the shoulder"
    figure = framed(f"{outcome.title}\nPath of the driven hand seen from above, in the plane {where}", 7.5, 6.5)
    axes = figure.add_subplot()
    path = MM * outcome.path
    axes.plot(path[:, 0], path[:, 1], color=REFERENCE, linewidth=4.5, alpha=0.25, label="reference path")
    axes.plot(*path[0, :2], "o", color=REFERENCE, markersize=6, label="start")
    if outcome.reachable is not None and not outcome.reachable.all():
        missed = path[~outcome.reachable]
        fraction = 100 * (1 - outcome.metrics["reachable_fraction_of_length"])
        label = f"out of this arm's reach ({fraction:.0f} % of the path)"
        axes.plot(missed[:, 0], missed[:, 1], "x", color=MISSED, markersize=5, label=label)
    for number, (first, last) in enumerate(outcome.gaps):
        bridge = path[(outcome.time >= first) & (outcome.time <= last)]
        label = "_" if number else f"no samples: {sum(b - a for a, b in outcome.gaps):.2g} s, bridged"
        axes.plot(bridge[:, 0], bridge[:, 1], color=MISSED, linewidth=9, alpha=0.3, zorder=1, label=label)
    for law, drive in _drives(outcome):
        label = f"hand, {law} law{_off_plane(outcome, law)}"
        axes.plot(MM * drive.hand[:, 0], MM * drive.hand[:, 1], **LAW_STYLES[law], label=label)
    axes.set(aspect="equal", adjustable="datalim", xlabel=ACROSS, ylabel=FORWARD)
    axes.grid(**GRID)
    return legend_below(figure, axes, 2)


def _off_plane(outcome: ArmOutcome, law: str) -> str:
    """How far the hand leaves the plane that the figure shows."""
    height = MM * outcome.metrics[law]["drive"]["height_off_plane_max_m"]
    return f" (up to {height:.0f} mm off the plane)" if height >= SEEN else ""


def _arm_error(outcome: ArmOutcome) -> Figure:
    what = "How far a driven hand is from the path, and the handle from the vertical"
    figure = framed(f"{outcome.title}\n{what}", 9.0, 7.0)
    distance, tilt, delay = figure.subplots(3, 1, sharex=True, height_ratios=(3, 3, 2))
    drives = tuple(_drives(outcome))
    for law, drive in drives:
        distance.plot(outcome.time, MM * drive.position_error, **LAW_STYLES[law], label=f"{law} law, driven")
        tilt.plot(outcome.time, np.rad2deg(drive.handle_tilt), **LAW_STYLES[law])
        delay.plot(outcome.time, drive.passes - outcome.time, **LAW_STYLES[law])
    limit = math.degrees(outcome.handle_tilt_limit)
    tilt.axhline(limit, color=REFERENCE, linewidth=1, linestyle=":")
    tilt.annotate(f"limit {limit:g} deg", (0.995, limit), xycoords=("axes fraction", "data"), ha="right", va="bottom")
    if outcome.reachable is not None and not outcome.reachable.all():
        for axes in (distance, tilt, delay):
            _shade_missed(axes, outcome.time, ~outcome.reachable)
        distance.plot([], [], color=MISSED, linewidth=8, alpha=0.3, label="path out of this arm's reach")
    for number, (first, last) in enumerate(outcome.gaps):
        label = "_" if number else f"no samples: {sum(b - a for a, b in outcome.gaps):.2g} s, bridged"
        for axes in (distance, tilt, delay):
            axes.axvspan(first, last, hatch="//", facecolor="none", edgecolor=REFERENCE, alpha=0.4, label=label)
    labels = "position error [mm]", "handle tilt [deg]", "later [s]"
    label_times((distance, tilt, delay), *labels, time="time of the recording [s]", from_zero=True)
    top = max(1.0, 1.08 * max(float(MM * drive.position_error.max()) for _, drive in drives))
    distance.set_ylim(0, top)
    tilt.set_ylim(0, max(1.25 * limit, tilt.dataLim.y1 * 1.08))
    return legend_below(figure, distance, 3)


def _shade_missed(axes: Axes, time: Array, missed: NDArray[np.bool_]) -> None:
    edges = np.flatnonzero(np.diff(np.concatenate(([False], missed, [False])).astype(int)))
    half = (time[1] - time[0]) / 2
    for first, after in list(pairwise(edges))[::2]:
        axes.axvspan(time[first] - half, time[after - 1] + half, color=MISSED, alpha=0.3, linewidth=0, zorder=0)
