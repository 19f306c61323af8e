"""Motion of the hand to a target without a stick: a smoothed target and the twist towards it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.smoother import Smoother
from rehab_opt.kinematics.mobile_arm import MobileArm
from rehab_opt.optim.rows import MAX_MAGNITUDE

__all__ = ["Reaching"]

Array = NDArray[np.float64]

HAND_SPEED = 0.25
"""[m/s] Speed of the target on each axis; the usual limit for machines near people."""
HAND_ACCELERATION = 0.5
"""[m/s^2] Largest acceleration of the smoothed target on each axis."""
HAND_JERK = 2.0
"""[m/s^3] Largest jerk of the smoothed target on each axis."""
GAIN = 4.0
"""[1/s] Decay rate of the hand's distance from the smoothed target."""
LEASH = 0.03
"""[m] The smoothed target waits for a hand that lags by more."""
FARTHEST = 100.0
"""[m] Largest distance of a target from the hand; a larger one is a mistake, such as millimetres."""
LATE = 0.1
"""[s] The hand takes at least this long from its stopping point to the target, since a chair stops late."""
ARRIVED = 1e-4
"""[m] Distance below which the hand has arrived."""
TINY = 1e-12
"""Smallest divisor."""


class Reaching:
    """Twist of the hand that follows a smoothed target along a straight line.

    If bounds hold the hand back by more than `LEASH`, the smoothed target restarts at the hand, to stay on the line.
    """

    def __init__(self, robot: MobileArm, *, dt: float) -> None:
        self.robot = robot
        self._smoother = Smoother(
            velocity=HAND_SPEED,
            acceleration=HAND_ACCELERATION,
            jerk=HAND_JERK,
            dt=dt,
            axes=3,
            max_age=math.inf,
            straight=True,
        )
        self._gain = (1 - math.exp(-GAIN * dt)) / dt
        self._begun = False
        self.refused = ""
        """Reason why the last target was refused; empty if it was accepted."""

    def forget(self) -> None:
        """Restart at the next tick."""
        self._begun = False

    def twist(self, q: Array, target: Array, *, last: Array, moving: bool) -> Array:
        """Velocity (3,) [m/s] of the hand in the world frame at joint values q (n,); NaN for invalid numbers.

        last : (n,) last joint velocities; those of the chair are in its own frame.
        """
        self.refused = ""
        valid = np.all(np.abs(q) <= MAX_MAGNITUDE) and np.all(np.abs(target) <= MAX_MAGNITUDE)  # NaN fails
        if not (moving and valid):
            self._begun = False
            wrong = np.flatnonzero(~(np.abs(target) <= MAX_MAGNITUDE))
            if wrong.size:
                self.refused = f"target[{wrong[0]}] is {target[wrong[0]]}, not a valid number"
            return np.full(3, math.nan) if moving else np.zeros(3)
        hand = self.robot.chain.pose(q)[:3, 3]
        if not np.linalg.norm(target - hand) <= FARTHEST:
            self._begun, self.refused = False, f"target is more than {FARTHEST:g} m away"
            return np.full(3, math.nan)
        smoother = self._smoother
        if not self._begun or not np.linalg.norm(smoother.position - hand) <= LEASH:
            way = target - hand
            along = max(0.0, float(smoother.velocity @ way) / max(float(way @ way), TINY)) if self._begun else 0.0
            most = HAND_SPEED / max(float(np.max(np.abs(way))), TINY)
            smoother.reset(hand, np.clip(min(along, most) * way, -HAND_SPEED, HAND_SPEED))  # rounding may exceed it
            self._begun = True
        place = smoother.step(target).value
        error = place - hand
        if smoother.arrived and np.linalg.norm(error) <= ARRIVED:
            return np.zeros(3)
        return self._in_time(smoother.velocity + self._gain * error, q, last, hand, target)

    def _in_time(self, twist: Array, q: Array, last: Array, hand: Array, target: Array) -> Array:
        """Twist (3,), slowed so that the hand takes at least `LATE` from the end of hard braking to the target."""
        chain, way = self.robot.chain, target - hand
        seconds = float(np.max(np.abs(last) / chain.acceleration))
        stop, turned = q + seconds / 2 * last, q[2] + seconds / 4 * last[2]  # mean of the chair's motion
        cos, sin = math.cos(turned), math.sin(turned)
        stop[:2] = q[:2] + seconds / 2 * np.array([cos * last[0] - sin * last[1], sin * last[0] + cos * last[1]])
        left = float(way @ (target - chain.pose(stop)[:3, 3])) / max(float(np.linalg.norm(way)), TINY)
        return np.asarray(twist * min(1.0, max(left, 0.0) / LATE / max(float(np.linalg.norm(twist)), TINY)))
