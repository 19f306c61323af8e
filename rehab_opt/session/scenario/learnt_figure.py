"""What was learnt from a therapist: the movements with their forces, and recorded forces beside those of the field."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rehab_opt.field.demonstration import Demonstration
from rehab_opt.session.drawing import GRID, MM, framed, legend_below
from rehab_opt.session.scenario.outcome import ScenarioOutcome
from rehab_opt.session.scenario.plane_drawing import draw_reference, draw_workspaces, seen_box, shown_box

__all__ = ["learnt_figure", "most_telling"]

Array = NDArray[np.float64]

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
