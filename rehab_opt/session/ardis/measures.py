"""Metrics of a run, from its commands alone: who moved the hand, effort, and limits."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from rehab_opt.control.obstacles import Obstacle
from rehab_opt.kinematics.drive import Drive
from rehab_opt.kinematics.mobile_arm import CHAIR, MobileArm
from rehab_opt.session.ardis.clearance import arm_gaps, arm_points, chair_gaps, point_gaps
from rehab_opt.session.ardis.outcome import Motion
from rehab_opt.session.ardis.problem import DriveName, GoalSection
from rehab_opt.session.outcome import Array, finite, reason_counts, status_counts

__all__ = ["KEPT", "excesses", "goals_met", "hand_fractions", "kinetic_energies", "motion_metrics"]

KEPT = 1e-6
"""[m, rad, and the same per s or s^2] What passes a limit by less keeps it: rounding, and what a certificate allows."""
MOVING = 1e-9
"""[m/s, rad/s] A hand that is slower stands still."""

Excesses = dict[str, Array]
"""By how much each tick (N,) passes each kind of limit, negative where there is room."""


def motion_metrics(
    robot: MobileArm, drive: DriveName, motion: Motion, room: Sequence[Obstacle], goals: Sequence[GoalSection]
) -> dict[str, Any]:
    """All numbers of what one law made of one drive."""
    over = excesses(robot, drive, motion, room)
    broken = {name: values > KEPT for name, values in over.items()}
    met = goals_met(motion, goals)
    moving = motion.commanded
    energy, alone = kinetic_energies(robot, drive, motion)
    chassis = motion.chassis[:, :CHAIR]
    base = robot.drive(drive)
    rolled = np.array([base.motion(speeds).twist for speeds in motion.wheels])
    points = arm_points(robot, motion.q)
    over_floor = points[:, 1:].reshape(-1, 3)
    to_room = point_gaps(room, over_floor[:, :2])
    return {
        "ticks": len(motion.time),
        "duration_s": float(motion.time[-1]),
        "goals": {goal.name: when for goal, when in zip(goals, met, strict=True)},
        "goals_met": sum(when is not None for when in met),
        **hand_fractions(motion, slice(None)),
        "kinetic_energy_mean_J": _mean(energy[moving]),
        "kinetic_energy_max_J": float(energy.max()),
        "kinetic_energy_chair_alone_mean_J": _mean(alone[moving]),
        "legs": _legs(motion, goals, met, energy, alone),
        "excess_max": {name: finite(values.max()) for name, values in over.items()},
        "broken_fraction": {name: float(np.mean(of)) for name, of in broken.items()},
        "broken_any_fraction": float(np.mean(np.logical_or.reduce(list(broken.values())))),
        # The rolling row of Eq. (4) is a left speed of zero in the chassis frame, at each tick's heading.
        "rolling_residual_max_m_s": _rolling(base, motion) if base.moving != (0, 1, 2) else None,
        "wheel_residual_max_m_s": float(np.abs(rolled - chassis).max()),
        "arm_to_obstacles_min_m": float(to_room.min()) if to_room.size else None,
        "arm_height_min_m": float(over_floor[:, 2].min()),
        "hand_tilt_max_deg": _tilt(motion),
        "at_rest_at_the_end": not motion.velocity[-1].any(),
        "scale_min": float(motion.scale.min()),
        "stick_ignored": reason_counts(motion.ignored),
        "stopped": reason_counts(motion.stopped),
        "status": status_counts(motion.status),
        "relaxed": status_counts(text for text in motion.relaxed if text),
    }


def excesses(robot: MobileArm, drive: DriveName, motion: Motion, room: Sequence[Obstacle]) -> Excesses:
    """By how much each tick passes the limits; accelerations against the last tick's velocity in the chair's frame."""
    chain, wheels = robot.chain, robot.drive(drive)
    ahead = motion.q + motion.velocity * motion.dt
    chassis = motion.chassis
    last = np.vstack([np.zeros(chain.n), chassis[:-1]])
    speeds = np.abs(chassis[:, CHAIR:]) - chain.velocity[CHAIR:]
    if wheels.moving:  # the room of a chair that stands is none of the arm's
        floor = np.hypot(chassis[:, 0], chassis[:, 1]) - chain.velocity[0]
        speeds = np.column_stack([speeds, np.abs(chassis[:, 2]) - chain.velocity[2], floor])
    over = {
        "position": np.maximum(ahead - chain.upper, chain.lower - ahead)[:, CHAIR:].max(axis=1),
        "velocity": speeds.max(axis=1),
        "acceleration": (np.abs(chassis - last) / motion.dt - chain.acceleration).max(axis=1),
        "wheels": np.abs(motion.wheels).max(axis=1, initial=0.0) - wheels.limit,
        "keep_out": -arm_gaps(robot, ahead).min(axis=1, initial=np.inf),
    }
    if room:
        over["obstacles"] = -chair_gaps(robot.outline, room, ahead).min(axis=1)
    return over


def hand_fractions(motion: Motion, when: slice) -> dict[str, float | None]:
    """Fractions of the hand's path and turning by arm and chair; both add up to one.

    The hand's velocity is the sum of the chair's and the arm's parts. The fraction of one is its part along the hand's
    direction, integrated over the path: negative where it went against it, above one where it made up for the other.
    """
    chair = np.einsum("nij,nj->ni", motion.jacobians[when, :, :CHAIR], motion.velocity[when, :CHAIR])
    arm = np.einsum("nij,nj->ni", motion.jacobians[when, :, CHAIR:], motion.velocity[when, CHAIR:])
    numbers: dict[str, float | None] = {}
    for name, part, unit in (("path", slice(0, 3), "m"), ("turn", slice(3, 6), "rad")):
        whole = (chair + arm)[:, part]
        size = np.linalg.norm(whole, axis=1)
        along = np.sum(arm[:, part] * whole, axis=1) / np.where(size > MOVING, size, 1.0)
        total = float(size.sum() * motion.dt)
        fraction = float(np.where(size > MOVING, along, 0.0).sum() * motion.dt / total) if total > MOVING else None
        numbers[f"hand_{name}_{unit}"] = total
        numbers[f"hand_{name}_arm_fraction"] = fraction
        numbers[f"hand_{name}_chair_fraction"] = None if fraction is None else 1.0 - fraction
    numbers["chair_path_m"] = float(np.hypot(*motion.velocity[when, :2].T).sum() * motion.dt)
    numbers["chair_turn_rad"] = float(np.abs(motion.velocity[when, 2]).sum() * motion.dt)
    return numbers


def kinetic_energies(robot: MobileArm, drive: DriveName, motion: Motion) -> tuple[Array, Array]:
    """(N,) [J] what the robot has, and what it would have if the chair alone gave the hand its level velocity.

    The latter is the least that does it: the arm is held, and the drive's joints of the chair move; NaN where it has
    none.
    """
    moving = list(robot.drive(drive).moving)
    energy, alone = np.empty(len(motion.q)), np.empty(len(motion.q))
    for k, (q, velocity, jacobian) in enumerate(zip(motion.q, motion.velocity, motion.jacobians, strict=True)):
        inertia = robot.inertia(q)
        energy[k] = velocity @ inertia @ velocity / 2
        if not moving:
            alone[k] = np.nan
            continue
        cos, sin = np.cos(q[2]), np.sin(q[2])
        turned = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])[:, moving]
        level = (jacobian[:2, :CHAIR] @ turned, jacobian[:2] @ velocity)
        weight = turned.T @ inertia[:CHAIR, :CHAIR] @ turned
        root = np.linalg.cholesky(weight)
        # With y = L' u the energy is |y|^2/2, and the least y is the pseudoinverse's.
        y = np.linalg.pinv(np.linalg.solve(root, level[0].T).T) @ level[1]
        alone[k] = y @ y / 2
    return energy, alone


def goals_met(motion: Motion, goals: Sequence[GoalSection]) -> list[float | None]:
    """[s] when each goal was reached, after the one before it; None for one that was not, and all after it."""
    met: list[float | None] = []
    begin = 0
    for goal in goals:
        there = goal.met(motion.hand[begin:], motion.closed[begin:])
        if not there.any():
            break
        begin += int(there.argmax())
        met.append(float(motion.time[begin]))
    return met + [None] * (len(goals) - len(met))


def _legs(
    motion: Motion, goals: Sequence[GoalSection], met: Sequence[float | None], energy: Array, alone: Array
) -> dict[str, Any]:
    """The way to each goal that was reached."""
    legs, begin = {}, 0
    for goal, when in zip(goals, met, strict=True):
        if when is None:
            break
        end = round(when / motion.dt)
        if end > begin:
            moving = motion.commanded[begin:end]
            legs[goal.name] = {
                **hand_fractions(motion, slice(begin, end)),
                "kinetic_energy_mean_J": _mean(energy[begin:end][moving]),
                "kinetic_energy_chair_alone_mean_J": _mean(alone[begin:end][moving]),
            }
        begin = end
    return legs


def _rolling(base: Drive, motion: Motion) -> float:
    rows = np.array([base.constraints(q) for q in motion.q])
    return float(np.abs(np.einsum("nij,nj->ni", rows, motion.velocity)).max())


def _tilt(motion: Motion) -> float:
    """[deg] largest angle by which what stood upright in the hand at the start leans: a cup that is held level."""
    up = motion.poses[:, 2, :3]  # the vertical in the hand's axes
    across = np.linalg.norm(np.cross(up[0], up), axis=1)
    return float(np.rad2deg(np.arctan2(across, up @ up[0])).max())


def _mean(values: Array) -> float | None:
    return finite(float(values.mean())) if values.size else None
