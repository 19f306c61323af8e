"""What the figures of scenarios share: how controllers look, the plane with its workspaces, means over trials."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Literal

import numpy as np
import shapely
from matplotlib.axes import Axes

from rehab_opt.session.drawing import ACROSS, FORWARD, MM, OKABE_ITO, REFERENCE
from rehab_opt.session.outcome import Array
from rehab_opt.session.scenario.problem import REACHES
from rehab_opt.session.scenario.trials import Law, ScenarioTrials
from rehab_opt.session.trace import Trace
from rehab_opt.session.workspaces.figures import draw_region

__all__ = [
    "COMFORTABLE",
    "LAW_COLOURS",
    "LAW_NAMES",
    "Box",
    "draw_arrows",
    "draw_plane",
    "draw_reference",
    "draw_workspace",
    "frame_plane",
    "grid_points",
    "mean_over_trials",
    "seen_points",
    "shown_box",
]
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
REGION_STYLES: Mapping[str, Mapping[str, Any]] = {
    "reachable": {"facecolor": "#DDDDDD", "edgecolor": "#555555", "linestyle": "--"},
    "comfortable": {"facecolor": COMFORTABLE, "edgecolor": "#00573F", "linestyle": "-"},
}
NONE = 1e-3
"""[N] A smaller force counts as zero and has no direction."""
ROOM = 0.15
"""Fraction of what is drawn that is left free around it."""


def draw_plane(axes: Axes, outcome: ScenarioTrials, box: Box) -> None:
    """W_r below W_c, in the frame of `frame_plane`."""
    frame_plane(axes, outcome, box)
    draw_workspace(axes, outcome, "reachable", label="$W_r$, reachable with help")
    draw_workspace(axes, outcome, "comfortable", label="$W_c$, comfortable without help")


def frame_plane(axes: Axes, outcome: ScenarioTrials, box: Box) -> None:
    """Set equal scales within the limits, and labels with the frame."""
    placement = outcome.comfortable.placement
    placed = any(placement.position) or placement.turn != 0
    axes.set(xlim=box[0], ylim=box[1], aspect="equal")
    axes.set_xlabel("x of the robot [mm]" if placed else ACROSS)
    axes.set_ylabel("y of the robot [mm]" if placed else FORWARD)


def draw_workspace(
    axes: Axes,
    outcome: ScenarioTrials,
    which: Literal["reachable", "comfortable"],
    *,
    label: str = "",
    zorder: float = 1,
) -> None:
    """Draw one workspace in its colours."""
    draw_region(axes, getattr(outcome, which), {**REGION_STYLES[which], "zorder": zorder}, label=label)


def draw_reference(axes: Axes, outcome: ScenarioTrials, path: Array | None = None, *, label: str = "reference") -> None:
    """Draw the reference, or another path (N, 2) [m]: a line, with its end marked if it is a goal, or points."""
    points = MM * (outcome.reference if path is None else path)
    if outcome.mode != "hold":
        # Of a path that is gone along more than once the dashes would fill each other's gaps.
        style = "-" if outcome.mode == "follow" else "--"
        axes.plot(points[:, 0], points[:, 1], style, color=REFERENCE, label=label, zorder=4)
        if outcome.mode in REACHES:
            target: dict[str, Any] = {
                "color": REFERENCE,
                "markersize": 7,
                "markeredgecolor": "white",
                "label": "target",
            }
            axes.plot(*points[-1], "X", **target, zorder=6)
        return
    axes.plot(*points.T, "+", color=REFERENCE, markersize=7, markeredgewidth=1.5, label=label, zorder=6)
    for i, point in enumerate(points if path is None else ()):
        axes.annotate(str(i + 1), point, xytext=(5, 5), textcoords="offset points", zorder=6)


def grid_points(box: Box, count: int) -> tuple[Array, Array, Array]:
    """Values x (K,), y (L,) and points (L K, 2) [m] of a square grid with `count` points along the longer side."""
    (left, right), (low, high) = box
    step = max(right - left, high - low) / MM / count
    x, y = np.arange(left / MM + step / 2, right / MM, step), np.arange(low / MM + step / 2, high / MM, step)
    return x, y, np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def draw_arrows(axes: Axes, box: Box, forces: Callable[[Array], Array], *, count: int) -> None:
    """Draw directions of the forces (N, 2) [N] at the points (N, 2) [m] of a grid."""
    x, y, points = grid_points(box, count)
    of = forces(points).reshape(len(y), len(x), 2)
    size = np.linalg.norm(of, axis=2, keepdims=True)
    unit = np.where(size > NONE, of / np.maximum(size, NONE), np.nan)
    axes.quiver(
        MM * x, MM * y, unit[..., 0], unit[..., 1], pivot="mid", scale=1.3 * count, width=0.0035, color=REFERENCE,
        zorder=3,
    )  # fmt: skip


def seen_points(outcome: ScenarioTrials, hands: Iterable[Array]) -> Array:
    """Points (N, 2) [m] of the reference, of W_c and of the hands' paths, which a picture of trials must show."""
    return np.vstack([outcome.reference, shapely.get_coordinates(outcome.comfortable.polygon), *hands])


def shown_box(points: Array) -> Box:
    """Limits of x and y [mm] around points (N, 2) [m], with a margin."""
    low, high = MM * points.min(axis=0), MM * points.max(axis=0)
    room = ROOM * max(*(high - low), 1.0)
    return (low[0] - room, high[0] + room), (low[1] - room, high[1] + room)


def mean_over_trials(trials: Sequence[Trace], values: Sequence[Array]) -> tuple[Array, Array]:
    """(K,) [s] and the mean of `values`, (N,) or (N, 2) for each trial, over the running trials, while at least half
    run.
    """
    longest = max(trials, key=lambda trial: len(trial["t_s"]))["t_s"]
    under_way = sorted((len(trial["t_s"]) for trial in trials), reverse=True)[(len(trials) - 1) // 2]
    total: Array = np.zeros((under_way, *values[0].shape[1:]))
    count = np.zeros(under_way)
    for of in values:
        ongoing = of[:under_way]
        total[: len(ongoing)] += ongoing
        count[: len(ongoing)] += 1
    return longest[:under_way], (total.T / count).T
