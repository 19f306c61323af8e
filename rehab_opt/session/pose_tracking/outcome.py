"""What a robot did along a moving pose."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rehab_opt.session.outcome import MovementOutcome
from rehab_opt.session.plant.motion import JointMotion

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
    """

    reference: Array = field(kw_only=True)
    tool: Array = field(kw_only=True)
    position_error: Array = field(kw_only=True)
    orientation_error: Array = field(kw_only=True)
    q: Array = field(kw_only=True)
    command: Array = field(kw_only=True)
    status: tuple[str, ...] = field(kw_only=True)
    motion: JointMotion | None = field(kw_only=True, default=None)
