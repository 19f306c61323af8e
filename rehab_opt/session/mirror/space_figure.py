"""The motion in space: the healthy hand, the mirror, the hand that is led, the robot."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rehab_opt.session.drawing import MM, REFERENCE, framed, legend_below
from rehab_opt.session.mirror.outcome import BEFORE, MirrorOutcome

__all__ = ["space_figure"]

Array = NDArray[np.float64]

Style = Mapping[str, Any]


def space_figure(
    outcome: MirrorOutcome, styles: Mapping[str, Style], labels: Mapping[str, str], astar: Style
) -> Figure:
    """In the robot's frame; the robot stands as at the motion's end."""
    figure = framed(f"{outcome.title}\nThe healthy hand, its mirror image, and the hand that is led", 9.0, 8.0)
    axes = figure.add_subplot(projection="3d")
    healthy, asked = MM * outcome.recorded, MM * outcome.asked[:, :3, 3]
    axes.plot(*healthy.T, color="#CC79A7", linewidth=1.2, label="healthy hand")
    axes.plot(*asked.T, color=REFERENCE, linewidth=4.0, alpha=0.25, label="mirrored hand")
    drawn = [healthy, asked]
    for name, led in outcome.laws.items():
        if name == BEFORE:
            continue
        path = MM * led.tool[:, :3, 3]
        axes.plot(*path.T, **styles[name], label=labels[name])
        drawn.append(path)
    if outcome.astar is not None:
        axes.plot(*(MM * outcome.astar.positions).T, **astar, label="published A*")
    last = list(outcome.laws.values())[-1].q[-1]
    arm = MM * np.array(
        [np.array(ca.DM(frame[:3, 3])).ravel() for frame in outcome.chain.frames_expression(ca.SX(last))]
    )
    axes.plot(*arm.T, color="#555555", linewidth=3, marker="o", markersize=5, label="robot at the end")
    drawn.append(arm)
    points = np.concatenate(drawn)
    points = points[np.all(np.isfinite(points), axis=1)]
    low, high = points.min(axis=0), points.max(axis=0)
    _draw_mirror(axes, outcome, low, high)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_box_aspect(np.maximum(high - low, 1.0), zoom=1.1)
    axes.view_init(elev=24, azim=-125)
    axes.set_xlabel("x [mm]")
    axes.set_ylabel("y [mm]")
    axes.zaxis.set_rotate_label(False)
    axes.set_zlabel("z [mm]", rotation=90)
    legend_below(figure, axes, 4)
    return figure


def _draw_mirror(axes: Any, outcome: MirrorOutcome, low: Array, high: Array) -> None:
    """The part of the sagittal plane, which is upright, over the extent of everything else."""
    normal = np.array(outcome.mirror.normal) / np.linalg.norm(outcome.mirror.normal)
    along, point = np.array([-normal[1], normal[0], 0.0]), MM * np.array(outcome.mirror.point)
    corners = np.array([[x, y, 0.0] for x in (low[0], high[0]) for y in (low[1], high[1])])
    reach = (corners - point) @ along
    across = np.array([reach.min(), reach.max()])
    heights = np.array([low[2], high[2]])
    ground = point[None, :2] + across[:, None] * along[None, :2]
    axes.plot_surface(
        np.tile(ground[:, 0], (2, 1)), np.tile(ground[:, 1], (2, 1)), np.tile(heights[:, None], (1, 2)),
        color="#56B4E9", alpha=0.15, linewidth=0,
    )  # fmt: skip
    axes.plot([], [], color="#56B4E9", alpha=0.3, linewidth=8, label="mirror: sagittal plane")
