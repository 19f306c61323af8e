"""Where the joints have been led, computed from the commands and supervised by what is measured.

A controller acts on the led positions, which neither delay nor noise moves:

    led' = command + PULL e,    e = what of (measured - led) is outside of [low, high],

where [low, high] is where the joint was led lately, as seen from where it is led now: the least and the most of the
last LATE to 2 LATE, through a low-pass of LATE. A servo that is late by a delay of up to LATE, by a lag of up to LATE,
or both, holds its joint in between: that explains the difference while the arm moves, and nothing does at rest, so that
a joint at rest is led from where its encoder says it is. What is pushed, sags or sticks is followed so.
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
"""[s] by which a servo may be late."""
PULL = 10.0
"""[1/s] rate at which the led position comes to the measured one: noise passes by the root of PULL dt / 2."""
WINDOW, SHARE, PATIENCE, TICKS = 0.015, 0.08, 0.15, 5
"""[rad or m] way of commands, all in one direction, on which a joint is judged, twice; of which it has moved less than
this fraction if it is blocked; [s, ticks] for which that is no fault."""
BEYOND = 0.3
"""[rad] by which a joint may be beyond its limit when it is first seen: farther off it is counted otherwise."""
NOISE = 1e-3
"""[rad or m] beyond a limit that is none."""
JUMP = 0.015
"""[rad or m] by which a sample may be beyond what twice the joint's largest speed explains in a tick."""
SAID = Record(fault=1, joint=1, far=1, missing=1)
"""The fault, 0 for none, the joint that it is of, how far it is from where it was led [rad or m]; whether the positions
are none that the joints can have now."""


@cache
def led_memory(n: int) -> Record:
    """Led positions; the ends of where they were lately, in this span of `LATE` and in the one before, seen from them;
    where each joint was seen; the way that it was led, and that it was seen to move, since it was last judged; how long
    it was blocked [s]; how old the span is [s]; how many samples were valid,
    at most 2; whether a base was seen to move.
    """
    ends = {"low": n, "high": n, "least": n, "most": n, "least_before": n, "most_before": n}
    return Record(led=n, **ends, seen=n, way=n, moved=n, blocked=n, span=1, known=1, placed=1)


class FrontEnd:
    """n joints of a chain at ticks of dt [s].

    The first `base` joints are the place of a base: its measured place is acted on, whatever it is, and it is judged
    once that place has changed, since a base need not be measured.

    Attributes
    ----------
    size : numbers remembered, see `led_memory`.
    tick : memory, measured positions, last command (n,) -> memory, led positions (n,), `SAID`.
    """

    def __init__(self, chain: SerialChain, *, dt: float, max_age: float, base: int = 0) -> None:
        n = chain.n
        self.size = led_memory(n).size
        arm = ca.DM(np.arange(n) >= base)
        self._turn = 2 * math.pi * arm * ca.DM([not row.prismatic for row in chain.rows])
        memory = led_memory(n).symbols("memory")
        measured, command = ca.SX.sym("measured", n), ca.SX.sym("command", n)
        number = all_true(ca.fabs(measured) <= MAX_MAGNITUDE)
        ahead = memory.led + dt * command

        # Encoders that count a turn otherwise: the turn next to where the joint is led; at first one about its limits.
        middle = ca.DM((np.clip(chain.lower, -1e6, 1e6) + np.clip(chain.upper, -1e6, 1e6)) / 2)
        inside = ca.logic_and(measured >= ca.DM(chain.lower) - BEYOND, measured <= ca.DM(chain.upper) + BEYOND)
        near = ca.if_else(memory.known, ahead, ca.if_else(inside, measured, middle))
        turned = near + self.shortest(measured - near)

        # Between where it was seen last and where it may be by its commands, for a while after the last one, too. The
        # first sample is dropped where the second contradicts it.
        ends, step = _led_lately(memory, command, dt), turned - memory.seen
        further = ahead + max_age * command
        margin = ca.DM(np.where(np.arange(n) < base, MAX_MAGNITUDE, 2 * chain.velocity * dt + JUMP))
        least = ca.fmin(ca.fmin(memory.seen, ahead + ends["low"]), further) - margin
        most = ca.fmax(ca.fmax(memory.seen, ahead + ends["high"]), further) + margin
        possible = all_true(number, memory.known, least <= turned, turned <= most)
        anew = all_true(number, memory.known < 2, ca.logic_not(possible))
        good = ca.logic_or(anew, possible)
        known = ca.fmin(memory.known + good, 2)

        # Noise about a limit leads no joint beyond it.
        nearest = clipped(turned, ca.DM(chain.lower), ca.DM(chain.upper))
        place = ca.if_else(ca.fabs(turned - nearest) < NOISE, nearest, turned)
        apart = ca.if_else(possible, place - ahead, 0)
        beside = apart - clipped(apart, ends["low"], ends["high"])
        led = ca.if_else(anew, turned, ahead - math.expm1(-PULL * dt) * beside)

        placed = ca.logic_or(memory.placed, ca.logic_and(possible, ca.dot(1 - arm, ca.fabs(step)) > 0))
        # Anew where the command turns round; how long a joint has been blocked, only if it stood until then.
        same = memory.way * command >= 0
        stood = ca.logic_and(ca.fabs(memory.way) > WINDOW / 3, ca.fabs(memory.moved) <= SHARE * ca.fabs(memory.way))
        watched = (arm + (1 - arm) * placed) * same
        way = watched * (memory.way + dt * command)
        moved = watched * (memory.moved + ca.if_else(possible, step, 0))
        pushed = ca.fabs(moved) > 2 * ca.fabs(way) + WINDOW / 2  # by no command, whatever its sign
        # At the end of a window, or sooner where the joint clearly goes along.
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
        numbers = ca.fabs(measured) <= MAX_MAGNITUDE  # what is no number is named by who is asked to act on it
        reference = ca.if_else(known * arm * numbers, led, measured)
        inputs, outputs = [memory.column, measured, command], [column, reference, said]
        self.tick = ca.Function("led_joints", inputs, [ca.densify(each) for each in outputs], {"cse": True})

    def shortest(self, way: ca.SX) -> ca.SX:
        """(n,) ways [rad or m] without whole turns."""
        return way - self._turn * ca.floor(way / (2 * math.pi) + 0.5)


def _led_lately(memory: Values, command: ca.SX, dt: float) -> dict[str, ca.SX]:
    """What is remembered of it after a tick."""
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
    """The largest of (n,), and the first place where it is."""
    most, place = numbers[0], ca.SX(0)
    for i in range(1, numbers.numel()):
        place, most = ca.if_else(numbers[i] > most, i, place), ca.fmax(most, numbers[i])
    return most, place
