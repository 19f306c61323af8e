"""Figures of scenarios, like Figs. 4, 6, 7, 9 and 10 of Rossa et al."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rehab_opt.session.drawing import CLOSE_UP, GRID, LIMIT, MM, REFERENCE, TOLD, TRUE, framed, legend_below
from rehab_opt.session.outcome import Array
from rehab_opt.session.scenario.field_figures import along_figure, field_figure, learnt_figure, parameter_figure
from rehab_opt.session.scenario.laws import BOUNDED
from rehab_opt.session.scenario.measures import deviation_of
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
from rehab_opt.session.scenario.trials import Law, ScenarioTrials
from rehab_opt.session.trace import Trace

__all__ = ["deviation_figure", "figures", "max_between", "trials_figure"]


def figures(outcome: ScenarioTrials) -> dict[str, Figure]:
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
    late = late_law(outcome)
    if late is not None:
        drawn["robot"] = robot_figure(outcome.title, late, outcome.trials[late][0])
    return drawn


PERCENT = 100.0
SIDEWAYS = 0.18
"""Of a place on the axis: trials are set apart by so much to either side."""


def compared(outcome: ScenarioTrials) -> tuple[tuple[str, str, float], ...]:
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
        (f"path covered in order,\nwithin {MM * outcome.within:g} mm [%]", "reference_covered_fraction", PERCENT),
    )


def comparison_figure(outcome: ScenarioTrials) -> Figure:
    """A panel for each measure, controllers beside each other, a bar at their mean."""
    chosen = compared(outcome)
    figure = framed(f"{outcome.title}\nevery trial under each law", 2.9 * len(chosen), 4.2)
    for axes, (label, key, factor) in zip(figure.subplots(1, len(chosen)), chosen, strict=True):
        _draw_measure(axes, outcome, key, factor)
        axes.set_title(label, fontsize=9.5, loc="left")
        axes.grid(**{**GRID, "axis": "y"})
    figure.axes[0].plot([], [], "o", color=REFERENCE, markersize=4, alpha=0.6, label="one trial")
    figure.axes[0].plot([], [], color=REFERENCE, linewidth=2.2, label="mean of the trials, also as a number")
    return legend_below(figure, figure.axes[0], 2)


def _draw_measure(axes: Axes, outcome: ScenarioTrials, key: str, factor: float) -> None:
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


def pairs_of(outcome: ScenarioTrials) -> dict[Law, Trace]:
    """The first trial of each controller that has a helper."""
    return {law: of[0] for law, of in outcome.trials.items() if "_helper_intended" in of[0]}


def together_figure(outcome: ScenarioTrials) -> Figure:
    """A column for each controller with a helper, of its first trial."""
    pairs = pairs_of(outcome)
    figure = framed(f"{outcome.title}: the first trial", 1.0 + 5.5 * len(pairs), 13.0)
    grid = figure.subplots(4, len(pairs), squeeze=False, height_ratios=(1.3, 1.6, 1, 1))
    demonstrated = outcome.reference if outcome.demonstrated is None else outcome.demonstrated
    hands = np.vstack([trial["helper"] for trial in pairs.values()])
    wide = shown_box(np.vstack([demonstrated, hands]))
    near = shown_box(seen_points(outcome, (trial["_hand"] for trial in pairs.values())))
    for column, (law, trial) in zip(grid.T, pairs.items(), strict=True):
        colour = LAW_COLOURS[law]
        column[0].set_title(f"{LAW_NAMES[law]}: the helper's hand", fontsize=11, loc="left", color=colour)
        column[1].set_title("the participant's hand", fontsize=11, loc="left", color=colour)
        for axes, box, path, hand in (
            (column[0], wide, demonstrated, trial["helper"]),
            (column[1], near, outcome.reference, trial["_hand"]),
        ):
            draw_workspaces(axes, outcome)
            draw_reference(axes, outcome, path, label="what the helper means to draw, and its image")
            axes.plot(*(MM * hand[trial.rows].T), color=colour, linewidth=1.6, label="hand")
            seen_box(axes, outcome, box)
        _over_time(column[2], trial, ("helper_force", "force_commanded"), colour)
        column[2].axhline(outcome.force_limit, color=LIMIT, linewidth=2.0, linestyle=":", label="largest force allowed")
        column[2].set_ylim(0, 1.1 * outcome.force_limit)
        tanks = "helper_energy_left_J", "energy_left_J"
        _over_time(column[3], trial, tanks, colour)
        column[3].set_ylim(0, 1.1 * max(trial[name].max() for name in tanks))
        column[3].set_xlabel("time [s]")
    grid[2, 0].set_ylabel("force on the hand [N]")
    grid[3, 0].set_ylabel("energy in the tank [J]")
    for axes in grid[:2, 1:].ravel():
        axes.set_ylabel("")
    grid[2, 0].legend(fontsize=8, loc="upper right")
    return legend_below(figure, grid[0, 0], 2)


def _over_time(axes: Axes, trial: Trace, columns: tuple[str, str], colour: str) -> None:
    """Sizes of vectors (N, 2), or values (N,): the helper's and the participant's."""
    for name, who, style in zip(columns, ("helper", "participant"), ("--", "-"), strict=True):
        of = trial[name][trial.rows]
        size = of if of.ndim == 1 else np.linalg.norm(of, axis=1)
        axes.plot(trial["t_s"][trial.rows], size, style, color=colour, linewidth=1.2, label=who)
    axes.grid(**GRID)


def late_law(outcome: ScenarioTrials) -> Law | None:
    """The first of our controllers, on a robot that is late; None on one that is not."""
    return next((law for law in BOUNDED if "_acting" in outcome.trials.get(law, [{}])[0]), None)


def robot_figure(title: str, law: Law, trial: Trace) -> Figure:
    """Forces and places of the first trial: all of it, and half a second about the hand's largest speed."""
    figure = framed(f"{title}\n{law}, trial 1: what was commanded and seen, and what was true", 11.0, 8.5)
    grid = figure.subplots(4, 2, width_ratios=(2.2, 1), sharex="col")
    speed, amiss = MM * np.hypot(*trial["velocity"].T), MM * np.hypot(*(trial["_seen"] - trial["_hand"]).T)
    near = np.flatnonzero(np.abs(trial["t_s"] - trial["t_s"][int(speed.argmax())]) <= CLOSE_UP / 2)
    for column, ticks in enumerate((np.arange(len(trial["t_s"])), near)):
        time = trial["t_s"][ticks]
        for axis, letter in enumerate("xy"):
            panel = grid[axis, column]
            panel.plot(
                time,
                trial["force_commanded"][ticks, axis],
                color=TOLD,
                linewidth=0.9,
                label="commanded to the force loop",
            )
            panel.plot(
                time, trial["_acting"][ticks, axis], color=TRUE, linewidth=1.4,
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


MEAN_PLACE: Mapping[str, Any] = {"markersize": 11, "markerfacecolor": "none", "markeredgewidth": 1.5, "linestyle": ""}


def trials_figure(outcome: ScenarioTrials) -> Figure:
    """Every trial a thin line, their mean a thick one."""
    laws = list(outcome.trials)
    count = max(map(len, outcome.trials.values()))
    figure = framed(f"{outcome.title}\ntrials under each law: {count}; and their mean", 0.8 + 4.2 * len(laws), 10.5)
    grid = figure.subplots(3, len(laws), squeeze=False, height_ratios=(1.6, 1, 1))
    box = shown_box(seen_points(outcome, (trial["_hand"] for of in outcome.trials.values() for trial in of)))
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


def _draw_paths(axes: Axes, outcome: ScenarioTrials, law: Law) -> None:
    trials, colour = outcome.trials[law], LAW_COLOURS[law]
    holds = outcome.mode == "hold"
    for trial in trials:
        ticks = trial.rows
        # Only while a point is to be held: between two of them the gap of NaN breaks the line.
        places = np.where(np.isfinite(trial["goal"]), trial["_hand"], np.nan) if holds else trial["_hand"]
        axes.plot(*(MM * places[ticks].T), color=colour, linewidth=0.8, alpha=0.6, zorder=5)
    if holds:
        for point in outcome.reference:
            held = [trial["_hand"][(trial["goal"] == point).all(axis=1)] for trial in trials]
            every = np.vstack(held)
            if len(every):
                axes.plot(*(MM * every.mean(axis=0)), "o", **MEAN_PLACE, markeredgecolor=colour, zorder=7)
        axes.plot([], [], "o", **MEAN_PLACE, markeredgecolor=REFERENCE, label="mean place while it was to be held")
        return
    _, mean = mean_over_trials(trials, [trial["_hand"] for trial in trials])
    axes.plot(*(MM * mean.T), color=colour, linewidth=2.2, zorder=5.5)


def _draw_force(axes: Axes, outcome: ScenarioTrials, law: Law) -> None:
    if outcome.mode in THERAPY:
        trials = outcome.trials[law]
        time, inside = mean_over_trials(trials, [trial["inside"].astype(np.float64) for trial in trials])
        axes.fill_between(
            time, 0, inside, step="mid", transform=axes.get_xaxis_transform(), color=COMFORTABLE, alpha=0.2, linewidth=0
        )
    axes.axhline(outcome.force_limit, color=LIMIT, linewidth=2.0, linestyle=":")
    _draw_sizes(axes, outcome, law, "force_measured", 1.0)


def _draw_sizes(axes: Axes, outcome: ScenarioTrials, law: Law, what: str, unit: float) -> None:
    trials = outcome.trials[law]
    _draw_over_time(axes, law, trials, [unit * np.linalg.norm(trial[what], axis=1) for trial in trials])


def _draw_over_time(axes: Axes, law: Law, trials: Sequence[Trace], values: Sequence[Array]) -> None:
    """A thin line for `values` (N,) of each trial, a thick one for their mean."""
    for trial, of in zip(trials, values, strict=True):
        axes.plot(
            trial["t_s"][trial.rows], max_between(of, trial.rows), color=LAW_COLOURS[law], linewidth=0.8, alpha=0.6
        )
    axes.plot(*mean_over_trials(trials, values), color=LAW_COLOURS[law], linewidth=2.2)


def _same_limits(row: NDArray[np.object_]) -> None:
    """Panels of one row, from zero to what the largest needs, over the longest time."""
    top, right = max(axes.get_ylim()[1] for axes in row), max(axes.get_xlim()[1] for axes in row)
    for axes in row:
        axes.set(xlim=(0, right), ylim=(0, top))


def deviation_figure(outcome: ScenarioTrials) -> Figure:
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


def _deviation(outcome: ScenarioTrials, trial: Trace) -> Array:
    """(N,) [mm], NaN where it does not count."""
    far, counts = deviation_of(trial, outcome.reference, outcome.mode)
    return MM * np.where(counts, far, np.nan)


def _number_points(outcome: ScenarioTrials, rows: NDArray[np.object_]) -> None:
    trial = next(iter(outcome.trials.values()))[0]
    for i, point in enumerate(outcome.reference):
        held = trial["t_s"][(trial["goal"] == point).all(axis=1)]
        for axes in rows if len(held) else ():
            axes.annotate(
                str(i + 1), (held.mean(), 0.97), xycoords=("data", "axes fraction"), ha="center", va="top", fontsize=8
            )
