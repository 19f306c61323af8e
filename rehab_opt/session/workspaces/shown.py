"""Workspaces shown: a table, and figures as in Fig. 3 of Rossa et al., slices (b) and volumes (a)."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path

from rehab_opt.session.arm_keys import ArmInPlane
from rehab_opt.session.drawing import ACROSS, FORWARD, GRID, MM, REFERENCE, framed, legend_below
from rehab_opt.session.workspaces.reached import handle_words, plane_words
from rehab_opt.session.workspaces.run import WorkspaceOutcome, rings
from rehab_opt.workspace.region import Workspace

__all__ = [
    "SET_STYLES",
    "draw_region",
    "draw_shoulder",
    "figures",
    "is_placed",
    "region_label",
    "region_path",
    "seen_from_above",
]


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
    filled = {**style, "facecolor": to_rgba(style["facecolor"], 0.45)}
    axes.add_patch(PathPatch(region_path(workspace), linewidth=1.6, label=label or None, **filled))


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
    """Whether the robot's frame differs from the shoulder's."""
    return any(section.shoulder_m) or section.shoulder_turn_deg != 0


def region_label(name: str, workspace: Workspace) -> str:
    """Name and area for a legend, or why the set is empty."""
    said = f"{name}: empty, {workspace.reason}" if workspace.empty else f"{name}: {1e4 * workspace.area:.4g} cm$^2$"
    return "\n".join(textwrap.wrap(said.replace("_", " "), WRAPPED))


def figures(outcome: WorkspaceOutcome) -> dict[str, Figure]:
    """The figures by file name (without suffix)."""
    drawn = {"workspace": _slices(outcome)}
    if outcome.volumes:
        drawn["volume"] = _volumes(outcome)
    return drawn


def _slices(outcome: WorkspaceOutcome) -> Figure:
    where = f"Reachable workspace seen from above, in the plane {plane_words(outcome.section)};"
    figure = framed(f"{outcome.title}\n{where}\n{handle_words(outcome.section)}", 8.0, 7.5)
    axes = figure.add_subplot()
    order = sorted(outcome.sets, key=lambda name: -outcome.sets[name].workspace.area)
    styles = {name: SET_STYLES[i % len(SET_STYLES)] for i, name in enumerate(outcome.sets)}
    for name in order:  # the largest below the others
        workspace = outcome.sets[name].workspace
        draw_region(axes, workspace, styles[name], label=region_label(name, workspace))
    draw_shoulder(axes, outcome.section)
    seen_from_above(axes, outcome.section)
    return legend_below(figure, axes, 1 if any(of.workspace.empty for of in outcome.sets.values()) else 2)


def _volumes(outcome: WorkspaceOutcome) -> Figure:
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped]  # noqa: PLC0415  (slow to import, rarely drawn)

    held = sorted({upright for _, upright in outcome.volumes}, reverse=True)
    figure = framed(f"{outcome.title}\nReachable volume", 6.0 * len(held) + 1, 6.5)
    names = list(outcome.sets)
    sizes: dict[str, list[str]] = {name: [] for name in names}
    views = figure.subplots(1, len(held), subplot_kw={"projection": "3d"}, squeeze=False)[0]
    for axes, upright in zip(views, held, strict=True):
        corners = []
        for i, name in enumerate(names):
            volume = outcome.volumes[name, upright]
            words = "held" if upright else "free"
            sizes[name].append(f"{words} {1e3 * volume.volume:.3g} l" if not volume.empty else f"{words}: empty")
            if volume.empty:
                continue
            corners.append(MM * volume.vertices)
            mesh = Poly3DCollection(corners[-1][volume.triangles], alpha=0.25 if i == 0 else 0.6, shade=True,
                                    facecolors=SET_STYLES[i % len(SET_STYLES)]["facecolor"])  # fmt: skip
            axes.add_collection3d(mesh)
        x, y, z = MM * np.array(outcome.section.shoulder_m)
        axes.scatter([x], [y], [z], color="black", s=40)
        around = np.concatenate([*corners, [[x, y, z]]])
        low, high = around.min(axis=0), around.max(axis=0)
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
        axes.set_box_aspect(np.maximum(high - low, 1.0))
        axes.view_init(elev=18, azim=-60)
        axes.locator_params(nbins=5)
        axes.tick_params(axis="z", pad=12)  # clear of the ticks
        placed = is_placed(outcome.section)
        axes.set_xlabel("x of the robot [mm]" if placed else "right of the shoulder [mm]")
        axes.set_ylabel("y of the robot [mm]" if placed else "in front [mm]")
        axes.set_zlabel("z of the robot [mm]" if placed else "above [mm]", labelpad=20)
        axes.set_title(handle_words(outcome.section) if upright else "the handle free", fontsize=10)
    handles = [
        Patch(facecolor=SET_STYLES[i % len(SET_STYLES)]["facecolor"], label=f"{name} ({'; '.join(sizes[name])})")
        for i, name in enumerate(names)
    ]
    return legend_below(figure, handles, 2)
