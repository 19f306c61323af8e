"""The force field on the plane, gated as the mode says: Figs. 6 and 9."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rehab_opt.field.potential import PotentialField
from rehab_opt.session.drawing import MM, framed, legend_below
from rehab_opt.session.scenario.force_colours import force_colours
from rehab_opt.session.scenario.measures import REACHES
from rehab_opt.session.scenario.outcome import ScenarioOutcome
from rehab_opt.session.scenario.plane_drawing import draw_reference, draw_workspaces, seen_box, shown_box

__all__ = ["draw_forces", "field_figure", "gated_forces"]

Array = NDArray[np.float64]
Box = tuple[tuple[float, float], tuple[float, float]]

FINE, COARSE = 161, 21
"""Points of the grid across the picture: of colours, of arrows."""
NONE = 1e-3
"""[N] less is no force and has no direction."""


def field_figure(outcome: ScenarioOutcome) -> Figure:
    """Colours say how large the wanted force is, arrows its direction, for a hand at rest."""
    mapped = outcome.demonstrated is not None
    acts = "zero within $W_c$" if outcome.mode in REACHES else "within $W_c$ alone"
    of = "; at each place that of the nearest point" if len(outcome.fields) > 1 else ""
    figure = framed(f"{outcome.title}\nforce field ({acts}{of})", 12.5 if mapped else 8.5, 7.0)
    panels = figure.subplots(1, 2, squeeze=False)[0] if mapped else figure.subplots(1, 1, squeeze=False)[0]
    if outcome.demonstrated is not None:
        draw_workspaces(panels[0], outcome)
        draw_reference(panels[0], outcome, outcome.demonstrated)
        seen_box(panels[0], outcome, shown_box(_corners(outcome, everything=True)))
        panels[0].set_title("as the helper showed it, in $W_r$", fontsize=10, loc="left")
        panels[1].set_title("mapped into $W_c$, with the force that leads there", fontsize=10, loc="left")
    axes = panels[-1]
    box = shown_box(_corners(outcome, everything=False))
    draw_workspaces(axes, outcome)
    draw_forces(axes, *_sampled(outcome, box, FINE), most=outcome.force_limit, figure=figure)
    _draw_arrows(axes, *_sampled(outcome, box, COARSE))
    draw_reference(axes, outcome, label="point to be held" if outcome.mode == "hold" else "reference")
    seen_box(axes, outcome, box)
    legend_below(figure, axes, 4)
    return figure


def gated_forces(outcome: ScenarioOutcome, points: Array) -> Array:
    """(N, 2) [N] the force that is wanted for a hand at rest at points (N, 2) [m], where the mode lets it act.

    Beyond W_r, where no hand comes, and outside W_c in "follow" and "hold", where there is only a pull back, NaN.
    """
    fields = outcome.fields
    if len(fields) == 1:
        forces = np.asarray(fields[0].force(points))
    else:
        targets = np.array([_end(field) for field in fields])
        nearest = np.linalg.norm(points[:, None] - targets, axis=2).argmin(axis=1)
        forces = np.zeros_like(points)
        for i, field in enumerate(fields):
            if (nearest == i).any():
                forces[nearest == i] = field.force(points[nearest == i])
    inside = np.asarray(outcome.comfortable.contains(points))
    if outcome.mode not in REACHES:
        return np.where(inside[:, None], forces, np.nan)
    there = np.asarray(outcome.reachable.contains(points)) | inside
    return np.where(there[:, None], np.where(inside[:, None], 0.0, forces), np.nan)


def draw_forces(axes: Axes, x: Array, y: Array, forces: Array, *, most: float, figure: Figure) -> None:
    """Sizes [N] of forces (K, K, 2) at x, y (K,) [m] as colours up to `most`; nothing where there is no force."""
    size = np.linalg.norm(forces, axis=2)
    shown = np.ma.masked_where(~(size > NONE), np.minimum(size, most))
    mesh = axes.pcolormesh(
        MM * x, MM * y, shown, cmap=force_colours(), vmin=0, vmax=most, shading="nearest", zorder=1.5, rasterized=True
    )
    figure.colorbar(mesh, ax=axes, shrink=0.8, label=f"wanted force [N]; where it is larger, {most:g} is given")


def _sampled(outcome: ScenarioOutcome, box: Box, count: int) -> tuple[Array, Array, Array]:
    (left, right), (low, high) = box
    step = max(right - left, high - low) / MM / count
    x, y = np.arange(left / MM + step / 2, right / MM, step), np.arange(low / MM + step / 2, high / MM, step)
    points = np.stack(np.meshgrid(x, y), axis=-1)
    return x, y, gated_forces(outcome, points.reshape(-1, 2)).reshape(points.shape)


def _draw_arrows(axes: Axes, x: Array, y: Array, forces: Array) -> None:
    size = np.linalg.norm(forces, axis=2, keepdims=True)
    unit = np.where(size > NONE, forces / np.maximum(size, NONE), np.nan)
    axes.quiver(
        MM * x,
        MM * y,
        unit[..., 0],
        unit[..., 1],
        pivot="mid",
        scale=1.3 * COARSE,
        width=0.0035,
        color="black",
        zorder=3,
    )


def _end(field: PotentialField) -> Array:
    """(2,) [m]"""
    end: Array = field.paths[0].points[-1]
    return end


def _corners(outcome: ScenarioOutcome, *, everything: bool) -> Array:
    """Points (N, 2) [m] that are to be seen."""
    import shapely  # noqa: PLC0415

    spaces = (outcome.comfortable, outcome.reachable) if everything else (outcome.comfortable,)
    corners = [shapely.get_coordinates(space.polygon) for space in spaces]
    return np.vstack([outcome.reference, *corners])
