"""Figures of scenarios, like Figs. 4, 6, 7, 9 and 10 of Rossa et al."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from rehab_opt.session.drawing import (
    CLOSE_UP,
    COMMANDED,
    MM,
    OKABE_ITO,
    REFERENCE,
    THIN,
    TRUE,
    framed,
    label_times,
    legend_below,
)
from rehab_opt.session.outcome import Array
from rehab_opt.session.scenario.field_figures import along_figure, field_figure, learnt_figure, parameter_figure
from rehab_opt.session.scenario.laws import BOUNDED
from rehab_opt.session.scenario.measures import deviation_of
from rehab_opt.session.scenario.plane_drawing import (
    COMFORTABLE,
    LAW_COLOURS,
    LAW_NAMES,
    draw_plane,
    draw_reference,
    mean_over_trials,
    seen_points,
    shown_box,
)
from rehab_opt.session.scenario.problem import THERAPY
from rehab_opt.session.scenario.trials import Law, ScenarioTrials
from rehab_opt.session.trace import Trace

__all__ = ["deviation_figure", "figures", "max_between", "trials_figure"]


def figures(outcome: ScenarioTrials) -> dict[str, Figure]:
    """The figures by file name (without suffix).

    "parameters" is left out for "hold": around a single point the field is a spring for any sigma and k1.
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
        drawn["robot"] = robot_figure(late, outcome.trials[late][0])
    return drawn


PERCENT = 100.0
MEAN = 1.6
"""[points] Line of the mean of trials."""


def compared(outcome: ScenarioTrials) -> tuple[tuple[str, str, float], ...]:
    """Label, key of the measure, and factor to the label's unit."""
    if outcome.mode == "hold":
        return (
            ("deviation,\nmean [mm]", "deviation_mean_m", MM),
            ("measured force while\nholding, mean [N]", "force_measured_held_mean_N", 1.0),
            ("speed while holding,\nmean [mm/s]", "speed_held_mean_m_s", MM),
            ("time on\ntarget [%]", "time_on_target_fraction", PERCENT),
        )
    whole = (
        ("deviation,\nmean [mm]", "deviation_mean_m", MM),
        ("measured force,\nmean [N]", "force_measured_mean_N", 1.0),
        ("speed,\nmean [mm/s]", "speed_mean_m_s", MM),
        ("smoothness,\nSPARC (0: best)", "smoothness_sparc", 1.0),
    )
    if outcome.mode in THERAPY:
        outside = ("deviation outside\n$W_c$, mean [mm]", "deviation_outside_mean_m", MM)
        return (outside, *whole[1:], ("distance to the\ntarget at the end\n[mm]", "final_distance_m", MM))
    return (
        *whole,
        (f"path covered\nin order within\n{MM * outcome.within:g} mm [%]", "reference_covered_fraction", PERCENT),
    )


def comparison_figure(outcome: ScenarioTrials) -> Figure:
    """A panel for each measure, a row for each controller."""
    chosen, laws = compared(outcome), list(outcome.measures)
    figure = framed(
        f"Measures of every trial, by controller: a dot is a trial, a bar and its number their mean. {_n(outcome)}",
        0.9 + 0.36 * len(laws),
    )
    panels = figure.subplots(1, len(chosen), sharey=True)
    for axes, (label, key, factor) in zip(panels, chosen, strict=True):
        _draw_measure(axes, outcome, key, factor)
        axes.set_xlabel(label)
        axes.grid(visible=False, axis="y")
    panels[0].set_yticks(range(len(laws)), [LAW_NAMES[law] for law in laws])
    panels[0].set_ylim(len(laws) - 0.4, -0.7)
    return figure


def _draw_measure(axes: Axes, outcome: ScenarioTrials, key: str, factor: float) -> None:
    for row, (law, measures) in enumerate(outcome.measures.items()):
        values = np.array([factor * of[key] for of in measures if of[key] is not None])
        if not len(values):
            axes.annotate("none", (0.97, row), xycoords=("axes fraction", "data"), ha="right", va="center")
            continue
        mean, colour = values.mean(), LAW_COLOURS[law]
        axes.plot(values, np.full(len(values), row), "o", color=colour, alpha=0.5, markeredgewidth=0, clip_on=False)
        axes.plot([mean, mean], [row - 0.25, row + 0.25], color=colour)
        at: dict[str, Any] = {"xycoords": ("axes fraction", "data"), "ha": "right", "va": "center"}
        axes.annotate(f"{mean:.3g}", (0.97, row), color=colour, **at)
    low, high = axes.get_xlim()
    low, high = (low if key == "smoothness_sparc" else 0.0), (PERCENT if factor == PERCENT else high)
    axes.set_xlim(low, high + 0.5 * (high - low))  # room for the numbers
    ticks = (0.0, 50.0, PERCENT) if factor == PERCENT else MaxNLocator(3, steps=(1, 2, 5, 10)).tick_values(low, high)
    axes.set_xticks([each for each in ticks if low <= each <= high])


def _n(outcome: ScenarioTrials) -> str:
    """How many trials, in words."""
    return f"n = {max(map(len, outcome.trials.values()))} trials with each controller, of a simulated person."


def pairs_of(outcome: ScenarioTrials) -> dict[Law, Trace]:
    """The first trial of each controller that has a helper."""
    return {law: of[0] for law, of in outcome.trials.items() if "_helper_intended" in of[0]}


def together_figure(outcome: ScenarioTrials) -> Figure:
    """One column for each controller with a helper, for its first trial."""
    pairs = pairs_of(outcome)
    figure = framed(
        "The first trial of helper and participant: hands of both in their own workspaces [mm], with what the helper "
        f"means to draw and its image; forces on both hands, at most {outcome.force_limit:g} N (dotted); energy that "
        f"is left in their tanks [J]. n = {max(len(trial['t_s']) for trial in pairs.values())} ticks.",
        7.6,
    )
    grid = figure.subplots(4, len(pairs), squeeze=False, height_ratios=(1.3, 1.8, 1, 1))
    demonstrated = outcome.reference if outcome.demonstrated is None else outcome.demonstrated
    hands = np.vstack([trial["helper"] for trial in pairs.values()])
    wide = shown_box(np.vstack([demonstrated, hands]))
    near = shown_box(seen_points(outcome, (trial["_hand"] for trial in pairs.values())))
    for column, (law, trial) in zip(grid.T, pairs.items(), strict=True):
        for axes, who, box, path, hand in (
            (column[0], "helper", wide, demonstrated, trial["helper"]),
            (column[1], "participant", near, outcome.reference, trial["_hand"]),
        ):
            draw_plane(axes, outcome, box)
            draw_reference(axes, outcome, path, label="path that the helper means to draw, and its image")
            axes.plot(*(MM * hand[trial.rows].T), color=PEOPLE[who], label=f"{who}")
        column[0].set_title(LAW_NAMES[law])
        _over_time(column[2], trial, ("helper_force", "force_commanded"))
        column[2].axhline(outcome.force_limit, **FORCE_LIMIT)
        tanks = "helper_energy_left_J", "energy_left_J"
        _over_time(column[3], trial, tanks)
        label_times(column[2:], "", "", from_zero=True)
    for axes, label in zip(grid[2:, 0], ("force on\nthe hand [N]", "energy in\nthe tank [J]"), strict=True):
        axes.set_ylabel(label)
    for axes in grid[:2, 1:].ravel():
        axes.set_ylabel("")
    return legend_below(figure)


PEOPLE = {"helper": OKABE_ITO[4], "participant": OKABE_ITO[0]}
FORCE_LIMIT: Mapping[str, Any] = {"color": REFERENCE, "linewidth": THIN, "linestyle": "--", "label": "force limit"}


def _over_time(axes: Axes, trial: Trace, columns: tuple[str, str]) -> None:
    """Draw the magnitudes of vectors (N, 2), or values (N,), of helper and participant."""
    for name, (who, colour) in zip(columns, PEOPLE.items(), strict=True):
        of = trial[name][trial.rows]
        size = of if of.ndim == 1 else np.linalg.norm(of, axis=1)
        axes.plot(trial["t_s"][trial.rows], size, color=colour, label=who)


def late_law(outcome: ScenarioTrials) -> Law | None:
    """The first of our controllers, if the robot has delays; else None."""
    return next((law for law in BOUNDED if "_acting" in outcome.trials.get(law, [{}])[0]), None)


def robot_figure(law: Law, trial: Trace) -> Figure:
    """Forces and positions of the first trial: the whole trial, and half a second around the hand's largest speed."""
    figure = framed(
        f"{LAW_NAMES[law]}, first trial: force commanded to the force loop, and the true force of the motors, which "
        "move the robot's mass and friction, too; true speed of the hand; distance of the measured from the true "
        f"position. Left the whole trial, right half a second about the largest speed. n = {len(trial['t_s'])} ticks.",
        5.2,
    )
    grid = figure.subplots(4, 2, width_ratios=(2.2, 1), sharex="col")
    speed, amiss = MM * np.hypot(*trial["velocity"].T), MM * np.hypot(*(trial["_seen"] - trial["_hand"]).T)
    near = np.flatnonzero(np.abs(trial["t_s"] - trial["t_s"][int(speed.argmax())]) <= CLOSE_UP / 2)
    for column, ticks in zip(grid.T, (np.arange(len(trial["t_s"])), near), strict=True):
        time = trial["t_s"][ticks]
        for axis, panel in enumerate(column[:2]):
            commanded, true = (trial[key][ticks, axis] for key in ("force_commanded", "_acting"))
            panel.plot(time, commanded, color=COMMANDED, linewidth=THIN, label="commanded to the force loop")
            panel.plot(time, true, color=TRUE, label="true force of the motors")
        column[2].plot(time, speed[ticks], color=TRUE)
        column[3].plot(time, amiss[ticks], color=TRUE, linewidth=THIN)
        label_times(column, *[""] * 4)
    labels = "force x [N]", "force y [N]", "true speed\nof the hand\n[mm/s]", "error of the\nposition [mm]"
    label_times(grid[:, 0], *labels)
    return legend_below(figure)


MEAN_PLACE: Mapping[str, Any] = {"markersize": 9, "markerfacecolor": "none", "markeredgewidth": 1.2, "linestyle": ""}


def trials_figure(outcome: ScenarioTrials) -> Figure:
    """Every trial as a thin line, and their mean as a thick one."""
    laws = list(outcome.trials)
    box = shown_box(seen_points(outcome, (trial["_hand"] for of in outcome.trials.values() for trial in of)))
    tall, across = (box[1][1] - box[1][0]) / (box[0][1] - box[0][0]), min(6.0 / len(laws), 3.0)
    inside = ", green: the fraction of trials whose hand is in $W_c$" if outcome.mode in THERAPY else ""
    figure = framed(
        f"Every trial (thin) and their mean: position of the hand [mm], measured force{inside}, and speed of the hand. "
        f"{_n(outcome)}",
        3.4 + tall * across,
    )
    grid = figure.subplots(3, len(laws), squeeze=False, height_ratios=(tall * across + 0.3, 1.1, 1.1))
    for column, law in zip(grid.T, laws, strict=True):
        column[0].set_title(LAW_NAMES[law], color=LAW_COLOURS[law])
        draw_plane(column[0], outcome, box)
        draw_reference(column[0], outcome, label="point to be held" if outcome.mode == "hold" else "reference")
        _draw_paths(column[0], outcome, law)
        _draw_force(column[1], outcome, law)
        _draw_sizes(column[2], outcome, law, "velocity", MM)
        column[2].set_xlabel("time [s]")
    for row, label in ((1, "measured\nforce [N]"), (2, "speed of the\nhand [mm/s]")):
        _same_limits(grid[row])
        grid[row, 0].set_ylabel(label)
    for axes in grid[0, 1:]:
        axes.set_ylabel("")
    _label_trials(grid[0, 0], outcome)
    if outcome.mode in THERAPY:
        grid[0, 0].fill_between([], [], color=COMFORTABLE, alpha=0.2, label="fraction of trials whose hand is in $W_c$")
    return legend_below(figure)


def _label_trials(axes: Axes, outcome: ScenarioTrials) -> None:
    count = max(map(len, outcome.trials.values()))
    axes.plot([], [], color=REFERENCE, linewidth=THIN, alpha=0.6, label=f"one trial of {count}")
    axes.plot([], [], color=REFERENCE, linewidth=MEAN, label="mean of the trials")


def max_between(values: Array, ticks: NDArray[np.intp]) -> Array:
    """(K,) largest of `values` (N,) since the previous kept tick, so that no peak is lost."""
    return np.maximum.reduceat(values, np.concatenate(([0], ticks[:-1] + 1)))


def _draw_paths(axes: Axes, outcome: ScenarioTrials, law: Law) -> None:
    trials, colour = outcome.trials[law], LAW_COLOURS[law]
    holds = outcome.mode == "hold"
    for trial in trials:
        ticks = trial.rows
        # Only while a point is to be held: between two of them the gap of NaN breaks the line.
        places = np.where(np.isfinite(trial["goal"]), trial["_hand"], np.nan) if holds else trial["_hand"]
        axes.plot(*(MM * places[ticks].T), color=colour, linewidth=THIN, alpha=0.6, zorder=5)
    if holds:
        for point in outcome.reference:
            held = [trial["_hand"][(trial["goal"] == point).all(axis=1)] for trial in trials]
            every = np.vstack(held)
            if len(every):
                axes.plot(*(MM * every.mean(axis=0)), "o", **MEAN_PLACE, markeredgecolor=colour, zorder=7)
        axes.plot([], [], "o", **MEAN_PLACE, markeredgecolor=REFERENCE, label="mean place while it was to be held")
        return
    if outcome.mode != "follow":  # of trials that go along a path more than once it is nobody's path
        _, mean = mean_over_trials(trials, [trial["_hand"] for trial in trials])
        axes.plot(*(MM * mean.T), color=colour, linewidth=MEAN, zorder=5.5)


def _draw_force(axes: Axes, outcome: ScenarioTrials, law: Law) -> None:
    if outcome.mode in THERAPY:
        trials = outcome.trials[law]
        time, inside = mean_over_trials(trials, [trial["inside"].astype(np.float64) for trial in trials])
        axes.fill_between(
            time, 0, inside, step="mid", transform=axes.get_xaxis_transform(), color=COMFORTABLE, alpha=0.2, linewidth=0
        )
    axes.axhline(outcome.force_limit, **FORCE_LIMIT)
    _draw_sizes(axes, outcome, law, "force_measured", 1.0)


def _draw_sizes(axes: Axes, outcome: ScenarioTrials, law: Law, what: str, unit: float) -> None:
    trials = outcome.trials[law]
    _draw_over_time(axes, law, trials, [unit * np.linalg.norm(trial[what], axis=1) for trial in trials])


def _draw_over_time(axes: Axes, law: Law, trials: Sequence[Trace], values: Sequence[Array]) -> None:
    """A thin line for `values` (N,) of each trial, a thick one for their mean."""
    for trial, of in zip(trials, values, strict=True):
        peaks = max_between(of, trial.rows)
        axes.plot(trial["t_s"][trial.rows], peaks, color=LAW_COLOURS[law], linewidth=THIN, alpha=0.6)
    axes.plot(*mean_over_trials(trials, values), color=LAW_COLOURS[law], linewidth=MEAN)


def _same_limits(row: NDArray[np.object_]) -> None:
    """Set equal limits for the panels of a row: from zero to the largest value, over the longest time."""
    top, right = max(axes.get_ylim()[1] for axes in row), max(axes.get_xlim()[1] for axes in row)
    for axes in row:
        axes.set(xlim=(0, right), ylim=(0, top))


def deviation_figure(outcome: ScenarioTrials) -> Figure:
    """Every trial as a thin line, and their mean as a thick one, on one scale; numbers mark the point to hold."""
    holds = outcome.mode == "hold"
    of_what = "the point to be held, numbered, while it was" if holds else "the point of the path that is due"
    figure = framed(
        f"Distance of the hand from {of_what}: every trial (thin) and their mean. {_n(outcome)}",
        0.7 + 1.2 * len(outcome.trials),
    )
    rows = figure.subplots(len(outcome.trials), 1, sharex=True, sharey=True, squeeze=False)[:, 0]
    for axes, (law, trials) in zip(rows, outcome.trials.items(), strict=True):
        _draw_over_time(axes, law, trials, [_deviation(outcome, trial) for trial in trials])
        axes.set_title(LAW_NAMES[law], color=LAW_COLOURS[law])
    label_times(rows, *["deviation [mm]"] * len(rows), from_zero=True)
    if holds:
        _number_points(outcome, rows)
    _label_trials(rows[0], outcome)
    return legend_below(figure)


def _deviation(outcome: ScenarioTrials, trial: Trace) -> Array:
    """(N,) [mm], NaN where it does not count."""
    far, counts = deviation_of(trial, outcome.reference, outcome.mode)
    return MM * np.where(counts, far, np.nan)


def _number_points(outcome: ScenarioTrials, rows: NDArray[np.object_]) -> None:
    trial = next(iter(outcome.trials.values()))[0]
    for i, point in enumerate(outcome.reference):
        held = trial["t_s"][(trial["goal"] == point).all(axis=1)]
        for axes in rows if len(held) else ():
            at = {"xycoords": ("data", "axes fraction"), "ha": "center", "va": "top"}
            axes.annotate(str(i + 1), (held.mean(), 0.97), **at)
