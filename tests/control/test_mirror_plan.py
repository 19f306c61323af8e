"""Whole mirrored motions: the guarantees of every tick, on every problem, and the lag of the chain."""

import functools
import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from problems.mirror import motions
from rehab_opt import ConfigurationError, MirrorTracker, ur5
from rehab_opt.control import mirror_plan, mirror_retiming
from rehab_opt.control.conditioning import Conditioned, conditioned
from rehab_opt.control.hand_bounds import KeepOut
from rehab_opt.control.path_timing import PathTiming
from rehab_opt.control.preview import Preview
from rehab_opt.control.reference_clock import ReferenceClock
from rehab_opt.kinematics.vr import fit_frame, poses_of, quaternions_of, robot_from_unity
from tests.control.mirror_campaign import LARGEST
from tests.judge import mirror_plan as judge

TASKS = ("pick_fruit", "refrigerator_door")


def shipped(task: str) -> tuple[np.ndarray, np.ndarray]:
    """Times and mirrored poses in the robot's frame, found the way a clinic would: from points touched with both."""
    folder = Path(motions.__file__).parent
    points = np.loadtxt(folder / "calibration_points.csv", delimiter=",", skiprows=1)
    seen, _ = robot_from_unity(points[:, :3], np.tile([0, 0, 0, 1.0], (len(points), 1)))
    fit = fit_frame(seen, points[:, 3:])
    assert fit.rms < 2e-3
    rows = np.loadtxt(folder / f"{task}.csv", delimiter=",", skiprows=1)
    right = fit.poses(poses_of(*robot_from_unity(rows[:, 1:4], rows[:, 4:8])))
    return rows[:, 0], motions.MIRROR.poses(right)


def samples(task: str, dt: float) -> Conditioned:
    times, poses = shipped(task)
    return conditioned(times, poses[:, :3, 3], quaternions_of(poses[:, :3, :3]), dt=dt)


@functools.cache
def tracker(dt: float) -> MirrorTracker:
    return MirrorTracker(ur5(), dt=dt, max_manipulability=LARGEST, compile=False)


@pytest.mark.parametrize("task", TASKS[1:])
def test_ticks_that_are_laid_out_lead_where_the_others_do(task: str, monkeypatch: pytest.MonkeyPatch) -> None:
    given, robot = samples(task, 2e-2), tracker(2e-2)
    seen: list[tuple[int, float]] = []
    go_on = ReferenceClock.go_on  # what a tick that is laid out asks of the clock
    monkeypatch.setattr(
        ReferenceClock,
        "go_on",
        lambda clock, *given: seen.append((clock.passed, clock.fraction)) or go_on(clock, *given),
    )
    quick = robot.plan(given.poses, given.twists, motions.START)
    assert len(seen) > 0.9 * len(quick.q)  # else this says nothing
    seen.clear()
    robot.plan(given.poses[:9], given.twists[:9], motions.START)
    assert seen[0] == (0, 0.0)  # from the first tick on
    ahead = Preview.ahead
    monkeypatch.setattr(Preview, "ahead", lambda self, place, pace, most, **more: ahead(self, place, pace, 0, **more))
    seen.clear()
    slow = robot.plan(given.poses, given.twists, motions.START)
    assert slow.complete
    assert not seen
    at = np.linspace(0.0, given.times[-1] - given.times[0], 300)
    for one, other in zip(quick.q.T, slow.q.T, strict=True):
        np.testing.assert_allclose(
            np.interp(at, quick.clock, one), np.interp(at, slow.clock, other), atol=math.radians(0.3)
        )
    assert quick.times[-1] <= slow.times[-1] + 0.1


def test_a_plan_that_ends_incomplete_ends_at_rest(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mirror_plan, "PATIENCE", 0.4)  # given up on its way
    chain, dt = ur5(acceleration=2.0), 2e-2
    made = MirrorTracker(chain, dt=dt, max_manipulability=LARGEST, compile=False)
    part = np.linspace(0, 1, 100)
    poses, twists = np.tile(chain.pose(motions.START), (100, 1, 1)), np.zeros((100, 6))
    poses[:, 1, 3] -= 0.3 * part**3 * (10 - 15 * part + 6 * part**2)
    twists[:, 1] = np.gradient(poses[:, 1, 3], dt)
    path = made.plan(poses, twists, motions.START)
    assert not path.complete
    speeds, braked = np.abs(path.velocities).max(axis=1), path.counts["braked"]
    assert speeds[-braked - 1] > 0.1
    assert speeds[-1] == 0.0
    assert braked == math.ceil(speeds[-braked - 1] / (2.0 * dt))
    assert np.abs(np.diff(path.velocities[-braked - 1 :], axis=0)).max() <= 2.0 * dt * (1 + 1e-9)


def test_a_plans_paces_are_the_steps_of_its_clock_also_in_a_bridge() -> None:
    dt, given = 2e-2, samples("pick_fruit", 2e-2)
    poses = given.poses.copy()
    poses[100:, :3, :3] = poses[100:, :3, :3] @ np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])  # a quarter turn at once
    path = tracker(dt).plan(poses, given.twists, motions.START)
    np.testing.assert_allclose(np.diff(path.clock), dt * path.paces[1:], atol=1e-12)
    bridged = (path.clock > 99 * dt + 1e-9) & (path.clock < 100 * dt - 1e-9)
    assert bridged.sum() * dt > 1.5  # pi/2 at 0.75 rad/s, for a recording's 0.02 s
    assert path.paces[1:][bridged[1:] & bridged[:-1]].max() < 0.02  # a tick that enters it was elsewhere, too
    assert path.complete


def test_samples_that_a_tick_would_refuse_are_lost_to_a_plan_too() -> None:
    """Of zeros it led the hand 0.45 m away from a recording that stands still."""
    poses, twists = np.tile(ur5().pose(motions.START), (50, 1, 1)), np.zeros((50, 6))
    poses[20:23], poses[25, :3, :3], poses[26, 0, 0], twists[27] = 0.0, -poses[25, :3, :3], math.nan, 1e9
    path = tracker(5e-3).plan(poses, twists, motions.START)
    assert path.complete
    assert path.counts["lost"] == 6
    poses[30:33, :3, 3] *= 1e3  # millimetres
    assert tracker(5e-3).plan(poses, twists, motions.START).counts["lost"] == 9
    poses[:, :3, 3] *= 1e3
    with pytest.raises(ConfigurationError, match=r"poses = '[0-9.]+ m away and more': expected .* in metres"):
        tracker(5e-3).plan(poses, twists, motions.START)
    poses[:, :3, 3] /= 1e3
    np.testing.assert_allclose(path.q, np.tile(motions.START, (len(path.q), 1)), atol=1e-9)
    rng = np.random.default_rng(3)
    for wrong in (np.zeros((5, 4, 4)), poses[:5] * 2.0, poses[:5] + rng.normal(scale=0.1, size=(5, 4, 4))):
        with pytest.raises(ConfigurationError, match="rigid transform"):
            tracker(5e-3).plan(wrong, twists[:5], motions.START)


def hurried(dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Poses and twists of a hand that goes 0.24 m to and fro, six times as fast as it is led."""
    seconds = np.arange(round(1.2 / dt)) * dt
    poses = np.tile(ur5().pose(motions.START), (len(seconds), 1, 1))
    poses[:, 1, 3] += 0.12 * (1 - np.cos(2 * math.pi * seconds / 0.6))
    twists = np.zeros((len(seconds), 6))
    twists[:, 1] = 0.12 * 2 * math.pi / 0.6 * np.sin(2 * math.pi * seconds / 0.6)
    return poses, twists


def test_a_plan_that_stands_before_it_counts_what_it_cannot_turn_is_passed_sooner(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """188.6 s of 10 s of a real hand, 89 s at least: one tick behind the stand was judged by what held before it."""
    dt, first = 5e-3, ur5().pose(motions.START)
    outwards = first[:3, 3] * [1, 1, 0] / np.linalg.norm(first[:2, 3])
    part = np.concatenate([np.linspace(0, 1, 300), np.ones(40), np.linspace(1, 0.3, 300)])
    poses, twists = np.tile(first, (len(part), 1, 1)), np.zeros((len(part), 6))
    angles, rate = math.radians(120) * part, np.gradient(part, dt)
    cosines, sines, none = np.cos(angles), np.sin(angles), np.zeros(len(part))
    turns = np.stack([[cosines, none, sines], [none, none + 1, none], [-sines, none, cosines]]).transpose(2, 0, 1)
    poses[:, :3, :3] = turns @ first[:3, :3]
    poses[:, :3, 3] += 0.43 * part[:, None] * outwards
    twists[:, :3], twists[:, 4] = 0.43 * rate[:, None] * outwards, math.radians(120) * rate
    robot = MirrorTracker(ur5(), dt=dt, max_turn=math.radians(10), max_manipulability=LARGEST)
    path = robot.plan(poses, twists, motions.START)
    assert path.complete
    assert path.short[:, 1].max() > 1.0
    assert (path.turns - path.short[:, 1]).max() <= math.radians(11.5)  # where the clock waits, not a bound
    monkeypatch.setattr(mirror_plan, "retimed", lambda tracker, plan, left: plan)
    assert path.times[-1] < robot.plan(poses, twists, motions.START).times[-1]


def sliding(dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Poses and twists of a hand that goes beneath a table 0.1 m under the base, too fast for an arm."""
    rng, seconds, first = np.random.default_rng(28), np.arange(round(1.6 / dt)) * dt, ur5().pose(motions.START)
    down, aside = (np.append(rng.uniform(-size, size, 2), z) for size, z in ((0.2, -0.34), (0.1, 0.0)))
    part, axis = 0.5 * (1 - np.cos(2 * math.pi * seconds / 1.6)), rng.uniform(-0.8, 0.8, 3)
    poses, twists = np.tile(first, (len(seconds), 1, 1)), np.zeros((len(seconds), 6))
    poses[:, :3, 3] += part[:, None] * down + np.sin(4 * math.pi * seconds / 1.6)[:, None] * aside
    poses[:, :3, :3] = Rotation.from_rotvec(part[:, None] * axis).as_matrix() @ first[:3, :3]
    twists[:, :3], twists[:, 3:] = np.gradient(poses[:, :3, 3], dt, axis=0), np.gradient(part, dt)[:, None] * axis
    return poses, twists


def test_the_first_passage_is_as_fast_as_the_hand_may_be_and_no_faster(monkeypatch: pytest.MonkeyPatch) -> None:
    """1.52 of the least time for two rows of a real hand: each of eight passages was refused, for a tick or two."""
    monkeypatch.setattr(mirror_retiming, "TRIES", 1)
    path = tracker(5e-3).plan(*sliding(5e-3), motions.START)
    way = np.linalg.norm(np.diff(path.poses[:, :3, 3], axis=0), axis=1).sum()
    assert path.complete
    assert path.times[-1] <= 1.03 * way / 0.25


def test_between_the_places_of_a_hand_that_slides_along_a_plane_there_is_room() -> None:
    """Ticks that end on the plane leave none: what leads from one to the next dips under it, by 20 micrometres."""
    table = KeepOut.through([0.0, 0.0, -0.1], [0.0, 0.0, 1.0])
    robot = MirrorTracker(ur5(), dt=5e-3, max_manipulability=LARGEST, keep_out=[table], compile=False)
    poses, twists = sliding(5e-3)
    poses[:, 2, 3] -= 0.3 * (ur5().pose(motions.START)[2, 3] - poses[:, 2, 3])
    path = robot.plan(poses, twists, motions.START)
    between = [path.q[:-1] + part * np.diff(path.q, axis=0) for part in (0.0, 0.25, 0.5, 0.75)]
    assert 1e-6 < robot.hand_bounds.min_heights(np.concatenate(between), table).min() < 6e-5


def test_a_passage_that_would_break_a_bound_is_not_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    robot, dt, fastest = tracker(5e-3), 5e-3, mirror_retiming.ruckig_timing
    monkeypatch.setattr(
        mirror_retiming, "ruckig_timing",
        lambda cells, *, velocity, **bounds: fastest(cells, velocity=1.2 * velocity, **bounds),
    )  # fmt: skip
    path = robot.plan(*hurried(dt), motions.START)
    assert np.linalg.norm(np.diff(path.poses[:, :3, 3], axis=0), axis=1).max() <= 0.25 * dt * (1 + 1e-9)
    assert path.complete


def test_a_passage_that_takes_days_is_not_laid_out_in_ticks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nearly at rest amid its way, one of 17 days was: 1.5 10^8 ticks, more than the memory of any machine."""
    at = PathTiming.at

    def counted(timing: PathTiming, times: np.ndarray) -> np.ndarray:
        assert len(times) < 10_000
        return at(timing, times)

    monkeypatch.setattr(PathTiming, "at", counted)
    verdict = judge.run(1, 62150014, only=85)
    assert verdict.ticks > 200
    assert not verdict.kinds, verdict.broken


@pytest.mark.parametrize("angular_speed", [0.3, 0.6])
def test_a_plan_turns_the_hand_no_faster_than_it_may(angular_speed: float) -> None:
    arm, dt = ur5(), 1e-2
    start = np.array([0.3, -1.2, 1.5, -1.8, -1.57, 0.2])
    time, pose = dt * np.arange(300), arm.pose(start)
    poses, twists = np.tile(pose, (len(time), 1, 1)), np.zeros((len(time), 6))
    poses[:, :3, :3] = Rotation.from_rotvec(np.outer(0.6 * np.sin(2 * time), [0, 0, 1])).as_matrix() @ pose[:3, :3]
    twists[:, 5] = 1.2 * np.cos(2 * time)
    robot = MirrorTracker(arm, dt=dt, angular_speed=angular_speed, max_manipulability=LARGEST, compile=False)
    path = robot.plan(poses, twists, start)
    turned = [Rotation.from_matrix(each[:3, :3]) for each in path.poses]
    speeds = [(b * a.inv()).magnitude() / dt for a, b in pairwise(turned)]
    assert 0.9 * angular_speed < max(speeds) <= 1.0001 * angular_speed
