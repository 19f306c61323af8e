"""Maps of problem files: both rules, both directions, and what they do to trajectories."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rehab_opt.errors import ProblemFileError
from rehab_opt.session.files import load_problem, problem_of
from rehab_opt.session.outcome import Outcome
from rehab_opt.session.report import metrics_json
from rehab_opt.session.run import checked, run_problem
from rehab_opt.session.systems import NotMet
from rehab_opt.session.workspace_maps.figures import figures as map_figures
from rehab_opt.session.workspace_maps.made import Direction
from tests.refusals import refuses

CONTENT: dict[str, Any] = {
    "system": "workspace_map",
    "title": "test",
    "source": "regular",
    "target": "restricted",
    "arm": {"side": "left", "accuracy_mm": 5.0, "range_of_motion": {"regular": "regular", "restricted": "restricted"}},
    "map": {"rules": ["polar"], "directions": "forward", "audit_points": 500},
}


def run(content: dict[str, Any], path: Path = Path("test.toml")) -> Outcome:
    return run_problem(problem_of(content, name="test", file="test.toml", path=path))


def directions_of(outcome: Outcome) -> list[Direction]:
    (scene,), (trace,) = outcome.scenes.values(), outcome.traces.values()
    return list(scene.directions(trace))


@pytest.fixture(scope="module")
def shipped() -> Outcome:
    return run_problem(load_problem("upper_limb/workspace_map"))


def test_safe_rule_folds_nowhere_and_stays_inside_both_ways_where_the_published_one_does_not(
    shipped: Outcome,
) -> None:
    maps = shipped.metrics["maps"]
    assert list(maps) == ["source_to_target", "target_to_source"]
    for numbers in maps.values():
        safe, polar = numbers["safe"], numbers["polar"]
        assert (safe["folded_fraction"], safe["outside_fraction"]) == (0.0, 0.0)
        assert safe["certificate"]["valid"]
        assert safe["certificate"]["margin_m"] >= safe["target_accuracy_m"] == pytest.approx(1e-3)
        assert safe["passed"]
        assert safe["round_trip_max_m"] <= 1e-9
        assert polar["folded_fraction"] > 0.1
        assert polar["outside_fraction"] > 0.1
        assert not polar["passed"]
        assert polar["coefficients"] == 20
    assert any("regular -> restricted, polar rule" in note for note in shipped.notes if "NOT FOR A CONTROLLER" in note)
    assert 0.25 <= maps["source_to_target"]["polar"]["folded_fraction"] <= 0.45
    json.loads(metrics_json(shipped), parse_constant=pytest.fail)


def test_figures_show_each_direction_on_one_scale(shipped: Outcome) -> None:
    drawn = map_figures(shipped)
    assert len(drawn) == 4
    figure = drawn["map_source_to_target"]
    figure.draw_without_rendering()
    panels = figure.axes
    assert len(panels) == 6
    across = [
        line.get_xdata()[0]
        for line in panels[0].get_lines()
        if len(line.get_xdata()) > 1 and not np.ptp(line.get_xdata())
    ]
    assert len(set(across)) > 10  # upright lines of the grid
    for axes in panels[4:]:  # a millimetre is as many pixels, of the same part of the plane
        np.testing.assert_allclose(axes.viewLim.bounds, panels[3].viewLim.bounds)
        np.testing.assert_allclose(axes.bbox.size, panels[3].bbox.size, rtol=1e-3)


def test_trajectories_are_carried_by_the_map_that_starts_where_they_lie(shipped: Outcome) -> None:
    columns = dict(shipped.trace())
    assert len({len(column) for column in columns.values()}) == 1
    names = np.array(columns["trajectory"])
    for direction in directions_of(shipped):
        (name,) = direction.before
        rows = np.flatnonzero(names == name)
        before = np.column_stack([np.array(columns[f"before_{axis}_m"], dtype=float)[rows] for axis in "xy"])
        after = np.column_stack([np.array(columns[f"safe_after_{axis}_m"], dtype=float)[rows] for axis in "xy"])
        safe = direction.maps[0].mapped
        assert safe is not None
        np.testing.assert_allclose(after, safe(before), atol=1e-12)
        assert np.all(direction.end_space.contains(after))
        np.testing.assert_allclose(safe.inverse(after), before, atol=1e-9)


def test_path_outside_its_set_is_mapped_from_the_nearest_points_and_said(tmp_path: Path) -> None:
    (tmp_path / "line.csv").write_text("t_s,x_m,y_m\n0,0,0\n1,0.3,0\n", encoding="utf-8")
    line = {
        "name": "line",
        "set": "source",
        "recording": {"file": "line.csv", "hand": "right", "mirror": True},
        "placement": {"centre_m": [0.15, 0.5]},
    }
    content, path = {**CONTENT, "trajectory": [line]}, tmp_path / "test.toml"
    found = checked(problem_of(content, name="test", file="test.toml", path=path))
    outcome = run(content, path)
    numbers = outcome.metrics["maps"]["source_to_target"]["trajectories"]["line"]
    assert 0.2 < numbers["outside_start_fraction"] < 0.8
    (said,) = (note for note in outcome.notes if "line: " in note and "nearest point of the set" in note)
    assert [note for note in found if isinstance(note, NotMet)] == [said]
    (direction,) = directions_of(outcome)
    assert direction.before["line"][0, 0] > direction.before["line"][-1, 0]  # mirrored
    assert np.isfinite(direction.after["polar"]["line"]).all()


def test_sets_of_two_people_in_one_robots_frame_can_be_mapped() -> None:
    one = {"side": "left", "range_of_motion": "restricted", "accuracy_mm": 2.0}
    other = {**one, "side": "right", "shoulder_m": [0.4, 0.1, 0.0], "segments": {"humerus_mm": 250.0}}
    content = {**CONTENT, "source": one, "target": other}
    del content["arm"]
    outcome = run(content)
    assert [of["name"] for of in outcome.metrics["sets"].values()] == ["source", "target"]
    assert outcome.metrics["sets"]["target"]["x_min_m"] > 0.4
    assert any("robot's frame" in note for note in outcome.notes)


def test_set_that_is_empty_is_refused_with_its_reason() -> None:
    arm = {**CONTENT["arm"], "handle_tilt_deg": 0.1}
    with pytest.raises(ProblemFileError, match=r"source = .*not empty \(no posture holds the handle"):
        run({**CONTENT, "arm": arm, "source": "restricted", "target": "regular"})


TRAJECTORY = {
    "name": "a",
    "set": "source",
    "recording": {"file": "none.csv", "hand": "left"},
    "placement": {"centre_m": [0, 0]},
}


def test_fault_is_refused_with_its_key(tmp_path: Path) -> None:
    def read(**values: Any) -> None:
        content = {key: value for key, value in {**CONTENT, **values}.items() if value is not None}
        checked(problem_of(content, name="test", file="test.toml", path=tmp_path / "test.toml"))

    other = {**TRAJECTORY, "recording": {"file": "a.csv", "hand": "right"}}
    high = {**TRAJECTORY, "placement": {"centre_m": [0, 0], "plane_height_m": 0}}
    refuses(
        read,
        ({"source": "regulr"}, "source", "the name of a range of arm.range_of_motion (regular, restricted)"),
        ({"target": "regular"}, "target", "another set than the source"),
        ({"arm": {}}, "arm"),
        ({"arm": None}, "source", "(there is none)"),
        ({"source": {"side": "left"}}, "source.range_of_motion", "this key"),
        ({"map": {"rules": ["safe", "safe"]}}, "map.rules", "each one once"),
        ({"map": {"rotation_deg": "worst"}}, "map.rotation_deg", "'best'"),
        ({"trajectory": [TRAJECTORY]}, "trajectory.0.recording.file", "a recording beside the problem file"),
        ({"trajectory": [TRAJECTORY, TRAJECTORY]}, "trajectory.1.name", "each name once"),
        ({"trajectory": [{**TRAJECTORY, "set": "target"}]}, "trajectory.0.set", '"source", since'),
        ({"trajectory": [high]}, "trajectory.0.placement.plane_height_m", "one of the keys"),
        ({"trajectory": [other]}, "trajectory.0.recording.mirror", "true, since a right hand"),
        error=ProblemFileError,
    )
