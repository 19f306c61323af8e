"""One call of each controller in its loop: the state moves on, so that a warm start is worth what it is in use."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from bench.arm.targets import figure_eight, reachable
from bench.long_run import DT, round_trip
from bench.peers.path import START
from rehab_opt import (
    ArmIK,
    Command,
    MirrorTracker,
    PoseTracker,
    RedundancyResolver,
    Smoother,
    Status,
    ardis,
    human_arm,
    ur5,
)
from rehab_opt.control.obstacles import Disc, HalfPlane
from rehab_opt.kinematics.ardis import ARDIS_READY
from rehab_opt.symbolic import Compile

TILT = math.radians(2)


def looped(tracker: PoseTracker, *, settle: int = 300) -> Callable[[], Command]:
    """`step` along a circle that is repeated, the state integrated between calls, after `settle` ticks."""
    path = round_trip(tracker.chain)
    samples = itertools.cycle(
        [(pose.copy(), twist.copy()) for pose, twist in zip(path.poses, path.twists, strict=True)]
    )
    q = START.copy()

    def tick() -> Command:
        command = tracker.step(q, *next(samples))
        np.add(q, DT * command.value, out=q)
        return command

    for _ in range(settle):
        tick()
    return tick


@pytest.mark.parametrize("limit", [math.pi, 0.35], ids=["free", "limited"])
@pytest.mark.parametrize("compiled", ["wait", False], ids=["compiled", "virtual_machine"])
def test_pose_tracker(benchmark: BenchmarkFixture, compiled: Compile, limit: float) -> None:
    command = benchmark(looped(PoseTracker(ur5(velocity=limit), dt=DT, compile=compiled)))
    assert command.status is Status.OK


@pytest.mark.parametrize("floor", [0.3, 0.76], ids=["free", "at_the_floor"])
@pytest.mark.parametrize("compiled", ["wait", False], ids=["compiled", "virtual_machine"])
def test_mirror_tracker(benchmark: BenchmarkFixture, compiled: Compile, floor: float) -> None:
    # The circle of `looped` is faster than a hand may be led: it would measure the clock's careful way instead.
    tracker = MirrorTracker(ur5(), floor=floor, linear_speed=0.5, dt=DT, compile=compiled)
    command = benchmark(looped(tracker, settle=6000))
    assert command.status is Status.OK


def test_mirror_tracker_behind_its_reference(benchmark: BenchmarkFixture) -> None:
    command = benchmark(looped(MirrorTracker(ur5(), dt=DT)))
    assert command.status is Status.OK
    assert command.scale < 1.0


@pytest.mark.parametrize("solver", ["proxqp", "osqp", "daqp"])
def test_pose_tracker_with_another_solver(benchmark: BenchmarkFixture, solver: str) -> None:
    tick = looped(PoseTracker(ur5(), dt=DT, solver=solver))
    benchmark(tick)
    commands = [tick() for _ in range(200)]
    certified = sum(command.status.certified for command in commands) / len(commands)
    benchmark.extra_info.update(certified=certified, residual=max(command.residual for command in commands))


def test_pose_tracker_not_enabled(benchmark: BenchmarkFixture) -> None:
    tracker = PoseTracker(ur5(), dt=DT)
    pose, twist = tracker.chain.pose(START), np.zeros(6)
    command = benchmark(lambda: tracker.step(START, pose, twist, enable=False))
    assert command.status is Status.HOLDING


@pytest.mark.parametrize("range_of_motion", ["regular", "restricted"])
def test_arm_ik_cold(benchmark: BenchmarkFixture, range_of_motion: str) -> None:
    arm = human_arm(range_of_motion=range_of_motion)
    solver, targets = ArmIK(arm, handle_tilt=TILT), itertools.cycle(reachable(arm, 100, tilt=TILT))
    solver.solve(next(targets))  # makes what is made once
    solution = benchmark(lambda: solver.solve(next(targets)))
    assert solution.status.certified


@pytest.mark.parametrize("range_of_motion", ["regular", "restricted"])
def test_arm_ik_warm(benchmark: BenchmarkFixture, range_of_motion: str) -> None:
    arm = human_arm(range_of_motion=range_of_motion)
    solver, path = ArmIK(arm, handle_tilt=TILT), figure_eight(arm, 400, tilt=TILT, cells=9)
    points, last = itertools.cycle(path), [solver.solve(path[0]).q]

    def sample() -> Status:
        solution = solver.solve(next(points), start=last[0])
        last[0] = solution.q
        return solution.status

    assert benchmark(sample).certified


@pytest.mark.parametrize("moving", [True, False], ids=["moving_target", "fixed_target"])
def test_smoother(benchmark: BenchmarkFixture, moving: bool) -> None:
    axes = 8
    smoother = Smoother(velocity=1.0, acceleration=5.0, jerk=50.0, dt=DT, axes=axes)
    smoother.reset(np.zeros(axes))
    phase = itertools.count()
    target = np.full(axes, 0.3)

    def tick() -> Command:
        if moving:
            target[:] = 0.3 * math.sin(DT * next(phase))
        return smoother.step(target)

    benchmark(tick)


ROOM = (
    HalfPlane((1, 0), 3.0), HalfPlane((-1, 0), 3.0), HalfPlane((0, 1), 2.0), HalfPlane((0, -1), 2.0),
    Disc((1.5, 1.2), 0.3), Disc((-1.5, -1.0), 0.2),
)  # fmt: skip


@pytest.mark.parametrize("speed", [0.1, 1.0], ids=["free", "limited"])
@pytest.mark.parametrize("drive", ["mecanum", "differential"])
@pytest.mark.parametrize("obstacles", [(), ROOM], ids=["free_floor", "room"])
def test_redundancy_resolver(
    benchmark: BenchmarkFixture, obstacles: tuple[object, ...], drive: str, speed: float
) -> None:
    """A stick that wanders; `limited` asks for more than the chair can do, so that the QP is solved in most ticks."""
    resolver = RedundancyResolver(ardis(), drive=drive, row_sets=[("x", "y", "z")], obstacles=obstacles)
    rng, q, ticks = np.random.default_rng(0), ARDIS_READY.copy(), itertools.count()
    sticks = itertools.cycle(speed * rng.standard_normal((40, 3)) * [1.0, 1.0, 0.3])
    stick = next(sticks)

    def tick() -> Command:
        nonlocal stick
        k = next(ticks)
        if k % 100 == 0:
            stick = next(sticks)
        if k % 400 == 0:
            q[:] = ARDIS_READY
            resolver.reset()
        command = resolver.step(q, stick)
        np.add(q, resolver.dt * command.value, out=q)
        return command

    for _ in range(300):
        tick()
    assert benchmark(tick).status.certified
