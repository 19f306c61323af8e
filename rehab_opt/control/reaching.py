"""Motion of the hand to a place, without a stick: a smoothed target and what brings the hand to it."""

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
"""[m/s] of the target, on each axis; the cap usual for machines that people stand beside."""
HAND_ACCELERATION = 0.5
"""[m/s^2]"""
HAND_JERK = 2.0
"""[m/s^3]"""
GAIN = 4.0
"""[1/s] rate at which the hand's distance from the smoothed target decays."""
LEASH = 0.03
"""[m] The smoothed target waits for a hand that lags by more."""
FARTHEST = 100.0
"""[m] What is further away than this from the hand is no target but a mistake, as of metres and millimetres."""
LATE = 0.1
"""[s] in which the way that is left from where the hand can stop is gone at the fastest: a chair takes longer to stop
than the target does, and hands passed a place by up to 84 mm."""
ARRIVED = 1e-4
"""[m] Nearer than this the hand is there."""
TINY = 1e-12
"""[m^2] A way that is none."""


class Reaching:
    """Twist of the hand that follows a smoothed target along the straight way.

    Where bounds slow the hand by more than `LEASH`, the target starts again from the hand, along the straight way from
    there: so the commanded direction stays that one. Axes that each go as fast as they may would command up to 55
    degrees off it, and the hand would stop where the straight way is free.
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
        """Why the last target cannot be aimed at; empty where it can."""

    def forget(self) -> None:
        """Begin anew at the next tick."""
        self._begun = False

    def twist(self, q: Array, target: Array, *, last: Array, moving: bool) -> Array:
        """(3,) velocity of the hand in the world frame [m/s] at joint values q (7,); NaN where a number is invalid.

        last : (7,) joint velocities of the last tick, the chair's in its own frame.
        """
        self.refused = ""
        valid = np.all(np.abs(q) <= MAX_MAGNITUDE) and np.all(np.abs(target) <= MAX_MAGNITUDE)  # NaN fails
        if not (moving and valid):
            self._begun = False
            wrong = np.flatnonzero(~(np.abs(target) <= MAX_MAGNITUDE))
            if wrong.size:
                self.refused = f"target[{wrong[0]}] is {target[wrong[0]]}, not a usable number"
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
            smoother.reset(hand, np.clip(min(along, most) * way, -HAND_SPEED, HAND_SPEED))  # which rounding may pass
            self._begun = True
        place = smoother.step(target).value
        error = place - hand
        if smoother.arrived and np.linalg.norm(error) <= ARRIVED:
            return np.zeros(3)
        return self._in_time(smoother.velocity + self._gain * error, q, last, hand, target)

    def _in_time(self, twist: Array, q: Array, last: Array, hand: Array, target: Array) -> Array:
        """(3,) the twist, slower where the hand, all braking as hard as they may from u `last`, would stop too late."""
        chain, way = self.robot.chain, target - hand
        seconds = float(np.max(np.abs(last) / chain.acceleration))
        stop, turned = q + seconds / 2 * last, q[2] + seconds / 4 * last[2]  # the mean of the chair's way
        cos, sin = math.cos(turned), math.sin(turned)
        stop[:2] = q[:2] + seconds / 2 * np.array([cos * last[0] - sin * last[1], sin * last[0] + cos * last[1]])
        left = float(way @ (target - chain.pose(stop)[:3, 3])) / max(float(np.linalg.norm(way)), TINY)
        return np.asarray(twist * min(1.0, max(left, 0.0) / LATE / max(float(np.linalg.norm(twist)), TINY)))
