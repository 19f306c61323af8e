"""A simulated user, who watches the hand and moves the stick until the hand has reached each goal in order.

The user is deterministic, and changes to the stick's next mode when the current mode has little distance left to cover.
Near the goal, the user presses the gripper's button if the goal requires it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rehab_opt.control.joystick import Joystick, StickMode
from rehab_opt.session.ardis.problem import GoalSection
from rehab_opt.session.ardis.stick import LET_GO, Moment
from rehab_opt.session.live.problem import LiveInputs
from rehab_opt.session.outcome import Array

RATE = 20.0  # [Hz] at which the user changes the deflection
NEAR = 0.5  # the user stops within this fraction of a goal's tolerance
SLOW = 0.8  # [1/s] the deflection falls in proportion to the distance below speed / SLOW
PRESS = 0.25  # [s] that a button is held down
PAUSE = 0.3  # [s] without motion after a button is released
BEGIN = 0.5  # [s] from the start until the stick is first moved
PATIENCE = 60.0  # [s] for one goal; then the user releases the stick for good


class SimulatedUser:
    """A stick that a simulated user moves; every run needs a new user.

    Parameters
    ----------
    goals : at least one. joystick : the user knows its modes and its dead zone.
    """

    def __init__(self, goals: Sequence[GoalSection], joystick: Joystick) -> None:
        self._dead = joystick.dead_zone
        self.goals, self._modes = list(goals), {mode.name: mode for mode in joystick.modes}
        self.duration = PATIENCE * len(self.goals) + BEGIN
        self._sample, self._next, self._begun = LET_GO, 0.0, 0.0
        self._closed, self._busy_until, self._pressed_until, self._button = False, BEGIN, 0.0, ""
        self._over = math.inf

    def at(self, moment: Moment) -> LiveInputs | None:
        """The stick's current sample; None after the last goal, or after a goal that was not reached in time."""
        if moment.time > self._over or moment.time - self._begun > PATIENCE:
            return None
        if moment.time >= self._next - 1e-9:
            self._next, self._sample = moment.time + 1 / RATE, self._decide(moment)
        return self._sample

    def _decide(self, moment: Moment) -> LiveInputs:
        if moment.time < self._busy_until:
            down = self._button if moment.time < self._pressed_until else ""
            return LET_GO._replace(switch=down == "switch", gripper=down == "gripper")
        while self.goals:
            goal = self.goals[0]
            error = np.array(goal.hand_m) - moment.hand
            near, size = NEAR * goal.within_m, float(np.linalg.norm(error))
            if size <= 1.2 * near:
                if goal.gripper is not None and (goal.gripper == "closed") != self._closed:
                    self._closed = not self._closed
                    return self._press("gripper", moment.time)
                self.goals.pop(0)
                self._begun = moment.time
                continue
            mode = self._modes[moment.mode]
            ways = _ways(error, moment, mode)
            mine = float(np.linalg.norm(ways))
            other = math.sqrt(max(size**2 - mine**2, 0.0))
            # Finish the current mode's motion before changing to the next mode.
            if mine <= 0.6 * near or (mine <= near and other > 3 * near):
                return self._press("switch", moment.time)
            forward, left = (SLOW * way / speed if speed else 0.0 for way, speed in zip(ways, mode.speeds, strict=True))
            size = math.hypot(forward, left)
            fraction = (self._dead + (1 - self._dead) * min(size, 1.0)) / size
            # Rounded to hundredths, like a recording of a stick.
            return LET_GO._replace(stick=(round(fraction * forward, 2) + 0.0, round(fraction * left, 2) + 0.0))
        self._over = min(self._over, moment.time + BEGIN)
        return LET_GO

    def _press(self, button: str, time: float) -> LiveInputs:
        self._button, self._pressed_until, self._busy_until = button, time + PRESS, time + PRESS + PAUSE
        return LET_GO._replace(switch=button == "switch", gripper=button == "gripper")


def _ways(error: Array, moment: Moment, mode: StickMode) -> Array:
    """(2,) [m] remaining distance along the two quantities that the mode moves; zero for a rotation."""
    cos, sin = math.cos(moment.q[2]), math.sin(moment.q[2])
    along = {"x": cos * error[0] + sin * error[1], "y": cos * error[1] - sin * error[0], "z": error[2]}
    moved = zip(mode.rows, mode.speeds, strict=True)
    return np.array([along.get(row, 0.0) if speed else 0.0 for row, speed in moved])
