"""What a robot did along a moving pose."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rehab_opt.session.clearance import NearestBodies
from rehab_opt.session.outcome import Column, MovementOutcome
from rehab_opt.session.plant.motion import JointMotion
from rehab_opt.session.trace_columns import joint_columns, point_columns

__all__ = ["RobotOutcome"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class RobotOutcome(MovementOutcome):
    """A pose followed by a robot, N ticks.

    Parameters
    ----------
    reference, tool : (N, 3) positions [m].
    position_error, orientation_error : (N,) [m, rad].
    q, command : (N, n) true positions [rad], commanded velocities [rad/s].
    status : (N,) of each command.
    motion : of the joints, commanded and true; None where they are the same.
    near : how near bodies came to each other; None without `[clearance]`.
    """

    reference: Array = field(kw_only=True)
    tool: Array = field(kw_only=True)
    position_error: Array = field(kw_only=True)
    orientation_error: Array = field(kw_only=True)
    q: Array = field(kw_only=True)
    command: Array = field(kw_only=True)
    status: tuple[str, ...] = field(kw_only=True)
    motion: JointMotion | None = field(kw_only=True, default=None)
    near: NearestBodies | None = field(kw_only=True, default=None)

    def trace(self) -> Iterator[Column]:
        """One row a tick."""
        yield "t_s", self.time
        yield from point_columns("reference", self.reference)
        yield from point_columns("tool", self.tool)
        yield "position_error_m", self.position_error
        yield "orientation_error_rad", self.orientation_error
        yield "status", self.status
        yield from joint_columns("joint", self.chain, self.q, "rad")
        yield from joint_columns("command", self.chain, self.command, "rad_s")
        if self.motion is not None:
            yield from joint_columns("measured", self.chain, self.motion.measured, "rad")
            yield from joint_columns("velocity", self.chain, self.motion.velocity, "rad_s")
