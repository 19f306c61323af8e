"""What chair and arm did under one stick."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rehab_opt.session.ardis.loop import Motion
from rehab_opt.session.ardis.problem import DriveName, GoalSection
from rehab_opt.session.clearance import NearestBodies
from rehab_opt.session.outcome import Column, Outcome

if TYPE_CHECKING:
    from rehab_opt.control.obstacles import Obstacle
    from rehab_opt.kinematics.mobile_arm import MobileArm

__all__ = ["LAWS", "ArdisOutcome", "DriveOutcome"]

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
    near : how near bodies came to each other, by drive; empty without `[clearance]`.
    """

    robot: MobileArm = field(kw_only=True)
    room: tuple[Obstacle, ...] = field(kw_only=True)
    goals: tuple[GoalSection, ...] = field(kw_only=True)
    drives: Mapping[DriveName, DriveOutcome] = field(kw_only=True)
    near: Mapping[DriveName, NearestBodies] = field(kw_only=True, default_factory=dict)

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
