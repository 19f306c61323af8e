"""Freshness of a controller's input state, from its time stamps alone."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from threading import get_ident
from typing import NamedTuple, cast

import casadi as ca

from rehab_opt.control.reasons import NUMBER, reason_text
from rehab_opt.control.thread_owner import OneThread
from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.real_array import is_finite, is_real, real_array
from rehab_opt.optim.certificate import all_true
from rehab_opt.symbolic import BufferedFunction
from rehab_opt.symbolic.record import Record, Values

__all__ = ["SHORTEST_TICK", "STAMPS", "Watchdog", "checked_stamp", "default_max_age", "stamp_and_kind", "watched"]

DRIFT = 1e-3
"""The clock of the stamps may be slower than the ticks by this fraction, ten times the drift of two quartz clocks."""
SLOWEST = 1.5
"""Ratio of the stamps' advance to dt above which the loop counts as slower than dt."""
SHORTEST_TICK = 1e-9
"""[s] Shortest tick; cubes of rates overflow for much shorter ones."""
STAMPS = Record(last=1, lag=1, stamped=1, ahead=1)
"""State of the stamps: last stamp [s], lag behind the ticks [s], whether there was a stamp, lead [s] over stamps that
advance by `SLOWEST` dt a tick. Initially NaN, 0, 0, 0.
"""
NO_STAMP, NUMBER_OF_SECONDS, NO_NUMBER = range(3)
"""Kinds of stamps."""


def default_max_age(dt: float) -> float:
    """Largest age [s] of a state at a tick dt [s]: 50 ms, a fast human reaction, or three ticks if these are longer."""
    return max(0.05, 3.0 * dt)


def stamp_and_kind(stamp: object) -> tuple[float, int]:
    """Time stamp as a float [s], and its kind; the float is NaN for a stamp of another type."""
    if stamp is None:
        return math.nan, NO_STAMP
    try:
        if is_real(stamp):
            return float(stamp), NUMBER_OF_SECONDS
        array = real_array(stamp)
    except OverflowError:
        return math.inf, NUMBER_OF_SECONDS
    except (TypeError, ValueError):
        return math.nan, NO_NUMBER
    return (math.nan, NO_NUMBER) if array.ndim else (float(array), NUMBER_OF_SECONDS)


class Judged(NamedTuple):
    """Verdict of a watchdog on one stamp."""

    memory: ca.SX
    """`STAMPS` after this stamp."""
    reason: ca.SX
    """Number of the reason why the state is invalid; 0 if it is valid."""
    details: ca.SX
    """(2,) details of the reason [s]."""


def checked_stamp(
    memory: Values, stamp: ca.SX, kind: ca.SX, *, dt: ca.SX, max_age: ca.SX, any_period: bool = False
) -> Judged:
    """Check one stamp [s, any origin] per tick, with its kind from `stamp_and_kind`; see `Watchdog`.

    any_period : whether ticks may be as slow as `max_age`.
    """
    gained = dt * (1.0 - DRIFT)
    finite = ca.logic_and(kind == NUMBER_OF_SECONDS, ca.fabs(stamp) < ca.inf)
    first = ca.logic_not(ca.fabs(memory.last) < ca.inf)
    advance = stamp - memory.last
    lag = memory.lag + gained - advance
    usual = ca.logic_and(advance > 0, advance <= max_age)
    ahead = memory.ahead - SLOWEST * dt + ca.if_else(ca.logic_and(finite, usual), advance, 0)
    ahead = ca.SX(0) if any_period else ca.fmin(ca.fmax(ahead, -max_age), SLOWEST * max_age)
    nothing, no_stamp, no_number = ca.SX.zeros(2), kind == NO_STAMP, kind == NO_NUMBER
    waiting, caught_up, behind = memory.lag + gained, ca.fmax(lag, 0), ca.vertcat(advance, max_age)
    cases = [
        (ca.logic_and(no_stamp, ca.logic_not(memory.stamped)), "FINE", memory.lag, nothing),
        (no_stamp, "STAMP_MISSING", waiting, nothing),
        (no_number, "STAMP_NO_NUMBER", waiting, nothing),
        (ca.logic_not(finite), "STAMP_NOT_FINITE", waiting, nothing),
        (first, "FINE", memory.lag, nothing),
        (all_true(usual, ahead > max_age), "LOOP_SLOW", caught_up, ca.vertcat(advance, dt)),
        (all_true(usual, lag <= max_age), "FINE", caught_up, nothing),
        (usual, "STATE_STALE", lag, ca.vertcat(lag, max_age)),
        (advance > max_age, "STAMP_GAP", caught_up, behind),
        (advance < -max_age, "STAMP_BACKWARDS", ca.SX(0), -behind),  # a restarted stream
        (advance < 0, "STAMP_BACKWARDS", lag, -behind),
        (ca.SX(1), "STAMP_REPEATED", lag, nothing),
    ]
    after = STAMPS.of(
        last=ca.if_else(finite, stamp, memory.last),
        lag=first_of([(when, then) for when, _, then, _ in cases]),
        stamped=ca.logic_or(memory.stamped, ca.logic_not(no_stamp)),
        ahead=ahead,
    )
    reason = first_of([(when, ca.SX(NUMBER[name])) for when, name, _, _ in cases])
    return Judged(after, reason, first_of([(when, details) for when, _, _, details in cases]))


def first_of(cases: Sequence[tuple[ca.SX, ca.SX]]) -> ca.SX:
    """Value of the first case whose condition is true; the last case is the default."""
    value = cases[-1][1]
    for when, then in reversed(cases[:-1]):
        value = ca.if_else(when, then, value)
    return value


@cache
def watched() -> ca.Function:
    """Function: dt and max_age, `STAMPS`, stamp and its kind -> `STAMPS`, reason and details."""
    memory, limits, given = STAMPS.symbols("memory"), ca.SX.sym("limits", 2), ca.SX.sym("given", 2)
    judged = checked_stamp(memory, given[0], given[1], dt=limits[0], max_age=limits[1])
    said = ca.vertcat(judged.reason, judged.details)
    return ca.Function("watched", [limits, memory.column, given], [judged.memory, said], {"cse": True})


class Watchdog(OneThread):
    """Detect repeated, reversed, missing and delayed time stamps; call `check` once per tick.

    The watchdog reads no clock. If stamps advance by less than the ticks, the accumulated lag is compared with
    `max_age`. Stamps that jump back by more than `max_age` mean a restarted stream, which counts as one fault. If the
    stamps advance by more than 1.5 dt a tick, and the excess adds up to `max_age`, the loop is slower than `dt`.

    Parameters
    ----------
    dt : nominal tick [s], at least 1e-9.
    max_age : largest age of a state, and largest gap between two [s], above dt; infinite for none; default
        `default_max_age`.
    """

    stamped: bool
    """Whether there was a stamp since the last reset; from then on a missing stamp is a fault."""

    def __init__(self, *, dt: float, max_age: float | None = None) -> None:
        if not (is_real(dt) and SHORTEST_TICK <= dt < math.inf):
            raise ConfigurationError("dt", dt, f"a finite number of seconds, at least {SHORTEST_TICK:g}")
        max_age = default_max_age(dt) if max_age is None else max_age
        if not (is_real(max_age) and max_age > dt):
            raise ConfigurationError("max_age", max_age, f"seconds, more than dt = {dt:g}")
        self.max_age = float(max_age) if is_finite(max_age) else math.inf
        """Largest age of a state [s]."""
        self._function = function = BufferedFunction(watched())
        self._evaluate = function.evaluate  # never replaced
        limits, self._memory, given = function.inputs
        limits[:] = dt, self.max_age
        after, said = function.outputs
        views = (cast("memoryview[float]", each.data) for each in (given, self._memory, after, said))
        self._given, self._keep, self._after, self._said = views
        self.reset()

    @property
    def lag(self) -> float:
        """Lag [s] of the stamps behind the ticks."""
        return float(self._memory[STAMPS["lag"]])

    def reset(self) -> None:
        """Forget all stamps; the next one counts as the first."""
        self._claim()
        self._memory[:] = math.nan, 0.0, 0.0, 0.0
        self.stamped = False
        self._give_away()

    def check(self, stamp: float | None) -> str:
        """Reason why a state with `stamp` [s, any origin] is invalid; empty if it is valid.

        None is accepted before the first stamp; later it is a fault.
        """
        if self._owner != get_ident():
            self._claim()
        if type(stamp) is float:
            self._given[0] = stamp
            self._given[1] = NUMBER_OF_SECONDS
        else:
            self._given[0], self._given[1] = stamp_and_kind(stamp)
        self._evaluate()
        self._keep[:] = self._after
        if stamp is not None:
            self.stamped = True
        if not self._said[0]:
            return ""
        reason, *details = self._said.tolist()
        return reason_text(reason, details)
