"""Figures of the force field: gated by the mode (Figs. 6 and 9), with other parameters (Fig. 4), and along the path."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import shapely
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import Colormap, ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch

from rehab_opt.field.demonstration import Demonstration
from rehab_opt.field.potential import PotentialField
from rehab_opt.measures.along_path import projected
from rehab_opt.session.drawing import (
    MM,
    NARROW,
    OKABE_ITO,
    REFERENCE,
    THIN,
    WIDE,
    framed,
    label_times,
    legend_below,
)
from rehab_opt.session.outcome import Array
from rehab_opt.session.scenario.plane_drawing import (
    COMFORTABLE,
    LAW_COLOURS,
    Box,
    draw_arrows,
    draw_plane,
    draw_reference,
    draw_workspace,
    frame_plane,
    grid_points,
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
"""Fraction of the map that is used."""


def force_colours() -> Colormap:
    """A colour map with one hue, starting at white, which reads the same with every kind of colour vision and in
    print.
    """
    whole = colormaps["Blues"]
    return ListedColormap([whole(DARKEST * i / 255) for i in range(256)])


FINE, COARSE = 161, 21
"""Grid points across the picture, for colours and for arrows."""


def field_figure(outcome: ScenarioTrials) -> Figure:
    """Magnitude (colour) and direction (arrows) of the desired force on a hand at rest."""
    mapped = outcome.demonstrated is not None
    acts = "zero within $W_c$" if outcome.mode in THERAPY else "within $W_c$; outside there is only a pull back into it"
    nearest = "It is the spring to the path's nearest point; a run pulls to the point of its progress. "
    spring = "" if outcome.spring is None else nearest
    box = shown_box(_corners(outcome, everything=False))
    height = 0.8 + 2.7 * np.clip((box[1][1] - box[1][0]) / (box[0][1] - box[0][0]), 0.5, 1.2)
    figure = framed(
        f"Desired force [N] on a hand at rest (colour: its size, at most {outcome.force_limit:g} N; arrows: its "
        f"direction), {acts}. Colours end with the workspace where the force may act. {spring}Positions in mm.",
        height,
        WIDE if mapped else NARROW,
    )
    panels = figure.subplots(1, 2 if mapped else 1, squeeze=False)[0]
    what = "points to be held" if outcome.mode == "hold" else "reference"
    if outcome.demonstrated is not None:
        draw_plane(panels[0], outcome, shown_box(_corners(outcome, everything=True)))
        draw_reference(panels[0], outcome, outcome.demonstrated)
        panels[0].set_title("(a) as the helper gave it, in $W_r$")
        panels[1].set_title("(b) mapped into $W_c$, with the desired force")
    axes = panels[-1]
    frame_plane(axes, outcome, box)
    draw_workspace(axes, outcome, "comfortable", label="$W_c$, comfortable without help")
    _draw_sizes(axes, outcome, box)
    draw_arrows(axes, box, lambda points: gated_forces(outcome, points), count=COARSE)
    draw_reference(axes, outcome, label=what)
    return legend_below(figure)


def gated_forces(outcome: ScenarioTrials, points: Array) -> Array:
    """(N, 2) [N] desired force on a hand at rest at points (N, 2) [m], with the mode's gate.

    NaN beyond W_r, where no hand can be, and outside W_c in "follow" and "hold", where only the pull back acts.
    """
    forces, inside = _forces(outcome, points), np.asarray(outcome.comfortable.contains(points))
    if outcome.mode not in THERAPY:
        return np.where(inside[:, None], forces, np.nan)
    there = np.asarray(outcome.reachable.contains(points)) | inside
    return np.where(there[:, None], _gate(outcome, points)[:, None] * forces, np.nan)


def _gate(outcome: ScenarioTrials, points: Array) -> Array:
    """(N,) fraction of a therapy's force at points (N, 2): 0 within W_c, 1 from the onset beyond it on."""
    distance = np.asarray(outcome.comfortable.distance(points))
    return np.clip(distance / outcome.onset, 0.0, 1.0) if outcome.onset > 0 else np.where(distance > 0, 1.0, 0.0)


def _forces(outcome: ScenarioTrials, points: Array) -> Array:
    """(N, 2) [N] force of the spring to the path, or of the field with the nearest target, without a gate."""
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
    """Draw the colours, clipped exactly at the edge of W_r or W_c."""
    x, y, points = grid_points(box, FINE)
    therapy, most = outcome.mode in THERAPY, outcome.force_limit
    size = np.minimum(np.linalg.norm(_forces(outcome, points), axis=1), most)
    size = (size * _gate(outcome, points) if therapy else size).reshape(len(y), len(x))
    mesh = axes.pcolormesh(
        MM * x, MM * y, size, cmap=force_colours(), vmin=0, vmax=most, shading="nearest", zorder=1.5, rasterized=True
    )
    edge = region_path(outcome.reachable if therapy else outcome.comfortable)
    mesh.set_clip_path(edge, axes.transData)
    if therapy:  # no force within W_c: its colour again
        axes.add_patch(PathPatch(region_path(outcome.comfortable), facecolor="white", edgecolor="none", zorder=1.6))
        draw_workspace(axes, outcome, "comfortable", zorder=1.7)
    axes.figure.colorbar(mesh, ax=axes, shrink=0.8, label=f"desired force [N], at most {most:g}")


def _corners(outcome: ScenarioTrials, *, everything: bool) -> Array:
    """Points (N, 2) [m] that must be visible."""
    spaces = (outcome.comfortable, outcome.reachable) if everything else (outcome.comfortable,)
    corners = [shapely.get_coordinates(space.polygon) for space in spaces]
    return np.vstack([outcome.reference, *corners])


LED, RECORDED, LEARNT = OKABE_ITO[5], OKABE_ITO[4], OKABE_ITO[0]
ARROWS = 12
"""Number of arrows along a movement."""
LONGEST = 0.7
"""[inches] Length of the arrow of the largest force, for any width of the plane."""


def learnt_figure(outcome: ScenarioTrials) -> Figure:
    """Left the plane; right the forces over time of the first held-out movement, or else of the last one."""
    fit = outcome.fields[0].fit
    assert fit is not None
    number, kept = (fit.held_out[0], "held out") if fit.held_out else (len(outcome.shown) - 1, "learnt from")
    figure = framed(
        f"The field learnt from n = {len(outcome.shown)} demonstrations: (a) their paths [mm] and recorded forces; "
        f"(b) the forces of demonstration {number + 1}, which was {kept}, and those of the learnt field there.",
        3.4,
    )
    plane, *panels = figure.subplot_mosaic([["plane", "x"], ["plane", "y"]], width_ratios=(1.2, 1)).values()
    draw_plane(plane, outcome, shown_box(np.vstack([each.positions for each in outcome.shown])))
    _draw_movements(plane, outcome.shown, largest=outcome.force_limit)
    draw_reference(plane, outcome, label="path of the field")
    shown = outcome.shown[number]
    time = np.arange(len(shown.positions)) if shown.times is None else shown.times
    field = np.asarray(outcome.fields[0].force(shown.positions, shown.velocities))
    for i, axes in enumerate(panels):
        axes.plot(time, shown.forces[:, i], color=RECORDED, label="recorded force")
        axes.plot(time, field[:, i], "--", color=LEARNT, label="force of the learnt field there")
    plane.set_title("(a)")
    panels[0].set_title(f"(b) demonstration {number + 1}, {kept}")
    label_times(panels, *(f"force {axis} [N]" for axis in "xy"), time="sample" if shown.times is None else "time [s]")
    return legend_below(figure)


def _draw_movements(axes: Axes, shown: tuple[Demonstration, ...], *, largest: float) -> None:
    for i, each in enumerate(shown):
        label = "demonstrations" if i == 0 else ""
        axes.plot(*(MM * each.positions.T), color=LED, label=label, zorder=3)
        at = np.unique(np.linspace(0, len(each.positions) - 1, ARROWS).astype(int))
        axes.quiver(
            *(MM * each.positions[at].T),
            *each.forces[at].T,
            color=RECORDED,
            angles="xy",
            units="inches",
            scale_units="inches",
            scale=largest / LONGEST,
            width=0.012,
            zorder=5,
        )


NARROWER, STIFFER = 0.4, 2.0
LEAST = 0.5
"""[N] to either side, so that a straight path shows no rounding."""
TO_THE_LEFT = np.array([[0.0, 1.0], [-1.0, 0.0]])
"""Turns a row vector by a quarter."""


def variants(outcome: ScenarioTrials) -> dict[str, dict[str, Any]]:
    """The scenario's own sigma and S without k1, then one number after the other is changed; by label."""
    field = outcome.fields[0]
    width, stiffness = field.width, float(np.mean(field.samples.stiffness))
    narrow, stiff = NARROWER * width, STIFFER * stiffness
    drag = max(abs(field.drag), outcome.force_limit / (2 * field.length))  # pulls as strongly as allowed at the start
    own = rf"$\sigma$ = {MM * width:.3g} mm, $S$ = {stiffness:.4g} N/m, $k_1$ = 0"
    changed = {
        own: {"width": width, "stiffness": stiffness, "drag": 0.0},
        rf"$\sigma$ = {MM * narrow:.3g} mm": {"width": narrow, "stiffness": stiffness, "drag": 0.0},
        f"and $S$ = {stiff:.4g} N/m": {"width": narrow, "stiffness": stiff, "drag": 0.0},
    }
    if outcome.mode != "follow":  # whose path may cross itself: no energy falls along it
        changed[f"and $k_1$ = {drag:.3g} N/m"] = {"width": narrow, "stiffness": stiff, "drag": drag}
    return changed


def parameter_figure(outcome: ScenarioTrials) -> Figure:
    """What each number of the field does: S across the path, sigma where it bends, k1 along it."""
    field = outcome.fields[0]
    path, (points, remaining) = field.paths[0].points, _places(field)
    off = field.width * np.linspace(-1.0, 1.0, PLACES)
    middle, tangent = points[PLACES // 3], _tangents(points)[PLACES // 3]
    normal, normals = tangent @ TO_THE_LEFT, _tangents(points) @ TO_THE_LEFT
    figure = framed(
        "What the numbers of the published field do, one after the other, for a hand at rest, without gate and bound: "
        "(a) $S$ is the stiffness across the path, here after a third of it; (b) on the path itself a large $\\sigma$ "
        "pulls across it, where it bends; (c) $k_1$ pulls along the path to the target.",
        2.8,
    )
    across, bends, along = figure.subplots(1, 3)
    for i, (label, numbers) in enumerate(variants(outcome).items()):
        varied = PotentialField(path, **numbers, rest_on_target=False, compile=False)
        force = np.asarray(varied.force(points))
        style = {"color": OKABE_ITO[i], "linestyle": ("-", "--", "-.", ":")[i]}
        across.plot(MM * off, varied.force(middle + off[:, None] * normal) @ normal, **style, label=label)
        bends.plot(MM * remaining, (force * normals).sum(axis=1), **style)
        along.plot(MM * remaining, (force * _tangents(points)).sum(axis=1), **style)
    across.set(title="(a) across", xlabel="to the left of the path [mm]", ylabel="force [N]")
    bends.set(title="(b) across, on the path", xlabel="path left to the target [mm]")
    along.set(title="(c) along, on the path", xlabel="path left to the target [mm]")
    for axes in (bends, along):
        axes.invert_xaxis()
        axes.set_ylim(min(axes.get_ylim()[0], -LEAST), max(axes.get_ylim()[1], LEAST))
    return legend_below(figure)


PLACES = 400
"""Number of points along the path."""
BINS = 16
CURVES: Mapping[Law, tuple[str, str]] = {
    "assisted": ("ours ($k_1$ and travelled length)", "-"),
    "published": ("published ($k_1$ < 0, Eq. (21))", "--"),
}
MARKERS: Mapping[Law, str] = {"assisted": "o", "published": "s"}
ENOUGH = 20
"""Least number of ticks in a bin."""


def along_figure(outcome: ScenarioTrials) -> Figure:
    """Force along the path, negative against the motion; the target is at the right."""
    field = outcome.fields[0]
    figure = framed(
        "Force along the path towards the target; below 0 it resists. Lines: the fields at rest, and what of them is "
        f"due to $k_1$; markers: median and 10 to 90 % of the commanded force in the trials, with damping. "
        f"n = {max(map(len, outcome.trials.values()))} trials with each controller.",
        3.8,
    )
    axes = figure.add_subplot()
    points, remaining = _places(field)
    inside = np.asarray(outcome.comfortable.contains(points))
    gates = {"assisted": _gate(outcome, points), "published": ~inside}
    without = fields_along(outcome, drags=False)
    for law, of in fields_along(outcome).items():
        whole = force_along(of, points)
        by_drag = whole - force_along(without[law], points)
        words, style = CURVES[law]
        for force, width, label in ((whole, 1.2, f"{words}, at rest"), (by_drag, THIN, "of this, due to $k_1$")):
            axes.plot(MM * remaining, gates[law] * force, style, color=LAW_COLOURS[law], linewidth=width, label=label)
        if law in outcome.trials:
            _draw_trials(axes, outcome, law)
    axes.fill_between(
        MM * remaining, 0, 1, where=inside, transform=axes.get_xaxis_transform(), color=COMFORTABLE, alpha=0.2,
        linewidth=0, label="path within $W_c$: no force",
    )  # fmt: skip
    axes.axhline(0, color=REFERENCE, linewidth=THIN)
    axes.set_xlim(MM * remaining[0], -0.03 * MM * remaining[0])
    axes.axvline(0, color=REFERENCE, linestyle=":", label="target")
    axes.set(xlabel="path that is left to the target [mm]", ylabel="force along the path, towards the target [N]")
    return legend_below(figure)


def fields_along(outcome: ScenarioTrials, *, drags: bool = True) -> dict[Law, PotentialField]:
    """Our field, and the published one with the same |k1|, S and sigma, with the remaining length and without
    continuation.

    With drags=False both without k1: the difference is due to Eq. (21).
    """
    ours = outcome.fields[0]
    path, size = ours.paths[0].points, abs(ours.drag) if drags else 0.0
    numbers: dict[str, Any] = {"stiffness": ours.samples.stiffness[0], "width": ours.width, "compile": False}
    published = PotentialField(path, drag=-size, rest_on_target=False, **numbers)
    if drags:
        return {"assisted": ours, "published": published}
    return {"assisted": PotentialField(path, drag_along=ours.drag_along, **numbers), "published": published}


def force_along(field: PotentialField, points: Array) -> Array:
    """(N,) [N] component of the force along the path at its points (N, 2)."""
    return np.asarray((field.force(points) * _tangents(points)).sum(axis=1))


def _tangents(points: Array) -> Array:
    """(N, 2) unit tangents of a path (N, 2)."""
    tangent = np.gradient(points, axis=0)
    return np.asarray(tangent / np.linalg.norm(tangent, axis=1, keepdims=True))


def _places(field: PotentialField) -> tuple[Array, Array]:
    """Points (N, 2) along the path, and the remaining path length (N,) [m]."""
    path = field.paths[0]
    travelled = np.linspace(0.0, path.travelled[-1], PLACES)
    points = np.column_stack([np.interp(travelled, path.travelled, path.points[:, axis]) for axis in (0, 1)])
    return points, travelled[-1] - travelled


def _draw_trials(axes: Axes, outcome: ScenarioTrials, law: Law) -> None:
    """Draw the median commanded force of all trials outside W_c over the remaining path length."""
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
            axes.plot([place, place], [low, high], color=LAW_COLOURS[law], linewidth=THIN)
            axes.plot(place, middle, marker, color=LAW_COLOURS[law])
    style: dict[str, Any] = {"linestyle": "-", "linewidth": THIN, "color": LAW_COLOURS[law]}
    axes.plot([], [], marker, **style, label="in the trials, with damping (median, 10 to 90 %)")
