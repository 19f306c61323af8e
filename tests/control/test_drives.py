"""A drive is a set of constraints on the chassis: what each allows, and the law on bases that stand or go anywhere."""

from __future__ import annotations

import math
from functools import partial

import numpy as np
import pytest
from numpy.typing import NDArray

from rehab_opt import RedundancyResolver, Relaxed, ardis
from rehab_opt.kinematics import DRIVES, DriveName
from rehab_opt.kinematics.ardis import ARDIS_READY
from tests.refusals import refuses

Array = NDArray[np.float64]
DT = 0.01
ROWS = ("x", "y", "z")
FREE = {"mecanum": (0, 1, 2), "differential": (0, 2), "omnidirectional": (0, 1, 2), "fixed": ()}
NEW: tuple[DriveName, ...] = ("omnidirectional", "fixed")


def resolver_of(drive: DriveName, **options: object) -> RedundancyResolver:
    robot = ardis(keep_out=())
    return RedundancyResolver(robot, drive=drive, dt=DT, row_sets=[ROWS], compile=False, **options)  # type: ignore[arg-type]


def free_posture(rng: np.random.Generator) -> Array:
    return np.concatenate([rng.uniform(-3, 3, 3), ARDIS_READY[3:] + rng.uniform(-0.2, 0.2, 4)])


@pytest.mark.parametrize("drive", DRIVES)
def test_constraints_are_the_motions_that_the_drive_has_not(drive: DriveName) -> None:
    robot, rng = ardis(), np.random.default_rng(0)
    base, still = robot.drive(drive), [i for i in range(3) if i not in FREE[drive]]
    assert base.moving == FREE[drive]
    for _ in range(20):
        q, chassis = rng.uniform(-3, 3, 7), rng.uniform(-1, 1, 7)
        heading = np.exp(1j * q[2])
        world = chassis.copy()
        along = heading * complex(chassis[0], chassis[1])
        world[:2] = along.real, along.imag
        np.testing.assert_allclose(base.constraints(q) @ world, -chassis[still], atol=1e-12)


@pytest.mark.parametrize("drive", DRIVES)
def test_wheel_speeds_lead_back_to_the_motion_that_they_are_of(drive: DriveName) -> None:
    base, twist = ardis().drive(drive), np.zeros(3)
    twist[list(FREE[drive])] = [0.3, -0.2, 0.1][: len(FREE[drive])]
    motion = base.motion(base.wheel_speeds(twist))
    np.testing.assert_allclose(motion.twist, twist, atol=1e-12)
    assert motion.slip <= 1e-12


@pytest.mark.parametrize("drive", ["omnidirectional"])
def test_every_speed_that_reset_takes_can_be_gone_on_from(drive: DriveName) -> None:
    """The polygon of chassis speeds has sides 8 % nearer than the circle: such states had no answer."""
    resolver, rng = resolver_of(drive), np.random.default_rng(5)
    chain, beyond = resolver.robot.chain, 0
    fastest, change = chain.velocity[0], chain.acceleration * DT
    for k in range(40):
        q, angle = free_posture(rng), rng.uniform(-math.pi, math.pi) if k % 2 else math.pi / 8 * (k - 19)
        speed = fastest * rng.choice([0.95, 0.999, 1.0])
        told = np.array([speed * math.cos(angle), speed * math.sin(angle), 0, 0, 0, 0, 0])
        wheels = resolver.robot.drive(drive)
        told /= max(1.0, *np.abs(wheels.wheel_speeds(told[:3])) / wheels.limit)
        resolver.reset(resolver.robot.world_velocity(q, told), heading=q[2])
        beyond += np.hypot(*told[:2]) > 0.93 * fastest
        asked = rng.choice([0.0, 0.3, 2.0]) * rng.standard_normal(3)
        for _ in range(12):
            last = resolver.chassis_velocity
            command = resolver.step(q, asked)
            now = resolver.chassis_velocity
            assert command.status.certified, command.reason
            assert command.solver != "braking together"
            assert np.hypot(*now[:2]) <= fastest
            assert np.all(np.abs(now - last) <= change * (1 + 1e-9) + 1e-9)
            q = q + DT * command.value
    assert beyond > 10


@pytest.mark.parametrize("drive", NEW)
def test_planar_speed_and_turning_are_bounded_whatever_the_stick_says(drive: DriveName) -> None:
    resolver, rng, q = resolver_of(drive), np.random.default_rng(2), ARDIS_READY.copy()
    chain, last, fastest = resolver.robot.chain, np.zeros(7), 0.0
    for k in range(500):
        if k % 60 == 0:
            # At first across both axes of the chassis, where each alone would let it be faster than the whole may.
            twist = np.array([3.0, 3.0, 0.0]) if k < 180 else rng.choice([0.2, 3.0]) * rng.standard_normal(3)
        command = resolver.step(q, twist, ROWS, "world" if k % 120 >= 60 else "chassis")
        u = resolver.robot.chassis_velocity(q, command.value)
        fastest = max(fastest, math.hypot(u[0], u[1]))
        assert math.hypot(u[0], u[1]) <= chain.velocity[0] + 1e-9
        assert np.all(np.abs(u[2:]) <= chain.velocity[2:] + 1e-12)
        assert np.all(np.abs(u - last) <= chain.acceleration * DT + 1e-9)
        assert not command.relaxed & Relaxed.ACCELERATION
        assert np.all(u[[i for i in range(3) if i not in FREE[drive]]] == 0.0)
        assert command.wheels is not None
        np.testing.assert_allclose(command.wheels, u[list(FREE[drive])], atol=1e-12)
        q, last = q + DT * command.value, u
    assert fastest > 0.9 * chain.velocity[0] or drive == "fixed"


def test_drives_rows_and_speeds_that_do_not_go_together_are_refused() -> None:
    rows = ("x", "y", "z", "rx", "ry")
    make = partial(RedundancyResolver, ardis(), drive="fixed", compile=False)
    refuses(make, ({"row_sets": [rows]}, "row_sets = ", "expected independent rows", "fixed base 4 of"))
    refuses(resolver_of, *(((drive,), "drive = ", "mecanum, differential, omni") for drive in ("tracks", 1, None)))
    for drive, speed in (("fixed", "forward"), ("fixed", "turning"), ("differential", "sideways")):
        velocity = np.zeros(7)
        velocity[("forward", "sideways", "turning").index(speed)] = 0.1
        refuses(resolver_of(drive).reset, ((velocity,), "no speed", speed))  # type: ignore[arg-type]
