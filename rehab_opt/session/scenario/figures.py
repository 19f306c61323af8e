"""Figures of scenarios, like Figs. 4, 6, 7, 9 and 10 of Rossa et al."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rehab_opt.session.drawing import (
    MM,
    OKABE_ITO,
    REFERENCE,
    THIN,
    framed,
    label_times,
    legend_below,
    servo_figure,
)
from rehab_opt.session.outcome import Array, Outcome
from rehab_opt.session.scenario.field_figures import along_figure, field_figure, learnt_figure
from rehab_opt.session.scenario.laws import BOUNDED
from rehab_opt.session.scenario.measures import deviation_of
from rehab_opt.session.scenario.plane_drawing import (
    COMFORTABLE,
    FORCE_LIMIT,
    LAW_COLOURS,
    LAW_NAMES,
    box_around,
    count_words,
    draw_plane,
    draw_reference,
    mean_over_trials,
    shown_box,
)
from rehab_opt.session.scenario.precomputed import Precomputed
from rehab_opt.session.scenario.problem import THERAPY
from rehab_opt.session.scenario.scene import ScenarioTrials, trials_of
from rehab_opt.session.scenario.trials import Law
from rehab_opt.session.trace import Trace


def figures(outcome: Outcome) -> dict[str, Figure]:
    """The figures of a run by file name (without suffix)."""
    return trials_figures(trials_of(outcome))


def trials_figures(of: ScenarioTrials) -> dict[str, Figure]:
    """The figures of trials by file name (without suffix)."""
    context, first = of.context, {law: trials[0] for law, trials in of.trials.items()}
    drawn = {"field": field_figure(context), "trials": trials_figure(of), "comparison": comparison_figure(of)}
    if context.shown:
        drawn["learnt"] = learnt_figure(context)
    if context.mode not in THERAPY:
        drawn["deviation"] = deviation_figure(of)
    if context.mode == "resist":
        drawn["along"] = along_figure(of)
    if pairs := {law: trial for law, trial in first.items() if "helper" in trial}:
        drawn["together"] = together_figure(context, pairs)
    if late := [law for law in BOUNDED if "_acting" in first.get(law, {})]:
        trial = first[late[0]]
        forces = Trace({"t_s": trial["t_s"], "command": trial["force_commanded"], "velocity": trial["_acting"]})
        names, most = ("force x", "force y"), np.full(2, context.problem.robot.motor_limit_N)
        what = f"First trial, {LAW_NAMES[late[0]]}: forces of the motors, which move the robot's own mass, too"
        drawn["robot"] = servo_figure(names, forces, most, lengths=2, what=what, unit="N")
    return drawn


PERCENT = 100.0
MEAN = 1.6
"""[points] Line width of the mean over trials."""
Compared = tuple[str, str, float]
"""Label, key of the measure, and factor to the label's unit."""
SPEED: Compared = ("speed,\nmean [mm/s]", "speed_mean_m_s", MM)
FORCE: Compared = ("measured force,\nmean [N]", "force_measured_mean_N", 1.0)
SMOOTH: Compared = ("smoothness,\nSPARC (0: best)", "smoothness_sparc", 1.0)
WHOLE: Compared = ("deviation,\nmean [mm]", "deviation_mean_m", MM)
IN_THERAPY: Sequence[Compared] = (
    ("deviation outside\n$W_c$, mean [mm]", "deviation_outside_mean_m", MM), FORCE, SPEED, SMOOTH,
    ("distance to the\ntarget at the end\n[mm]", "final_distance_m", MM),
)  # fmt: skip
COMPARED: Mapping[str, Sequence[Compared]] = {
    "hold": (
        WHOLE, ("measured force while\nholding, mean [N]", "force_measured_held_mean_N", 1.0),
        ("speed while holding,\nmean [mm/s]", "speed_held_mean_m_s", MM),
        ("time on\ntarget [%]", "time_on_target_fraction", PERCENT),
    ),
    "follow": (
        WHOLE, FORCE, SPEED, SMOOTH,
        ("path covered\nin order within\n{:g} mm [%]", "reference_covered_fraction", PERCENT),
    ),
}  # fmt: skip
"""Compared measures by mode; the therapy modes have `IN_THERAPY`."""


def comparison_figure(of: ScenarioTrials) -> Figure:
    """Figure with a panel for each measure, and a row for each controller."""
    chosen, laws = COMPARED.get(of.context.mode, IN_THERAPY), list(of.measures)
    figure = framed(
        f"Measures of every trial, by controller: a dot is a trial, a bar their mean. {count_words(of)}",
        0.9 + 0.36 * len(laws),
    )
    panels = figure.subplots(1, len(chosen), sharey=True)
    for axes, (label, key, factor) in zip(panels, chosen, strict=True):
        for row, (law, measures) in enumerate(of.measures.items()):
            values = np.array([factor * each[key] for each in measures if each[key] is not None])
            style: dict[str, Any] = {"color": LAW_COLOURS[law], "markeredgewidth": 0, "clip_on": False}
            axes.plot(values, np.full(len(values), row), "o", alpha=0.5, **style)
            if len(values):
                axes.plot([values.mean()] * 2, [row - 0.25, row + 0.25], **style)
        axes.set_xlabel(label.format(of.context.problem.task.within_mm))
        axes.set_xlim(left=None if key == "smoothness_sparc" else 0.0)
        axes.locator_params(axis="x", nbins=3)
        axes.grid(visible=False, axis="y")
    panels[0].set_yticks(range(len(laws)), [LAW_NAMES[law] for law in laws])
    panels[0].set_ylim(len(laws) - 0.4, -0.7)
    return figure


COLOURS = {"helper": OKABE_ITO[4], "participant": OKABE_ITO[0]}
PEOPLE = {
    "helper": ("helper", "helper_force", "helper_energy_left_J"),
    "participant": ("_hand", "force_commanded", "energy_left_J"),
}
"""Columns of the trace: position of the hand, force on it, and energy in the tank."""


def together_figure(context: Precomputed, pairs: Mapping[Law, Trace]) -> Figure:
    """Figure with a column for the first trial of each controller with a helper."""
    limit = context.problem.assistance.force_limit_N
    figure = framed(
        "The first trial of helper and participant: hands of both in their own workspaces [mm], with what the helper "
        f"means to draw and its image; forces on both hands, at most {limit:g} N (dotted); energy that "
        f"is left in their tanks [J]. n = {max(len(trial['t_s']) for trial in pairs.values())} ticks.",
        7.6,
    )
    grid = figure.subplots(4, len(pairs), squeeze=False, height_ratios=(1.3, 1.8, 1, 1))
    demonstrated = context.reference if context.demonstrated is None else context.demonstrated
    wide = box_around(MM * np.vstack([demonstrated, *(trial["helper"] for trial in pairs.values())]))
    near = shown_box(context, *(trial["_hand"] for trial in pairs.values()))
    label = "path that the helper means to draw, and its image"
    for column, (law, trial) in zip(grid.T, pairs.items(), strict=True):
        rows, boxes, paths = trial.rows, (wide, near), (demonstrated, context.reference)
        for axes, box, path, (who, (hand, force, tank)) in zip(column, boxes, paths, PEOPLE.items(), strict=False):
            style = {"color": COLOURS[who], "label": who}
            draw_plane(axes, context, box)
            draw_reference(axes, context, path, label=label)
            axes.plot(*(MM * trial[hand][rows].T), **style)
            column[2].plot(trial["t_s"][rows], np.linalg.norm(trial[force][rows], axis=1), **style)
            column[3].plot(trial["t_s"][rows], trial[tank][rows], **style)
        column[0].set_title(LAW_NAMES[law])
        column[2].axhline(limit, **FORCE_LIMIT)
        label_times(column[2:], "", "", from_zero=True)
    for axes, label in zip(grid[2:, 0], ("force on\nthe hand [N]", "energy in\nthe tank [J]"), strict=True):
        axes.set_ylabel(label)
    for axes in grid[:2, 1:].ravel():
        axes.set_ylabel("")
    return legend_below(figure)


MEAN_PLACE: Mapping[str, Any] = {"markersize": 9, "markerfacecolor": "none", "markeredgewidth": 1.2, "linestyle": ""}


def trials_figure(of: ScenarioTrials) -> Figure:
    """Figure of the trials: each as a thin line, and their mean as a thick one."""
    context, laws = of.context, list(of.trials)
    box = shown_box(context, *(trial["_hand"] for trials in of.trials.values() for trial in trials))
    tall, across = (box[1][1] - box[1][0]) / (box[0][1] - box[0][0]), min(6.0 / len(laws), 3.0)
    inside = ", green: the fraction of trials whose hand is in $W_c$" if context.mode in THERAPY else ""
    figure = framed(
        f"Every trial (thin) and their mean: position of the hand [mm], measured force{inside}, and speed of the hand. "
        f"{count_words(of)}",
        3.4 + tall * across,
    )
    grid = figure.subplots(3, len(laws), squeeze=False, height_ratios=(tall * across + 0.3, 1.1, 1.1))
    for (plane, force, speed), (law, trials) in zip(grid.T, of.trials.items(), strict=True):
        plane.set_title(LAW_NAMES[law], color=LAW_COLOURS[law])
        draw_plane(plane, context, box)
        draw_reference(plane, context, label="point to be held" if context.mode == "hold" else "reference")
        _draw_paths(plane, of, law)
        if context.mode in THERAPY:
            time, fraction = mean_over_trials(trials, [trial["inside"].astype(np.float64) for trial in trials])
            green: dict[str, Any] = {"color": COMFORTABLE, "alpha": 0.2, "linewidth": 0}
            force.fill_between(time, 0, fraction, step="mid", transform=force.get_xaxis_transform(), **green)
        force.axhline(context.problem.assistance.force_limit_N, **FORCE_LIMIT)
        _draw_over_time(force, law, trials, lambda trial: np.linalg.norm(trial["force_measured"], axis=1))
        _draw_over_time(speed, law, trials, lambda trial: MM * np.linalg.norm(trial["velocity"], axis=1))
        speed.set_xlabel("time [s]")
    for row, label in ((1, "measured\nforce [N]"), (2, "speed of the\nhand [mm/s]")):
        _same_limits(grid[row])
        grid[row, 0].set_ylabel(label)
    for axes in grid[0, 1:]:
        axes.set_ylabel("")
    _label_trials(grid[0, 0], of)
    if context.mode in THERAPY:
        grid[0, 0].fill_between([], [], color=COMFORTABLE, alpha=0.2, label="fraction of trials whose hand is in $W_c$")
    return legend_below(figure)


def _label_trials(axes: Axes, of: ScenarioTrials) -> None:
    count = max(map(len, of.trials.values()))
    axes.plot([], [], color=REFERENCE, linewidth=THIN, alpha=0.6, label=f"one trial of {count}")
    axes.plot([], [], color=REFERENCE, linewidth=MEAN, label="mean of the trials")


def _draw_paths(axes: Axes, of: ScenarioTrials, law: Law) -> None:
    trials, colour, mode = of.trials[law], LAW_COLOURS[law], of.context.mode
    for trial in trials:
        # In "hold", only while a point is held; between two points, NaN breaks the line.
        places = np.where(np.isfinite(trial["goal"]), trial["_hand"], np.nan) if mode == "hold" else trial["_hand"]
        axes.plot(*(MM * places[trial.rows].T), color=colour, linewidth=THIN, alpha=0.6, zorder=5)
    if mode == "hold":
        for point in of.context.reference:
            every = np.vstack([trial["_hand"][(trial["goal"] == point).all(axis=1)] for trial in trials])
            if len(every):
                axes.plot(*(MM * every.mean(axis=0)), "o", **MEAN_PLACE, markeredgecolor=colour, zorder=7)
        axes.plot([], [], "o", **MEAN_PLACE, markeredgecolor=REFERENCE, label="mean place while it was to be held")
    elif mode != "follow":  # no mean of paths that are followed more than once
        _, mean = mean_over_trials(trials, [trial["_hand"] for trial in trials])
        axes.plot(*(MM * mean.T), color=colour, linewidth=MEAN, zorder=5.5)


def _draw_over_time(axes: Axes, law: Law, trials: Sequence[Trace], value: Callable[[Trace], Array]) -> None:
    """Draw a thin line for `value` (N,) of each trial, and a thick one for their mean."""
    values = [value(trial) for trial in trials]
    for trial, of in zip(trials, values, strict=True):
        # The largest value since the previous row, so that no peak is lost.
        peaks = np.maximum.reduceat(of, np.concatenate(([0], trial.rows[:-1] + 1)))
        axes.plot(trial["t_s"][trial.rows], peaks, color=LAW_COLOURS[law], linewidth=THIN, alpha=0.6)
    axes.plot(*mean_over_trials(trials, values), color=LAW_COLOURS[law], linewidth=MEAN)


def _same_limits(row: NDArray[np.object_]) -> None:
    """Set equal limits for the panels of a row: from zero to the largest value, over the longest time."""
    top, right = max(axes.get_ylim()[1] for axes in row), max(axes.get_xlim()[1] for axes in row)
    for axes in row:
        axes.set(xlim=(0, right), ylim=(0, top))


def deviation_figure(of: ScenarioTrials) -> Figure:
    """Figure of the deviations: every trial as a thin line, and their mean as a thick one; all on one scale."""
    context = of.context
    of_what = "the point to be held, while it was" if context.mode == "hold" else "the point of the path that is due"
    figure = framed(
        f"Distance of the hand from {of_what}: every trial (thin) and their mean. {count_words(of)}",
        0.7 + 1.2 * len(of.trials),
    )
    rows = figure.subplots(len(of.trials), 1, sharex=True, sharey=True, squeeze=False)[:, 0]

    def deviation(trial: Trace) -> Array:
        far, counts = deviation_of(trial, context.reference, context.mode)
        return MM * np.where(counts, far, np.nan)

    for axes, (law, trials) in zip(rows, of.trials.items(), strict=True):
        _draw_over_time(axes, law, trials, deviation)
        axes.set_title(LAW_NAMES[law], color=LAW_COLOURS[law])
    label_times(rows, *["deviation [mm]"] * len(rows), from_zero=True)
    _label_trials(rows[0], of)
    return legend_below(figure)
