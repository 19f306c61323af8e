"""Commanded positions of the joints, integrated from the commands and corrected by measurements.

    led' = command + PULL e,    e = part of (measured - led) outside [low, high],

Here led is the commanded position, which delay and noise do not disturb. [low, high] is the low-passed range of led
over the past LATE to 2 LATE seconds, relative to its present value. A servo with a delay or lag of up to LATE keeps its
joint in this range; at rest the range has zero width.
"""

from __future__ import annotations

import math
from functools import cache

import casadi as ca
import numpy as np

from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.optim.certificate import all_true, clipped
from rehab_opt.optim.rows import MAX_MAGNITUDE
from rehab_opt.symbolic.record import Record, Values

__all__ = ["JUMP", "LATE", "SAID", "FrontEnd", "led_memory"]

LATE = 0.1
"""[s] Largest delay, and largest lag, of a servo."""
PULL = 10.0
"""[1/s] Rate of approach to the measured position; noise is multiplied by sqrt(PULL dt / 2)."""
WINDOW, SHARE, PATIENCE, TICKS = 0.015, 0.08, 0.15, 5
"""[rad or m] Commanded travel after which a joint is checked; fraction of this travel below which the joint counts as
blocked; [s] and [ticks] time for which a blocked joint is no fault.
"""
BEYOND = 0.3
"""[rad] Largest excess of a joint over its limit at the first sample; beyond it, whole turns are subtracted."""
COUNTED = 12 * math.pi
"""[rad] Largest position of a joint with limits; a larger one must be in degrees."""
NOISE = 1e-3
"""[rad or m] Excess over a limit that counts as noise."""
JUMP = 0.015
"""[rad or m] Largest jump of a sample beyond twice the joint's largest motion in a tick."""
SAID = Record(fault=1, joint=1, far=1, missing=1)
"""Fault (0 for none); joint with the fault; distance of this joint between measured and commanded position [rad or m];
whether the measured positions are impossible.
"""


@cache
def led_memory(n: int) -> Record:
    """Memory of a `FrontEnd` with n joints.

    The memory holds the commanded positions, and their range in the current and in the previous period of `LATE`; the
    last measured positions; commanded and measured travel since the last check; time [s] for which each joint has been
    blocked; age of the current period [s]; number of valid samples, at most 2; whether the base has moved.
    """
    ends = {"low": n, "high": n, "least": n, "most": n, "least_before": n, "most_before": n}
    return Record(led=n, **ends, seen=n, way=n, moved=n, blocked=n, span=1, known=1, placed=1)


class FrontEnd:
    """Track the commanded positions of n joints at ticks of dt [s].

    The first `base` joints are the coordinates of a mobile base. Their measured values are used directly, and are
    checked only after they have changed for the first time.

    Attributes
    ----------
    size : length of the memory, see `led_memory`.
    tick : function: memory, measured positions, last command (n,) -> memory, commanded positions (n,), `SAID`.
    """

    def __init__(self, chain: SerialChain, *, dt: float, max_age: float, base: int = 0) -> None:
        n = chain.n
        self.size = led_memory(n).size
        arm = ca.DM(np.arange(n) >= base)
        self._turn = 2 * math.pi * arm * ca.DM([not row.prismatic for row in chain.rows])
        memory = led_memory(n).symbols("memory")
        measured, command = ca.SX.sym("measured", n), ca.SX.sym("command", n)
        number = all_true(ca.fabs(measured) <= _countable(chain))
        ahead = memory.led + dt * command

        # Unwrap: add the whole turns that lead nearest to the commanded position, at first to the middle of the limits.
        middle = ca.DM((np.clip(chain.lower, -1e6, 1e6) + np.clip(chain.upper, -1e6, 1e6)) / 2)
        inside = ca.logic_and(measured >= ca.DM(chain.lower) - BEYOND, measured <= ca.DM(chain.upper) + BEYOND)
        near = ca.if_else(memory.known, ahead, ca.if_else(inside, measured, middle))
        turned = near + self.shortest(measured - near)

        # A measurement is possible between the last measurement and the position that the commands lead to within
        # `max_age`. If the second sample contradicts the first one, the first is dropped.
        ends, step = _led_lately(memory, command, dt), turned - memory.seen
        further = ahead + max_age * command
        margin = ca.DM(np.where(np.arange(n) < base, MAX_MAGNITUDE, 2 * chain.velocity * dt + JUMP))
        least = ca.fmin(ca.fmin(memory.seen, ahead + ends["low"]), further) - margin
        most = ca.fmax(ca.fmax(memory.seen, ahead + ends["high"]), further) + margin
        possible = all_true(number, memory.known, least <= turned, turned <= most)
        anew = all_true(number, memory.known < 2, ca.logic_not(possible))
        good = ca.logic_or(anew, possible)
        known = ca.fmin(memory.known + good, 2)

        # Noise at a limit moves no commanded position beyond the limit.
        nearest = clipped(turned, ca.DM(chain.lower), ca.DM(chain.upper))
        place = ca.if_else(ca.fabs(turned - nearest) < NOISE, nearest, turned)
        apart = ca.if_else(possible, place - ahead, 0)
        beside = apart - clipped(apart, ends["low"], ends["high"])
        led = ca.if_else(anew, turned, ahead - math.expm1(-PULL * dt) * beside)

        placed = ca.logic_or(memory.placed, ca.logic_and(possible, ca.dot(1 - arm, ca.fabs(step)) > 0))
        # Restart when the command reverses; the blocked time continues only if the joint stood still.
        same = memory.way * command >= 0
        stood = ca.logic_and(ca.fabs(memory.way) > WINDOW / 3, ca.fabs(memory.moved) <= SHARE * ca.fabs(memory.way))
        watched = (arm + (1 - arm) * placed) * same
        way = watched * (memory.way + dt * command)
        moved = watched * (memory.moved + ca.if_else(possible, step, 0))
        pushed = ca.fabs(moved) > 2 * ca.fabs(way) + WINDOW / 2  # something else than the command moves it
        # At the end of a window, or sooner if the joint clearly follows.
        told = ca.logic_and(ca.fabs(way) > WINDOW / 3, ca.logic_not(pushed))
        lags = ca.logic_and(told, ca.sign(way) * moved < SHARE * ca.fabs(way))
        along = ca.logic_and(told, ca.sign(way) * moved > ca.fabs(way) / 2)
        whole = ca.logic_or(ca.fabs(way) > WINDOW, ca.logic_or(pushed, along))
        before = memory.blocked * ca.logic_or(same, stood)
        lagging = ca.if_else(whole, lags, before > 0)
        blocked = lagging * (before + dt * ca.logic_and(possible, ca.fabs(command) > 0))
        longest, joint = _largest(lags * blocked)
        after = {
            "led": led, **ends, "seen": ca.if_else(good, turned, memory.seen),
            "way": ca.logic_not(whole) * way, "moved": ca.logic_not(whole) * moved, "blocked": blocked,
        }  # fmt: skip
        begun = {name: each if name in ("led", "seen") else ca.if_else(anew, 0, each) for name, each in after.items()}
        column = led_memory(n).of(**begun, known=known, placed=placed)
        far = sum((ca.if_else(joint == i, ca.fabs(apart[i]), 0) for i in range(n)), ca.SX(0))
        said = SAID.of(
            fault=longest > max(PATIENCE, TICKS * dt) + dt / 2, joint=joint, far=far, missing=ca.logic_not(good)
        )
        numbers = ca.fabs(measured) <= MAX_MAGNITUDE  # the watchdog reports NaN
        reference = ca.if_else(known * arm * numbers, led, measured)
        inputs, outputs = [memory.column, measured, command], [column, reference, said]
        self.tick = ca.Function("led_joints", inputs, [ca.densify(each) for each in outputs], {"cse": True})

    def shortest(self, way: ca.SX) -> ca.SX:
        """Joint differences `way` (n,) [rad or m] without whole turns."""
        return way - self._turn * ca.floor(way / (2 * math.pi) + 0.5)


def _countable(chain: SerialChain) -> ca.DM:
    rotary, limited = [not row.prismatic for row in chain.rows], np.isfinite(chain.upper) & np.isfinite(chain.lower)
    return ca.DM(np.where(rotary & limited, COUNTED, MAX_MAGNITUDE))


def _led_lately(memory: Values, command: ca.SX, dt: float) -> dict[str, ca.SX]:
    ended = memory.span + dt > LATE - dt / 2
    kept = {"span": ca.if_else(ended, 0, memory.span + dt)}
    for far, inner, before, clip in (
        ("low", "least", "least_before", ca.fmin),
        ("high", "most", "most_before", ca.fmax),
    ):
        passed, now, past = (getattr(memory, name) - dt * command for name in (far, inner, before))
        now = clip(now, 0)
        end = clip(now, past)
        kept[far] = clip(end, passed - math.expm1(-dt / LATE) * (end - passed))
        kept |= {inner: ca.if_else(ended, 0, now), before: ca.if_else(ended, now, past)}
    return kept


def _largest(numbers: ca.SX) -> tuple[ca.SX, ca.SX]:
    most, place = numbers[0], ca.SX(0)
    for i in range(1, numbers.numel()):
        place, most = ca.if_else(numbers[i] > most, i, place), ca.fmax(most, numbers[i])
    return most, place
