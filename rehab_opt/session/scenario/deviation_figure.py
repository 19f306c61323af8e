"""Deviation over time, a panel for each law: from the path that is followed, or from the point that is held."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rehab_opt.session.drawing import GRID, MM, REFERENCE, framed, legend_below
from rehab_opt.session.scenario.deviation import projected
from rehab_opt.session.scenario.measures import deviation_of
from rehab_opt.session.scenario.outcome import ScenarioOutcome
from rehab_opt.session.scenario.plane_drawing import LAW_COLOURS, LAW_NAMES, mean_over_trials
from rehab_opt.session.scenario.trace import thinned_ticks
from rehab_opt.session.scenario.trial import Trial
from rehab_opt.session.scenario.trials_figure import largest_between

__all__ = ["deviation_figure"]

Array = NDArray[np.float64]


def deviation_figure(outcome: ScenarioOutcome) -> Figure:
    """Every trial a thin line, their mean a thick one, on one scale; numbers say which point was to be held."""
    holds = outcome.mode == "hold"
    of_what = "the point to be held, while it was" if holds else "the reference"
    figure = framed(f"{outcome.title}\ndistance of the hand from {of_what}", 10.0, 1.6 + 2.3 * len(outcome.trials))
    rows = figure.subplots(len(outcome.trials), 1, sharex=True, sharey=True, squeeze=False)[:, 0]

    for axes, (law, trials) in zip(rows, outcome.trials.items(), strict=True):
        far = [_deviation(outcome, trial) for trial in trials]
        for trial, of in zip(trials, far, strict=True):
            ticks = thinned_ticks(trial)
            axes.plot(
                trial.time[ticks],
                largest_between(of, ticks),
                color=LAW_COLOURS[law],
                linewidth=0.8,
                alpha=0.6,
            )
        axes.plot(*mean_over_trials(trials, far), color=LAW_COLOURS[law], linewidth=2.2)
        axes.set_title(LAW_NAMES[law], fontsize=10, loc="left", color=LAW_COLOURS[law])
        axes.set_ylabel("deviation [mm]")
        axes.grid(**GRID)
    rows[0].set_ylim(bottom=0)
    rows[-1].set_xlabel("time [s]")
    if holds:
        _number_points(outcome, rows)
    rows[0].plot([], [], color=REFERENCE, linewidth=0.8, alpha=0.6, label="one trial")
    rows[0].plot([], [], color=REFERENCE, linewidth=2.2, label="mean of the trials")
    legend_below(figure, rows[0], 2)
    return figure


def _deviation(outcome: ScenarioOutcome, trial: Trial) -> Array:
    """(N,) [mm], NaN where it does not count."""
    far, counts = deviation_of(trial, projected(trial.position, outcome.reference).distance, outcome.mode)
    return MM * np.where(counts, far, np.nan)


def _number_points(outcome: ScenarioOutcome, rows: NDArray[np.object_]) -> None:
    trial = next(iter(outcome.trials.values()))[0]
    for i, point in enumerate(outcome.reference):
        held = trial.time[(trial.goal == point).all(axis=1)]
        for axes in rows if len(held) else ():
            axes.annotate(
                str(i + 1), (held.mean(), 0.97), xycoords=("data", "axes fraction"), ha="center", va="top", fontsize=8
            )
