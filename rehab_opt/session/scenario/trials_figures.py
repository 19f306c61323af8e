"""Trials beside each other, a panel for each law: places, force, speed (Figs. 7 and 10), and deviation over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rehab_opt.session.drawing import GRID, LIMIT, MM, REFERENCE, framed, legend_below
from rehab_opt.session.outcome import Array
from rehab_opt.session.scenario.measures import deviation_of
from rehab_opt.session.scenario.outcome import Law, ScenarioOutcome, Trial, thinned_ticks
from rehab_opt.session.scenario.plane_drawing import (
    COMFORTABLE,
    LAW_COLOURS,
    LAW_NAMES,
    draw_reference,
    draw_workspaces,
    mean_over_trials,
    seen_box,
    seen_points,
    shown_box,
)
from rehab_opt.session.scenario.problem import THERAPY

__all__ = ["deviation_figure", "max_between", "trials_figure"]


MEAN_PLACE: Mapping[str, Any] = {"markersize": 11, "markerfacecolor": "none", "markeredgewidth": 1.5, "linestyle": ""}


def trials_figure(outcome: ScenarioOutcome) -> Figure:
    """Every trial a thin line, their mean a thick one."""
    laws = list(outcome.trials)
    count = max(map(len, outcome.trials.values()))
    figure = framed(f"{outcome.title}\ntrials under each law: {count}; and their mean", 0.8 + 4.2 * len(laws), 10.5)
    grid = figure.subplots(3, len(laws), squeeze=False, height_ratios=(1.6, 1, 1))
    box = shown_box(seen_points(outcome, (trial.position for of in outcome.trials.values() for trial in of)))
    for column, law in zip(grid.T, laws, strict=True):
        column[0].set_title(LAW_NAMES[law], fontsize=11, loc="left", color=LAW_COLOURS[law])
        draw_workspaces(column[0], outcome)
        draw_reference(column[0], outcome, label="point to be held" if outcome.mode == "hold" else "reference")
        _draw_paths(column[0], outcome, law)
        seen_box(column[0], outcome, box)
        _draw_force(column[1], outcome, law)
        _draw_sizes(column[2], outcome, law, "velocity", MM)
        column[2].set_xlabel("time [s]")
    for row, label in ((1, "measured force [N]"), (2, "speed of the hand [mm/s]")):
        _same_limits(grid[row])
        grid[row, 0].set_ylabel(label)
    for axes in grid[0, 1:]:
        axes.set_ylabel("")
    for axes in grid[1:].ravel():
        axes.grid(**GRID)
    grid[0, 0].plot([], [], color=REFERENCE, linewidth=0.8, alpha=0.6, label="one trial")
    grid[0, 0].plot([], [], color=REFERENCE, linewidth=2.2, label="mean of the trials")
    grid[0, 0].plot([], [], color=LIMIT, linewidth=2.0, linestyle=":", label="largest force allowed")
    if outcome.mode in THERAPY:
        grid[0, 0].fill_between([], [], color=COMFORTABLE, alpha=0.2, label="share of trials whose hand is in $W_c$")
    return legend_below(figure, grid[0, 0], 4)


def max_between(values: Array, ticks: NDArray[np.intp]) -> Array:
    """(K,) the largest of `values` (N,) since the kept tick before, so that no peak is lost."""
    return np.maximum.reduceat(values, np.concatenate(([0], ticks[:-1] + 1)))


def _draw_paths(axes: Axes, outcome: ScenarioOutcome, law: Law) -> None:
    trials, colour = outcome.trials[law], LAW_COLOURS[law]
    holds = outcome.mode == "hold"
    for trial in trials:
        ticks = thinned_ticks(trial)
        # Only while a point is to be held: between two of them the gap of NaN breaks the line.
        places = np.where(np.isfinite(trial.goal), trial.position, np.nan) if holds else trial.position
        axes.plot(*(MM * places[ticks].T), color=colour, linewidth=0.8, alpha=0.6, zorder=5)
    if holds:
        for point in outcome.reference:
            held = [trial.position[(trial.goal == point).all(axis=1)] for trial in trials]
            every = np.vstack(held)
            if len(every):
                axes.plot(*(MM * every.mean(axis=0)), "o", **MEAN_PLACE, markeredgecolor=colour, zorder=7)
        axes.plot([], [], "o", **MEAN_PLACE, markeredgecolor=REFERENCE, label="mean place while it was to be held")
        return
    _, mean = mean_over_trials(trials, [trial.position for trial in trials])
    axes.plot(*(MM * mean.T), color=colour, linewidth=2.2, zorder=5.5)


def _draw_force(axes: Axes, outcome: ScenarioOutcome, law: Law) -> None:
    if outcome.mode in THERAPY:
        trials = outcome.trials[law]
        time, inside = mean_over_trials(trials, [trial.inside.astype(np.float64) for trial in trials])
        axes.fill_between(
            time, 0, inside, step="mid", transform=axes.get_xaxis_transform(), color=COMFORTABLE, alpha=0.2, linewidth=0
        )
    axes.axhline(outcome.force_limit, color=LIMIT, linewidth=2.0, linestyle=":")
    _draw_sizes(axes, outcome, law, "measured", 1.0)


def _draw_sizes(axes: Axes, outcome: ScenarioOutcome, law: Law, what: str, unit: float) -> None:
    trials = outcome.trials[law]
    _draw_over_time(axes, law, trials, [unit * np.linalg.norm(getattr(trial, what), axis=1) for trial in trials])


def _draw_over_time(axes: Axes, law: Law, trials: Sequence[Trial], values: Sequence[Array]) -> None:
    """A thin line for `values` (N,) of each trial, a thick one for their mean."""
    for trial, of in zip(trials, values, strict=True):
        ticks = thinned_ticks(trial)
        axes.plot(trial.time[ticks], max_between(of, ticks), color=LAW_COLOURS[law], linewidth=0.8, alpha=0.6)
    axes.plot(*mean_over_trials(trials, values), color=LAW_COLOURS[law], linewidth=2.2)


def _same_limits(row: NDArray[np.object_]) -> None:
    """Panels of one row, from zero to what the largest needs, over the longest time."""
    top, right = max(axes.get_ylim()[1] for axes in row), max(axes.get_xlim()[1] for axes in row)
    for axes in row:
        axes.set(xlim=(0, right), ylim=(0, top))


def deviation_figure(outcome: ScenarioOutcome) -> Figure:
    """Every trial a thin line, their mean a thick one, on one scale; numbers say which point was to be held."""
    holds = outcome.mode == "hold"
    of_what = "the point to be held, while it was" if holds else "the place of the path that is due"
    figure = framed(f"{outcome.title}\ndistance of the hand from {of_what}", 10.0, 1.6 + 2.3 * len(outcome.trials))
    rows = figure.subplots(len(outcome.trials), 1, sharex=True, sharey=True, squeeze=False)[:, 0]

    for axes, (law, trials) in zip(rows, outcome.trials.items(), strict=True):
        _draw_over_time(axes, law, trials, [_deviation(outcome, trial) for trial in trials])
        axes.set_title(LAW_NAMES[law], fontsize=10, loc="left", color=LAW_COLOURS[law])
        axes.set_ylabel("deviation [mm]")
        axes.grid(**GRID)
    rows[0].set_ylim(bottom=0)
    rows[-1].set_xlabel("time [s]")
    if holds:
        _number_points(outcome, rows)
    rows[0].plot([], [], color=REFERENCE, linewidth=0.8, alpha=0.6, label="one trial")
    rows[0].plot([], [], color=REFERENCE, linewidth=2.2, label="mean of the trials")
    return legend_below(figure, rows[0], 2)


def _deviation(outcome: ScenarioOutcome, trial: Trial) -> Array:
    """(N,) [mm], NaN where it does not count."""
    far, counts = deviation_of(trial, outcome.reference, outcome.mode)
    return MM * np.where(counts, far, np.nan)


def _number_points(outcome: ScenarioOutcome, rows: NDArray[np.object_]) -> None:
    trial = next(iter(outcome.trials.values()))[0]
    for i, point in enumerate(outcome.reference):
        held = trial.time[(trial.goal == point).all(axis=1)]
        for axes in rows if len(held) else ():
            axes.annotate(
                str(i + 1), (held.mean(), 0.97), xycoords=("data", "axes fraction"), ha="center", va="top", fontsize=8
            )
