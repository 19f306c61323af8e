"""The closed loop of a stick, a law and a robot, and what chair and arm did in it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.control.command import Command, Relaxed, Status
from rehab_opt.control.joystick import Joystick, StickCommand
from rehab_opt.control.obstacles import Obstacle
from rehab_opt.kinematics.mobile_arm import CHAIR, MobileArm
from rehab_opt.plants.ideal import IdealJoints
from rehab_opt.plants.plant import Measurement, Plant
from rehab_opt.plants.touched import TouchedPlant
from rehab_opt.published.pseudoinverse_law import PseudoinverseLaw
from rehab_opt.session.ardis.problem import DriveName, GoalSection
from rehab_opt.session.ardis.stick import LET_GO, Moment, Stick, StickSample
from rehab_opt.session.clearance import NearestBodies
from rehab_opt.session.closed_loop import JointMotion, simulate
from rehab_opt.session.live.problem import LiveControl, LiveInputs
from rehab_opt.session.outcome import Array, Column, Columns, Outcome, point_columns, stacked

__all__ = [
    "LAWS",
    "ArdisOutcome",
    "DriveOutcome",
    "Motion",
    "Published",
    "Steering",
    "StickLaw",
    "simulate_motion",
]


STANDSTILL = 1.0
"""[s] that the robot is watched after the stick was let go for good: it comes to rest."""
NO_ANSWER = "no answer"


class StickLaw(Protocol):
    """A controller of the stick's twist, such as a `RedundancyResolver`."""

    def step(
        self, q: Array, twist: Array, rows: tuple[str, ...], frame: str, *, enable: object, stamp: float | None
    ) -> Command:
        """Joint velocities (n,), the chair's in the world frame, and wheel speeds."""
        ...


class Published:
    """Eq. (1), Honzik; where it has no answer the robot rests."""

    def __init__(self, law: PseudoinverseLaw) -> None:
        self._law = law

    def step(
        self, q: Array, twist: Array, rows: tuple[str, ...], frame: str, *, enable: object, stamp: float | None
    ) -> Command:
        """Eq. (1) of the stick, whatever `enable` and `stamp` say."""
        velocity = np.full(len(q), math.nan)
        with suppress(np.linalg.LinAlgError):
            velocity = self._law.rate(q, twist, rows, frame)
        answered = bool(np.all(np.isfinite(velocity)))
        status, reason = (Status.OK, "") if answered else (Status.HOLDING, NO_ANSWER)
        velocity = velocity if answered else np.zeros(len(q))
        wheels = self._law.wheels(q, velocity)
        return Command(velocity, status, "", math.inf, -1, reason, Relaxed.NOTHING, 1.0, wheels)


class Steering(LiveControl):
    """A stick, a law and a robot.

    Parameters
    ----------
    stick : who moves the stick where nobody operates; a simulated user is for this control alone.
    plant : that takes joint velocities, or with `wheels` wheel speeds and the arm's joint velocities.
    start : (n,) joint values [m, rad].
    """

    def __init__(
        self,
        robot: MobileArm,
        law: StickLaw,
        joystick: Joystick,
        stick: Stick,
        *,
        plant: Plant,
        start: Array,
        wheels: bool,
    ) -> None:
        super().__init__(plant, start)
        self._robot, self._joystick, self._law, self._stick, self._wheels = robot, joystick, law, stick, wheels
        self.mode = joystick.mode.name
        self.commanded: StickCommand

    def sample(self, time: float) -> StickSample | None:
        """The stick at a time [s], of the true robot as it is then; None once it is let go for good."""
        now = self.plant.truth.position
        return self._stick.at(Moment(time, now, self._robot.chain.pose(now)[:3, 3], self.mode))

    def untouched(self, time: float) -> LiveInputs:
        """The stick's."""
        return _inputs(self.sample(time))

    def step(self, inputs: LiveInputs, seen: Measurement) -> Command:
        """The law's, of what the stick asks for."""
        # NaN while the dead-man is released: afterwards the stick has to be let go before it moves anything.
        axes = inputs.stick if inputs.enable else (math.nan, math.nan)
        commanded = self.commanded = self._joystick.step(axes, switch=inputs.switch, gripper=inputs.gripper)
        self.mode = self._joystick.mode.name
        command = self._law.step(
            seen.position,
            commanded.twist,
            commanded.rows,
            commanded.frame,
            enable=inputs.enable,
            stamp=self.stamp(seen),
        )
        return command._replace(reason=commanded.reason) if inputs.enable and not command.reason else command

    def plant_command(self, command: Command) -> Array:
        """Wheel speeds in place of the chair's velocity where the plant has wheels."""
        if not self._wheels or command.wheels is None:
            return command.value
        return np.concatenate([command.wheels, command.value[CHAIR:]])

    def shown(self) -> dict[str, ArrayLike]:
        """Where the robot is, the push, the gripper."""
        truth = self.plant.truth
        return {"q": truth.position, "force": truth.force, "closed": self.commanded.gripper_closed}


def _inputs(sample: StickSample | None) -> LiveInputs:
    now = sample or LET_GO
    return LiveInputs(enable=True, stick=now.axes, switch=now.switch, gripper=now.gripper)


@dataclass(frozen=True, eq=False)
class Motion:
    """A run, N ticks; what holds from each tick to the next.

    Parameters
    ----------
    dt : [s]. time : (N,) [s]. q : (N, 7) [m, rad] at the beginning of each tick.
    velocity : (N, 7) what was sent [m/s, rad/s], the chair's in the world frame; chassis : the same in its own.
    wheels : (N, w) [rad/s]. hand : (N, 3) [m]. poses : (N, 4, 4) of the hand. jacobians : (N, 6, 7).
    sticks : (N, 2) deflections. commanded : (N,) whether anything was asked for. closed : (N,) the gripper.
    ignored : (N,) why a stick that may ask for motion gets none, or empty.
    stopped : (N,) why the law brakes or rests, whatever the stick asks for, or empty.
    mode, status, relaxed : (N,) each. scale : (N,) fraction of the commanded motion that was delivered.
    motion : commanded and true, of a robot that does not move exactly as commanded.
    """

    dt: float
    time: Array
    q: Array
    velocity: Array
    chassis: Array
    wheels: Array
    poses: Array
    jacobians: Array
    sticks: Array
    commanded: NDArray[np.bool_]
    ignored: tuple[str, ...]
    stopped: tuple[str, ...]
    closed: NDArray[np.bool_]
    mode: tuple[str, ...]
    status: tuple[str, ...]
    relaxed: tuple[str, ...]
    scale: Array
    motion: JointMotion | None = None

    @property
    def hand(self) -> Array:
        """(N, 3) [m]"""
        return self.poses[:, :3, 3]


def simulate_motion(
    robot: MobileArm,
    law: StickLaw,
    joystick: Joystick,
    stick: Stick,
    start: Array,
    *,
    dt: float,
    plant: Plant | None = None,
    progress: Callable[[int, int], None] = lambda *_: None,
) -> Motion:
    """Run until the stick was let go for good, and a second more.

    Parameters
    ----------
    start : (7,) joint values [m, rad]; the robot is at rest.
    dt : [s] tick, which joystick and law were made for.
    plant : that takes wheel speeds, and the arm's joint velocities; by default the robot moves exactly as commanded.
    progress : told the tick and how many there may be.
    """
    touched = TouchedPlant(IdealJoints(dt) if plant is None else plant)
    control = Steering(robot, law, joystick, stick, plant=touched, start=start, wheels=plant is not None)
    left, inputs = math.ceil(STANDSTILL / dt), LiveInputs()
    rows: list[tuple[tuple[float, float], StickCommand, str]] = []

    def steer(k: int) -> LiveInputs | None:
        nonlocal left, inputs
        if left <= 0:
            return None
        sample = control.sample(k * dt)
        if sample is None:
            left -= 1
        inputs = _inputs(sample)
        return inputs

    ran = simulate(
        control, steer, ticks=math.ceil((stick.duration + STANDSTILL) / dt) + 1, progress=progress,
        note=lambda *_: rows.append((inputs.stick, control.commanded, control.mode)),
    )  # fmt: skip
    sticks, commanded, modes = zip(*rows, strict=True)
    return Motion(
        dt=dt,
        time=dt * np.arange(len(rows), dtype=np.float64),
        q=ran.q,
        velocity=ran.values,
        chassis=np.array([robot.chassis_velocity(*pair) for pair in zip(ran.q, ran.values, strict=True)]),
        wheels=np.array([np.empty(0) if each.wheels is None else each.wheels for each in ran.commands]),
        poses=np.array([robot.chain.pose(each) for each in ran.q]),
        jacobians=np.array([robot.chain.jacobian(each) for each in ran.q]),
        sticks=np.array(sticks),
        commanded=np.array([bool(each.twist.any()) for each in commanded]),
        ignored=tuple(each.reason for each in commanded),
        stopped=tuple("" if each.status.certified else each.reason for each in ran.commands),
        closed=np.array([each.gripper_closed for each in commanded]),
        mode=modes,
        status=tuple(NO_ANSWER if each.reason == NO_ANSWER else each.status.value for each in ran.commands),
        relaxed=ran.relaxed,
        scale=ran.scales,
        motion=ran.motion,
    )


LAWS = ("published", "optimised")
METRES = 2
"""Joints of the chain that are lengths."""


@dataclass(frozen=True, eq=False)
class DriveOutcome:
    """One drive: a run of the published law, and one of ours."""

    published: Motion
    optimised: Motion

    @property
    def by_law(self) -> dict[str, Motion]:
        """In the order of `LAWS`."""
        return {"published": self.published, "optimised": self.optimised}


@dataclass(frozen=True, eq=False)
class ArdisOutcome(Outcome):
    """A run of a problem with each of its drives.

    Parameters
    ----------
    robot : that moved. room : walls and posts. goals : of the user.
    drives : motions by drive.
    near : how near bodies came to each other, by drive; empty without `[clearance]`.
    """

    robot: MobileArm = field(kw_only=True)
    room: tuple[Obstacle, ...] = field(kw_only=True)
    goals: tuple[GoalSection, ...] = field(kw_only=True)
    drives: Mapping[DriveName, DriveOutcome] = field(kw_only=True)
    near: Mapping[DriveName, NearestBodies] = field(kw_only=True, default_factory=dict)

    def trace(self) -> Iterable[Column]:
        """One row a drive, law and tick; wheels that a drive does not have are at rest."""
        motions = [(drive, law, motion) for drive, of in self.drives.items() for law, motion in of.by_law.items()]
        wheels = max(motion.wheels.shape[1] for *_, motion in motions)
        return stacked(self._columns(*each, wheels) for each in motions).items()

    def _columns(self, drive: str, law: str, motion: Motion, wheels: int) -> Columns:
        n, names = len(motion.time), self.robot.chain.names
        joints = [(name, "m" if i < METRES else "rad") for i, name in enumerate(names)]
        turning = np.hstack([motion.wheels, np.zeros((n, wheels - motion.wheels.shape[1]))])
        return {
            "drive": (drive,) * n,
            "law": (law,) * n,
            "t_s": motion.time,
            "stick_forward": motion.sticks[:, 0],
            "stick_left": motion.sticks[:, 1],
            "stick_mode": motion.mode,
            "stick_ignored": motion.ignored,
            "stopped": motion.stopped,
            "gripper_closed": motion.closed.astype(int),
            **dict(point_columns("hand", motion.hand)),
            **{f"joint_{name}_{unit}": of for (name, unit), of in zip(joints, motion.q.T, strict=True)},
            # The chair's in its own frame, in which its limits are.
            **{f"command_{name}_{unit}_s": of for (name, unit), of in zip(joints, motion.chassis.T, strict=True)},
            **{f"wheel_{i + 1}_rad_s": of for i, of in enumerate(turning.T)},
            "scale": motion.scale,
            "status": motion.status,
            "relaxed": motion.relaxed,
        }
