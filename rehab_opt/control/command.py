"""Output of a controller: a value that is safe to send, with status, certificate and reason."""

from __future__ import annotations

from enum import Enum, IntFlag
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["NUMBERED", "Command", "Relaxed", "Status"]


class Status(Enum):
    """Stage of the fallback chain that gave the answer."""

    OK = "ok"  #: solved by the primary solver, certified
    BACKUP = "backup"  #: answered by the backup solver, or bounds certified but not optimality (see `reason`)
    BLOCKED = "blocked"  #: certified, but the bounds leave nothing of the commanded motion or desired force; or a hand
    # that stood still under force is released. The robot may still move.
    UNREACHABLE = "unreachable"  #: inverse kinematics: the answer is the nearest reachable point
    BRAKING = "braking"  #: fallback command: decelerating within the limits
    HOLDING = "holding"  #: fallback command: at rest
    RELEASING = "releasing"  #: fallback command of a force: falling to zero
    RELEASED = "released"  #: fallback command of a force: zero

    @property
    def certified(self) -> bool:
        """Whether a certificate covers every bound of the value."""
        return self in (Status.OK, Status.BACKUP, Status.BLOCKED)


NUMBERED = (
    Status.OK, Status.BACKUP, Status.BRAKING, Status.HOLDING, Status.RELEASING, Status.RELEASED, Status.BLOCKED,
)  # fmt: skip
"""Statuses in the order of their numbers in C code and in a tick's output; other statuses have no number."""


class Relaxed(IntFlag):
    """Bounds that were relaxed in this tick; velocity and force bounds never are."""

    NOTHING = 0
    POSITION = 1  #: the robot is outside a joint limit, beyond a plane or `Limit`, or within an obstacle
    ACCELERATION = 2  #: the velocity changed by more than the acceleration bound, to satisfy a stronger bound
    TASK = 4  #: the hand moves slower than commanded or off that direction, or the force is not the desired one
    SLEW = 8  #: the force was released faster than its slew limit; ranks with ACCELERATION


class Command(NamedTuple):
    """Output of one tick; immutable."""

    value: NDArray[np.float64]
    """Value to send: joint velocity (n,) [rad/s or m/s] or force (2,) [N]; always finite."""
    status: Status
    solver: str
    """Name of the solver; empty for a fallback command."""
    residual: float
    """Certificate residual of the answer; infinite for a fallback command."""
    iterations: int
    """Iterations of the solver; -1 if it reports none."""
    reason: str
    """Reason for a status other than OK, or for limited assistance; empty otherwise."""
    relaxed: Relaxed
    scale: float
    """Delivered fraction of the commanded motion, 0 to 1; 1 if no motion is commanded.

    Trackers measure it along the reference twist with feedback, assistance along the desired force. A `MirrorTracker`
    reports the pace of its clock. Less than 0.001 counts as 0: `BLOCKED`.
    """
    wheels: NDArray[np.float64] | None = None
    """Wheel speeds [rad/s] for `value`, if there are wheels."""
