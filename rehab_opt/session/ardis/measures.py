"""Metrics of a trace, computed from its commands: contributions of chair and arm, kinetic energy, and limits.

The trace has the joint positions `joint` (N, n), the hand's `pose` (N, 4, 4) and `jacobian` (N, 6, n), and commanded
velocities `_world` (N, n) in the world frame and `command` (N, n), where the chair's velocity is in the chair frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from rehab_opt.control.obstacles import Obstacle
from rehab_opt.kinematics import DriveName
from rehab_opt.kinematics.drive import Drive
from rehab_opt.kinematics.mobile_arm import CHAIR, MobileArm
from rehab_opt.session.ardis.clearance import arm_gaps, arm_points, chair_gaps, point_gaps
from rehab_opt.session.ardis.problem import GoalSection
from rehab_opt.session.outcome import Array, finite, reason_counts, status_counts
from rehab_opt.session.trace import Trace

KEPT = 1e-6
"""[m, rad, and the same per s or s^2] A limit is satisfied up to this excess, which covers rounding and the
certificate's tolerance."""
MOVING = 1e-9
"""[m/s, rad/s] A slower hand counts as being at rest."""


def motion_metrics(
    robot: MobileArm,
    drive: DriveName,
    trace: Trace,
    dt: float,
    *,
    room: Sequence[Obstacle],
    goals: Sequence[GoalSection],
) -> dict[str, Any]:
    """All metrics of one controller with one drive; a tick lasts `dt` [s]."""
    over = excesses(robot, drive, trace, dt, room)
    broken = {name: values > KEPT for name, values in over.items()}
    met, moved = goals_met(trace, goals), trace["_asked"]
    energy, alone = kinetic_energies(robot, drive, trace)
    base = robot.drive(drive)
    rolled = np.array([base.motion(speeds).twist for speeds in trace["wheel"]])
    over_floor = arm_points(robot, trace["joint"])[:, 1:].reshape(-1, 3)
    to_room = point_gaps(room, over_floor[:, :2])
    up = trace["pose"][:, 2, :3]  # the vertical in the hand's axes, which is constant for a cup that is held level
    tilt = np.arctan2(np.linalg.norm(np.cross(up[0], up), axis=1), up @ up[0])
    legs, begin = dict[str, Any](), 0
    for goal, when in zip(goals, met, strict=True):
        end = begin if when is None else round(when / dt)
        if end > begin:
            leg = slice(begin, end)
            legs[goal.name] = {
                **hand_fractions(trace, dt, leg),
                "kinetic_energy_mean_J": _mean(energy[leg][moved[leg]]),
                "kinetic_energy_chair_alone_mean_J": _mean(alone[leg][moved[leg]]),
            }
        begin = end
    return {
        "ticks": len(trace["t_s"]),
        "duration_s": float(trace["t_s"][-1]),
        "goals": {goal.name: when for goal, when in zip(goals, met, strict=True)},
        "goals_met": sum(when is not None for when in met),
        **hand_fractions(trace, dt),
        "kinetic_energy_mean_J": _mean(energy[moved]),
        "kinetic_energy_max_J": float(energy.max()),
        "kinetic_energy_chair_alone_mean_J": _mean(alone[moved]),
        "legs": legs,
        "excess_max": {name: finite(values.max()) for name, values in over.items()},
        "broken_fraction": {name: float(np.mean(of)) for name, of in broken.items()},
        "broken_any_fraction": float(np.mean(np.logical_or.reduce(list(broken.values())))),
        # The rolling row of Eq. (4): zero sideways speed in the chassis frame, at each tick's heading.
        "rolling_residual_max_m_s": _rolling(base, trace) if base.moving != (0, 1, 2) else None,
        "wheel_residual_max_m_s": float(np.abs(rolled - trace["command"][:, :CHAIR]).max()),
        "arm_to_obstacles_min_m": float(to_room.min()) if to_room.size else None,
        "arm_height_min_m": float(over_floor[:, 2].min()),
        "hand_tilt_max_deg": float(np.rad2deg(tilt).max()),
        "at_rest_at_the_end": not trace["_world"][-1].any(),
        "scale_min": float(trace["scale"].min()),
        "stick_ignored": reason_counts(trace["stick_ignored"].tolist()),
        "stopped": reason_counts(trace["stopped"].tolist()),
        "status": status_counts(trace["status"].tolist()),
        "relaxed": status_counts(filter(None, trace["relaxed"].tolist())),
    }


def excesses(robot: MobileArm, drive: DriveName, trace: Trace, dt: float, room: Sequence[Obstacle]) -> dict[str, Array]:
    """Excess (N,) over each kind of limit, for every tick of `dt` [s]; negative while the limit is satisfied.

    Accelerations are difference quotients of successive velocities; the chair's velocity is in the chair frame.
    """
    chain, wheels, own = robot.chain, robot.drive(drive), trace["command"]
    ahead = trace["joint"] + trace["_world"] * dt
    speeds = np.abs(own[:, CHAIR:]) - chain.velocity[CHAIR:]
    if wheels.moving:  # a fixed chair has no speeds to limit
        floor = np.hypot(own[:, 0], own[:, 1]) - chain.velocity[0]
        speeds = np.column_stack([speeds, np.abs(own[:, 2]) - chain.velocity[2], floor])
    over = {
        "position": np.maximum(ahead - chain.upper, chain.lower - ahead)[:, CHAIR:].max(axis=1),
        "velocity": speeds.max(axis=1),
        "acceleration": (np.abs(np.diff(own, axis=0, prepend=0.0)) / dt - chain.acceleration).max(axis=1),
        "wheels": np.abs(trace["wheel"]).max(axis=1, initial=0.0) - wheels.limit,
        "keep_out": -arm_gaps(robot, ahead).min(axis=1, initial=np.inf),
    }
    return over | ({"obstacles": -chair_gaps(robot.outline, room, ahead).min(axis=1)} if room else {})


def hand_fractions(trace: Trace, dt: float, when: slice = slice(None)) -> dict[str, float | None]:
    """Fractions of the hand's path and of its rotation that arm and chair contribute; the two add up to one.

    The velocity that the arm or the chair gives the hand is projected onto the hand's direction of motion, integrated
    over time, and divided by the hand's path. A fraction is negative for motion against the hand's direction.
    """
    jacobians, velocity = trace["jacobian"][when], trace["_world"][when]
    chair = np.einsum("nij,nj->ni", jacobians[:, :, :CHAIR], velocity[:, :CHAIR])
    arm = np.einsum("nij,nj->ni", jacobians[:, :, CHAIR:], velocity[:, CHAIR:])
    numbers: dict[str, float | None] = {}
    for name, part, unit in (("path", slice(0, 3), "m"), ("turn", slice(3, 6), "rad")):
        whole = (chair + arm)[:, part]
        size = np.linalg.norm(whole, axis=1)
        along = np.sum(arm[:, part] * whole, axis=1) / np.where(size > MOVING, size, 1.0)
        total = float(size.sum() * dt)
        fraction = float(np.where(size > MOVING, along, 0.0).sum() * dt / total) if total > MOVING else None
        numbers[f"hand_{name}_{unit}"] = total
        numbers[f"hand_{name}_arm_fraction"] = fraction
        numbers[f"hand_{name}_chair_fraction"] = None if fraction is None else 1.0 - fraction
    numbers["chair_path_m"] = float(np.hypot(*velocity[:, :2].T).sum() * dt)
    numbers["chair_turn_rad"] = float(np.abs(velocity[:, 2]).sum() * dt)
    return numbers


def kinetic_energies(robot: MobileArm, drive: DriveName, trace: Trace) -> tuple[Array, Array]:
    """Two arrays (N,) [J]: the robot's kinetic energy, and the least energy for moving the hand with the chair alone.

    For the second, the arm is locked and only the hand's horizontal velocity counts; NaN without chair joints.
    """
    moving = list(robot.drive(drive).moving)
    energy, alone = np.empty(len(trace["joint"])), np.full(len(trace["joint"]), np.nan)
    rows = zip(trace["joint"], trace["_world"], trace["jacobian"], strict=True)
    for k, (q, velocity, jacobian) in enumerate(rows):
        inertia = robot.inertia(q)
        energy[k] = velocity @ inertia @ velocity / 2
        if not moving:
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


def goals_met(trace: Trace, goals: Sequence[GoalSection]) -> list[float | None]:
    """Times [s] at which the goals were reached, in order; None for a goal not reached and for all goals after it."""
    met: list[float | None] = []
    begin = 0
    for goal in goals:
        there = goal.met(trace["hand"][begin:], trace["gripper_closed"][begin:])
        if not there.any():
            break
        begin += int(there.argmax())
        met.append(float(trace["t_s"][begin]))
    return met + [None] * (len(goals) - len(met))


def _rolling(base: Drive, trace: Trace) -> float:
    rows = np.array([base.constraints(q) for q in trace["joint"]])
    return float(np.abs(np.einsum("nij,nj->ni", rows, trace["_world"])).max())


def _mean(values: Array) -> float | None:
    return finite(float(values.mean())) if values.size else None
