"""What chair and arm did under one stick."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from rehab_opt.session.ardis.loop import Motion
from rehab_opt.session.ardis.problem import DriveName, GoalSection
from rehab_opt.session.outcome import Outcome

if TYPE_CHECKING:
    from rehab_opt.control.obstacles import Obstacle
    from rehab_opt.kinematics.mobile_arm import MobileArm

__all__ = ["LAWS", "ArdisOutcome", "DriveOutcome"]

LAWS = ("published", "optimised")


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
