"""The circle a robot is asked to follow, and that it follows it."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rehab_opt import Clearance, MovingCapsule, ProblemFileError
from rehab_opt.kinematics.ur5 import ur5
from rehab_opt.session.clearance import nearest_bodies
from rehab_opt.session.files import load_problem, shipped_folder
from rehab_opt.session.outcome import Outcome
from rehab_opt.session.pose_tracking import CircleSection, circle_reference
from rehab_opt.session.run import checked, run_problem
from rehab_opt.session.systems import NotMet, system_named
from rehab_opt.session.trace import Trace
from tests.control.clearance_world import least_distance, link_ends
from tests.refusals import refuses

START = ur5().pose(np.deg2rad([0.0, -90.0, 90.0, -90.0, -90.0, 0.0]))


def trace_of(outcome: Outcome) -> Trace:
    (trace,) = outcome.traces.values()
    return trace


direction = st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1))


@given(normal=direction, towards=direction, turns=st.floats(0.2, 3), swing=st.floats(0, 90))
def test_twist_is_the_derivative_of_the_pose(
    normal: tuple[float, ...], towards: tuple[float, ...], turns: float, swing: float
) -> None:
    if np.linalg.norm(np.cross(normal, towards)) < 1e-2:
        return
    circle = CircleSection(
        radius_m=0.1, normal=list(normal), towards=list(towards), turns=turns, duration_s=4.0, swing_deg=swing
    )
    h = 1e-5
    times = np.array([1.3 - h, 1.3, 1.3 + h])
    poses, twists = circle_reference(START, circle, times)
    np.testing.assert_allclose(twists[1, :3], (poses[2, :3, 3] - poses[0, :3, 3]) / (2 * h), atol=1e-6)
    spin = (poses[2, :3, :3] - poses[0, :3, :3]) / (2 * h) @ poses[1, :3, :3].T
    np.testing.assert_allclose(twists[1, 3:], [spin[2, 1], spin[0, 2], spin[1, 0]], atol=1e-6)


def test_circle_starts_and_ends_at_rest_in_the_starting_pose_and_keeps_its_radius() -> None:
    circle = CircleSection(radius_m=0.1, turns=2.0, duration_s=4.0, swing_deg=30.0)
    poses, twists = circle_reference(START, circle, np.array([0.0, 4.0]))
    np.testing.assert_allclose(poses, [START, START], atol=1e-12)
    np.testing.assert_allclose(twists, 0, atol=1e-12)
    circle = CircleSection(radius_m=0.1, normal=[0.0, 1.0, 0.0], towards=[0.0, 0.0, 1.0], duration_s=4.0)
    poses, _ = circle_reference(START, circle, np.linspace(0, 4, 50))
    np.testing.assert_allclose(np.linalg.norm(poses[:, :3, 3] - START[:3, 3] - [0, 0, 0.1], axis=1), 0.1, atol=1e-12)
    np.testing.assert_allclose(poses[:, 1, 3], START[1, 3], atol=1e-12)


def test_a_start_within_a_margin_is_said_by_check_and_by_the_run_of_whom_and_by_how_much(tmp_path: Path) -> None:
    shipped = load_problem("robot/ur5_among_bodies")
    assert not any("starts" in each for each in checked(shipped))
    file = tmp_path / "within.toml"
    file.write_text(shipped.path.read_text().replace("centre_m = [-0.5, 0.0, 0.1]", "centre_m = [-0.5, -0.1, 0.45]"))
    config = load_problem(str(file))
    (whole,) = (each for each in checked(config) if "starts" in each)
    note = whole.split("; ")[0]
    said = re.fullmatch(r"the robot starts (\d+(?:\.\d+)?) mm within the margin: (.+) and table", note)
    assert said is not None, note
    start = np.deg2rad([[0.0, -90.0, 90.0, -90.0, -90.0, 0.0]])
    near = nearest_bodies(config.problem.clearance, config.file, ur5(), start, np.zeros(1))
    assert near is not None
    deepest = near.metrics["min_beyond_margin_m"]
    assert -1e3 * deepest == pytest.approx(float(said[1]), rel=1e-2)
    assert float(said[1]) > 40.0  # half of the table's thickness and the margin, at least
    assert near.note == f"{note}; bodies came {said[1]} mm within the margin: {said[2]} and table, at 0 s"


def test_shipped_robot_among_bodies_comes_to_its_margin_and_goes_on() -> None:
    outcome = run_problem(load_problem("robot/ur5_among_bodies"))
    ((scene,), trace) = outcome.scenes.values(), trace_of(outcome)
    near = scene.near(trace)
    pairs = near.pairs
    ends, given = link_ends(pairs.chain, trace["joint"][::10]), pairs.clearance
    found, trays = [], []
    for each, time in zip(ends, trace["t_s"][::10], strict=True):
        y = -0.8 + 0.65 * np.sin(np.pi * time / 8.0) ** 2
        tray = MovingCapsule((-0.75, y, 0.45), (-0.45, y, 0.45), 0.05)
        found.append(least_distance(pairs.chain, given, each, [tray], np.array(pairs.free)))
        trays.append(least_distance(pairs.chain, Clearance(margin=given.margin), each, [tray], np.array(pairs.free)))
    assert 0.0 <= min(found) < 2e-3
    assert -1e-9 <= min(trays) < 5e-3
    assert any("tray" in pair for pair in near.names)
    assert min(found) == pytest.approx(
        near.distances[::10, len(pairs.linked) :].min(), abs=1e-6
    )  # of the links among each other nothing is asked here
    assert outcome.metrics["optimised"]["clearance"]["min_beyond_margin_m"] == pytest.approx(near.distances.min())
    assert outcome.metrics["optimised"]["scale_min"] < 0.5
    assert "clearance" in system_named("pose_tracking").figures(outcome)


PATH = """system = "pose_tracking"
title = "Along a file"
[robot]
model = "ur5"
start_deg = [0.0, -70.0, 90.0, -110.0, -90.0, 0.0]
[path]
file = "path.csv"
"""


def written(folder: Path, points: np.ndarray, text: str = PATH) -> Path:
    np.savetxt(folder / "path.csv", points, delimiter=",", header="t_s,x_m,y_m,z_m", comments="", fmt="%.9g")
    (folder / "path.toml").write_text(text)
    return folder / "path.toml"


def eight(rng: np.random.Generator, seconds: float) -> np.ndarray:
    """Uneven stamps, and a figure eight in space from rest to rest."""
    times = np.cumsum(rng.uniform(0.005, 0.06, round(seconds / 0.0325)))
    u = (times - times[0]) / (times[-1] - times[0])
    a = 2 * np.pi * (10 * u**3 - 15 * u**4 + 6 * u**5)
    return np.column_stack(
        (times + rng.uniform(0, 1e3), 0.07 * np.sin(a), 0.04 * np.sin(2 * a), 0.02 * (1 - np.cos(a)))
    )


def test_a_path_of_a_file_is_followed_from_where_the_tool_starts(tmp_path: Path) -> None:
    points = eight(np.random.default_rng([63, 0]), 4.0)
    outcome = run_problem(load_problem(written(tmp_path, points)))
    trace = trace_of(outcome)
    assert set(trace["status"]) == {"ok"}
    assert not any("NOT FOLLOWED" in each for each in outcome.notes)
    asked = points[:, 1:] - points[0, 1:] + trace["tool"][0]
    away = np.linalg.norm(trace["tool"][:, None] - asked[None, ::5], axis=2).min(axis=0)
    assert away.max() < 1e-3  # every point, but for what the filter cuts off
    np.testing.assert_allclose(trace["tool"][-1], asked[-1], atol=1e-5)
    assert np.rad2deg(trace["orientation_error_rad"]).max() < 1e-3


def test_a_path_in_the_robots_frame_is_come_to_before_it_begins(tmp_path: Path) -> None:
    points = eight(np.random.default_rng(5), 4.0)
    start = ur5().pose(np.deg2rad([0.0, -70.0, 90.0, -110.0, -90.0, 0.0]))[:3, 3]
    points[:, 1:] += start + [0.0, 0.1, 0.05]
    outcome = run_problem(load_problem(written(tmp_path, points, PATH + "from_start = false\n")))
    trace = trace_of(outcome)
    np.testing.assert_allclose(trace["reference"][0], start, atol=1e-9)
    away = np.linalg.norm(trace["tool"][:, None] - points[None, ::5, 1:], axis=2)
    assert away.min(axis=0).max() < 1e-3  # its first points, too
    assert np.linalg.norm(np.diff(trace["tool"][:1900], axis=0), axis=1).max() < 0.1e-3 * 1.01
    assert not any("NOT FOLLOWED" in each for each in outcome.notes)


def test_stamps_of_when_samples_arrive_and_spikes_are_no_jumps(tmp_path: Path) -> None:
    """One in twenty comes with the next, one is 36 cm off, and sight is lost for a while: noted, the path as before."""
    rng = np.random.default_rng([64, 0])
    points = eight(rng, 6.0)
    even = run_problem(load_problem(written(tmp_path, points)))
    k = int(rng.integers(50, len(points) - 50))
    late = np.setdiff1d(1 + np.flatnonzero(rng.random(len(points) - 2) < 0.03), k)
    points[late, 0] = points[late + 1, 0] - 6e-5
    points[k, 1:] += [0.3, 0.0, 0.2]
    outcome = run_problem(load_problem(written(tmp_path, points)))
    trace = trace_of(outcome)
    assert np.linalg.norm(np.diff(trace["reference"], axis=0), axis=1).max() < 1e-3  # m in a tick: 1 m/s
    count = min(len(trace_of(even)["reference"]), len(trace["reference"]))
    assert np.abs(trace_of(even)["reference"][:count] - trace["reference"][:count]).max() < 3e-3
    assert any("samples left out as spikes: 1," in note for note in outcome.notes)
    assert any(f"bunch with the next: {len(late)}" in note for note in outcome.notes)
    points = np.delete(points, slice(60, 80), axis=0)
    assert any("bridged by straight lines" in note for note in checked(load_problem(written(tmp_path, points))))


@pytest.mark.parametrize(
    ("robot", "stretch", "cause"),
    [
        ("joint_speed_deg_s = 8.0", 1.0, "at its largest speed"),
        pytest.param(
            "joint_acceleration_deg_s2 = 10.0", 1.0, "at their largest acceleration", marks=pytest.mark.nightly
        ),
        pytest.param("", 6.0, "singular", marks=pytest.mark.nightly),
        ("five", 1.0, "an arm of 5 joints, which cannot hold every orientation"),
    ],
)
def test_check_reports_what_the_run_reports(tmp_path: Path, robot: str, stretch: float, cause: str) -> None:
    """With an arm of five joints it looked at places alone, and as if a turn counted for 0.1 m/rad: 14 mm for 64."""
    seconds = 20.0 if cause == "singular" else 4.0  # slowly, so that speeds and accelerations suffice
    points = eight(np.random.default_rng(17), seconds) * [1.0, stretch, 1.0, 1.0]
    text = PATH.replace('model = "ur5"', f'model = "ur5"\n{robot}')
    if robot == "five":
        model = Path(shipped_folder()) / "robots" / "kinova_gen3" / "gen3.urdf"
        (tmp_path / "gen3.urdf").write_bytes(model.read_bytes())
        (tmp_path / "five.toml").write_text(
            'urdf = "gen3.urdf"\ntip = "end_effector_link"\nacceleration_deg_s2 = 300.0\n'
            "[joints.joint_3]\nlocked_deg = 0.0\n[joints.joint_5]\nlocked_deg = 0.0\n"
        )
        text = PATH.replace('model = "ur5"', 'file = "five.toml"').replace(
            "[0.0, -70.0, 90.0, -110.0, -90.0, 0.0]", "[0.0, 28.6, 86.0, 10.0, 0.0]"
        )
    config = load_problem(written(tmp_path, points, text))
    (quick,) = (each for each in checked(config) if isinstance(each, NotMet))
    (whole,) = (each for each in run_problem(config).notes if isinstance(each, NotMet))
    assert cause in quick
    assert cause in whole
    number = re.compile(r"for (\d+)% of the time .* at most ([\d.]+) mm and ([\d.e-]+) deg")
    found = [np.array(number.search(each).groups(), dtype=float) for each in (quick, whole)]  # type: ignore[union-attr]
    np.testing.assert_allclose(*found, rtol=0.1, atol=1.0)


def test_a_path_that_cannot_be_used_is_refused_by_its_key(tmp_path: Path) -> None:
    points = eight(np.random.default_rng(7), 3.0)
    points[-1, 0] += 300.0
    refuses(
        lambda text: checked(load_problem(written(tmp_path, points, text))),
        ((PATH + "[circle]\nradius_m = 0.1\nduration_s = 4.0\n",), "one of them"),
        ((PATH[: PATH.index("[path]")],), "one of them"),
        ((PATH.replace("path.csv", "none.csv"),), "path.file = 'none.csv'"),
        ((PATH + 'columns = ["a_m", "b_m"]\n',), "path.columns"),
        ((PATH + "[tracker]\nrate_hz = 10000.0\n",), "tracker.rate_hz = 10000"),
        ((PATH + "cutoff_hz = 0.0\n",), "path.cutoff_hz = 0"),
        error=ProblemFileError,
    )


@pytest.mark.parametrize("last", [75, None])
def test_a_path_that_jumps_is_refused_and_what_is_strange_is_told(tmp_path: Path, last: int | None) -> None:
    """For half a second, or for good: the run of it ended in a ValueError of json."""
    points = eight(np.random.default_rng(8), 4.0)
    small = np.column_stack((points[:, 0], 0.01 * points[:, 1:]))
    assert checked(load_problem(written(tmp_path, small)))
    points[60:last, 1] += 0.4
    with pytest.raises(ProblemFileError, match=r"path\.csv: points = 'a jump at [0-9.]+ s': expected a path without"):
        checked(load_problem(written(tmp_path, points)))


def test_gaps_of_a_recorded_path_are_drawn_beside_the_error(tmp_path: Path) -> None:
    time = np.arange(0.0, 3.0, 0.02)
    seen = ~((time > 1.0) & (time < 1.4)) & ~((time > 2.0) & (time < 2.3))
    rows = [f"{t:.2f},{0.03 * np.sin(t):.5f},{0.02 * t:.5f}" for t in time[seen]]
    (tmp_path / "path.csv").write_text("\n".join(["t_s,x_m,y_m", *rows]))
    (tmp_path / "mine.toml").write_text(PATH)
    outcome = run_problem(load_problem(str(tmp_path / "mine.toml")))
    (error,) = [each for key, each in system_named(outcome.system).figures(outcome).items() if key == "error"]
    for axes in error.axes:
        spans = [patch.get_extents().transformed(axes.transData.inverted()) for patch in axes.patches]
        np.testing.assert_allclose([(span.x0, span.x1) for span in spans], [(1.0, 1.4), (2.0, 2.3)], atol=0.021)
    assert "no samples: 0.7 s, bridged" in {each.get_text() for each in error.legends[0].get_texts()}
