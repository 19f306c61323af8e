"""Figures of the force field: gated by the mode (Figs. 6 and 9), learnt, and along the path."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import shapely
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch

from rehab_opt.field.potential import PotentialField
from rehab_opt.measures.along_path import projected
from rehab_opt.session.drawing import MM, NARROW, OKABE_ITO, REFERENCE, THIN, WIDE, framed, label_times, legend_below
from rehab_opt.session.outcome import Array
from rehab_opt.session.scenario.plane_drawing import (
    COMFORTABLE,
    COMFORTABLE_STYLE,
    LAW_COLOURS,
    Box,
    box_around,
    count_words,
    draw_plane,
    draw_reference,
    shown_box,
)
from rehab_opt.session.scenario.precomputed import Precomputed
from rehab_opt.session.scenario.problem import THERAPY
from rehab_opt.session.scenario.scene import ScenarioTrials
from rehab_opt.session.scenario.trials import Law
from rehab_opt.session.workspaces.figures import draw_region, region_path

DARKEST = 0.75
"""Fraction of the colour map that is used; it has a single hue, for every kind of colour vision."""
FINE, COARSE = 161, 21
"""Grid points across the picture, for colours and for arrows."""
NONE = 1e-3
"""[N] A smaller force counts as zero and has no direction."""


def field_figure(context: Precomputed) -> Figure:
    """Figure of the desired force on a hand at rest: magnitude (colour) and direction (arrows)."""
    mapped, most = context.demonstrated is not None, context.problem.assistance.force_limit_N
    acts = "zero within $W_c$" if context.mode in THERAPY else "within $W_c$; outside there is only a pull back into it"
    nearest = "It is the spring to the path's nearest point; a run pulls to the point of its progress. "
    box = shown_box(context)
    height = 0.8 + 2.7 * np.clip((box[1][1] - box[1][0]) / (box[0][1] - box[0][0]), 0.5, 1.2)
    figure = framed(
        f"Desired force [N] on a hand at rest (colour: its size, at most {most:g} N; arrows: its direction), {acts}. "
        f"Colours end with the workspace where the force may act. {nearest if context.follows_path else ''}"
        "Positions in mm.",
        height,
        WIDE if mapped else NARROW,
    )
    panels = figure.subplots(1, 2 if mapped else 1, squeeze=False)[0]
    if context.demonstrated is not None:
        draw_plane(panels[0], context, shown_box(context, shapely.get_coordinates(context.reachable.polygon)))
        draw_reference(panels[0], context, context.demonstrated)
        panels[0].set_title("(a) as the helper gave it, in $W_r$")
        panels[1].set_title("(b) mapped into $W_c$, with the desired force")
    axes = panels[-1]
    draw_plane(axes, context, box, reachable=False)
    _draw_sizes(axes, context, box)
    x, y, points = grid_points(box, COARSE)
    force = gated_forces(context, points).reshape(len(y), len(x), 2)
    size = np.linalg.norm(force, axis=2, keepdims=True)
    unit = np.where(size > NONE, force / np.maximum(size, NONE), np.nan)
    axes.quiver(
        MM * x, MM * y, unit[..., 0], unit[..., 1], pivot="mid", scale=1.3 * COARSE, width=0.0035, color=REFERENCE,
        zorder=3,
    )  # fmt: skip
    draw_reference(axes, context, label="points to be held" if context.mode == "hold" else "reference")
    return legend_below(figure)


def grid_points(box: Box, count: int) -> tuple[Array, Array, Array]:
    """Values x (K,), y (L,) and points (L K, 2) [m] of a square grid with `count` points along the longer side."""
    (left, right), (low, high) = box
    step = max(right - left, high - low) / MM / count
    x, y = np.arange(left / MM + step / 2, right / MM, step), np.arange(low / MM + step / 2, high / MM, step)
    points: Array = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    return np.asarray(x), np.asarray(y), points


def gated_forces(context: Precomputed, points: Array) -> Array:
    """Desired force (N, 2) [N], including the mode's gate, on a hand at rest at `points` (N, 2) [m].

    The force is NaN outside W_r. In "follow" and "hold" it is NaN outside W_c, too, where only a pull into W_c acts.
    """
    forces, there = _forces(context, points), np.asarray(context.comfortable.contains(points))
    if context.mode in THERAPY:
        there |= np.asarray(context.reachable.contains(points))
    return np.where(there[:, None], _gate(context, points)[:, None] * forces, np.nan)


def _gate(context: Precomputed, points: Array) -> Array:
    """Factor (N,) of the force at `points` (N, 2) [m]; in therapy it rises from 0 in W_c to 1 at the onset distance."""
    if context.mode not in THERAPY:
        return np.ones(len(points))
    distance, onset = np.asarray(context.comfortable.distance(points)), 1e-3 * context.problem.assistance.onset_mm
    return np.clip(distance / onset, 0.0, 1.0) if onset > 0 else np.where(distance > 0, 1.0, 0.0)


def _forces(context: Precomputed, points: Array) -> Array:
    """Force (N, 2) [N] at `points` (N, 2) [m] before the gate."""
    fields = context.fields
    if context.follows_path:
        path = shapely.LineString(fields[0].paths[0].points)
        places = shapely.line_interpolate_point(path, shapely.line_locate_point(path, shapely.points(points)))
        return np.asarray(context.numbers["stiffness"] * (shapely.get_coordinates(places) - points))
    ends = np.array([field.paths[0].points[-1] for field in fields])
    nearest = np.linalg.norm(points[:, None] - ends, axis=2).argmin(axis=1)
    forces = np.zeros_like(points)
    for i in np.unique(nearest):
        forces[nearest == i] = fields[i].force(points[nearest == i])
    return forces


def _draw_sizes(axes: Axes, context: Precomputed, box: Box) -> None:
    """Draw the magnitude of the force in colour, clipped at the edge of W_r or W_c."""
    x, y, points = grid_points(box, FINE)
    therapy, most = context.mode in THERAPY, context.problem.assistance.force_limit_N
    size = _gate(context, points) * np.minimum(np.linalg.norm(_forces(context, points), axis=1), most)
    colours = ListedColormap([colormaps["Blues"](DARKEST * i / 255) for i in range(256)])
    style: dict[str, Any] = {"shading": "nearest", "zorder": 1.5, "rasterized": True}
    mesh = axes.pcolormesh(MM * x, MM * y, size.reshape(len(y), len(x)), cmap=colours, vmin=0, vmax=most, **style)
    mesh.set_clip_path(region_path(context.reachable if therapy else context.comfortable), axes.transData)
    if therapy:  # no force within W_c: cover the colours there
        axes.add_patch(PathPatch(region_path(context.comfortable), facecolor="white", edgecolor="none", zorder=1.6))
        draw_region(axes, context.comfortable, {**COMFORTABLE_STYLE, "zorder": 1.7})
    axes.figure.colorbar(mesh, ax=axes, shrink=0.8, label=f"desired force [N], at most {most:g}")


LED, RECORDED, LEARNT = OKABE_ITO[5], OKABE_ITO[4], OKABE_ITO[0]
ARROWS = 12
"""Number of arrows along a movement."""
LONGEST = 0.7
"""[inches] Length of an arrow for the largest allowed force."""


def learnt_figure(context: Precomputed) -> Figure:
    """Figure with the plane and the forces of one demonstration: the first held-out one, or the last if none is."""
    fit, every = context.fields[0].fit, context.shown
    assert fit is not None
    number, kept = (fit.held_out[0], "held out") if fit.held_out else (len(every) - 1, "learnt from")
    figure = framed(
        f"The field learnt from n = {len(every)} demonstrations: (a) their paths [mm] and recorded forces; "
        f"(b) the forces of demonstration {number + 1}, which was {kept}, and those of the learnt field there.",
        3.4,
    )
    plane, *panels = figure.subplot_mosaic([["plane", "x"], ["plane", "y"]], width_ratios=(1.2, 1)).values()
    draw_plane(plane, context, box_around(MM * np.vstack([each.positions for each in every])))
    scale = context.problem.assistance.force_limit_N / LONGEST
    style: dict[str, Any] = {"angles": "xy", "units": "inches", "scale_units": "inches", "width": 0.012, "zorder": 5}
    for i, each in enumerate(every):
        plane.plot(*(MM * each.positions.T), color=LED, label="" if i else "demonstrations", zorder=3)
        at = np.unique(np.linspace(0, len(each.positions) - 1, ARROWS).astype(int))
        plane.quiver(*(MM * each.positions[at].T), *each.forces[at].T, color=RECORDED, scale=scale, **style)
    draw_reference(plane, context, label="path of the field")
    shown = every[number]
    time = np.arange(len(shown.positions)) if shown.times is None else shown.times
    field = np.asarray(context.fields[0].force(shown.positions, shown.velocities))
    for i, axes in enumerate(panels):
        axes.plot(time, shown.forces[:, i], color=RECORDED, label="recorded force")
        axes.plot(time, field[:, i], "--", color=LEARNT, label="force of the learnt field there")
    plane.set_title("(a)")
    panels[0].set_title(f"(b) demonstration {number + 1}, {kept}")
    label_times(panels, *(f"force {axis} [N]" for axis in "xy"), time="sample" if shown.times is None else "time [s]")
    return legend_below(figure)


PLACES = 400
"""Number of points along the path."""
CURVES: Mapping[Law, tuple[str, str]] = {
    "assisted": ("ours ($k_1$ and travelled length), at rest", "-"),
    "published": ("published ($k_1$ < 0, Eq. (21)), at rest", "--"),
}


def along_figure(of: ScenarioTrials) -> Figure:
    """Figure of the force component along the path, negative if it resists; the target is at the right."""
    figure = framed(
        "Force along the path towards the target; below 0 it resists. The fields at rest, and thin the commanded force "
        f"of every trial outside $W_c$, with damping. {count_words(of)}",
        3.8,
    )
    axes, context, field = figure.add_subplot(), of.context, of.context.fields[0]
    path = field.paths[0]
    travelled = np.linspace(0.0, path.travelled[-1], PLACES)
    points = np.column_stack([np.interp(travelled, path.travelled, path.points[:, axis]) for axis in (0, 1)])
    tangents, left = np.gradient(points, axis=0), MM * (travelled[-1] - travelled)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    inside = np.asarray(context.comfortable.contains(points))
    published = PotentialField(path.points, drag=-field.drag, rest_on_target=False, compile=False, **context.numbers)
    gated = (field, _gate(context, points)), (published, ~inside)
    for (law, (label, style)), (whole, gate) in zip(CURVES.items(), gated, strict=True):
        along = gate * (whole.force(points) * tangents).sum(axis=1)
        axes.plot(left, along, style, color=LAW_COLOURS[law], label=label)
        for i, trial in enumerate(of.trials.get(law, ())):
            where = projected(trial["_hand"], context.reference)
            force = np.where(trial["inside"], np.nan, (trial["force_commanded"] * where.tangent).sum(axis=1))
            thin: dict[str, Any] = {
                "color": LAW_COLOURS[law],
                "linewidth": THIN,
                "label": None if i else "in each trial, with damping",
            }
            axes.plot(MM * (where.length - where.along)[trial.rows], force[trial.rows], style, **thin)
    axes.fill_between(
        left, 0, 1, where=inside, transform=axes.get_xaxis_transform(), color=COMFORTABLE, alpha=0.2, linewidth=0,
        label="path within $W_c$: no force",
    )  # fmt: skip
    axes.axhline(0, color=REFERENCE, linewidth=THIN)
    axes.set_xlim(left[0], -0.03 * left[0])
    axes.axvline(0, color=REFERENCE, linestyle=":", label="target")
    axes.set(xlabel="path that is left to the target [mm]", ylabel="force along the path, towards the target [N]")
    return legend_below(figure)
