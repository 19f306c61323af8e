"""What controllers command in short hostile runs, and what the functions that they are made of give, is what is kept.

Each run has unusable numbers, stale and repeated stamps, a dead-man switch let go, jumps, postures outside of limits,
and bodies that come near; the functions are then asked for what they met, changed here and there.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
import shapely

import rehab_opt as lib
from rehab_opt.control.command import Command
from rehab_opt.control.obstacles import Disc, HalfPlane
from rehab_opt.kinematics.ardis import ARDIS_READY
from tests.control.every_controller import FORCE, PATH, READY, workspace, workspace_map
from tests.control.mirror_campaign import LARGEST
from tests.golden.functions import assert_functions_kept, watched

Array = np.ndarray
Said = list[Any]
TICKS = 60
MOUNT = np.eye(4)
MOUNT[:3, 3] = 0.25, -0.3, 0.6


def said(command: Command, *more: Any) -> Said:
    """Of a command what is no rounding."""
    return [command._replace(residual=0.0, iterations=0), *more]


def shown(made: Any) -> Said:
    """What its properties say in numbers."""
    names = [name for name in sorted(dir(type(made))) if isinstance(getattr(type(made), name), property)]
    values = {name: getattr(made, name) for name in names if name[0] != "_"}
    return [(name, value) for name, value in values.items() if isinstance(value, (int, float, np.ndarray, Counter))]


def elbow(chain: lib.SerialChain, q: ca.SX) -> ca.SX:
    frames = chain.frames_expression(q)
    return ca.vertcat(frames[-1][2, 3] + 0.2, 0.5 - frames[2][0, 3], frames[-2][2, 3] + 0.1, 2 - q[-1], q[-2] + 3)


def around(place: Array, moving: int = 0) -> lib.Clearance:
    """Bodies near a place."""
    pose = np.eye(4)
    pose[:3, 3] = place + (0.3, 0.2, -0.1)
    post = lib.Capsule("post", tuple(place + (-0.2, 0.25, -0.4)), tuple(place + (-0.2, 0.25, 0.4)), 0.05)
    plane = lib.KeepOut.through(place + (0, 0, -0.25), [0.1, 0.05, 1.0])
    bodies = {"planes": [plane], "capsules": [post], "boxes": [lib.Box.at("box", pose, [0.2, 0.1, 0.3])]}
    return lib.Clearance(margin=0.02, self_margin=0.01, moving=moving, **bodies)


def hostile(k: int, q: Array, dt: float) -> tuple[Array, dict[str, Any]]:
    """What a tick is told of a posture, and enable and stamp."""
    told = q.copy()
    if k in (9, 27, 28):
        told[k % q.size] = (math.nan, math.inf, 1e9)[k % 3]
    stamp = dt * (k - (k % 10 == 7)) if 15 <= k < 40 else None if k < 15 else dt * k + (0.5 if k > 52 else 0.0)
    return told, {"enable": not 30 <= k < 38, "stamp": stamp}


def bodies(k: int, hand: Array, moving: int) -> Array:
    """(moving, 14) that come to the hand from beside."""
    found, way = np.zeros((moving, 14)), np.array([math.cos(k), math.sin(k), 0.2])
    for i in range(moving - (k % 7 == 3)):
        place = hand + (0.45 - 0.005 * k) * np.array([math.cos(2 * i), math.sin(2 * i), 0.1])
        found[i] = *(place - 0.1 * way), *(place + 0.1 * way), *(-0.2 * way), *(0.1 * way), 0.05, 1.0
    return found


def led(made: Any, start: Array, *, held: range = range(0), reach: float = 0.15, force: bool = False) -> Iterator[Said]:
    """A tracker to poses that jump."""
    rng, arm, q, moving = np.random.RandomState(3), made.chain, start.copy(), made.limits.moving
    for k in range(TICKS):
        if k % 12 == 0:
            goal = arm.pose(q + reach * rng.normal(size=arm.n))
            twist = rng.normal(size=6) * (0.0, 0.1, 1.0)[k // 12 % 3]
        if k == 45:
            q[1], q[2] = arm.upper[1] + 0.02, q[2] + 0.3
        if k in (24, 54):
            made.reset(0.97 * arm.velocity * np.sign(rng.normal(size=arm.n)))
        told, options = hostile(k, q, made.dt)
        if moving:
            options["obstacles"] = bodies(k, arm.pose(q)[:3, 3], moving)
        if force and k % 5:
            options["force"] = rng.normal(size=3) * (10.0 if k != 42 else 300.0)
        pose = goal * (math.nan if k == 20 else 1.0 if k != 21 else 1.1)
        command = made.step(told, pose, twist, **options)
        q = q + made.dt * command.value * (k not in held)
        yield said(command, *(shown(made) if k % 8 == 3 else ()))
        yield made.instance(q, goal, twist) if k % 20 == 0 and not moving else ()


def driven(made: lib.RedundancyResolver, start: Array, *, reach: int = 48) -> Iterator[Said]:
    """A chair and arm by twists of every set of rows, and to a place."""
    rng, arm, q, moving = np.random.RandomState(4), made.robot.chain, start.copy(), made.limits.moving
    for k in range(TICKS):
        if k % 10 == 0:
            rows, frame = made.row_sets[k // 10 % len(made.row_sets)], ("chassis", "world")[k // 10 % 2]
            twist = rng.normal(size=len(rows)) * (0.2, 0.05, 1.0)[k // 10 % 3]
        if k == 45:
            q[4] = arm.upper[4] + 0.02 if math.isfinite(arm.upper[4]) else q[4] + 1.0
        told, options = hostile(k, q, made.dt)
        if moving:
            options["moving"] = bodies(k, arm.pose(q)[:3, 3], moving)
        if k >= reach:
            command = made.reach(told, arm.pose(start)[:3, 3] + (0.3, 0.1, 0.0), **options)
        else:
            command = made.step(told, twist * (math.nan if k == 20 else 1.0), rows, frame, **options)
        q = q + made.dt * command.value
        yield said(command, *(shown(made) if k % 8 == 3 else ()))
        yield made.instance(q, twist, rows, frame) if k % 20 == 1 else ()


def felt(made: lib.BoundedForce, *, v: bool = False, noise: float = 0.0, dt: float = 0.001) -> Iterator[Said]:
    """A hand that goes in and out of the workspace, stands, leaps, and is not seen."""
    rng, hand, speed = np.random.RandomState(5), np.array([0.03, 0.01]), np.zeros(2)
    for k in range(240):
        speed = 0.97 * speed + 0.06 * rng.normal(size=2) if k % 60 < 45 else np.zeros(2)
        hand = hand + dt * speed + (0.2 if k in (100, 180) else 0.0) * np.array([1.0, 0.3]) * (1 if k < 150 else -1)
        told = hand + noise * rng.normal(size=2)
        if k in (40, 130, 131):
            told[k % 2] = (math.nan, math.inf)[k % 2]
        if k in (70, 200):
            made.reset(energy=k > 100, force=(3.0, -4.0))
        stamp = 10.0 + dt * (k - (k % 9 == 8) + (k > 150) * 0.7 * (k % 2)) if 20 <= k < 210 and k != 165 else None
        given = (speed if k % 90 < 60 else math.nan * speed) if v else None
        command = made.step(told, given, enable=not 110 <= k < 118, stamp=stamp)
        yield said(command, made.energy_left, *made.desired_force, *(shown(made) if k % 8 == 3 else ()))
        yield made.instance(hand, speed) if k % 40 == 1 else ()
        if k % 50 == 49:
            yield [made.give_energy(0.1)]


def pair(made: lib.Bilateral) -> Iterator[Said]:
    """A helper and a participant who is led."""
    rng, one = np.random.RandomState(6), np.array([0.2, 0.1])
    other = np.array(made.helper.workspace_map.image(one))
    for k in range(120):
        one = one + 0.0004 * rng.normal(size=2) + (0.001 if k < 100 else -0.05) * np.array([1.0, 0.4])
        other = other + 0.3 * (np.array(made.helper.workspace_map.image(one)) - other) + 0.0005 * rng.normal(size=2)
        at = one * (math.nan if k == 50 else 1.0)
        speeds = (0.1 * one, 0.1 * other) if k % 3 else (None, None)
        helper, participant = made.step(at, other, *speeds, enable=not 70 <= k < 74)
        yield said(helper, *made.helper.partner, *shown(made))
        yield said(participant)


def sides(delay: float, **options: Any) -> lib.Bilateral:
    held = lib.HelperSide(workspace_map(), damping=3.0, **FORCE, **options)
    room = lib.Workspace(shapely.box(0, 0, 0.27, 0.3), accuracy=1e-3)
    led = lib.ParticipantSide(workspace_map(), comfortable=room, exchange=50.0, **FORCE, **options)
    return lib.Bilateral(held, led, delay=delay)


def field(**options: Any) -> lib.PotentialField:
    return lib.PotentialField(PATH[:, ::1] - (0.1, 0.0), stiffness=1000.0, width=0.025, compile=False, **options)


def helped(mode: str, field: lib.PotentialField, **options: Any) -> lib.Assistance:
    return lib.Assistance(field, comfortable=workspace(), mode=mode, **FORCE, **options)


ARM, PERSON, FAST = lib.ur5(), lib.human_arm(), lib.ur5(acceleration=np.full(6, 10.0))
HAND, CHAIR_HAND = ARM.pose(READY)[:3, 3], lib.ardis().chain.pose(ARDIS_READY)[:3, 3]
MIDDLE, ON_CHAIR = (PERSON.lower + PERSON.upper) / 2, np.concatenate([np.zeros(3), READY])
LIMITS, SIX = [lib.Limit(elbow, rate=2.0), around(HAND, 1)], ("x", "y", "z", "rx", "ry", "rz")
NOISY = {"position_noise": 1e-4, "energy_budget": 0.02}


def tracker(chain: lib.SerialChain, **options: Any) -> lib.PoseTracker:
    return lib.PoseTracker(chain, compile=False, **options)


def mirror(height: float, **options: Any) -> lib.MirrorTracker:
    plane = lib.KeepOut.through(HAND - (0, 0, height), [0, 0.1, 1])
    given = {"dt": 5e-3, "floor": 0.1, "max_manipulability": LARGEST, "keep_out": [plane], "compile": False}
    return lib.MirrorTracker(FAST, **given, **options)


def chair(robot: Any, **options: Any) -> lib.RedundancyResolver:
    obstacles = [HalfPlane((1.0, 0.3), 0.75), Disc((-0.3, 0.75), 0.2), Disc((0.2, -0.7), 0.3)]
    return lib.RedundancyResolver(robot, **{"obstacles": obstacles, "compile": False, **options})


def forces() -> Iterator[Said]:
    """One run after the other: they have most functions in common."""
    desired = lambda x, y, vx, vy: (200 * (0.1 - x) - 5 * vx, 30 - 900 * y)  # noqa: E731
    late = {"actuation_delay": 0.004, "actuation_lag": 0.002, **NOISY, **FORCE}
    ideal = {"actuation_uncertainty": 0.0, "trust_stillness": True, "growth_limit": 1e5, "speed_cap": 0.5, **FORCE}
    yield from felt(lib.BoundedForce(desired, **late), noise=1e-4)
    yield from felt(lib.BoundedForce(desired, slew_limit=900.0, energy_budget=0.2, **ideal), v=True)
    yield from felt(lib.BoundedForce(desired, solver="daqp", energy_budget=0.2, **FORCE), v=True)
    yield from felt(helped("assist", field(drag=200.0), onset=0.02), noise=1e-5)
    yield from felt(helped("stretch", field(damping=20.0), force_limit=12.0), v=True)
    yield from felt(helped("resist", field(drag=30.0, drag_along="travelled")), v=True)
    yield from felt(helped("follow", field(drag=100.0, damping=5.0), return_force=7.0))
    along = {"stiffness": 1000.0, "width": 0.025, "damping": 9.0, "comfortable": workspace(), **FORCE}
    yield from felt(lib.PathAssistance(PATH - (0.1, 0.0), **along), v=True)
    yield from pair(sides(0.003))
    yield from pair(sides(0.0, **NOISY))


RUNS: dict[str, Callable[[], Iterator[Said]]] = {
    "tracker": lambda: led(tracker(PERSON, posture=np.zeros(8), dt=0.01), MIDDLE),
    "tracker_daqp": lambda: led(tracker(ARM, solver="daqp", dt=0.01), READY),
    "tracker_jerk": lambda: led(tracker(ARM, jerk=60.0, gain=1.0, task_weights=[1, 1, 1, 0, 0.1, 0.1], dt=5e-3), READY),
    "tracker_led": lambda: led(tracker(FAST, dt=5e-3), READY, held=range(16, 24)),
    "tracker_limits": lambda: led(tracker(FAST, limits=[lib.Limit(elbow), around(HAND, 2)], dt=0.01), READY),
    "mirror": lambda: led(mirror(0.1, interaction=lib.Interaction(), person=PERSON), READY, reach=0.05, force=True),
    "mirror_limits": lambda: led(mirror(0.2, limits=LIMITS), READY, reach=0.05),
    "chair": lambda: driven(
        chair(lib.ardis(), limits=[around(CHAIR_HAND, 2)], row_sets=[SIX[:3], ("z", "roll7")]), ARDIS_READY
    ),
    "chair_differential": lambda: driven(
        chair(lib.ardis(), drive="differential", limits=[lib.Limit(elbow)],
              row_sets=[SIX[:3], ("rz", "ry")]), ARDIS_READY,
    ),
    "chair_ur5": lambda: driven(
        chair(replace(lib.arm_on_chair(ARM, mount=MOUNT), hand_volume=0.1), drive="omnidirectional",
              row_sets=[SIX]), ON_CHAIR, reach=TICKS
    ),
    "chair_fixed": lambda: driven(chair(lib.ardis(), drive="fixed", row_sets=[SIX[:3]], obstacles=()), ARDIS_READY),
    "force": forces,
}  # fmt: skip


@pytest.mark.parametrize("name", RUNS)
def test_commands_and_functions_are_those_kept(name: str) -> None:
    with watched() as met:
        commands = list(RUNS[name]())
    assert_functions_kept(f"control_{name}", met, *commands, samples=160 if name == "force" else 80)
