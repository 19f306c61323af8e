"""Runs of the shipped problems: what the laws achieve, checked with the kinematics and not with their own word."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from rehab_opt.session.drawing import LAW_STYLES
from rehab_opt.session.files import load_problem
from rehab_opt.session.outcome import Outcome
from rehab_opt.session.report import metrics_json, write_trace
from rehab_opt.session.run import run_problem
from rehab_opt.session.trace import Trace
from rehab_opt.session.upper_limb.drive import law_columns
from rehab_opt.session.upper_limb.figures import figures
from rehab_opt.session.upper_limb.problem import UpperLimb
from rehab_opt.session.upper_limb.scene import FollowedPath, verified

Columns = dict[str, NDArray[Any]]


@pytest.fixture(scope="module")
def figure_eight() -> Outcome:
    return run_problem(load_problem("upper_limb/figure_eight"))


def scene_of(outcome: Outcome) -> FollowedPath:
    (scene,) = outcome.scenes.values()
    return scene  # type: ignore[no-any-return]


def trace_of(outcome: Outcome) -> Trace:
    (trace,) = outcome.traces.values()
    return trace


def check_law(outcome: Outcome, law: Columns) -> None:
    """What holds for either law on any path: limits kept, reported positions and tilts those of the joints."""
    arm, path = scene_of(outcome).arm, trace_of(outcome)["path"]
    assert (law["joint"] >= arm.lower - 1e-12).all()
    assert (law["joint"] <= arm.upper + 1e-12).all()
    driven = law["drive_joint"]
    assert (driven >= arm.lower).all()
    assert (driven <= arm.upper).all()
    assert (np.abs(np.diff(driven, axis=0)) <= arm.velocity * 1e-3 * (1 + 1e-9)).all()
    assert (np.abs(np.diff(driven, 2, axis=0)) <= arm.acceleration * 1e-6 * (1 + 1e-6) + 1e-14).all()
    for k in range(0, len(law["joint"]), 37):
        pose = arm.pose(law["joint"][k])
        np.testing.assert_allclose(law["hand"][k], pose[:3, 3], atol=1e-12)
        assert law["position_error_m"][k] == pytest.approx(np.linalg.norm(pose[:3, 3] - path[k]), abs=1e-12)
        assert np.cos(law["handle_tilt_rad"][k]) == pytest.approx(pose[2, 0], abs=1e-9)


def test_shipped_path_is_followed_to_a_micrometre_within_every_limit(figure_eight: Outcome) -> None:
    metrics = figure_eight.metrics
    for law in ("optimised", "published"):
        check_law(figure_eight, law_columns(trace_of(figure_eight), law))
        assert metrics[law]["position_error_reachable_max_m"] == metrics[law]["position_error_max_m"]  # all is in reach
    assert metrics["reachable_fraction_of_length"] == 1.0
    optimised = law_columns(trace_of(figure_eight), "optimised")
    assert optimised["position_error_m"].max() <= 1e-6
    assert optimised["handle_tilt_rad"].max() <= scene_of(figure_eight).tilt + 1e-6
    assert metrics["optimised"]["status_refuted"] == 0
    assert metrics["optimised"]["joint_speed_max_fraction_of_limit"] < 1.0
    assert metrics["optimised"]["drive"]["position_error_max_m"] < 1e-5


def test_claim_that_the_kinematics_does_not_bear_out_is_not_believed(figure_eight: Outcome) -> None:
    honest = law_columns(trace_of(figure_eight), "optimised")
    error = honest["position_error_m"].copy()
    error[5] = 0.02
    believed = verified({**honest, "position_error_m": error})
    assert not believed[5]
    assert believed.sum() == len(error) - 1


def test_numbers_of_a_drive_are_those_of_its_joints(figure_eight: Outcome) -> None:
    trace, chain = trace_of(figure_eight), scene_of(figure_eight).arm
    path, times = trace["path"], trace["t_s"]
    for law in ("optimised", "published"):
        of, told = law_columns(trace, law), figure_eight.metrics[law]["drive"]
        phase, poses = of["drive_phase_s"], np.array([chain.pose(q) for q in of["drive_joint"]])
        tilt = np.rad2deg(np.arccos(np.clip(poses[:, 2, 0], -1, 1))).max()
        assert told["handle_tilt_max_deg"] == pytest.approx(tilt, abs=1e-5)
        asked = np.stack([np.interp(phase, times, column) for column in path.T], axis=1)
        away = np.linalg.norm(poses[:, :3, 3] - asked, axis=1)
        assert told["position_error_max_m"] == pytest.approx(away.max(), abs=1e-12)
        nearest = np.abs(phase[:, None] - times[300:310]).argmin(axis=1) + 300
        for k in range(301, 309):
            at = (nearest == k) & (np.abs(phase - times[k]) < 0.0049)
            assert of["drive_position_error_m"][k] >= away[at].max() - 1e-12
        np.testing.assert_allclose(of["drive"], of["joint"], atol=2e-4)  # each sample is passed, late or not
        assert told["delay_s"] == pytest.approx(of["drive_time_s"][-1] - times[-1], abs=1e-9)
        assert told["joint_acceleration_max_fraction_of_limit"] <= 1.0
        assert told["kept_fraction"] >= 0.99
    assert figure_eight.metrics["optimised"]["drive"]["followed_fraction_of_length"] == 1.0


def test_outside_of_its_limits_a_joint_is_shaded(figure_eight: Outcome) -> None:
    panels, arm = figures(figure_eight)["joints"].axes, scene_of(figure_eight).arm
    for axes, lower, upper in zip(panels, arm.lower, arm.upper, strict=False):
        below, above = (patch.get_extents().transformed(axes.transData.inverted()) for patch in axes.patches)
        assert (below.y1, above.y0) == (pytest.approx(np.rad2deg(lower)), pytest.approx(np.rad2deg(upper)))


def test_tilt_that_no_posture_keeps_is_the_reason_that_is_given() -> None:
    config = load_problem("upper_limb/figure_eight")
    assert isinstance(config.problem, UpperLimb)
    arm = config.problem.arm.model_copy(update={"handle_tilt_deg": 0.01})
    upright = replace(config, problem=config.problem.model_copy(update={"arm": arm}))
    outcome = run_problem(upright, law="optimised")
    ((reason, count),) = outcome.metrics["optimised"]["reasons"].items()
    assert reason == "no posture holds the handle within 0.01 deg: most upright one"
    assert count == outcome.metrics["samples"]
    assert any(reason in note for note in outcome.notes)


def test_numbers_are_strict_json_and_the_trace_has_a_unit_in_every_column(
    figure_eight: Outcome, tmp_path: Path
) -> None:
    def refuse(constant: str) -> float:
        raise AssertionError(constant)

    content = json.loads(metrics_json(figure_eight), parse_constant=refuse)
    assert content["notes"] == list(figure_eight.notes)
    units = ("_s", "_m", "_rad", "_status", "reachable")
    names = [name for name, _ in figure_eight.trace()]
    assert len(set(names)) == len(names)
    assert [name for name in names if not name.endswith(units)] == []
    write_trace(figure_eight, tmp_path / "trace.csv")
    with (tmp_path / "trace.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    trace = trace_of(figure_eight)
    assert len(rows) == len(trace["t_s"])
    assert float(rows[3]["optimised_humeral_flexion_rad"]) == pytest.approx(trace["optimised"][3, 3], rel=1e-8)


@pytest.mark.parametrize(
    ("name", "data", "least", "most"),
    [
        pytest.param("pen_trace", "pen_trace/signal.svc", 1.0, 1.0, marks=pytest.mark.nightly),
        ("mocap_lift", "upper_limb_mocap/markers.trc", 0.35, 0.6),
        pytest.param("mocap_box", "upper_limb_mocap/inverse_kin.mot", 0.45, 0.75, marks=pytest.mark.nightly),
    ],
)
def test_recording_is_followed_where_it_is_within_reach(
    recorded: Callable[[str], Path], name: str, data: str, least: float, most: float
) -> None:
    recorded(data)
    outcome = run_problem(load_problem(f"upper_limb/{name}"))
    metrics, trace, laws = outcome.metrics, trace_of(outcome), ("optimised", "published")
    of = {law: law_columns(trace, law) for law in laws}
    for law in laws:
        check_law(outcome, of[law])
    optimised, reachable = of["optimised"], trace["reachable"]
    assert least <= metrics["reachable_fraction_of_length"] <= most
    assert metrics["optimised"]["status_refuted"] == 0
    assert optimised["position_error_m"][reachable].max() <= 1e-6
    assert optimised["handle_tilt_rad"].max() <= scene_of(outcome).tilt + 1e-6
    for law in laws:
        told = metrics[law]["drive"]
        beyond = told["handle_tilt_max_deg"] > metrics[law]["handle_tilt_limit_deg"] + 0.01
        assert any("HANDLE BEYOND" in note and law in note for note in outcome.notes) == beyond
        assert told["kept_fraction"] is None or told["kept_fraction"] >= 0.99
    assert metrics["optimised"]["drive"]["kept_fraction"] == 1.0
    drawn = figures(outcome)
    if not reachable.all():
        assert optimised["position_error_m"][~reachable].min() > 1e-6
        assert metrics["optimised"]["reasons"] == {"out of reach: nearest posture": int((~reachable).sum())}
        assert any("winds up" in note for note in outcome.notes)
        for law in laws:
            height = 1e3 * np.abs(of[law]["drive_hand"][:, 2] - trace["path"][0, 2]).max()
            labels = [text.get_text() for text in drawn["hand_path"].legends[0].get_texts()]
            (said,) = [label for label in labels if label.startswith(LAW_STYLES[law]["label"])]
            assert (f"up to {height:.0f} mm off the plane" in said) == (height >= 1.0)
