"""Force along the path against what is left of it: where resistance is largest, in our law and in the published one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rehab_opt.field.potential import PotentialField
from rehab_opt.session.drawing import GRID, MM, REFERENCE, framed, legend_below
from rehab_opt.session.scenario.deviation import projected
from rehab_opt.session.scenario.outcome import ScenarioOutcome
from rehab_opt.session.scenario.plane_drawing import COMFORTABLE, LAW_COLOURS
from rehab_opt.session.scenario.trial import Law

__all__ = ["along_figure", "fields_along", "force_along"]

Array = NDArray[np.float64]

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
