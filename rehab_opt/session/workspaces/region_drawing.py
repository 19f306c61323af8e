"""Workspaces drawn from above: each with its own colour, line and hatching, and the shoulder they belong to."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import PathPatch
from matplotlib.path import Path

from rehab_opt.session.drawing import ACROSS, FORWARD, GRID, MM, REFERENCE
from rehab_opt.session.workspaces.run import rings
from rehab_opt.session.workspaces.sections import ArmInPlane
from rehab_opt.workspace.region import Workspace

__all__ = ["SET_STYLES", "draw_region", "draw_shoulder", "is_placed", "region_label", "region_path", "seen_from_above"]

SET_STYLES: Sequence[Mapping[str, Any]] = (
    {"facecolor": "#BBBBBB", "edgecolor": "#555555", "linestyle": "-"},
    {"facecolor": "#D55E00", "edgecolor": "#7A3600", "linestyle": "-", "hatch": "////"},
    {"facecolor": "#0072B2", "edgecolor": "#003F63", "linestyle": "--", "hatch": "\\\\\\\\"},
    {"facecolor": "#009E73", "edgecolor": "#00573F", "linestyle": "-.", "hatch": "...."},
    {"facecolor": "#E69F00", "edgecolor": "#7F5800", "linestyle": ":", "hatch": "xxxx"},
    {"facecolor": "#CC79A7", "edgecolor": "#75405E", "linestyle": "--", "hatch": "oo"},
    {"facecolor": "#F0E442", "edgecolor": "#786F00", "linestyle": "-.", "hatch": "++"},
    {"facecolor": "#56B4E9", "edgecolor": "#1F5F86", "linestyle": ":", "hatch": "||||"},
    {"facecolor": "#8B5A2B", "edgecolor": "#452D15", "linestyle": "-", "hatch": "----"},
    {"facecolor": "#5D3A9B", "edgecolor": "#2E1D4D", "linestyle": "--", "hatch": "**"},
    {"facecolor": "#E8C4B8", "edgecolor": "#8A5A4A", "linestyle": "-.", "hatch": "OO"},
    {"facecolor": "#333333", "edgecolor": "#000000", "linestyle": ":", "hatch": "xx"},
)
"""Of the sets in the order of the file, as many as may be compared."""
WRAPPED = 62  # characters of a legend's line
ARROW = 60  # [mm]


def draw_region(axes: Axes, workspace: Workspace, style: Mapping[str, Any], *, label: str = "") -> None:
    """A workspace as a translucent area; an empty one leaves its label in the legend alone."""
    patch = PathPatch(region_path(workspace), linewidth=1.6, label=label or None, **_translucent(style))
    axes.add_patch(patch)


def region_path(workspace: Workspace) -> Path:
    """The boundary [mm], holes left open; no vertices where the set is empty."""
    vertices: list[tuple[float, float]] = []
    codes: list[Any] = []
    for _, _, points in rings(workspace):
        vertices += [(MM * x, MM * y) for x, y in points]
        codes += [Path.MOVETO, *[Path.LINETO] * (len(points) - 2), Path.CLOSEPOLY]
    return Path(np.array(vertices).reshape(-1, 2), codes or None)


def draw_shoulder(axes: Axes, section: ArmInPlane) -> None:
    """The shoulder as a dot, and an arrow of 60 mm to where the participant looks; both are within the frame drawn."""
    x, y = MM * np.array(section.shoulder_m[:2])
    turn = math.radians(section.shoulder_turn_deg)
    ahead = (x - ARROW * math.sin(turn), y + ARROW * math.cos(turn))
    # Axes make no room for an annotation; where every set is empty the frame would be a tenth of a millimetre wide.
    axes.update_datalim([(x - ARROW, y - ARROW), (x + ARROW, y + ARROW)])
    axes.annotate("", ahead, (x, y), arrowprops={"arrowstyle": "-|>", "color": REFERENCE, "linewidth": 1.5})
    axes.plot(x, y, "o", color=REFERENCE, markersize=8, label=f"{section.side} shoulder; the arrow points forwards")


def seen_from_above(axes: Axes, section: ArmInPlane) -> None:
    """Equal scales in millimetres, labelled in the shoulder's frame or, where that is turned or moved, the robot's."""
    placed = is_placed(section)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x in the robot's frame [mm]" if placed else ACROSS)
    axes.set_ylabel("y in the robot's frame [mm]" if placed else FORWARD)
    axes.grid(**GRID)
    axes.autoscale_view()


def is_placed(section: ArmInPlane) -> bool:
    """Whether the robot's frame is another one than the shoulder's."""
    return any(section.shoulder_m) or section.shoulder_turn_deg != 0


def region_label(name: str, workspace: Workspace) -> str:
    """Name and area for a legend, or why the set is empty."""
    said = f"{name}: empty, {workspace.reason}" if workspace.empty else f"{name}: {1e4 * workspace.area:.4g} cm$^2$"
    return "\n".join(textwrap.wrap(said.replace("_", " "), WRAPPED))


def _translucent(style: Mapping[str, Any]) -> dict[str, Any]:
    red, green, blue = (int(style["facecolor"][k : k + 2], 16) / 255 for k in (1, 3, 5))
    return {**style, "facecolor": (red, green, blue, 0.45)}
