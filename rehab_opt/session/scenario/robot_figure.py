"""The force that was commanded beside the one that acted, and where the hand was seen beside where it was."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from rehab_opt.session.drawing import GRID, MM, framed, legend_below
from rehab_opt.session.scenario.outcome import ScenarioOutcome
from rehab_opt.session.scenario.swinging import BOUNDED
from rehab_opt.session.scenario.trial import Trial

__all__ = ["late_trial", "robot_figure"]

TRUE, TOLD = "#0072B2", "#E69F00"
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
    figure = framed(
        f"{title}\n{trial.law}, trial {trial.number + 1}: what was commanded and seen, and what was true", 11.0, 8.5
    )
    grid = figure.subplots(4, 2, width_ratios=(2.2, 1), sharex="col")
    speed, amiss = np.hypot(*trial.velocity.T), MM * np.hypot(*(trial.seen - trial.position).T)
    near = np.flatnonzero(np.abs(trial.time - trial.time[int(speed.argmax())]) <= CLOSE_UP / 2)
    for column, ticks in enumerate((np.arange(len(trial.time)), near)):
        time = trial.time[ticks]
        for axis, letter in enumerate("xy"):
            panel = grid[axis, column]
            panel.plot(
                time, trial.commanded[ticks, axis], color=TOLD, linewidth=0.9, label="commanded to the force loop"
            )
            panel.plot(
                time, trial.acting[ticks, axis], color=TRUE, linewidth=1.4,
                label="true force of the motors, which move the robot's mass and friction, too",
            )  # fmt: skip
            panel.set_ylabel(f"force {letter} [N]" if not column else "")
        grid[2, column].plot(time, speed[ticks], color=TRUE, linewidth=1.4)
        grid[3, column].plot(time, amiss[ticks], color=TRUE, linewidth=0.8)
        grid[3, column].set_xlabel("time [s]")
    grid[2, 0].set_ylabel("true speed of\nthe hand [m/s]")
    grid[3, 0].set_ylabel("place seen from\nthe true one [mm]")
    for panel in grid.ravel():
        panel.grid(**GRID)
        panel.margins(x=0.01)
    legend_below(figure, grid[0, 0], 2)
    return figure
