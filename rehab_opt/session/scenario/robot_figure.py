"""The force that was commanded beside the one that acted, and where the hand was seen beside where it was."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from rehab_opt.session.drawing import GRID, MM, REFERENCE, framed, legend_below
from rehab_opt.session.scenario.outcome import ScenarioOutcome
from rehab_opt.session.scenario.swinging import BOUNDED
from rehab_opt.session.scenario.trial import Trial

__all__ = ["late_trial", "robot_figure"]

TRUE, SEEN = "#0072B2", "#E69F00"
CLOSE_UP = 0.5
"""[s] shown around the fastest motion."""


def late_trial(outcome: ScenarioOutcome) -> Trial | None:
    """The first trial with our help, on a robot that is late; None of one that is not."""
    for law in BOUNDED:
        for trial in outcome.trials.get(law, ())[:1]:
            if trial.acting is not None:
                return trial
    return None


def robot_figure(title: str, trial: Trial) -> Figure:
    """Forces and places of one trial: all of it, and half a second about the hand's largest speed."""
    assert trial.acting is not None
    assert trial.seen is not None
    figure = framed(f"{title}\n{trial.law}, trial {trial.number + 1}: commanded, seen and true", 11.0, 8.5)
    grid = figure.subplots(4, 2, width_ratios=(2.2, 1), sharex="col")
    speed = np.hypot(*trial.velocity.T)
    near = np.flatnonzero(np.abs(trial.time - trial.time[int(speed.argmax())]) <= CLOSE_UP / 2)
    for column, ticks in enumerate((np.arange(len(trial.time)), near)):
        time = trial.time[ticks]
        for axis, letter in enumerate("xy"):
            force, place = grid[axis, column], grid[2 + axis, column]
            force.plot(time, trial.acting[ticks, axis], color=TRUE, linewidth=1.4, label="true: acting force, place")
            force.plot(
                time, trial.commanded[ticks, axis], "--", color=REFERENCE, linewidth=0.9, label="commanded force"
            )
            place.plot(time, MM * trial.position[ticks, axis], color=TRUE, linewidth=1.4)
            place.plot(
                time, MM * trial.seen[ticks, axis], color=SEEN, linewidth=0.8, linestyle=":", label="place as seen"
            )
            force.set_ylabel(f"force {letter} [N]" if not column else "")
            place.set_ylabel(f"hand {letter} [mm]" if not column else "")
        grid[3, column].set_xlabel("time [s]")
    for panel in grid.ravel():
        panel.grid(**GRID)
        panel.margins(x=0.01)
    grid[0, 0].plot([], [], color=SEEN, linewidth=0.8, linestyle=":", label="place as seen")
    legend_below(figure, grid[0, 0], 3)
    return figure
