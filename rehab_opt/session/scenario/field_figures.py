"""The force field on the plane, gated as the mode says (Figs. 6 and 9), and what it was learnt from."""

from __future__ import annotations

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import Colormap, ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from numpy.typing import NDArray

from rehab_opt.field.demonstration import Demonstration
from rehab_opt.session.drawing import GRID, MM, framed, legend_below
from rehab_opt.session.scenario.outcome import ScenarioOutcome
from rehab_opt.session.scenario.plane_drawing import (
    Box,
    draw_arrows,
    draw_reference,
    draw_workspace,
    draw_workspaces,
    grid_points,
    seen_box,
    shown_box,
)
from rehab_opt.session.scenario.problem import THERAPY
from rehab_opt.session.workspaces.shown import region_path

__all__ = ["field_figure", "force_colours", "gated_forces", "learnt_figure"]

Array = NDArray[np.float64]


DARKEST = 0.75
"""Share of the map that is used."""


def force_colours() -> Colormap:
    """One hue from white on, so that it is read the same with every kind of colour vision, and in print."""
    whole = colormaps["Blues"]
    return ListedColormap([whole(DARKEST * i / 255) for i in range(256)])


FINE, COARSE = 161, 21
"""Points of the grid across the picture: of colours, of arrows."""


def field_figure(outcome: ScenarioOutcome) -> Figure:
    """Colours say how large the wanted force is, arrows its direction, for a hand at rest."""
    mapped = outcome.demonstrated is not None
    acts = "none within $W_c$" if outcome.mode in THERAPY else "within $W_c$; outside there is only a pull back into it"
    leads = "to the nearest of them" if len(outcome.fields) > 1 else "there"
    box = shown_box(_corners(outcome, everything=False))
    height = 2.4 + (4.6 if mapped else 5.4) * np.clip((box[1][1] - box[1][0]) / (box[0][1] - box[0][0]), 0.5, 1.2)
    figure = framed(f"{outcome.title}\nforce that is wanted: {acts}", 12.5 if mapped else 8.5, height)
    panels = figure.subplots(1, 2 if mapped else 1, squeeze=False)[0]
    what = "points to be held" if outcome.mode == "hold" else "reference"
    if outcome.demonstrated is not None:
        draw_workspaces(panels[0], outcome)
        draw_reference(panels[0], outcome, outcome.demonstrated)
        seen_box(panels[0], outcome, shown_box(_corners(outcome, everything=True)))
        panels[0].set_title("as the helper gave it, in $W_r$", fontsize=10, loc="left")
        panels[1].set_title(f"mapped into $W_c$, with the force that leads {leads}", fontsize=10, loc="left")
    axes = panels[-1]
    draw_workspaces(axes, outcome)
    _draw_sizes(axes, outcome, box)
    draw_arrows(axes, box, lambda points: gated_forces(outcome, points), count=COARSE)
    draw_reference(axes, outcome, label=what)
    seen_box(axes, outcome, box)
    legend_below(figure, axes, 4)
    return figure


def gated_forces(outcome: ScenarioOutcome, points: Array) -> Array:
    """(N, 2) [N] the force that is wanted for a hand at rest at points (N, 2) [m], where the mode lets it act.

    NaN beyond W_r, where no hand comes, and outside W_c in "follow" and "hold", where there is only a pull back.
    """
    forces, inside = _forces(outcome, points), np.asarray(outcome.comfortable.contains(points))
    if outcome.mode not in THERAPY:
        return np.where(inside[:, None], forces, np.nan)
    there = np.asarray(outcome.reachable.contains(points)) | inside
    return np.where(there[:, None], np.where(inside[:, None], 0.0, forces), np.nan)


def _forces(outcome: ScenarioOutcome, points: Array) -> Array:
    """(N, 2) [N] of the field or, of several, the one whose end is nearest; everywhere."""
    fields = outcome.fields
    ends = np.array([field.paths[0].points[-1] for field in fields])
    nearest = np.linalg.norm(points[:, None] - ends, axis=2).argmin(axis=1)
    forces = np.zeros_like(points)
    for i, field in enumerate(fields):
        if (nearest == i).any():
            forces[nearest == i] = field.force(points[nearest == i])
    return forces


def _draw_sizes(axes: Axes, outcome: ScenarioOutcome, box: Box) -> None:
    """Colours, cut exactly where the force ends: along the edge of W_r, or of W_c."""
    x, y, points = grid_points(box, FINE)
    size = np.linalg.norm(_forces(outcome, points), axis=1).reshape(len(y), len(x))
    therapy, most = outcome.mode in THERAPY, outcome.force_limit
    mesh = axes.pcolormesh(
        MM * x, MM * y, np.minimum(size, most), cmap=force_colours(), vmin=0, vmax=most, shading="nearest", zorder=1.5
    )
    edge = region_path(outcome.reachable if therapy else outcome.comfortable)
    mesh.set_clip_path(edge, axes.transData)
    if therapy:  # no force within W_c: its colour again
        axes.add_patch(PathPatch(region_path(outcome.comfortable), facecolor="white", edgecolor="none", zorder=1.6))
        draw_workspace(axes, outcome, "comfortable", zorder=1.7)
    words = f"wanted force [N]; of more than {most:g} only {most:g} is given"
    axes.figure.colorbar(mesh, ax=axes, shrink=0.8, label=words)


def _corners(outcome: ScenarioOutcome, *, everything: bool) -> Array:
    """Points (N, 2) [m] that are to be seen."""
    import shapely  # noqa: PLC0415

    spaces = (outcome.comfortable, outcome.reachable) if everything else (outcome.comfortable,)
    corners = [shapely.get_coordinates(space.polygon) for space in spaces]
    return np.vstack([outcome.reference, *corners])


LED, RECORDED, LEARNT = "#56B4E9", "#E69F00", "#0072B2"
ARROWS = 12
"""Along one movement."""
LONGEST = 1.2
"""[inches] An arrow of the largest force, however narrow the plane is drawn."""


def learnt_figure(outcome: ScenarioOutcome) -> Figure:
    """Left the plane; right one movement over time, of those held out if there are any: forces along x and y."""
    number = most_telling(outcome)
    fit = outcome.fields[0].fit
    assert fit is not None
    kept = "held out" if number in fit.held_out else "learnt from"
    figure = framed(f"{outcome.title}\nwhat {len(outcome.shown)} demonstrations taught", 13.0, 6.4)
    plane, *panels = figure.subplot_mosaic([["plane", "x"], ["plane", "y"]], width_ratios=(1.2, 1)).values()
    draw_workspaces(plane, outcome)
    _draw_movements(plane, outcome.shown, largest=outcome.force_limit)
    draw_reference(plane, outcome, label="path of the field")
    seen_box(plane, outcome, shown_box(np.vstack([each.positions for each in outcome.shown])))
    shown = outcome.shown[number]
    time = np.arange(len(shown.positions)) if shown.times is None else shown.times
    field = np.asarray(outcome.fields[0].force(shown.positions, shown.velocities))
    for i, (axes, axis) in enumerate(zip(panels, "xy", strict=True)):
        axes.plot(time, shown.forces[:, i], color=RECORDED, linewidth=1.4, label="recorded force")
        axes.plot(time, field[:, i], "--", color=LEARNT, linewidth=1.8, label="force of the learnt field there")
        axes.set_ylabel(f"force along {axis} [N]")
        axes.grid(**GRID)
    panels[0].set_title(f"demonstration {number + 1}, {kept}", fontsize=10, loc="left")
    panels[1].set_xlabel("sample" if shown.times is None else "time [s]")
    plane.plot([], [], color=RECORDED, linewidth=1.4, label="recorded force")
    plane.plot([], [], "--", color=LEARNT, linewidth=1.8, label="force of the learnt field there")
    legend_below(figure, plane, 4)
    return figure


def most_telling(outcome: ScenarioOutcome) -> int:
    """The first demonstration that was held out; the last one where none was."""
    fit = outcome.fields[0].fit
    held = () if fit is None else fit.held_out
    return held[0] if held else len(outcome.shown) - 1


def _draw_movements(axes: Axes, shown: tuple[Demonstration, ...], *, largest: float) -> None:
    for i, each in enumerate(shown):
        label = "demonstrations" if i == 0 else ""
        axes.plot(*(MM * each.positions.T), color=LED, linewidth=1.0, label=label, zorder=3)
        at = np.unique(np.linspace(0, len(each.positions) - 1, ARROWS).astype(int))
        axes.quiver(
            *(MM * each.positions[at].T),
            *each.forces[at].T,
            color=RECORDED,
            angles="xy",
            units="inches",
            scale_units="inches",
            scale=largest / LONGEST,
            width=0.02,
            zorder=5,
        )
