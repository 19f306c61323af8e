"""The force field drawn: gated as the mode says (Figs. 6 and 9), with its numbers changed (Fig. 4), along the path."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import shapely
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import Colormap, ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch

from rehab_opt.field.demonstration import Demonstration
from rehab_opt.field.potential import PotentialField
from rehab_opt.field.weights import energies_and_forces
from rehab_opt.measures.along_path import projected
from rehab_opt.session.drawing import GRID, MM, REFERENCE, framed, legend_below
from rehab_opt.session.outcome import Array
from rehab_opt.session.scenario.plane_drawing import (
    COMFORTABLE,
    LAW_COLOURS,
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
from rehab_opt.session.scenario.trials import Law, ScenarioTrials
from rehab_opt.session.workspaces.figures import region_path

__all__ = [
    "along_figure",
    "field_figure",
    "fields_along",
    "force_along",
    "gated_forces",
    "learnt_figure",
    "parameter_figure",
    "variants",
]


DARKEST = 0.75
"""Share of the map that is used."""


def force_colours() -> Colormap:
    """One hue from white on, so that it is read the same with every kind of colour vision, and in print."""
    whole = colormaps["Blues"]
    return ListedColormap([whole(DARKEST * i / 255) for i in range(256)])


FINE, COARSE = 161, 21
"""Points of the grid across the picture: of colours, of arrows."""


def field_figure(outcome: ScenarioTrials) -> Figure:
    """Colours say how large the desired force is, arrows its direction, for a hand at rest."""
    mapped = outcome.demonstrated is not None
    acts = "zero within $W_c$" if outcome.mode in THERAPY else "within $W_c$; outside there is only a pull back into it"
    leads = "to the nearest of them" if len(outcome.fields) > 1 else "there"
    box = shown_box(_corners(outcome, everything=False))
    height = 2.4 + (4.6 if mapped else 5.4) * np.clip((box[1][1] - box[1][0]) / (box[0][1] - box[0][0]), 0.5, 1.2)
    figure = framed(f"{outcome.title}\ndesired force: {acts}", 12.5 if mapped else 8.5, height)
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
    return legend_below(figure, axes, 4)


def gated_forces(outcome: ScenarioTrials, points: Array) -> Array:
    """(N, 2) [N] the desired force for a hand at rest at points (N, 2) [m], where the mode lets it act.

    NaN beyond W_r, where no hand comes, and outside W_c in "follow" and "hold", where there is only a pull back.
    """
    forces, inside = _forces(outcome, points), np.asarray(outcome.comfortable.contains(points))
    if outcome.mode not in THERAPY:
        return np.where(inside[:, None], forces, np.nan)
    there = np.asarray(outcome.reachable.contains(points)) | inside
    return np.where(there[:, None], _gate(outcome, points)[:, None] * forces, np.nan)


def _gate(outcome: ScenarioTrials, points: Array) -> Array:
    """(N,) share of a therapy's force at points (N, 2): 0 within W_c, 1 from the onset beyond it on."""
    distance = np.asarray(outcome.comfortable.distance(points))
    return np.clip(distance / outcome.onset, 0.0, 1.0) if outcome.onset > 0 else np.where(distance > 0, 1.0, 0.0)


def _forces(outcome: ScenarioTrials, points: Array) -> Array:
    """(N, 2) [N] of the spring to the path, or of the field whose end is nearest; everywhere."""
    fields = outcome.fields
    if outcome.spring is not None:
        path = shapely.LineString(fields[0].paths[0].points)
        places = shapely.line_interpolate_point(path, shapely.line_locate_point(path, shapely.points(points)))
        return np.asarray(outcome.spring * (shapely.get_coordinates(places) - points))
    ends = np.array([field.paths[0].points[-1] for field in fields])
    nearest = np.linalg.norm(points[:, None] - ends, axis=2).argmin(axis=1)
    forces = np.zeros_like(points)
    for i, field in enumerate(fields):
        if (nearest == i).any():
            forces[nearest == i] = field.force(points[nearest == i])
    return forces


def _draw_sizes(axes: Axes, outcome: ScenarioTrials, box: Box) -> None:
    """Colours, cut exactly where the force ends: along the edge of W_r, or of W_c."""
    x, y, points = grid_points(box, FINE)
    therapy, most = outcome.mode in THERAPY, outcome.force_limit
    size = np.minimum(np.linalg.norm(_forces(outcome, points), axis=1), most)
    size = (size * _gate(outcome, points) if therapy else size).reshape(len(y), len(x))
    mesh = axes.pcolormesh(MM * x, MM * y, size, cmap=force_colours(), vmin=0, vmax=most, shading="nearest", zorder=1.5)
    edge = region_path(outcome.reachable if therapy else outcome.comfortable)
    mesh.set_clip_path(edge, axes.transData)
    if therapy:  # no force within W_c: its colour again
        axes.add_patch(PathPatch(region_path(outcome.comfortable), facecolor="white", edgecolor="none", zorder=1.6))
        draw_workspace(axes, outcome, "comfortable", zorder=1.7)
    words = f"desired force [N], saturated at {most:g}"
    axes.figure.colorbar(mesh, ax=axes, shrink=0.8, label=words)


def _corners(outcome: ScenarioTrials, *, everything: bool) -> Array:
    """Points (N, 2) [m] that are to be seen."""
    spaces = (outcome.comfortable, outcome.reachable) if everything else (outcome.comfortable,)
    corners = [shapely.get_coordinates(space.polygon) for space in spaces]
    return np.vstack([outcome.reference, *corners])


LED, RECORDED, LEARNT = "#56B4E9", "#E69F00", "#0072B2"
ARROWS = 12
"""Along one movement."""
LONGEST = 1.2
"""[inches] An arrow of the largest force, however narrow the plane is drawn."""


def learnt_figure(outcome: ScenarioTrials) -> Figure:
    """Left the plane; right the forces over time, of the first movement held out, or the last where none was."""
    fit = outcome.fields[0].fit
    assert fit is not None
    number, kept = (fit.held_out[0], "held out") if fit.held_out else (len(outcome.shown) - 1, "learnt from")
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
    return legend_below(figure, [*plane.get_legend_handles_labels()[0], *panels[0].lines], 4)


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


PANEL_FINE, PANEL_COARSE = 91, 15
"""The same across a panel."""
NARROWER, STIFFER = 0.4, 2.0
SHOWN = 2.0
"""Of the scenario's force limit: what is larger has the darkest colour, far from the path a spring has no end."""
LEVELS = 12


class Variant(NamedTuple):
    """Numbers of a field, and what was changed from the one before."""

    changed: str
    width: float
    """[m]"""
    stiffness: float
    """[N/m]"""
    drag: float
    """[N/m]"""


def variants(outcome: ScenarioTrials) -> tuple[Variant, ...]:
    """(a) the scenario's own sigma and S without k1; then one number after the other is changed."""
    field = outcome.fields[0]
    width, stiffness = field.width, float(np.mean(field.samples.stiffness))
    drag = max(abs(field.drag), outcome.force_limit / (2 * field.length))  # pulls as strongly as allowed at the start
    return (
        Variant("as here, $k_1$ = 0", width, stiffness, 0.0),
        Variant(r"smaller $\sigma$", NARROWER * width, stiffness, 0.0),
        Variant("larger $S$", NARROWER * width, STIFFER * stiffness, 0.0),
        Variant("with $k_1$", NARROWER * width, STIFFER * stiffness, drag),
    )


def parameter_figure(outcome: ScenarioTrials) -> Figure:
    """Potential above, force below, one panel for each set of numbers; without gate and bound."""
    path, room = outcome.fields[0].paths[0].points, MM * outcome.fields[0].width
    (left, right), (low, high) = shown_box(path)
    left, right, low, high = left - room, right + room, low - room, high + room
    width = 3.2
    height = 2 * width * np.clip((high - low) / (right - left), 0.3, 1.6) + 2.2
    words = "the published field along this path, without gate and bound: what its numbers do"
    figure = framed(f"{outcome.title}\n{words}", 4 * width + 1.6, height)
    grid = figure.subplots(2, 4, sharex=True, sharey=True)
    box = (left, right), (low, high)
    x, y, points = grid_points(box, PANEL_FINE)
    most = SHOWN * outcome.force_limit
    for i, (of, column) in enumerate(zip(variants(outcome), grid.T, strict=True)):
        field = PotentialField(
            path, stiffness=of.stiffness, width=of.width, drag=of.drag, rest_on_target=False, compile=False
        )
        energies, forces = energies_and_forces(field.samples, field.width, points)
        energy, size = energies.reshape(len(y), len(x)), np.linalg.norm(forces, axis=1).reshape(len(y), len(x))
        energy = (energy - energy.min()) / max(float(np.ptp(energy)), 1e-12)
        contours = column[0].contourf(MM * x, MM * y, energy, levels=np.linspace(0, 1, LEVELS + 1), cmap="cividis")
        shown = column[1].pcolormesh(MM * x, MM * y, np.minimum(size, most), cmap=force_colours(), vmin=0, vmax=most)
        draw_arrows(column[1], box, field.force, count=PANEL_COARSE)
        column[0].set_title(
            f"({'abcd'[i]}) {of.changed}\n"
            rf"$\sigma$ = {MM * of.width:.3g} mm, $S$ = {of.stiffness:.4g} N/m, $k_1$ = {of.drag:.3g} N/m",
            fontsize=8.5,
            loc="left",
        )
        for axes, colour in zip(column, ("white", REFERENCE), strict=True):
            axes.plot(*(MM * path.T), "--", color=colour, linewidth=1.4, label="path")
            axes.plot(*(MM * path[-1]), "X", color=colour, markersize=8, markeredgecolor="#888888", label="target")
            axes.set(aspect="equal", xlim=box[0], ylim=box[1])
        column[1].set_xlabel("x [mm]")
    grid[0, 0].set_ylabel("y [mm]")
    grid[1, 0].set_ylabel("y [mm]")
    figure.colorbar(contours, ax=grid[0, :], label="potential, each panel\nfrom 0 to 1", shrink=0.8, ticks=[0, 0.5, 1])
    figure.colorbar(shown, ax=grid[1, :], label="force [N]", shrink=0.8, extend="max")
    return legend_below(figure, grid[1, 0], 2)


PLACES = 400
"""Along the path."""
BINS = 16
CURVES: Mapping[Law, tuple[str, str]] = {
    "assisted": ("ours ($k_1$ and travelled length)", "-"),
    "published": ("published ($k_1$ < 0, Eq. (21))", "--"),
}
MARKERS: Mapping[Law, str] = {"assisted": "o", "published": "s"}
ENOUGH = 20
"""Ticks that a bin needs."""


def along_figure(outcome: ScenarioTrials) -> Figure:
    """Below zero the force is against the motion; the target is at the right."""
    field = outcome.fields[0]
    figure = framed(f"{outcome.title}\nforce along the path towards the target: below 0 it resists", 10.0, 6.4)
    axes = figure.add_subplot()
    points, remaining = _places(field)
    inside = np.asarray(outcome.comfortable.contains(points))
    gates = {"assisted": _gate(outcome, points), "published": ~inside}
    without = fields_along(outcome, drags=False)
    for law, of in fields_along(outcome).items():
        whole = force_along(of, points)
        by_drag = whole - force_along(without[law], points)
        words, style = CURVES[law]
        for force, width, said in ((whole, 2.2, f"{words}, at rest"), (by_drag, 1.1, "of this, given by $k_1$")):
            axes.plot(MM * remaining, gates[law] * force, style, color=LAW_COLOURS[law], linewidth=width, label=said)
        if law in outcome.trials:
            _draw_trials(axes, outcome, law)
    axes.fill_between(
        MM * remaining, 0, 1, where=inside, transform=axes.get_xaxis_transform(), color=COMFORTABLE, alpha=0.2,
        linewidth=0, label="path within $W_c$: no force",
    )  # fmt: skip
    axes.axhline(0, color=REFERENCE, linewidth=0.8)
    axes.set_xlim(MM * remaining[0], -0.03 * MM * remaining[0])
    axes.axvline(0, color=REFERENCE, linewidth=1.2, linestyle=":", label="target")
    axes.set(xlabel="path that is left to the target [mm]", ylabel="force along the path, towards the target [N]")
    axes.grid(**GRID)
    return legend_below(figure, axes, 3)


def fields_along(outcome: ScenarioTrials, *, drags: bool = True) -> dict[Law, PotentialField]:
    """Our field, and the published one of the same |k1|, S and sigma: of the remaining length, with no rest on its end.

    With drags=False the same without k1: the difference is what Eq. (21) gives.
    """
    ours = outcome.fields[0]
    path, size = ours.paths[0].points, abs(ours.drag) if drags else 0.0
    numbers: dict[str, Any] = {"stiffness": ours.samples.stiffness[0], "width": ours.width, "compile": False}
    published = PotentialField(path, drag=-size, rest_on_target=False, **numbers)
    if drags:
        return {"assisted": ours, "published": published}
    return {"assisted": PotentialField(path, drag_along=ours.drag_along, **numbers), "published": published}


def force_along(field: PotentialField, points: Array) -> Array:
    """(N,) [N] the force at points (N, 2) of a path, along it."""
    tangent = np.gradient(points, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    return np.asarray((field.force(points) * tangent).sum(axis=1))


def _places(field: PotentialField) -> tuple[Array, Array]:
    """Points (N, 2) along the path and what is left of it (N,) [m]."""
    path = field.paths[0]
    travelled = np.linspace(0.0, path.travelled[-1], PLACES)
    points = np.column_stack([np.interp(travelled, path.travelled, path.points[:, axis]) for axis in (0, 1)])
    return points, travelled[-1] - travelled


def _draw_trials(axes: Axes, outcome: ScenarioTrials, law: Law) -> None:
    """The commanded force of all trials outside W_c: its median by what is left of the path."""
    marker = MARKERS[law]
    left, along = [], []
    for trial in outcome.trials[law]:
        where = projected(trial["_hand"], outcome.reference)
        outside = ~trial["inside"]
        left.append((where.length - where.along)[outside])
        along.append((trial["force_commanded"] * where.tangent).sum(axis=1)[outside])
    every, force = np.concatenate(left), np.concatenate(along)
    if not len(every):
        return
    edges = np.linspace(0.0, float(every.max()) + 1e-9, BINS + 1)
    which = np.digitize(every, edges) - 1
    for i in range(BINS):
        of = force[which == i]
        if len(of) >= ENOUGH:
            low, middle, high = np.percentile(of, (10, 50, 90))
            place = MM * (edges[i] + edges[i + 1]) / 2
            axes.plot([place, place], [low, high], color=LAW_COLOURS[law], linewidth=1.0, alpha=0.7)
            axes.plot(place, middle, marker, color=LAW_COLOURS[law], markersize=5)
    axes.plot(
        [], [], marker, linestyle="-", linewidth=1.0, color=LAW_COLOURS[law], markersize=5,
        label="in the trials, with damping\n(median, 10 to 90 %)",
    )  # fmt: skip
