"""What plans, paths, filters, sticks and searches of whole motions give on seeded inputs is what is kept."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from datetime import timedelta
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rehab_opt import ArmIK, Joystick, KeepOut, Limit, MirrorTracker, Smoother, human_arm, smooth_path, ur5
from rehab_opt.control.arm_path import arm_path
from rehab_opt.control.axis_motion import AxisStop
from rehab_opt.control.conditioning import Conditioner, conditioned
from rehab_opt.control.manipulability import maximise_manipulability
from rehab_opt.control.path_timing import PathCells, ruckig_timing
from rehab_opt.control.posture import POSTURE_COSTS, History, PostureCost
from rehab_opt.control.scanning import Scanning
from rehab_opt.control.seats import Seats
from rehab_opt.control.watchdog import Watchdog
from tests.control.every_controller import READY
from tests.control.mirror_campaign import LARGEST
from tests.golden import assert_kept
from tests.golden.functions import digest

ARM, FAST, NAN = human_arm(range_of_motion="regular"), ur5(acceleration=np.full(6, 12.0)), math.nan
STAMPS = (0.0, 0.01, 0.01, 0.03, 0.02, 0.04, 0.09, 0.1, 0.2, NAN, 0.21, 0.22, None, 0.23, 5.0, 5.01, 4.0, "x", 6.0)

ODD = (1e300, math.inf, 10**400, "soon", np.zeros(2), np.timedelta64(1, "ns"), timedelta(1), 1j, np.ma.masked, -1e308)


def wandering(rng: np.random.RandomState, rows: int, size: int, rough: float = 0.0) -> np.ndarray:
    """(rows, size) smooth sums of sines, with noise."""
    t = np.linspace(0, 1, rows)[:, None]
    waves = [rng.normal(size=size) / (1 + i) * np.sin(2 * math.pi * i * t + rng.uniform(0, 6, size)) for i in (1, 2, 3)]
    return np.sum(waves, axis=0) + rough * rng.normal(size=(rows, size))


def conditioning() -> Iterator[Any]:
    for cutoff in (8.0, math.inf):
        rng = np.random.RandomState(1)
        times = np.cumsum(rng.uniform(0.008, 0.014, 300)) + 0.25 * (np.arange(300) > 150)
        places = 0.2 * wandering(rng, 300, 3, 1e-3)
        turns = Rotation.from_rotvec(0.5 * wandering(rng, 300, 3, 1e-3)).as_quat() * rng.choice([-1, 1], (300, 1))
        places[60], places[61:64], turns[90], times[120], times[200:202] = 9.0, NAN, 0.0, times[118], times[220]
        places[230:] += 3.0
        turns[250:] = (Rotation.from_rotvec([2.0, 0, 0]) * Rotation.from_quat(turns[250:])).as_quat()
        options = {"dt": 0.01, "cutoff_hz": cutoff, "max_gap": 0.05, "max_speed": 4.0, "max_turn_rate": 20.0}
        live = Conditioner(**options)
        yield conditioned(times, places, turns, **options), live.lag
        yield [live.push(*each) for each in zip(times, places, turns, strict=True)]
        yield [live.push(times[-1] + 700.0 + 0.02 * k, [0.1 * k, 0, 0], [0, 0, 0, 1.0]) for k in range(4)]


def sticks() -> Iterator[Any]:
    rng, deflection, pressure = np.random.RandomState(2), np.zeros(2), 0.0
    for stick in (Joystick(), Joystick(dt=0.05)):
        for k in range(200):
            if k % 4 == 0:
                deflection = rng.uniform(-1, 1, 2) * (1.5 if k % 9 else NAN if k % 2 else 0.01)
            yield stick.step(deflection, switch=k % 33 in (3, 4, 5, 9, 25), gripper=k % 40 in (7, 8, 10, 31))
    for switch in (Scanning(dwell=0.05), Scanning(dwell=0.07, sip=True, rate=1.7)):
        for k in range(300):
            pressure = (0.0, 0.31, 0.29, 0.8, 0.22, 0.2, -0.5, NAN)[rng.randint(8)] if k % 7 == 0 else pressure
            yield switch.step(pressure), switch.lit.name
    for stamps in (STAMPS, *([0.0, each] for each in ODD)):
        watch = Watchdog(dt=0.01, max_age=0.05)
        yield [(watch.check(stamp), watch.lag) for stamp in stamps]


def smoothers() -> Iterator[Any]:
    walls, locked = {"lower": [-0.3, -0.2, -1], "upper": 0.2}, {"lower": [-1, 0.1, -1], "upper": [1, 0.1, 1]}
    for options in ({}, {"straight": True}, walls, {"straight": True, **locked}):
        rng, goal, moving = np.random.RandomState(3), np.zeros(3), np.zeros(3)
        bounds = {"velocity": [0.5, 1.0, 0.7], "acceleration": [2.0, 1.0, 3.0], "jerk": [20.0, 8.0, 50.0]}
        each = Smoother(dt=0.01, max_age=0.05, **bounds, **options)
        for begin, first in (([0.0, 0.1, 0.0], None), ([0.3, 0.1, 0.05], [0.4, -0.3, 0.2]), ([-0.5, 0.5, 0.3], None)):
            each.reset(begin, first)
            for k in range(160):
                if k % 32 == 0:
                    goal, moving = 0.4 * rng.normal(size=3), 0.3 * rng.normal(size=3)
                way = goal + (0.01 * k * moving if 64 < k < 130 else 0.0)
                speed = None if k < 64 else moving * (1.0 if k < 96 else 4.0)
                stamp = None if k < 5 else 0.01 * (k - (k % 50 == 49))
                told = way * (NAN if k == 50 else 1e9 if k == 55 else 1.0)
                yield each.step(told, speed, enable=k % 40 != 37, stamp=stamp)._replace(residual=0.0)
                yield each.velocity, each.acceleration, each.arrived
        yield each.lag([0.1, -0.4, 9.0])
    for _ in range(40):
        stop = AxisStop(*rng.normal(size=3), most=rng.uniform(0.5, 3), jerk=rng.uniform(1, 20))
        yield stop.seconds, stop.lowest, stop.highest, [stop.at(part * stop.seconds) for part in (0.3, 0.7, 2.0)]


def timed() -> Iterator[Any]:
    rng = np.random.RandomState(5)
    for velocity, acceleration, jerk, more in (
        (0.4, 1.0, 6.0, {}), ([1.0, 0.6], [3.0, 5.0], [60.0, 20.0], {"lower": [-0.5, -0.6], "upper": 0.4}),
        (50.0, 900.0, 1e5, {"tolerance": 1e-3}),
    ):  # fmt: skip
        times, points = np.cumsum(rng.uniform(0.02, 0.06, 40)), 0.4 * wandering(rng, 40, 2)
        found = smooth_path(times, points, velocity=velocity, acceleration=acceleration, jerk=jerk, dt=0.01, **more)
        yield found, found.delay
    cells = PathCells(np.linspace(0, 1, 30), *(wandering(rng, 29, 3) for _ in range(3)))
    for jerk in (30.0, math.inf):
        bounds = np.array([1.0, 0.7, 2.0]), np.array([3.0, 2.0, 9.0]), np.full(3, jerk)
        timing = ruckig_timing(cells, velocity=bounds[0], acceleration=bounds[1], jerk=bounds[2])
        yield timing.times[-1], timing.at(np.linspace(0, timing.times[-1], 60))


def searches() -> Iterator[Any]:
    rng, middle = np.random.RandomState(7), (ARM.lower + ARM.upper) / 2
    for name in POSTURE_COSTS[:-1]:
        cost = PostureCost(ARM, {name: 1.7, "rest": {ARM.names[2]: 3.0}}, rest=rng.normal(size=ARM.n))
        yield [cost.quadratic(History(*rng.normal(size=(k, ARM.n)))) for k in range(4)]
    hand = ARM.pose(ARM.lower + 0.6 * (ARM.upper - ARM.lower))[:3, 3]
    costs = {"posture_cost": {"rest": 1.0, "speed": 0.5, "manipulability": 0.2}, "handle_tilt": 0.3}
    for options in ({}, {"handle_tilt": None}, costs):
        solver = ArmIK(ARM, compile=False, table_size=512, nearest_starts=4, **options)
        for target in (hand, hand + 0.05 * rng.normal(size=3), 3 * hand, NAN * hand):
            for start in (None, middle):
                found = solver.solve(target, start)
                yield found._replace(residual=0.0, iterations=found.iterations > 0, q=np.round(found.q, 5))
        path = solver.follow(hand + np.linspace(0, 0.1, 8)[:, None] * np.array([1.0, -0.5, 0.2]), middle)
        yield np.round(path.q, 5), path.position_error, path.max_step, path.reached, path.reason


def plans() -> Iterator[Any]:
    tool, rng = FAST.pose(READY), np.random.RandomState(8)
    plane = KeepOut.through(tool[:3, 3] - (0, 0, 0.03), [0.0, 0.1, 1.0])
    above = Limit(lambda chain, q: chain.frames_expression(q)[2][2, 3] - 0.1)
    for size, options in ((0.05, {}), (0.02, {"keep_out": [plane], "limits": [above], "floor": 0.2})):
        tracker = MirrorTracker(FAST, dt=0.02, max_manipulability=LARGEST, compile=False, **options)
        way, turn = size * wandering(rng, 150, 3), 2 * size * wandering(rng, 150, 3)
        poses, twists = np.tile(tool, (150, 1, 1)), np.gradient(np.hstack([way, turn]), 0.02, axis=0)
        poses[:, :3, 3] += way - way[0] + 0.03 * (np.arange(150) > 100)[:, None]
        poses[:, :3, :3] = (Rotation.from_rotvec(turn - turn[0]) * Rotation.from_matrix(tool[:3, :3])).as_matrix()
        poses[75:83] = NAN
        yield tracker.plan(poses, twists, READY)._replace(seconds=0.0)
        seats, starts = Seats(tracker), READY + 0.1 * rng.normal(size=(5, 6))
        paths = np.stack([FAST.pose(q) @ np.linalg.inv(poses[0]) @ poses[:60:6] for q in starts], axis=1)
        yield seats.walk(paths, starts, 3), seats.at(starts)
    yield [maximise_manipulability(arm)[0] for arm in (FAST, ARM)]
    grip, postures = np.eye(4), (ARM.lower + ARM.upper) / 2 + 0.3 * wandering(rng, 60, ARM.n)
    grip[:3, 3] = 0.0, 0.02, 0.05
    tools = np.array([ARM.pose(np.clip(q, ARM.lower, ARM.upper)) for q in postures])
    tools[30:, :3, 3] *= 1.2
    yield [arm_path(ARM, grip, tools[:count] @ grip, dt=0.02) for count in (60, 30)]


PARTS: dict[str, Callable[[], Any]] = {
    each.__name__: each for each in (conditioning, sticks, smoothers, timed, searches, plans)
}


@pytest.mark.parametrize("name", PARTS)
def test_motions_are_those_kept(name: str) -> None:
    assert_kept(f"control_{name}", digest(*PARTS[name](), width=30), relative=1e-6, absolute=1e-4)
