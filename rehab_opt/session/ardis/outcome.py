"""The closed loop of a stick, a law and a robot, and what chair and arm did in it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from rehab_opt.kinematics.mobile_arm import CHAIR
from rehab_opt.plants.ideal import IdealJoints
from rehab_opt.session.ardis.problem import DriveName, GoalSection
from rehab_opt.session.ardis.stick import Moment, Stick, StickSample
from rehab_opt.session.outcome import Column, Outcome
from rehab_opt.session.plant.loop import JointMotion, Sent, closed_loop

if TYPE_CHECKING:
    from rehab_opt.control.joystick import Joystick, StickCommand
    from rehab_opt.control.obstacles import Obstacle
    from rehab_opt.control.redundancy import RedundancyResolver
    from rehab_opt.kinematics.mobile_arm import MobileArm
    from rehab_opt.plants.plant import Measurement, Plant
    from rehab_opt.published.pseudoinverse_law import PseudoinverseLaw

__all__ = [
    "LAWS",
    "LET_GO",
    "Answer",
    "ArdisOutcome",
    "DriveOutcome",
    "Law",
    "Motion",
    "Optimised",
    "Published",
    "moved",
]

Array = NDArray[np.float64]


STANDSTILL = 1.0
"""[s] that the robot is watched after the stick was let go for good: it comes to rest."""
LET_GO = StickSample((0.0, 0.0))


class Answer(NamedTuple):
    """What a law answered in one tick."""

    velocity: Array
    """(7,) [m/s, rad/s], the chair's in the world frame."""
    wheels: Array
    """[rad/s]"""
    status: str
    yielded: str
    scale: float
    """Share of the asked motion that is delivered."""


class Law(Protocol):
    """Something that makes joint velocities of what the stick asks for."""

    def step(self, q: Array, asked: StickCommand) -> Answer:
        """Joint velocities now."""
        ...


class Optimised:
    """`RedundancyResolver`."""

    def __init__(self, resolver: RedundancyResolver) -> None:
        self._resolver = resolver

    def step(self, q: Array, asked: StickCommand) -> Answer:
        """Its command."""
        command = self._resolver.step(q, asked.twist, asked.rows, asked.frame)
        wheels = command.wheels if command.wheels is not None else np.empty(0)
        yielded = str(command.yielded.name or "").lower().replace("|", ", ")
        return Answer(
            command.value, wheels, command.status.value, "" if yielded == "nothing" else yielded, command.scale
        )


class Published:
    """Eq. (1), Honzik, as it is; where it has no answer the robot is told to stand still."""

    def __init__(self, law: PseudoinverseLaw) -> None:
        self._law = law

    def step(self, q: Array, asked: StickCommand) -> Answer:
        """Eq. (1) of the stick."""
        status, velocity = "ok", np.zeros(len(q))
        try:
            velocity = self._law.rate(q, asked.twist, asked.rows, asked.frame)
        except np.linalg.LinAlgError:
            status = "no answer"
        if not np.all(np.isfinite(velocity)):
            status, velocity = "no answer", np.zeros(len(q))
        return Answer(velocity, self._law.wheels(q, velocity), status, "", 1.0)


@dataclass(frozen=True, eq=False)
class Motion:
    """A run, N ticks; what holds from each tick to the next.

    Parameters
    ----------
    dt : [s]. time : (N,) [s]. q : (N, 7) [m, rad] at the beginning of each tick.
    velocity : (N, 7) what was sent [m/s, rad/s], the chair's in the world frame; chassis : the same in its own.
    wheels : (N, w) [rad/s]. hand : (N, 3) [m]. poses : (N, 4, 4) of the hand. jacobians : (N, 6, 7).
    sticks : (N, 2) deflections. asked : (N,) whether anything was asked for. closed : (N,) the gripper.
    mode, status, yielded : (N,) each. scale : (N,) share of the asked motion that was delivered.
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
    asked: NDArray[np.bool_]
    closed: NDArray[np.bool_]
    mode: tuple[str, ...]
    status: tuple[str, ...]
    yielded: tuple[str, ...]
    scale: Array
    motion: JointMotion | None = None

    @property
    def hand(self) -> Array:
        """(N, 3) [m]"""
        return self.poses[:, :3, 3]


def moved(
    robot: MobileArm,
    law: Law,
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
    most = math.ceil((stick.duration + STANDSTILL) / dt) + 1
    left = math.ceil(STANDSTILL / dt)
    ideal = plant is None
    robot_in_loop: Plant = IdealJoints(dt) if plant is None else plant
    rows: list[tuple[Any, ...]] = []

    def steer(k: int, seen: Measurement) -> Sent | None:
        nonlocal left
        if left <= 0:
            return None
        now = robot_in_loop.truth.position
        pose = robot.chain.pose(now)
        given = stick.at(Moment(k * dt, now, pose[:3, 3], joystick.mode.name))
        if given is None:
            left -= 1
        sample = given or LET_GO
        asked = joystick.step(sample.axes, switch=sample.switch, gripper=sample.gripper)
        answer = law.step(seen.position, asked)
        rows.append((now, answer, pose, sample.axes, asked, joystick.mode.name))
        wheels_and_arm = answer.velocity if ideal else np.concatenate([answer.wheels, answer.velocity[CHAIR:]])
        return Sent(answer.velocity, wheels_and_arm)

    motion = closed_loop(robot_in_loop, start, steer, ticks=most, progress=progress)
    q = np.array([row[0] for row in rows])
    velocity = np.array([row[1].velocity for row in rows])
    return Motion(
        dt=dt,
        time=dt * np.arange(len(rows), dtype=np.float64),
        q=q,
        velocity=velocity,
        chassis=np.array([robot.chassis_velocity(*pair) for pair in zip(q, velocity, strict=True)]),
        wheels=np.array([row[1].wheels for row in rows]),
        poses=np.array([row[2] for row in rows]),
        jacobians=np.array([robot.chain.jacobian(each) for each in q]),
        sticks=np.array([row[3] for row in rows]),
        asked=np.array([bool(row[4].twist.any()) for row in rows]),
        closed=np.array([row[4].gripper_closed for row in rows]),
        mode=tuple(row[5] for row in rows),
        status=tuple(row[1].status for row in rows),
        yielded=tuple(row[1].yielded for row in rows),
        scale=np.array([row[1].scale for row in rows]),
        motion=motion,
    )


LAWS = ("published", "optimised")
METRES = 2
"""Joints of the chain that are lengths."""


@dataclass(frozen=True, eq=False)
class DriveOutcome:
    """One drive under its stick: what the published law made of it, and what ours did."""

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
    """

    robot: MobileArm = field(kw_only=True)
    room: tuple[Obstacle, ...] = field(kw_only=True)
    goals: tuple[GoalSection, ...] = field(kw_only=True)
    drives: Mapping[DriveName, DriveOutcome] = field(kw_only=True)

    def trace(self) -> Iterator[Column]:
        """One row a drive, law and tick; wheels that a drive does not have are at rest."""
        motions = [(drive, law, motion) for drive, of in self.drives.items() for law, motion in of.by_law.items()]

        def numbers(of: Callable[[Motion], NDArray[np.float64]]) -> list[float]:
            return [float(value) for _, _, motion in motions for value in of(motion)]

        def words(of: Callable[[Motion], tuple[str, ...]]) -> tuple[str, ...]:
            return tuple(value for _, _, motion in motions for value in of(motion))

        yield "drive", tuple(drive for drive, _, motion in motions for _ in motion.time)
        yield "law", tuple(law for _, law, motion in motions for _ in motion.time)
        yield "t_s", numbers(lambda motion: motion.time)
        for axis, name in enumerate(("forward", "left")):
            yield f"stick_{name}", numbers(lambda motion, axis=axis: motion.sticks[:, axis])  # type: ignore[misc]
        yield "stick_mode", words(lambda motion: motion.mode)
        yield "gripper_closed", [int(value) for _, _, motion in motions for value in motion.closed]
        for axis, name in enumerate("xyz"):
            yield f"hand_{name}_m", numbers(lambda motion, axis=axis: motion.hand[:, axis])  # type: ignore[misc]
        for joint, name in enumerate(self.robot.chain.names):
            unit = "m" if joint < METRES else "rad"
            yield f"joint_{name}_{unit}", numbers(lambda motion, joint=joint: motion.q[:, joint])  # type: ignore[misc]
        for joint, name in enumerate(self.robot.chain.names):
            unit = "m_s" if joint < METRES else "rad_s"
            # The chair's in its own frame, in which its limits are.
            yield f"command_{name}_{unit}", numbers(lambda motion, joint=joint: motion.chassis[:, joint])  # type: ignore[misc]
        most = max(motion.wheels.shape[1] for _, _, motion in motions)
        for wheel in range(most):
            yield f"wheel_{wheel + 1}_rad_s", numbers(lambda motion, wheel=wheel: _wheel(motion, wheel))  # type: ignore[misc]
        yield "scale", numbers(lambda motion: motion.scale)
        yield "status", words(lambda motion: motion.status)
        yield "yielded", words(lambda motion: motion.yielded)


def _wheel(motion: Motion, wheel: int) -> NDArray[np.float64]:
    return motion.wheels[:, wheel] if wheel < motion.wheels.shape[1] else np.zeros(len(motion.time))
