"""Where a hand is and how it moves, as far as its sensor can be believed, with the energy accounted for meanwhile."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rehab_opt.control.energy_tank import EnergyTank
from rehab_opt.control.watchdog import Watchdog, seconds_of
from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.real_array import real_array

__all__ = ["Hand"]

FURTHEST = 1e3
"""[m] A position beyond this is a broken sensor."""
ROUNDING = 1e-12
"""[m] By what a step at the speed cap may exceed it."""

_INF, _NAN, _hypot = math.inf, math.nan, math.hypot
_FLOATS = np.dtype(np.float64)


class Hand:
    """Judges one sample a tick; `x`, `y`, `vx`, `vy` are the hand's where the judgement is good.

    Parameters
    ----------
    tank : is told what the force may have delivered between samples.
    watchdog : judges stamps.
    dt : [s] nominal tick. speed_cap : [m/s] a faster hand is let go.
    velocity_lag : [s] time constant of the estimated velocity.
    trust_stillness : whether a position that repeats itself exactly was seen, or may be a frozen sensor's.
    """

    __slots__ = (
        "_cap", "_dt", "_estimated_x", "_estimated_y", "_lag", "_stamp", "_stamped", "_tank", "_trusted", "_watchdog",
        "vx", "vy", "x", "y",
    )  # fmt: skip

    x: float
    y: float
    vx: float
    vy: float

    def __init__(
        self,
        tank: EnergyTank,
        watchdog: Watchdog,
        *,
        dt: float,
        speed_cap: float,
        velocity_lag: float,
        trust_stillness: bool,
    ) -> None:
        self._tank, self._watchdog = tank, watchdog
        self._dt, self._cap, self._lag, self._trusted = dt, speed_cap, velocity_lag, trust_stillness
        self.reset()

    def reset(self) -> None:
        """Forget where it was."""
        self._watchdog.reset()
        self.x = self.y = self._stamp = _NAN
        self.vx = self.vy = self._estimated_x = self._estimated_y = 0.0
        self._stamped = False

    def read(self, x: ArrayLike, v: ArrayLike | None, stamp: float | None, force: Any) -> tuple[str, bool]:
        """Take one sample, after `force` (2,) [N] has acted since the last; see `Assistance.step`.

        Returns why it must not be acted on, or "", and whether the force must be let go at once.
        """
        px, py = x.tolist() if type(x) is np.ndarray and x.dtype is _FLOATS and x.shape == (2,) else _pair("x", x)
        reason, seconds = "", self._dt
        if stamp is not None:
            reason, self._stamped = self._watchdog.check(stamp), True
            seconds = self._since(stamp)
        elif self._stamped:
            reason = "stamp is missing"  # who gave stamps before has lost them
        self._tank.elapse(force[0], force[1], seconds)
        if not (-FURTHEST <= px <= FURTHEST and -FURTHEST <= py <= FURTHEST):
            reason = reason or f"x is ({px}, {py}), not a usable position"
        sudden = "" if reason else self._look(px, py)
        if v is None:
            self.vx, self.vy = self._estimated_x, self._estimated_y
        else:
            vx, vy = v.tolist() if type(v) is np.ndarray and v.dtype is _FLOATS and v.shape == (2,) else _pair("v", v)
            self.vx, self.vy, speed = vx, vy, _hypot(vx, vy)
            if not speed <= self._cap:
                if speed < _INF:
                    sudden = f"hand moves at {speed:.3g} m/s, at most {self._cap:g} m/s"
                else:
                    reason = reason or f"v is ({vx}, {vy}), not a usable velocity"
        return sudden or reason, sudden != ""

    def _since(self, stamp: object) -> float:
        """[s] since the last stamp, and no less than a tick."""
        now = seconds_of(stamp)
        if now is None:
            return self._dt
        advance = now - self._stamp
        if math.isfinite(now):
            self._stamp = now
        return advance if self._dt < advance < _INF else self._dt

    def _look(self, x: float, y: float) -> str:
        """Settle with the tank where the hand has gone; why the force must be let go, or ""."""
        tank = self._tank
        dx, dy, seconds = x - self.x, y - self.y, tank.unseen
        if dx == 0.0 and dy == 0.0:
            self._estimate(0.0, 0.0, seconds)
            if self._trusted:
                tank.seen(0.0, 0.0)
            return ""
        self.x, self.y, distance = x, y, _hypot(dx, dy)
        if distance <= self._cap * seconds * (1 + 1e-9) + ROUNDING:
            self._estimate(dx / seconds, dy / seconds, seconds)
            tank.seen(dx, dy)
            return ""
        self._estimated_x = self._estimated_y = 0.0
        if math.isnan(distance):  # the first position
            tank.seen(0.0, 0.0)
            return ""
        tank.jumped(distance)
        return f"position moved {distance:.3g} m in {seconds:.3g} s, at most {self._cap:g} m/s"

    def _estimate(self, vx: float, vy: float, seconds: float) -> None:
        """A low-pass of differences: it lags by its time constant and half a tick."""
        share = seconds / (self._lag + seconds)
        self._estimated_x += share * (vx - self._estimated_x)
        self._estimated_y += share * (vy - self._estimated_y)


def _pair(argument: str, value: Any) -> tuple[float, float]:
    """Two floats; infinite where a number is too large for one."""
    if type(value) is tuple and len(value) == 2 and type(value[0]) is type(value[1]) is float:
        return value
    try:
        pair = real_array(value)
    except OverflowError:
        return _INF, _INF
    except (TypeError, ValueError) as problem:
        raise ConfigurationError(argument, value, "two real numbers") from problem
    if pair.shape != (2,):
        raise ConfigurationError(argument, value, "two real numbers")
    first, second = pair.tolist()
    return first, second
