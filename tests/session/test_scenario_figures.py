"""Table, trace and figures of scenarios: complete, finite, and readable where they are read."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely

from rehab_opt.control.command import Relaxed
from rehab_opt.control.gate import Mode
from rehab_opt.session.drawing import THIN
from rehab_opt.session.scenario.field_figures import gated_forces
from rehab_opt.session.scenario.figures import trials_figure
from rehab_opt.session.scenario.plane_drawing import mean_over_trials
from rehab_opt.session.scenario.problem import AssistanceSection
from rehab_opt.session.scenario.trials import RATE, thinned_ticks
from tests.session.made_trials import COMFORTABLE, REACHABLE, made_outcome, trial_of

# ---------------------------------------------------------------------------------------------------------- figures


def test_every_trial_is_a_line_and_no_peak_of_a_force_is_lost() -> None:
    outcome = made_outcome("assist", trials=4, laws=("assisted",))
    outcome.trials["assisted"][2]["force_measured"][101] = (0.0, 27.0)  # between two ticks that are drawn
    place, force, speed = trials_figure(outcome).axes
    for axes in (place, force, speed):
        lines = (line for line in axes.get_lines() if np.asarray(line.get_xydata()).size)
        thin = [line for line in lines if line.get_linewidth() == THIN and line.get_linestyle() == "-"]
        assert len(thin) == 4
    assert force.get_ylabel() == "measured\nforce [N]"
    assert max(np.asarray(line.get_ydata()).max() for line in force.get_lines()[1:]) == pytest.approx(27.0, abs=0.01)


def test_mean_over_trials_is_of_those_under_way_and_ends_with_half_of_them() -> None:
    trials = [trial_of(np.zeros((length, 2))) for length in (10, 30, 20)]
    time, mean = mean_over_trials(trials, [np.full(len(of["t_s"]), float(i)) for i, of in enumerate(trials)])
    assert len(time) == 20
    assert mean[:10].tolist() == [1.0] * 10
    assert mean[10:].tolist() == [1.5] * 10


@pytest.mark.parametrize("mode", ["stretch", "assist", "resist"])
def test_drawn_field_is_zero_within_the_comfortable_workspace_in_therapy(mode: Mode) -> None:
    context, points = made_outcome(mode, trials=1).context, _spread_points()
    forces, inside = gated_forces(context, points), np.asarray(COMFORTABLE.contains(points))
    there = np.asarray(REACHABLE.contains(points))
    assert not forces[inside].any()
    assert np.isnan(forces[~there]).all()
    drawn, whole = there & ~inside, context.fields[0].force(points)
    assert np.allclose(forces[drawn], whole[drawn])
    context.problem.assistance = AssistanceSection(onset_mm=100.0)
    share = np.minimum(np.asarray(COMFORTABLE.distance(points[drawn])) / 0.1, 1.0)
    assert np.allclose(gated_forces(context, points)[drawn], share[:, None] * whole[drawn])


@pytest.mark.parametrize("mode", ["follow", "hold"])
def test_drawn_field_is_within_the_comfortable_workspace_alone_in_help(mode: Mode) -> None:
    context, points = made_outcome(mode, trials=1).context, _spread_points()
    forces, inside = gated_forces(context, points), np.asarray(COMFORTABLE.contains(points))
    assert np.isnan(forces[~inside]).all()
    assert np.isfinite(forces[inside]).all()
    if mode == "hold":  # a spring to the nearest of the points
        away = context.reference[None] - points[inside][:, None]
        nearest = away[np.arange(inside.sum()), np.linalg.norm(away, axis=2).argmin(axis=1)]
        assert np.allclose(forces[inside], 3500.0 * nearest)
    else:  # a spring across the path
        context = replace(context, drag=0.0, numbers={"stiffness": 100.0})
        drawn = np.linalg.norm(gated_forces(context, points)[inside], axis=1)
        path = shapely.LineString(context.fields[0].paths[0].points)
        assert np.allclose(drawn, 100.0 * shapely.distance(path, shapely.points(points[inside])))


def _spread_points() -> np.ndarray:
    return np.random.default_rng(3).uniform((-0.3, 0.15), (0.3, 0.75), (400, 2))


# --------------------------------------------------------------------------------------------------- table and trace


def test_trace_has_a_row_a_kept_tick_and_a_unit_in_every_header() -> None:
    trial = made_outcome("hold", trials=1).trials["assisted"][0]
    columns = dict(trial.written())
    assert {len(column) for column in columns.values()} == {len(thinned_ticks(trial["t_s"]))}
    for name in set(columns) - {"inside", "status", "relaxed"}:
        assert name.endswith(("_m", "_m_s", "_N", "_J", "_s")), name
    assert np.isnan(columns["goal_x_m"]).any()
    assert not any(word == "nan" for column in columns.values() for word in column)


def test_trace_is_thinned_to_at_most_a_hundred_rows_a_second_with_both_ends() -> None:
    for dt, expected in ((0.001, 0.010), (0.002, 0.010), (0.003, 0.012), (0.010, 0.010), (0.040, 0.040)):
        trial = trial_of(np.zeros((1001, 2)), dt=dt)
        ticks, time = thinned_ticks(trial["t_s"]), trial["t_s"]
        assert np.median(np.diff(time[ticks])) == pytest.approx(expected)
        assert np.median(np.diff(time[ticks])) >= 1 / RATE - 1e-9
        assert (ticks[0], ticks[-1]) == (0, 1000)


def test_a_bound_that_yields_between_two_rows_is_in_the_second_and_in_no_other() -> None:
    relaxed = np.zeros(41, dtype=np.uint8)
    relaxed[13], relaxed[17], relaxed[30] = int(Relaxed.SLEW), int(Relaxed.TASK), int(Relaxed.SLEW)
    said = dict(trial_of(np.zeros((41, 2)), dt=0.001, _relaxed=relaxed).written())["relaxed"]
    assert list(said) == ["", "", "task, slew", "slew", ""]
