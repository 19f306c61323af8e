"""What plans, paths, filters, sticks and searches of whole motions give on seeded inputs is what is kept."""

from __future__ import annotations

import math
from collections.abc import Callable
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

ARM = human_arm(range_of_motion="regular")
NAN = math.nan


def wandering(rng: np.random.RandomState, rows: int, size: int, rough: float = 0.0) -> np.ndarray:
    """(rows, size) smooth sums of sines, with noise."""
    t = np.linspace(0, 1, rows)[:, None]
    waves = [rng.normal(size=size) / (1 + i) * np.sin(2 * math.pi * i * t + rng.uniform(0, 6, size)) for i in range(1, 5)]
    return sum(waves) + rough * rng.normal(size=(rows, size))


def recorded(rng: np.random.RandomState, rows: int = 300) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stamps, places and quaternions with all that trackers do."""
    times = np.cumsum(rng.uniform(0.008, 0.014, rows)) + 0.25 * (np.arange(rows) > 150)
    places = 0.2 * wandering(rng, rows, 3, 1e-3)
    turns = Rotation.from_rotvec(0.5 * wandering(rng, rows, 3, 1e-3)).as_quat() * rng.choice([-1, 1], (rows, 1))
    places[60], places[61:64], turns[90], times[120], times[200:202] = 9.0, NAN, 0.0, times[118], times[220]
    places[230:] += 3.0
    turns[250:] = (Rotation.from_rotvec([2.0, 0, 0]) * Rotation.from_quat(turns[250:])).as_quat()
    return times, places, turns


def conditioning() -> Any:
    found = {}
    for cutoff in (8.0, math.inf):
        times, places, turns = recorded(np.random.RandomState(1))
        options = {"dt": 0.01, "cutoff_hz": cutoff, "max_gap": 0.05, "max_speed": 4.0, "max_turn_rate": 20.0}
        whole, live = conditioned(times, places, turns, **options), Conditioner(**options)
        pushed = [live.push(*each) for each in zip(times, places, turns, strict=True)]
        for key, parts in (("whole", [whole]), ("live", pushed)):
            found[f"{key} {cutoff}"] = [
                *digest(*(np.nan_to_num(np.concatenate([getattr(p, n).ravel() for p in parts]), nan=7.0) for n in ("times", "poses", "twists")), width=40),
                *(int(np.sum(np.concatenate([p.lost for p in parts]) * 1)), parts[-1].dropped, parts[-1].gaps),
            ]  # fmt: skip
        found[f"lag {cutoff}"] = live.lag
        live.push(times[-1] + 700.0, [0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0])
    return found


def sticks() -> Any:
    rng, found, words = np.random.RandomState(2), {}, []
    for name, stick in {"plain": Joystick(), "slow": Joystick(dt=0.05)}.items():
        told = []
        for k in range(200):
            deflection = rng.uniform(-1, 1, 2) * (1.5 if k % 9 else NAN if k % 2 else 0.01) if k % 4 == 0 else deflection
            given = stick.step(deflection, switch=k % 33 in (3, 4, 5, 9, 25), gripper=k % 40 in (7, 8, 10, 31))
            told += [*given.twist, given.gripper_closed, len(given.rows), "z" in given.rows]
            words.append(given.reason)
        found[name] = [*digest(told, width=20), *sorted(set(words))]
    for name, switch in {"one": Scanning(dwell=0.05), "straw": Scanning(dwell=0.07, sip=True, rate=1.7)}.items():
        told, said = [], []
        for k in range(300):
            pressure = (0.0, 0.31, 0.29, 0.8, 0.22, 0.2, -0.5, NAN)[rng.randint(8)] if k % 7 == 0 else pressure
            given = switch.step(pressure)
            told += [*given.twist, given.gripper_closed, switch.options.index(switch.lit)]
            said.append(given.reason)
        found[name] = [*digest(told, width=24), *sorted({each for each in said})]
    watch, told = Watchdog(dt=0.01, max_age=0.05), []
    for stamp in (0.0, 0.01, 0.01, 0.03, 0.02, 0.04, 0.09, 0.1, 0.2, NAN, 0.21, 0.22, None, 0.23, 5.0, 5.01, 4.0, 4.01, 4.02, "x", 6.0):
        told += [watch.check(stamp).split(" ")[:2], watch.lag]
    found["watchdog"] = told
    return found


def smoothers() -> Any:
    found = {}
    for name, options in {
        "free": {}, "straight": {"straight": True}, "walls": {"lower": [-0.3, -0.2, -1.0], "upper": [0.25, 0.4, 0.1]},
        "locked": {"lower": [-0.3, 0.1, -1.0], "upper": [0.25, 0.1, 0.1], "straight": True},
    }.items():  # fmt: skip
        rng, told, words = np.random.RandomState(3), [], []
        each = Smoother(velocity=[0.5, 1.0, 0.7], acceleration=[2.0, 1.0, 3.0], jerk=[20.0, 8.0, 50.0], dt=0.01, max_age=0.05, **options)
        for begin, speed in (([0.0, 0.1, 0.0], None), ([0.3, 0.1, 0.05], [0.4, -0.3, 0.2]), ([-0.5, 0.5, 0.3], None)):
            each.reset(begin, speed)
            for k in range(160):
                if k % 32 == 0:
                    goal, moving = 0.4 * rng.normal(size=3), 0.3 * rng.normal(size=3)
                way = goal + (0.01 * k * moving if k > 64 else 0.0)
                way = NAN * way if k == 50 else 1e9 * way if k == 55 else way
                given = (None if k < 64 else moving * (1.0 if k < 96 else 4.0)), k % 40 != 37, None if k < 5 else 0.01 * (k - (k % 50 == 49))
                command = each.step(way if k < 130 else goal, given[0], enable=given[1], stamp=given[2])
                told += [*command.value, *each.velocity, *each.acceleration, command.status.value == "ok", int(command.relaxed), each.arrived]
                words.append("".join(c for c in command.reason if not c.isdigit() and c not in ".e-"))
        found[name] = [*digest(told, width=60), *sorted(set(words)), *digest(each.lag([0.1, -0.4, 9.0]))]
    rng, told = np.random.RandomState(4), []
    for _ in range(40):
        stop = AxisStop(*rng.normal(size=3), most=rng.uniform(0.5, 3), jerk=rng.uniform(1, 20))
        told += [stop.seconds, stop.lowest, stop.highest, *stop.at(0.3 * stop.seconds), *stop.at(0.7 * stop.seconds), *stop.at(9.0)]
    return found | {"stops": digest(told)}


def timed() -> Any:
    found, rng = {}, np.random.RandomState(5)
    for name, options in {
        "slow": {"velocity": 0.4, "acceleration": 1.0, "jerk": 6.0}, "walls": {"velocity": [1.0, 0.6], "acceleration": [3.0, 5.0], "jerk": [60.0, 20.0], "lower": [-0.5, -0.6], "upper": 0.4},
        "fast": {"velocity": 50.0, "acceleration": 900.0, "jerk": 1e5, "tolerance": 1e-3},
    }.items():  # fmt: skip
        times = np.cumsum(rng.uniform(0.02, 0.06, 40))
        path = smooth_path(times, 0.4 * wandering(rng, 40, 2), dt=0.01, **options)
        found[name] = [len(path.times), path.delay, *digest(path.positions, path.phase, width=30), *digest(path.deviation * 1e3)]
    knots = np.linspace(0, 1, 30)
    cells = PathCells(knots, *(wandering(rng, 29, 3) for _ in range(3)))
    for jerk in (30.0, math.inf):
        timing = ruckig_timing(cells, velocity=np.array([1.0, 0.7, 2.0]), acceleration=np.array([3.0, 2.0, 9.0]), jerk=np.full(3, jerk))
        at = np.linspace(0, timing.times[-1], 60)
        found[f"cells {jerk}"] = [float(timing.times[-1]), *digest(timing.at(at), width=5)]
    return found


def costs() -> Any:
    rng, found = np.random.RandomState(6), {}
    arm = human_arm()
    for names in ([each] for each in POSTURE_COSTS[:-1]):
        cost = PostureCost(arm, dict.fromkeys(names, 1.7))
        for history in (History(), History(rng.normal(size=arm.n)), History(*rng.normal(size=(3, arm.n)))):
            found[f"{names} {sum(each is not None for each in history)}"] = digest(*cost.quadratic(history), width=2)
    several = PostureCost(arm, {"rest": 1.0, "speed": {arm.names[2]: 3.0}, "elbow": 0.3, "acceleration": 0.2}, rest=rng.normal(size=arm.n))
    return found | {"several": digest(*several.quadratic(History(*rng.normal(size=(3, arm.n)))), width=2)}


def searches() -> Any:
    rng, found = np.random.RandomState(7), {}
    for name, options in {"upright": {}, "free": {"handle_tilt": None}, "costs": {"posture_cost": {"rest": 1.0, "speed": 0.5, "manipulability": 0.2}, "handle_tilt": 0.3}}.items():
        solver = ArmIK(ARM, compile=False, table_size=512, nearest_starts=4, **options)
        start = (ARM.lower + ARM.upper) / 2
        hand = ARM.pose(ARM.lower + 0.6 * (ARM.upper - ARM.lower))[:3, 3]
        told = []
        for target in (hand, hand + 0.05 * rng.normal(size=3), 3 * hand, NAN * hand):
            for given in (None, start):
                answer = solver.solve(target, given)
                told += [*np.round(answer.q, 5), answer.position_error, answer.handle_tilt, answer.cost, answer.status.certified]
        path = solver.follow(hand + np.linspace(0, 0.1, 8)[:, None] * np.array([1.0, -0.5, 0.2]), start)
        found[name] = [*digest(told, path.q, path.position_error, width=4), path.max_step, path.reached, *path.reason[:1]]
    return found


def recording(tool: np.ndarray, rows: int, size: float, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Poses (rows, 4, 4) and twists (rows, 6) about a tool, with a stretch that is not seen and a jump."""
    rng = np.random.RandomState(8)
    way, turn = size * wandering(rng, rows, 3), 2 * size * wandering(rng, rows, 3)
    poses = np.tile(tool, (rows, 1, 1))
    poses[:, :3, 3] += way - way[0]
    poses[:, :3, :3] = (Rotation.from_rotvec(turn - turn[0]) * Rotation.from_matrix(tool[:3, :3])).as_matrix()
    twists = np.gradient(np.concatenate([way, turn], axis=1), dt, axis=0)
    poses[rows // 2 : rows // 2 + 8] = NAN
    poses[2 * rows // 3 :, :3, 3] += 0.03
    return poses, twists


def plans() -> Any:
    found, robot = {}, ur5(acceleration=np.full(6, 12.0))
    plane = KeepOut.through(robot.pose(READY)[:3, 3] - (0, 0, 0.03), [0.0, 0.1, 1.0])
    above = Limit(lambda chain, q: chain.frames_expression(q)[2][2, 3] - 0.1)
    for name, size, options in (("wide", 0.05, {}), ("tight", 0.02, {"keep_out": [plane], "limits": [above], "floor": 0.2})):
        tracker = MirrorTracker(robot, dt=0.02, max_manipulability=LARGEST, compile=False, **options)
        poses, twists = recording(robot.pose(READY), 150, size, 0.02)
        plan = tracker.plan(poses, twists, READY)
        numbers = [np.nan_to_num(np.asarray(each, dtype=float), nan=7.0) for each in plan if isinstance(each, np.ndarray)]
        found[name] = [*digest(*numbers, width=60), *(each for each in plan if isinstance(each, (bool, int)))]
        seats = Seats(tracker)
        starts = READY + 0.1 * np.random.RandomState(9).normal(size=(5, 6))
        paths = np.stack([robot.pose(q) @ np.linalg.inv(poses[0]) @ poses[:60:6] for q in starts], axis=1)
        walk = seats.walk(paths, starts, 3)
        found[f"{name} seats"] = [*digest(walk.q, walk.done, walk.above, walk.elbows, width=20), *digest(*seats.at(starts), width=20)]
    found["largest"] = [maximise_manipulability(arm)[0] for arm in (robot, ARM)]
    tools = np.array([ARM.pose(np.clip(q, ARM.lower, ARM.upper)) for q in (ARM.lower + ARM.upper) / 2 + 0.3 * wandering(np.random.RandomState(3), 60, ARM.n)])
    tools[30:, :3, 3] *= 1.2
    grip = np.eye(4)
    grip[:3, 3] = 0.0, 0.02, 0.05
    path = arm_path(ARM, grip, tools @ grip, dt=0.02)
    found["arm"] = digest(*(np.asarray(each, dtype=float) for each in path if isinstance(each, np.ndarray)), width=40)
    return found


PARTS: dict[str, Callable[[], Any]] = {each.__name__: each for each in (conditioning, sticks, smoothers, timed, costs, searches, plans)}


@pytest.mark.parametrize("name", PARTS)
def test_motions_are_those_kept(name: str) -> None:
    assert_kept(f"control_{name}", PARTS[name](), relative=1e-6, absolute=1e-4)
