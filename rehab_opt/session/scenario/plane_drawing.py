"""Parts that the figures of scenarios share: styles of controllers, plane with workspaces, means over trials."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import shapely
from matplotlib.axes import Axes

from rehab_opt.session.drawing import ACROSS, FORWARD, MM, OKABE_ITO, REFERENCE, THIN
from rehab_opt.session.outcome import Array
from rehab_opt.session.scenario.precomputed import Precomputed
from rehab_opt.session.scenario.problem import REACHES
from rehab_opt.session.scenario.scene import ScenarioTrials
from rehab_opt.session.scenario.trials import Law
from rehab_opt.session.trace import Trace
from rehab_opt.session.workspaces.figures import draw_region

Box = tuple[tuple[float, float], tuple[float, float]]
"""[mm] Limits of x and of y."""
LAW_COLOURS: Mapping[Law, str] = {
    "unassisted": "#555555",
    "assisted": OKABE_ITO[0],
    "published": OKABE_ITO[1],
    "together": OKABE_ITO[0],
    "delayed": OKABE_ITO[3],
}
LAW_NAMES: Mapping[Law, str] = {
    "unassisted": "unassisted",
    "assisted": "assisted (ours)",
    "published": "published controller",
    "together": "with a helper",
    "delayed": "delayed helper",
}
COMFORTABLE = OKABE_ITO[2]
REACHABLE_STYLE = {"facecolor": "#DDDDDD", "edgecolor": "#555555", "linestyle": "--", "zorder": 1}
COMFORTABLE_STYLE = {"facecolor": COMFORTABLE, "edgecolor": "#00573F", "linestyle": "-", "zorder": 1}
FORCE_LIMIT: Mapping[str, Any] = {"color": REFERENCE, "linewidth": THIN, "linestyle": "--", "label": "force limit"}
ROOM = 0.15
"""Margin around the points in a picture, as a fraction of their extent."""


def draw_plane(axes: Axes, context: Precomputed, box: Box, *, reachable: bool = True) -> None:
    """Draw W_r, and W_c on top, with equal scales and the axis limits `box`; the axis labels name the frame."""
    placement = context.comfortable.placement
    placed = any(placement.position) or placement.turn != 0
    axes.set(xlim=box[0], ylim=box[1], aspect="equal")
    axes.set_xlabel("x of the robot [mm]" if placed else ACROSS)
    axes.set_ylabel("y of the robot [mm]" if placed else FORWARD)
    if reachable:
        draw_region(axes, context.reachable, REACHABLE_STYLE, label="$W_r$, reachable with help")
    draw_region(axes, context.comfortable, COMFORTABLE_STYLE, label="$W_c$, comfortable without help")


def draw_reference(axes: Axes, context: Precomputed, path: Array | None = None, *, label: str = "reference") -> None:
    """Draw the reference, or another path (N, 2) [m]: points to hold, or a line whose end is marked if it is a goal."""
    points = MM * (context.reference if path is None else path)
    if context.mode == "hold":
        axes.plot(*points.T, "+", color=REFERENCE, markersize=7, markeredgewidth=1.5, label=label, zorder=6)
        for i, point in enumerate(points if path is None else ()):
            axes.annotate(str(i + 1), point, xytext=(5, 5), textcoords="offset points", zorder=6)
        return
    # On a path that is followed more than once, dashes would fill each other's gaps.
    style = "-" if context.mode == "follow" else "--"
    axes.plot(points[:, 0], points[:, 1], style, color=REFERENCE, label=label, zorder=4)
    if context.mode in REACHES:
        target: dict[str, Any] = {"color": REFERENCE, "markersize": 7, "markeredgecolor": "white", "label": "target"}
        axes.plot(*points[-1], "X", **target, zorder=6)


def shown_box(context: Precomputed, *more: Array) -> Box:
    """Limits of x and y [mm] around the reference, W_c and more points (N, 2) [m], with a margin."""
    points = MM * np.vstack([context.reference, shapely.get_coordinates(context.comfortable.polygon), *more])
    return box_around(points)


def box_around(points: Array) -> Box:
    """Limits of x and y around points (N, 2) [mm], with a margin."""
    low, high = points.min(axis=0), points.max(axis=0)
    room = ROOM * max(*(high - low), 1.0)
    return (low[0] - room, high[0] + room), (low[1] - room, high[1] + room)


def count_words(of: ScenarioTrials) -> str:
    """Text with the number of trials."""
    return f"n = {max(map(len, of.trials.values()))} trials with each controller, of a simulated person."


def mean_over_trials(trials: Sequence[Trace], values: Iterable[Array]) -> tuple[Array, Array]:
    """Two results: times (K,) [s], and the mean over the trials that still run, as long as at least half of them do.

    `values` has an array (N,) or (N, 2) for each trial.
    """
    lengths = sorted((len(trial["t_s"]) for trial in trials), reverse=True)
    under_way = lengths[(len(trials) - 1) // 2]
    longest = max(trials, key=lambda trial: len(trial["t_s"]))["t_s"][:under_way]
    total, count = np.zeros(1), np.zeros(under_way)
    for of in values:
        short = under_way - len(of[:under_way])
        total = np.pad(of[:under_way], [(0, short), (0, 0)][: of.ndim]) + total
        count[: under_way - short] += 1
    return longest, (total.T / count).T
