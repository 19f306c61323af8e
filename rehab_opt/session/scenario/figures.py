"""Figures of scenarios, like Figs. 4, 6, 7, 9 and 10 of Rossa et al."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rehab_opt.session.drawing import CLOSE_UP, GRID, LIMIT, MM, REFERENCE, TOLD, TRUE, framed, legend_below
from rehab_opt.session.outcome import Array
from rehab_opt.session.scenario.field_figures import along_figure, field_figure, learnt_figure, parameter_figure
from rehab_opt.session.scenario.laws import BOUNDED
from rehab_opt.session.scenario.outcome import HelperTrace, Law, ScenarioOutcome, Trial, thinned_ticks
from rehab_opt.session.scenario.plane_drawing import (
    LAW_COLOURS,
    LAW_NAMES,
    draw_reference,
    draw_workspaces,
    seen_box,
    seen_points,
    shown_box,
)
from rehab_opt.session.scenario.problem import THERAPY
from rehab_opt.session.scenario.trials_figures import deviation_figure, trials_figure

__all__ = ["figures"]


def figures(outcome: ScenarioOutcome) -> dict[str, Figure]:
    """The figures by file name (without suffix).

    "parameters" is left out for "hold": around a single point the field is a spring, whatever sigma and k1.
    """
    drawn = {
        "field": field_figure(outcome),
        "trials": trials_figure(outcome),
        "comparison": comparison_figure(outcome),
    }
    if outcome.shown:
        drawn["learnt"] = learnt_figure(outcome)
    if outcome.mode != "hold":
        drawn["parameters"] = parameter_figure(outcome)
    if outcome.mode not in THERAPY:
        drawn["deviation"] = deviation_figure(outcome)
    if outcome.mode == "resist":
        drawn["along"] = along_figure(outcome)
    if pairs_of(outcome):
        drawn["together"] = together_figure(outcome)
    late = late_trial(outcome)
    if late is not None:
        drawn["robot"] = robot_figure(outcome.title, late)
    return drawn


PERCENT = 100.0
SIDEWAYS = 0.18
"""Of a place on the axis: trials are set apart by so much to either side."""


def compared(outcome: ScenarioOutcome) -> tuple[tuple[str, str, float], ...]:
    """Label, key of the measure, and factor to the label's unit."""
    if outcome.mode == "hold":
        return (
            ("deviation, mean [mm]", "deviation_mean_m", MM),
            ("measured force\nwhile holding, mean [N]", "force_measured_held_mean_N", 1.0),
            ("speed while holding,\nmean [mm/s]", "speed_held_mean_m_s", MM),
            ("time on target [%]", "time_on_target_fraction", PERCENT),
        )
    whole = (
        ("deviation, mean [mm]", "deviation_mean_m", MM),
        ("measured force,\nmean [N]", "force_measured_mean_N", 1.0),
        ("speed, mean [mm/s]", "speed_mean_m_s", MM),
        ("smoothness, SPARC\n(nearer 0 is smoother)", "smoothness_sparc", 1.0),
    )
    if outcome.mode in THERAPY:
        outside = ("deviation outside $W_c$,\nmean [mm]", "deviation_outside_mean_m", MM)
        return (outside, *whole[1:], ("distance to the target\nat the end [mm]", "final_distance_m", MM))
    return (
        *whole,
        (f"path {outcome.coverage} [%]".replace("order,", "order,\n"), "reference_covered_fraction", PERCENT),
    )


def comparison_figure(outcome: ScenarioOutcome) -> Figure:
    """A panel for each measure, laws beside each other, a bar at their mean."""
    chosen = compared(outcome)
    figure = framed(f"{outcome.title}\nevery trial under each law", 2.9 * len(chosen), 4.2)
    for axes, (label, key, factor) in zip(figure.subplots(1, len(chosen)), chosen, strict=True):
        _draw_measure(axes, outcome, key, factor)
        axes.set_title(label, fontsize=9.5, loc="left")
        axes.grid(**{**GRID, "axis": "y"})
    figure.axes[0].plot([], [], "o", color=REFERENCE, markersize=4, alpha=0.6, label="one trial")
    figure.axes[0].plot([], [], color=REFERENCE, linewidth=2.2, label="mean of the trials, also as a number")
    return legend_below(figure, figure.axes[0], 2)


def _draw_measure(axes: Axes, outcome: ScenarioOutcome, key: str, factor: float) -> None:
    for place, (law, measures) in enumerate(outcome.measures.items()):
        values = np.array([factor * of[key] for of in measures if of[key] is not None])
        if not len(values):
            axes.annotate("none", (place, 0.5), xycoords=("data", "axes fraction"), ha="center", fontsize=8)
            continue
        sideways = place + np.linspace(-SIDEWAYS, SIDEWAYS, len(values)) if len(values) > 1 else [place]
        axes.plot(sideways, values, "o", color=LAW_COLOURS[law], markersize=4, alpha=0.6)
        mean = values.mean()
        axes.plot([place - 0.32, place + 0.32], [mean, mean], color=LAW_COLOURS[law], linewidth=2.2)
        axes.annotate(
            f"{mean:.3g}", (place, 0.98), xycoords=("data", "axes fraction"), ha="center", va="top", fontsize=8.5,
            color=LAW_COLOURS[law],
        )  # fmt: skip
    axes.set_xlim(-0.6, len(outcome.measures) - 0.4)
    axes.set_xticks(range(len(outcome.measures)), list(outcome.measures), fontsize=8)
    low, high = axes.get_ylim()
    low = low if key == "smoothness_sparc" else 0.0
    high = 100.0 if factor == PERCENT else high
    axes.set_ylim(low, high + 0.15 * (high - low))  # room for the numbers
    if factor == PERCENT:
        axes.set_yticks(np.linspace(0, PERCENT, 6))


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
    wide = shown_box(np.vstack([demonstrated, hands]))
    near = shown_box(seen_points(outcome, (trial.position for trial, _ in pairs.values())))
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
    grid[2, 0].legend(fontsize=8, loc="upper right")
    return legend_below(figure, grid[0, 0], 2)


def _over_time(axes: Axes, trial: Trial, values: dict[str, Array], ticks: NDArray[np.intp], colour: str) -> None:
    """Sizes of vectors (N, 2), or values (N,), by who they belong to."""
    for (name, of), style in zip(values.items(), ("--", "-"), strict=True):
        size = of if of.ndim == 1 else np.linalg.norm(of, axis=1)
        axes.plot(trial.time[ticks], size[ticks], style, color=colour, linewidth=1.2, label=name)
    axes.grid(**GRID)


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
    speed, amiss = MM * np.hypot(*trial.velocity.T), MM * np.hypot(*(trial.seen - trial.position).T)
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
    grid[2, 0].set_ylabel("true speed of\nthe hand [mm/s]")
    grid[3, 0].set_ylabel("place seen from\nthe true one [mm]")
    for panel in grid.ravel():
        panel.grid(**GRID)
        panel.margins(x=0.01)
    return legend_below(figure, grid[0, 0], 2)
