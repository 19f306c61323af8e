"""Table, trace and figures of scenarios: complete, finite, and readable where they are read."""

from __future__ import annotations

import io
import itertools
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest
import shapely
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure
from matplotlib.text import Text
from PIL import Image
from rich.console import Console
from rich.table import Table

from rehab_opt.control.command import Relaxed
from rehab_opt.control.gate import Mode
from rehab_opt.session.scenario.field_figures import (
    along_figure,
    field_figure,
    fields_along,
    force_along,
    gated_forces,
    variants,
)
from rehab_opt.session.scenario.figures import deviation_figure, figures, max_between, trials_figure
from rehab_opt.session.scenario.outcome import RATE, ScenarioOutcome, thinned_ticks
from rehab_opt.session.scenario.plane_drawing import LAW_NAMES, mean_over_trials, shown_box
from rehab_opt.session.scenario.problem import REACHES
from rehab_opt.session.scenario.table import brief, table
from tests.session.made_trials import ALONE, COMFORTABLE, REACHABLE, WITHIN, made_outcome, trial_of

NAMES: dict[Mode, set[str]] = {
    "stretch": {"field", "trials", "comparison", "parameters"},
    "assist": {"field", "trials", "comparison", "parameters"},
    "resist": {"field", "trials", "comparison", "parameters", "along"},
    "follow": {"field", "trials", "comparison", "parameters", "deviation"},
    "hold": {"field", "trials", "comparison", "deviation"},
}
MODES = tuple(NAMES)


def words(figure: Figure) -> str:
    """All that is written in a figure."""
    return "\n".join(text.get_text() for text in figure.findobj(Text))


def lines(figure: Figure) -> Iterator[np.ndarray]:
    for axes in figure.axes:
        for line in axes.get_lines():
            yield np.asarray(line.get_xydata(), dtype=float)


# ---------------------------------------------------------------------------------------------------------- figures
@pytest.mark.parametrize("mode", MODES)
def test_figures_of_every_mode_are_there_and_can_be_drawn(mode: Mode) -> None:
    drawn = figures(made_outcome(mode))
    assert set(drawn) == NAMES[mode]
    for name, figure in drawn.items():
        assert "Made by hand" in words(figure), name
        file = io.BytesIO()
        figure.savefig(file, dpi=40)
        image = np.asarray(Image.open(file).convert("L"))
        assert image.std() > 5, f"{name} is blank"
        for data in lines(figure):
            assert not np.isinf(data).any(), name
    for law in ALONE:
        assert LAW_NAMES[law] in words(drawn["trials"])
        assert law in words(drawn["comparison"])


@pytest.mark.parametrize("mode", MODES)
def test_a_target_is_marked_only_where_the_hand_has_to_reach_that_point(mode: Mode) -> None:
    """Of a line to be stretched to any place will do, and the table measures the distance to the nearest."""
    assert ("target" in words(trials_figure(made_outcome(mode)))) == (mode in REACHES)


@pytest.mark.parametrize("laws", [("assisted",), ("unassisted", "assisted")])
def test_figures_are_drawn_of_the_laws_that_were_run(laws: tuple[str, ...]) -> None:
    outcome = made_outcome("resist", trials=1, laws=laws)  # type: ignore[arg-type]
    trials, along = trials_figure(outcome), along_figure(outcome)
    assert len(trials.axes) == 3 * len(laws)
    assert LAW_NAMES["published"] not in words(trials)
    assert words(along).count("in the trials") == 1


def test_every_trial_is_a_line_and_no_peak_of_a_force_is_lost() -> None:
    outcome = made_outcome("assist", trials=4, laws=("assisted",))
    outcome.trials["assisted"][2].measured[101] = (0.0, 27.0)  # between two ticks that are drawn
    place, force, speed = trials_figure(outcome).axes
    for axes in (place, force, speed):
        thin = [line for line in axes.get_lines() if line.get_linewidth() == 0.8 and np.asarray(line.get_xydata()).size]
        assert len(thin) == 4
    assert force.get_ylabel() == "measured force [N]"
    assert max(np.asarray(line.get_ydata()).max() for line in force.get_lines()[1:]) == pytest.approx(27.0, abs=0.01)


@pytest.mark.parametrize("mode", ["follow", "hold"])
def test_largest_deviation_of_the_figure_is_that_of_the_table(mode: Mode) -> None:
    outcome = made_outcome(mode, laws=("unassisted",))
    drawn = [np.asarray(line.get_ydata()) for line in deviation_figure(outcome).axes[0].get_lines()]
    most = max(np.nanmax(values) for values in drawn if values.size)
    assert most == pytest.approx(1e3 * max(of["deviation_max_m"] for of in outcome.measures["unassisted"]), rel=1e-9)


def test_number_of_trials_is_said_so_that_one_is_none_of_many() -> None:
    for count in (1, 3):
        assert f"trials under each law: {count}" in words(
            trials_figure(made_outcome("assist", trials=count, laws=("assisted",)))
        )


def test_every_point_lies_within_the_box_that_is_shown_with_the_same_room_on_all_sides() -> None:
    points = np.random.default_rng(5).normal(0.3, 0.1, (50, 2))
    low, high = (np.array(each) for each in zip(*shown_box(points), strict=True))
    below, above = 1e3 * points.min(axis=0) - low, high - 1e3 * points.max(axis=0)
    assert below.min() > 0
    np.testing.assert_allclose(np.concatenate([below, above]), below[0])


def test_largest_between_two_kept_ticks_is_kept() -> None:
    values = np.array([1.0, 5.0, 2.0, 0.0, 7.0, 3.0])
    assert max_between(values, np.array([0, 2, 5])).tolist() == [1.0, 5.0, 7.0]


def test_mean_over_trials_is_of_those_under_way_and_ends_with_half_of_them() -> None:
    trials = [trial_of(np.zeros((length, 2))) for length in (10, 30, 20)]
    time, mean = mean_over_trials(trials, [np.full(len(of.time), float(i)) for i, of in enumerate(trials)])
    assert len(time) == 20
    assert mean[:10].tolist() == [1.0] * 10
    assert mean[10:].tolist() == [1.5] * 10


@pytest.mark.parametrize("mode", ["stretch", "assist", "resist"])
def test_drawn_field_is_zero_within_the_comfortable_workspace_in_therapy(mode: Mode) -> None:
    outcome, points = made_outcome(mode, trials=1), _spread_points()
    forces, inside = gated_forces(outcome, points), np.asarray(COMFORTABLE.contains(points))
    there = np.asarray(REACHABLE.contains(points))
    assert not forces[inside].any()
    assert np.isnan(forces[~there]).all()
    drawn, whole = there & ~inside, outcome.fields[0].force(points)
    assert np.allclose(forces[drawn], whole[drawn])
    outcome = replace(outcome, onset=0.1)
    share = np.minimum(np.asarray(COMFORTABLE.distance(points[drawn])) / 0.1, 1.0)
    assert np.allclose(gated_forces(outcome, points)[drawn], share[:, None] * whole[drawn])


@pytest.mark.parametrize("mode", ["follow", "hold"])
def test_drawn_field_is_within_the_comfortable_workspace_alone_in_help(mode: Mode) -> None:
    outcome, points = made_outcome(mode, trials=1), _spread_points()
    forces, inside = gated_forces(outcome, points), np.asarray(COMFORTABLE.contains(points))
    assert np.isnan(forces[~inside]).all()
    assert np.isfinite(forces[inside]).all()
    if mode == "hold":  # a spring to the nearest of the points
        away = outcome.reference[None] - points[inside][:, None]
        nearest = away[np.arange(inside.sum()), np.linalg.norm(away, axis=2).argmin(axis=1)]
        assert np.allclose(forces[inside], 3500.0 * nearest)
    else:  # a spring across the path
        outcome = replace(outcome, spring=100.0)
        drawn = np.linalg.norm(gated_forces(outcome, points)[inside], axis=1)
        path = shapely.LineString(outcome.fields[0].paths[0].points)
        assert np.allclose(drawn, 100.0 * shapely.distance(path, shapely.points(points[inside])))


def _spread_points() -> np.ndarray:
    return np.random.default_rng(3).uniform((-0.3, 0.15), (0.3, 0.75), (400, 2))


def test_colours_end_at_the_force_limit() -> None:
    figure = field_figure(made_outcome("stretch", trials=1))
    meshes = [of for axes in figure.axes for of in axes.collections if isinstance(of, QuadMesh) and of.get_clip_path()]
    assert any(mesh.get_clim() == (0.0, 30.0) and np.asarray(mesh.get_array()).max() <= 30.0 for mesh in meshes)


def test_parameters_change_one_at_a_time() -> None:
    of = variants(made_outcome("assist", trials=1))
    for before, after in itertools.pairwise(of):
        assert sum(before[i] != after[i] for i in (1, 2, 3)) == 1


def test_published_resistance_falls_to_nothing_at_the_target_and_ours_is_largest_there() -> None:
    outcome = made_outcome("resist", trials=1)
    fraction = np.array([0.3, 0.6, 0.9])
    points = outcome.reference[0] + fraction[:, None] * np.diff(outcome.reference, axis=0)
    whole, without = fields_along(outcome), fields_along(outcome, drags=False)
    ours, published = (force_along(whole[law], points) - force_along(without[law], points) for law in whole)
    # Without the smoothing of width sigma: -2 k1 travelled, and Eq. (21)'s -2 |k1| remaining.
    assert np.allclose(ours, -2 * 40.0 * 0.2 * fraction, atol=2.0)
    assert np.allclose(published, -2 * 40.0 * 0.2 * (1 - fraction), atol=2.0)
    assert np.all(np.diff(ours) < -2.0)
    assert np.all(np.diff(published) > 2.0)


# --------------------------------------------------------------------------------------------------- table and trace
@pytest.mark.parametrize("mode", MODES)
def test_table_fits_a_hundred_columns_and_names_every_law(mode: Mode) -> None:
    text = _printed(made_outcome(mode))
    assert max(map(len, text.splitlines())) <= 100
    for heading in ("unassisted", "assisted", "published", "Deviation", "Force", "Speed and time", "Clinical measures"):
        assert heading in text
    assert "nan" not in text
    assert "…" not in text
    assert ("SPARC" in text) == (mode != "hold")


@pytest.mark.parametrize(
    ("mode", "said"),
    [("stretch", "the end on the path"), ("assist", "at rest at the target in time,"),
     ("resist", "at rest at the target in time,"), ("follow", "95 % covered, the end"),
     ("hold", "each point reached")],
)  # fmt: skip
def test_table_says_what_success_is(mode: Mode, said: str) -> None:
    assert f"success: {said} within {1e3 * WITHIN:g} mm" in " ".join(_printed(made_outcome(mode)).split())


@pytest.mark.parametrize("mode", ["follow", "assist", "hold"])
def test_what_is_printed_first_are_success_deviation_and_force(mode: Mode) -> None:
    outcome = made_outcome(mode, trials=2)
    file = io.StringIO()
    Console(file=file, width=100).print(brief(outcome))
    text = file.getvalue()
    assert brief(outcome).row_count <= (10 if mode == "follow" else 9)  # and where the person meant to be
    assert "…" not in text
    for part in ("trials that succeeded", "deviation, largest", "force measured, largest", *outcome.measures):
        assert part in text
    rows = [line for line in text.splitlines() if "trials that succeeded" in line or "covered in order" in line]
    assert len(rows) == 1 + (mode == "follow")
    # A hand may cut a corner by as much: what is covered says within what, and stands first.
    assert (f"path covered in order, within {1e3 * WITHIN:g} mm, %" in rows[0]) == (mode == "follow")


@pytest.mark.parametrize("shown", [brief, table])
def test_distance_at_the_end_stands_beside_the_share_that_succeeded(shown: Callable[[ScenarioOutcome], Table]) -> None:
    """One law ended 4.4 mm off and succeeded, another 5.6 mm, at a threshold of 5 mm: 100 and 0 %."""
    outcome = made_outcome("assist", trials=2)
    for law, away in (("assisted", (0.0042, 0.0046)), ("published", (0.0055, 0.0057))):
        for of, distance in zip(outcome.measures[law], away, strict=True):
            of |= {"final_distance_m": distance, "success": distance <= WITHIN}  # type: ignore[operator]
    file = io.StringIO()
    Console(file=file, width=150).print(shown(outcome))
    row = next(line for line in file.getvalue().splitlines() if "trials that succeeded" in line)
    assert "100; 4.4 (4.6)" in row
    assert "0; 5.6 (5.7)" in row


def test_table_says_when_a_target_was_never_reached() -> None:
    outcome = made_outcome("assist", trials=2)
    for of in outcome.measures["unassisted"]:
        of["time_to_target_s"] = None  # type: ignore[index]
    row = next(line for line in _printed(outcome).splitlines() if "time to the target" in line)
    assert "never" in row


def _printed(outcome: ScenarioOutcome) -> str:
    file = io.StringIO()
    Console(file=file, width=100).print(table(outcome))
    return file.getvalue()


def test_trace_has_a_row_a_kept_tick_and_a_unit_in_every_header() -> None:
    outcome = made_outcome("hold", trials=2)
    columns = dict(outcome.trace())
    lengths = {len(column) for column in columns.values()}
    trials = [trial for of in outcome.trials.values() for trial in of]
    assert lengths == {sum(len(thinned_ticks(trial)) for trial in trials)}
    assert set(columns["law"]) == set(outcome.trials)
    bare = {"law", "trial", "inside", "status", "relaxed"}
    for name in set(columns) - bare:
        assert name.endswith(("_m", "_m_s", "_N", "_J", "_s")), name
    assert np.isnan(columns["goal_x_m"]).any()
    assert not any(word == "nan" for column in columns.values() for word in column)


def test_a_helper_is_in_the_trace_and_the_figures_and_others_cells_are_empty() -> None:
    outcome = made_outcome("follow", trials=1, laws=("unassisted", "together"))
    columns = dict(outcome.trace())
    helper, place = columns["helper_x_m"], columns["x_m"]
    for law, cell, x in zip(columns["law"], helper, place, strict=True):
        assert np.isnan(cell) if law == "unassisted" else cell == 3.0 * x  # type: ignore[operator]
    assert "together" in figures(outcome)
    assert "helper_x_m" not in dict(made_outcome("follow", trials=1).trace())


def test_trace_is_thinned_to_at_most_a_hundred_rows_a_second_with_both_ends() -> None:
    for dt, expected in ((0.001, 0.010), (0.002, 0.010), (0.003, 0.012), (0.010, 0.010), (0.040, 0.040)):
        trial = trial_of(np.zeros((1001, 2)), dt=dt)
        ticks = thinned_ticks(trial)
        assert np.median(np.diff(trial.time[ticks])) == pytest.approx(expected)
        assert np.median(np.diff(trial.time[ticks])) >= 1 / RATE - 1e-9
        assert (ticks[0], ticks[-1]) == (0, 1000)


def test_a_bound_that_yields_between_two_rows_is_in_the_second_and_in_no_other() -> None:
    relaxed = np.zeros(41, dtype=np.uint8)
    relaxed[13], relaxed[17], relaxed[30] = int(Relaxed.SLEW), int(Relaxed.TASK), int(Relaxed.SLEW)
    outcome = made_outcome("assist", trials=1, laws=("assisted",))
    outcome.trials["assisted"] = (trial_of(np.zeros((41, 2)), dt=0.001, relaxed=relaxed),)  # type: ignore[index]
    said = dict(outcome.trace())["relaxed"]
    assert list(said) == ["", "", "task, slew", "slew", ""]
