"""A controller's output: a value that is safe to send, with status, certificate and reason."""

from __future__ import annotations

from enum import Enum, IntFlag
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["NUMBERED", "Command", "Relaxed", "Status"]


class Status(Enum):
    """Which stage of the fallback chain answered."""

    OK = "ok"  #: solved by the primary solver, certified
    BACKUP = "backup"  #: by the backup solver, or feasible, not certified optimal (see `reason`); its bounds certified
    BLOCKED = "blocked"  #: certified, but the bounds leave nothing of the commanded motion or desired force, or a hand
    # that stood under force is let go; the robot may still move
    UNREACHABLE = "unreachable"  #: the nearest reachable point is given instead (inverse kinematics)
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
"""Statuses in the order of their numbers in C and in a tick's output; others have no number."""


class Relaxed(IntFlag):
    """Bounds that were relaxed in this tick; velocity and force bounds never are."""

    NOTHING = 0
    POSITION = 1  #: outside a joint limit, beyond a plane or `Limit`, within an obstacle; led back where stated
    ACCELERATION = 2  #: the change was larger than the acceleration bound, to keep a bound above it
    TASK = 4  #: the hand moves slower than commanded, or off that direction; or the force is not the desired one
    SLEW = 8  #: the force was let go faster than its slew bound; it ranks with ACCELERATION


class Command(NamedTuple):
    """Output of one tick; immutable."""

    value: NDArray[np.float64]
    """Value to send: joint velocity (n,) [rad/s or m/s] or force (2,) [N]; always finite."""
    status: Status
    """Which stage of the fallback chain answered."""
    solver: str
    """Name of the solver; empty for a fallback command."""
    residual: float
    """Certificate residual of the answer; infinite for a fallback command."""
    iterations: int
    """Iterations of the solver; -1 if it reports none."""
    reason: str
    """Reason for another status than OK, or for limited assistance; empty otherwise."""
    relaxed: Relaxed
    """Relaxed bounds or tasks."""
    scale: float
    """Delivered fraction of the commanded motion, 0 to 1; 1 if none is commanded. For a tracker it is along the
    reference twist with feedback, for assistance along the desired force. Less than 0.001 (of at most `force_limit`)
    counts as 0: `BLOCKED`. For a `MirrorTracker` it is the pace of the clock, 0 while it waits."""
    wheels: NDArray[np.float64] | None = None
    """Wheel speeds [rad/s] for `value`, if there are wheels."""
