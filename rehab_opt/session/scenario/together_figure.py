"""Helper and participant at one task: both hands in their own workspaces, what each feels, what their tanks hold."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rehab_opt.session.drawing import GRID, LIMIT, MM, framed, legend_below
from rehab_opt.session.scenario.outcome import ScenarioOutcome
from rehab_opt.session.scenario.plane_drawing import (
    LAW_COLOURS,
    LAW_NAMES,
    draw_reference,
    draw_workspaces,
    seen_box,
    shown_box,
)
from rehab_opt.session.scenario.trace import thinned_ticks
from rehab_opt.session.scenario.trial import HelperTrace, Law, Trial

__all__ = ["pairs_of", "together_figure"]

Array = NDArray[np.float64]


def pairs_of(outcome: ScenarioOutcome) -> dict[Law, tuple[Trial, HelperTrace]]:
    """The first trial of each law that has a helper, with the helper's side of it."""
    pairs = {}
    for law, trials in outcome.trials.items():
        helper = trials[0].helper
        if helper is not None:
            pairs[law] = trials[0], helper
    return pairs


def together_figure(outcome: ScenarioOutcome) -> Figure:
    """A column for each law with a helper, of its first trial."""
    pairs = pairs_of(outcome)
    figure = framed(f"{outcome.title}: the first trial", 1.0 + 5.5 * len(pairs), 13.0)
    grid = figure.subplots(4, len(pairs), squeeze=False, height_ratios=(1.3, 1.6, 1, 1))
    demonstrated = outcome.reference if outcome.demonstrated is None else outcome.demonstrated
    hands = np.vstack([helper.position for _, helper in pairs.values()])
    wide, near = shown_box(np.vstack([demonstrated, hands])), shown_box(_close_up(outcome, pairs))
    for column, (law, (trial, helper)) in zip(grid.T, pairs.items(), strict=True):
        ticks, colour = thinned_ticks(trial), LAW_COLOURS[law]
        column[0].set_title(f"{LAW_NAMES[law]}: the helper's hand", fontsize=11, loc="left", color=colour)
        column[1].set_title("the participant's hand", fontsize=11, loc="left", color=colour)
        for axes, box, path, hand in (
            (column[0], wide, demonstrated, helper.position),
            (column[1], near, outcome.reference, trial.position),
        ):
            draw_workspaces(axes, outcome)
            draw_reference(axes, outcome, path, label="what the helper means to draw, and its image")
            axes.plot(*(MM * hand[ticks].T), color=colour, linewidth=1.6, label="hand")
            seen_box(axes, outcome, box)
        _over_time(column[2], trial, {"helper": helper.commanded, "participant": trial.commanded}, ticks, colour)
        column[2].axhline(outcome.force_limit, color=LIMIT, linewidth=2.0, linestyle=":", label="largest force allowed")
        column[2].set_ylim(0, 1.1 * outcome.force_limit)
        _over_time(column[3], trial, {"helper": helper.energy_left, "participant": trial.energy_left}, ticks, colour)
        column[3].set_ylim(0, 1.1 * max(trial.energy_left.max(), helper.energy_left.max()))
        column[3].set_xlabel("time [s]")
    grid[2, 0].set_ylabel("force on the hand [N]")
    grid[3, 0].set_ylabel("energy in the tank [J]")
    for axes in grid[:2, 1:].ravel():
        axes.set_ylabel("")
    legend_below(figure, grid[0, 0], 2)
    grid[2, 0].legend(fontsize=8, loc="upper right")
    return figure


def _close_up(outcome: ScenarioOutcome, pairs: dict[Law, tuple[Trial, HelperTrace]]) -> Array:
    import shapely  # noqa: PLC0415

    hands = [trial.position for trial, _ in pairs.values()]
    return np.vstack([outcome.reference, shapely.get_coordinates(outcome.comfortable.polygon), *hands])


def _over_time(axes: Axes, trial: Trial, values: dict[str, Array], ticks: NDArray[np.intp], colour: str) -> None:
    """Sizes of vectors (N, 2), or values (N,), by who they belong to."""
    for (name, of), style in zip(values.items(), ("--", "-"), strict=True):
        size = of if of.ndim == 1 else np.linalg.norm(of, axis=1)
        axes.plot(trial.time[ticks], size[ticks], style, color=colour, linewidth=1.2, label=name)
    axes.grid(**GRID)
