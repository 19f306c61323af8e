"""A controller's output: a value that is safe to send, its status, certificate and reason."""

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
    BRAKING = "braking"  #: safe command: decelerating within the limits
    HOLDING = "holding"  #: safe command: at rest
    RELEASING = "releasing"  #: safe command of a force: falling to zero
    RELEASED = "released"  #: safe command of a force: zero

    @property
    def certified(self) -> bool:
        """Whether a certificate of every bound stands behind the value."""
        return self in (Status.OK, Status.BACKUP, Status.BLOCKED)


NUMBERED = (
    Status.OK, Status.BACKUP, Status.BRAKING, Status.HOLDING, Status.RELEASING, Status.RELEASED, Status.BLOCKED,
)  # fmt: skip
"""In the order of their numbers in C, and in what a tick returns; there is no number for others."""


class Relaxed(IntFlag):
    """Which bounds were relaxed in this tick; velocity and force bounds never do."""

    NOTHING = 0
    POSITION = 1  #: outside a joint limit, beyond a plane or `Limit`, within an obstacle; led back where stated
    ACCELERATION = 2  #: the change was larger than the acceleration bound, to keep a bound above it
    TASK = 4  #: the hand moves slower than commanded, or off that direction; or the force is not the desired one
    SLEW = 8  #: the force was let go faster than its slew bound; it ranks with ACCELERATION


class Command(NamedTuple):
    """Output of one tick; frozen, its array read-only and its own."""

    value: NDArray[np.float64]
    """What to send: joint velocity (n,) in rad/s or m/s for a tracker, force (2,) in N of assistance; always finite."""
    status: Status
    """Which stage of the fallback chain answered."""
    solver: str
    """Name of the solver whose answer this is; empty for a safe command."""
    residual: float
    """Certificate residual of the answer; infinite for a safe command."""
    iterations: int
    """Iterations of the solver; -1 where it reports none."""
    reason: str
    """Why this is not a plain OK, or what holds help back; empty otherwise."""
    relaxed: Relaxed
    """Which bounds or tasks gave way."""
    scale: float
    """Fraction of the commanded motion that is delivered, 0 to 1, 1 where none is commanded; of a tracker: along the
    reference twist, feedback included; of assistance: of the desired force, along it. Less than a thousandth, of a
    desired force beyond `force_limit` of that, is 0: `BLOCKED`."""
    wheels: NDArray[np.float64] | None = None
    """Wheel speeds [rad/s] that belong to `value`, where there are wheels."""
