"""Figures of workspaces as in Fig. 3 of Rossa et al.: slices in a plane (b) and volumes (a)."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path

from rehab_opt.session.arm_keys import ArmInPlane
from rehab_opt.session.drawing import ACROSS, FORWARD, MM, NARROW, REFERENCE, framed, legend_below
from rehab_opt.session.outcome import Outcome
from rehab_opt.session.workspaces.reached import handle_words, plane_words, rings, sets_of
from rehab_opt.workspace.region import Workspace
from rehab_opt.workspace.volume import ReachableVolume

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
"""Styles of the sets in the order of the problem file; there are as many as a file may compare."""
WRAPPED = 62  # largest number of characters in a line of a legend
ARROW = 60  # length of the arrow at the shoulder [mm]


def draw_region(axes: Axes, workspace: Workspace, style: Mapping[str, Any], *, label: str = "") -> None:
    """Draw a workspace as a translucent area; an empty workspace appears only in the legend."""
    filled = {**style, "facecolor": to_rgba(style["facecolor"], 0.45)}
    axes.add_patch(PathPatch(region_path(workspace), label=label or None, **filled))


def region_path(workspace: Workspace) -> Path:
    """Boundary of a workspace [mm] with its holes; an empty workspace has no vertices."""
    vertices: list[tuple[float, float]] = []
    codes: list[Any] = []
    for _, _, points in rings(workspace):
        vertices += [(MM * x, MM * y) for x, y in points]
        codes += [Path.MOVETO, *[Path.LINETO] * (len(points) - 2), Path.CLOSEPOLY]
    return Path(np.array(vertices).reshape(-1, 2), codes or None)


def draw_shoulder(axes: Axes, section: ArmInPlane) -> None:
    """Draw the shoulder as a dot, with an arrow of 60 mm in the direction that the participant faces."""
    x, y = MM * np.array(section.shoulder_m[:2])
    turn = math.radians(section.shoulder_turn_deg)
    ahead = (x - ARROW * math.sin(turn), y + ARROW * math.cos(turn))
    # Annotations do not extend the axes' range; without this line, axes of empty sets would have almost no width.
    axes.update_datalim([(x - ARROW, y - ARROW), (x + ARROW, y + ARROW)])
    axes.annotate("", ahead, (x, y), arrowprops={"arrowstyle": "-|>", "color": REFERENCE, "linewidth": 1.2})
    axes.plot(x, y, "o", color=REFERENCE, label=f"{section.side} shoulder, arrow: forward")


def seen_from_above(axes: Axes, section: ArmInPlane) -> None:
    """Set equal scales and label the axes [mm]; labels name the robot's frame if it differs from the shoulder's."""
    placed = is_placed(section)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x of the robot [mm]" if placed else ACROSS)
    axes.set_ylabel("y of the robot [mm]" if placed else FORWARD)
    axes.autoscale_view()


def is_placed(section: ArmInPlane) -> bool:
    """Whether the robot's frame differs from the shoulder's frame."""
    return any(section.shoulder_m) or section.shoulder_turn_deg != 0


def region_label(name: str, workspace: Workspace) -> str:
    """Text for a legend: name and area of a set, or the reason why the set is empty."""
    area = np.format_float_positional(1e4 * workspace.area, precision=3, fractional=False, trim="-")
    size = f"empty, {workspace.reason}" if workspace.empty else f"{area} cm$^2$"
    return "\n".join(textwrap.wrap(f"{name}: {size}".replace("_", " "), WRAPPED))


def figures(outcome: Outcome) -> dict[str, Figure]:
    """Figures of a run by file name without suffix."""
    (scene,), (trace,) = outcome.scenes.values(), outcome.traces.values()
    drawn = {"workspace": _slices(scene.problem.arm, sets_of(trace))}
    if scene.held:
        names, sets = trace["_range"].tolist(), [of.tolist() for of in trace["_volume"].T]
        drawn["volume"] = _volumes(scene.problem.arm, names, dict(zip(scene.held, sets, strict=True)))
    return drawn


def _slices(section: ArmInPlane, sets: Mapping[str, Workspace]) -> Figure:
    figure = framed(
        f"Reachable workspace seen from above [mm], in the plane {plane_words(section)}; {handle_words(section)}. "
        f"n = {len(sets)} ranges of motion.",
        3.3,
        NARROW,
    )
    axes = figure.add_subplot()
    styles = dict(zip(sets, cycle(SET_STYLES), strict=False))
    for name, workspace in sorted(sets.items(), key=lambda of: -of[1].area):  # largest area first, below others
        draw_region(axes, workspace, styles[name], label=region_label(name, workspace))
    draw_shoulder(axes, section)
    seen_from_above(axes, section)
    return legend_below(figure)


def _volumes(section: ArmInPlane, names: Sequence[str], volumes: Mapping[bool, Sequence[ReachableVolume]]) -> Figure:
    """Figure with one view for the held handle (key True of `volumes`) and one for the free handle (key False)."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped]  # noqa: PLC0415  (slow to import, rarely drawn)

    figure = framed(f"Reachable volume [mm]. n = {len(names)} ranges of motion.", 3.6)
    colours = [SET_STYLES[i % len(SET_STYLES)]["facecolor"] for i in range(len(names))]
    views = figure.subplots(1, len(volumes), subplot_kw={"projection": "3d"}, squeeze=False)[0]
    for axes, (held, of) in zip(views, volumes.items(), strict=True):
        corners = [MM * np.array([section.shoulder_m])]
        for i, (volume, colour) in enumerate(zip(of, colours, strict=True)):
            if not volume.empty:
                corners.append(MM * volume.vertices)
                alpha = 0.25 if i == 0 else 0.6
                faces = corners[-1][volume.triangles]
                axes.add_collection3d(Poly3DCollection(faces, alpha=alpha, shade=True, facecolors=colour))
        axes.scatter(*corners[0].T, color=REFERENCE, s=12)
        around = np.concatenate(corners)
        low, high = around.min(axis=0), around.max(axis=0)
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
        axes.set_box_aspect(np.maximum(high - low, 1.0))
        axes.view_init(elev=18, azim=-60)
        axes.locator_params(nbins=5)
        axes.tick_params(axis="z", pad=12)  # so that numbers do not touch the ticks
        own = ("right of the shoulder [mm]", "in front [mm]", "above [mm]")
        labels = [f"{axis} of the robot [mm]" for axis in "xyz"] if is_placed(section) else own
        axes.set(xlabel=labels[0], ylabel=labels[1])
        axes.set_zlabel(labels[2], labelpad=20)
        axes.set_title(handle_words(section) if held else "the handle free")
    sizes = zip(*([_size(volume, held) for volume in of] for held, of in volumes.items()), strict=True)
    labels = [f"{name} ({'; '.join(said)})" for name, said in zip(names, sizes, strict=True)]
    patches = [Patch(facecolor=colour, label=label) for colour, label in zip(colours, labels, strict=True)]
    return legend_below(figure, patches)


def _size(volume: ReachableVolume, held: bool) -> str:
    words = "held" if held else "free"
    return f"{words}: empty" if volume.empty else f"{words} {1e3 * volume.volume:.3g} l"
