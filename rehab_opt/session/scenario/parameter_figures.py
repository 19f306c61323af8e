"""What sigma, S and k1 do to the published field (Fig. 4), and where on the path it resists."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rehab_opt.field.potential import PotentialField
from rehab_opt.field.weights import energies_and_forces
from rehab_opt.measures.along_path import projected
from rehab_opt.session.drawing import GRID, MM, REFERENCE, framed, legend_below
from rehab_opt.session.scenario.field_figures import force_colours
from rehab_opt.session.scenario.outcome import Law, ScenarioOutcome
from rehab_opt.session.scenario.plane_drawing import COMFORTABLE, LAW_COLOURS, draw_arrows, grid_points, shown_box

__all__ = ["along_figure", "fields_along", "force_along", "parameter_figure", "variants"]

Array = NDArray[np.float64]


FINE, COARSE = 91, 15
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


def variants(outcome: ScenarioOutcome) -> tuple[Variant, ...]:
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


def parameter_figure(outcome: ScenarioOutcome) -> Figure:
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
    x, y, points = grid_points(box, FINE)
    fields = [
        PotentialField(
            path, stiffness=of.stiffness, width=of.width, drag=of.drag, rest_on_target=False, compile=False
        )
        for of in variants(outcome)
    ]  # fmt: skip
    most = SHOWN * outcome.force_limit
    for i, (of, field, column) in enumerate(zip(variants(outcome), fields, grid.T, strict=True)):
        energies, forces = energies_and_forces(field.samples, field.width, points)
        energy, size = energies.reshape(len(y), len(x)), np.linalg.norm(forces, axis=1).reshape(len(y), len(x))
        energy = (energy - energy.min()) / max(float(np.ptp(energy)), 1e-12)
        contours = column[0].contourf(MM * x, MM * y, energy, levels=np.linspace(0, 1, LEVELS + 1), cmap="cividis")
        shown = column[1].pcolormesh(MM * x, MM * y, np.minimum(size, most), cmap=force_colours(), vmin=0, vmax=most)
        draw_arrows(column[1], box, field.force, count=COARSE)
        column[0].set_title(
            f"({'abcd'[i]}) {of.changed}\n"
            rf"$\sigma$ = {MM * of.width:.3g} mm, $S$ = {of.stiffness:.4g} N/m, $k_1$ = {of.drag:.3g} N/m",
            fontsize=8.5,
            loc="left",
        )
        for axes, colour in zip(column, ("white", REFERENCE), strict=True):
            axes.plot(*(MM * path.T), "--", color=colour, linewidth=1.4, label="path")
            axes.plot(*(MM * path[-1]), "X", color=colour, markersize=8, markeredgecolor="#888888", label="target")
            axes.set_aspect("equal")
            axes.set(xlim=box[0], ylim=box[1])
        column[1].set_xlabel("x [mm]")
    grid[0, 0].set_ylabel("y [mm]")
    grid[1, 0].set_ylabel("y [mm]")
    figure.colorbar(contours, ax=grid[0, :], label="potential, each panel\nfrom 0 to 1", shrink=0.8, ticks=[0, 0.5, 1])
    figure.colorbar(shown, ax=grid[1, :], label="force [N]", shrink=0.8, extend="max")
    legend_below(figure, grid[1, 0], 2)
    return figure


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


def along_figure(outcome: ScenarioOutcome) -> Figure:
    """Below zero the force is against the motion; the target is at the right."""
    field = outcome.fields[0]
    figure = framed(f"{outcome.title}\nforce along the path towards the target: below 0 it resists", 10.0, 6.4)
    axes = figure.add_subplot()
    points, remaining = _places(field)
    inside = np.asarray(outcome.comfortable.contains(points))
    without = fields_along(outcome, drags=False)
    for law, of in fields_along(outcome).items():
        whole = force_along(of, points)
        by_drag = whole - force_along(without[law], points)
        words, style = CURVES[law]
        for force, width, said in ((whole, 2.2, f"{words}, at rest"), (by_drag, 1.1, "of this, given by $k_1$")):
            shown = np.where(inside, 0.0, force)
            axes.plot(MM * remaining, shown, style, color=LAW_COLOURS[law], linewidth=width, label=said)
        if law in outcome.trials:
            _draw_trials(axes, outcome, law)
    axes.fill_between(
        MM * remaining, 0, 1, where=inside, transform=axes.get_xaxis_transform(), color=COMFORTABLE, alpha=0.2,
        linewidth=0, label="path within $W_c$: no force",
    )  # fmt: skip
    axes.axhline(0, color=REFERENCE, linewidth=0.8)
    axes.set_xlim(MM * remaining[0], -0.03 * MM * remaining[0])
    axes.axvline(0, color=REFERENCE, linewidth=1.2, linestyle=":", label="target")
    axes.set_xlabel("path that is left to the target [mm]")
    axes.set_ylabel("force along the path, towards the target [N]")
    axes.grid(**GRID)
    legend_below(figure, axes, 3)
    return figure


def fields_along(outcome: ScenarioOutcome, *, drags: bool = True) -> dict[Law, PotentialField]:
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
    along: Array = (field.force(points) * tangent).sum(axis=1)
    return along


def _places(field: PotentialField) -> tuple[Array, Array]:
    """Points (N, 2) along the path and what is left of it (N,) [m]."""
    path = field.paths[0]
    travelled = np.linspace(0.0, path.travelled[-1], PLACES)
    points = np.column_stack([np.interp(travelled, path.travelled, path.points[:, axis]) for axis in (0, 1)])
    return points, travelled[-1] - travelled


def _draw_trials(axes: Axes, outcome: ScenarioOutcome, law: Law) -> None:
    """The commanded force of all trials outside W_c: its median by what is left of the path."""
    marker = MARKERS[law]
    left, along = [], []
    for trial in outcome.trials[law]:
        where = projected(trial.position, outcome.reference)
        outside = ~trial.inside
        left.append((where.length - where.along)[outside])
        along.append((trial.commanded * where.tangent).sum(axis=1)[outside])
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
