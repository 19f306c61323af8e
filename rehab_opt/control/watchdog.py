"""Whether the state a controller is handed is fresh, from nothing but its time stamps."""

from __future__ import annotations

import math

import numpy as np

from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.real_array import real_array

__all__ = ["DRIFT", "Watchdog", "default_max_age", "seconds_of"]

DRIFT = 1e-3
"""Share by which the stamps' clock may run slower than the ticks for ever: ten times what two quartz clocks differ by.
Without it every long session would end as stale."""


def default_max_age(dt: float) -> float:
    """Largest age [s] of a state at a nominal tick dt [s]: 50 ms, and never less than three ticks.

    50 ms is below a person's fastest voluntary reaction, and a hand led at 0.25 m/s moves 12 mm in it; three ticks
    let two samples in a row be lost.
    """
    return max(0.05, 3.0 * dt)


def seconds_of(stamp: object) -> float | None:
    """A time stamp as a float [s]; None where it is no single real number: a time of another unit, text, an array."""
    try:
        if isinstance(stamp, float | int):
            return float(stamp)
        array = real_array(stamp)
    except OverflowError:
        return math.inf
    except (TypeError, ValueError):
        return None
    return None if array.ndim else float(array)


class Watchdog:
    """Finds repeated, reversed, missing and delayed time stamps; one `check` a tick.

    No clock is read, so that a replayed session is judged as the live one was: a delayed stream shows as stamps that
    advance by less than the ticks do, and the lag so gathered is held against `max_age`. It is paid back only by
    stamps that advance by more. Stamps that jump back by more than `max_age` are a restarted stream: one fault, and
    the count begins anew.

    Parameters
    ----------
    dt : nominal tick [s].
    max_age : largest age of a state, and largest gap between two [s]; infinite for none; default `default_max_age`.

    Raises
    ------
    ConfigurationError : dt not a positive, finite number, max_age not one above dt.
    """

    __slots__ = ("_dt", "_gained", "_lag", "_last", "_max_age")

    def __init__(self, *, dt: float, max_age: float | None = None) -> None:
        if not (isinstance(dt, (int, float, np.integer, np.floating)) and 0.0 < dt < math.inf):
            raise ConfigurationError("dt", dt, "a positive, finite number of seconds")
        max_age = default_max_age(dt) if max_age is None else max_age
        if not (isinstance(max_age, (int, float, np.integer, np.floating)) and max_age > dt):
            raise ConfigurationError("max_age", max_age, f"seconds, more than dt = {dt:g}")
        self._dt = float(dt)
        self._gained = float(dt) * (1.0 - DRIFT)
        self._max_age = float(max_age)
        self.reset()

    @property
    def max_age(self) -> float:
        """Largest age of a state [s]."""
        return self._max_age

    @property
    def lag(self) -> float:
        """By how much the stamps have fallen behind the ticks [s]."""
        return self._lag

    def reset(self) -> None:
        """Forget every stamp: the next one is the first."""
        self._last = math.nan
        self._lag = 0.0

    def check(self, stamp: float | None) -> str:
        """Why the state stamped `stamp` [s, any origin] must not be acted on; empty when it may. Never raises.

        None is not checked. Each fault is judged by itself: after a gap or a reversal the next stamp may be fine.
        """
        if type(stamp) is not float:
            if stamp is None:
                return ""
            stamp = seconds_of(stamp)
            if stamp is None:
                self._fault(math.nan)
                return "stamp is not a number of seconds"
        advance = stamp - self._last
        if 0.0 < advance <= self._max_age:  # NaN fails
            lag = self._lag + self._gained - advance
            self._last = stamp
            if lag <= 0.0:
                self._lag = 0.0
                return ""
            self._lag = lag
            if lag <= self._max_age:
                return ""
            return f"state is stale: {lag:.3g} s behind the ticks, at most {self._max_age:.3g} s"
        return self._fault(stamp)

    def _fault(self, stamp: float) -> str:
        """The rare cases: the first stamp, and what is wrong with a later one."""
        if not math.isfinite(stamp):
            self._lag += self._gained
            return "stamp is not finite"
        last, self._last = self._last, stamp
        if math.isnan(last):
            return ""
        advance = stamp - last
        if advance > self._max_age:
            self._lag = max(0.0, self._lag + self._gained - advance)
            return f"gap in stamps: {advance:.3g} s, at most {self._max_age:.3g} s"
        if advance < -self._max_age:
            self._lag = 0.0
            return f"stamp went backwards by {-advance:.3g} s"
        self._lag += self._gained - advance
        return f"stamp went backwards by {-advance:.3g} s" if advance < 0.0 else "stamp repeated"
