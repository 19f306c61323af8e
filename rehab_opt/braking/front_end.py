"""Where the joints have been led, told from what is commanded, with what is measured as its supervisor.

A controller acts on the led positions, which neither delay nor noise moves:

    led' = command + PULL e,    e = what of (measured - led) is not the way between led and trail,
    trail' = (led - trail) / LATE

A servo that is late by up to LATE holds its joint somewhere between `trail` and `led`: that explains the difference
while the arm moves, and nothing does at rest, so that a joint at rest is led from where its encoder says it is. What is
pushed, sags or sticks is followed so.
"""

from __future__ import annotations

import math
from functools import cache

import casadi as ca
import numpy as np

from rehab_opt.control.held_hand import largest
from rehab_opt.control.judged_state import GIVEN, judged_memory
from rehab_opt.control.reasons import NUMBER
from rehab_opt.control.watchdog import NO_STAMP, STAMPS, checked_stamp, first_of
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.optim.certificate import all_true, clipped
from rehab_opt.optim.rows import MAX_MAGNITUDE
from rehab_opt.symbolic.record import Record

__all__ = ["FrontEnd"]

LATE = 0.1
"""[s] by which a servo may be late."""
PULL = 10.0
"""[1/s] rate at which the led position comes to the measured one: noise passes by the root of PULL dt / 2."""
WINDOW, SHARE, PATIENCE = 0.02, 0.08, 0.15
"""[rad or m] way of commands on which a joint is judged; of which it has moved less than this share if it is blocked;
[s] for which that is no fault."""
JUMP = 0.015
"""[rad or m] by which a sample may be beyond what the joint's largest speed explains."""
SAID = Record(fault=1, joint=1, far=1, missing=1)
"""The fault, 0 for none, the joint that it is of, how far it is from where it was led [rad or m]; whether the positions
are none that the joints can have now."""


@cache
def memory_of(n: int) -> Record:
    """Led and trailing positions, where each joint was seen; the way that it was led, and that it was seen to move,
    since it was last judged; how long it was blocked [s]; since when nothing usable was seen [s]; whether anything was.
    """
    return Record(led=n, trail=n, seen=n, way=n, moved=n, blocked=n, waiting=1, known=1)


class FrontEnd:
    """n joints of a chain at ticks of dt [s].

    Attributes
    ----------
    size : numbers remembered.
    tick : memory, measured positions, last command (n,) -> memory, led positions (n,), the command to go on from (n,),
        `SAID`.
    """

    def __init__(self, chain: SerialChain, *, dt: float, max_age: float) -> None:
        n = chain.n
        self.size = memory_of(n).size
        turning = ca.DM([not row.prismatic for row in chain.rows])
        memory = memory_of(n).symbols("memory")
        measured, command = ca.SX.sym("measured", n), ca.SX.sym("command", n)
        number = all_true(ca.fabs(measured) <= MAX_MAGNITUDE)
        ahead = memory.led + dt * command

        # Encoders that count a turn otherwise: the turn next to where the joint is led; at first one within its limits.
        middle = ca.DM((np.clip(chain.lower, -1e6, 1e6) + np.clip(chain.upper, -1e6, 1e6)) / 2)
        inside = ca.logic_and(measured >= ca.DM(chain.lower), measured <= ca.DM(chain.upper))
        near = ca.if_else(memory.known, ahead, ca.if_else(inside, measured, middle))
        turned = measured + turning * 2 * math.pi * ca.floor((near - measured) / (2 * math.pi) + 0.5)

        waiting = memory.waiting + dt
        most = ca.DM(2 * chain.velocity) * waiting + JUMP
        possible = all_true(number, ca.fabs(turned - memory.seen) <= most)
        stands = ca.sum1(ca.fabs(command)) == 0
        anew = all_true(number, ca.logic_or(ca.logic_not(memory.known), ca.logic_and(stands, waiting > max_age)))
        good = ca.logic_or(anew, possible)

        low, high = ca.fmin(memory.trail - ahead, 0), ca.fmax(memory.trail - ahead, 0)
        apart = ca.if_else(possible, turned - ahead, 0)
        pull = -math.expm1(-PULL * dt) * (apart - clipped(apart, low, high))
        led = ca.if_else(anew, turned, ahead + pull)
        trail = ca.if_else(anew, turned, memory.trail + pull - math.expm1(-dt / LATE) * (ahead - memory.trail))

        way, moved = memory.way + dt * command, memory.moved + ca.if_else(possible, turned - memory.seen, 0)
        pushed = ca.fabs(moved) > 2 * ca.fabs(way) + WINDOW  # by no command, whatever its sign
        judged = ca.logic_and(ca.fabs(way) > WINDOW, ca.logic_not(pushed))
        lags = ca.logic_and(judged, ca.sign(way) * moved < SHARE * ca.fabs(way))
        goes_on = ca.logic_and(ca.logic_or(ca.fabs(way) <= WINDOW, lags), ca.logic_not(ca.logic_or(anew, pushed)))
        blocked = ca.if_else(anew, 0, ca.fmax(memory.blocked + dt * possible * (2 * lags - 1), 0))
        longest, joint = largest(blocked)
        fault = longest > max(PATIENCE, 5 * dt)
        far = sum((ca.if_else(joint == i, ca.fabs(apart[i]), 0) for i in range(n)), ca.SX(0))
        after = memory_of(n).of(
            led=ca.if_else(ca.logic_or(memory.known, anew), led, memory.led), trail=trail,
            seen=ca.if_else(good, turned, memory.seen), way=goes_on * way, moved=goes_on * moved, blocked=blocked,
            waiting=ca.if_else(good, 0, waiting), known=ca.logic_or(memory.known, anew),
        )  # fmt: skip
        said = SAID.of(fault=fault, joint=joint, far=far, missing=ca.logic_not(good))
        reference = ca.if_else(ca.logic_and(number, memory_of(n).parts(after).known), led, measured)
        outputs = [ca.densify(each) for each in (after, reference, ca.if_else(anew * memory.known, 0, command), said)]
        self.tick = ca.Function("led_joints", [memory.column, measured, command], outputs, {"cse": True})

    def start(self, velocity: ca.SX) -> ca.SX:
        """Memory where nothing is known."""
        return ca.SX.zeros(self.size)


def judged(n: int, size: int, *, dt: float, max_age: float, led: FrontEnd) -> ca.Function:
    """Positions (n,), memory of a controller (size,), `judged_memory`, `GIVEN` -> the first three.

    A pause of usable positions ends at rest where the joints are then; so does one of the stamps, unless the joints
    have moved on as commanded. A command that so drops to rest is flagged (`Relaxed.ACCELERATION`). A robot that is not
    enabled and rests is forgotten: it may be moved by hand, and a fault is acknowledged.
    """
    record = judged_memory(n, led.size, n)
    q, memory = ca.SX.sym("q", n), ca.SX.sym("memory", size)
    own, given = record.symbols("own"), GIVEN.symbols("given")
    stamped = STAMPS.parts(own.stamps)
    stamps = checked_stamp(stamped, given.stamp, given.kind, dt=ca.SX(dt), max_age=ca.SX(max_age))
    untold = ca.logic_and(given.kind == NO_STAMP, ca.logic_not(stamped.stamped))
    # What follows a stamp that went back has only come forward again.
    paused = ca.logic_and(stamps.reason == NUMBER["STAMP_GAP"], own.reason != NUMBER["STAMP_BACKWARDS"])
    last = memory[:n]
    moved = ca.dot(q - memory_of(n).parts(own.led).seen, last)
    rests = ca.logic_and(paused, ca.logic_not(moved > 0.5 * ca.sumsqr(last) * stamps.details[0]))
    after, reference, goes_on, said = led.tick(ca.if_else(paused, 0, own.led), q, ca.if_else(rests, 0, last))
    found = SAID.parts(said)
    lost = ca.if_else(own.lost[0] > 0, own.lost, found.fault * ca.vertcat(1, found.joint, found.far))
    enabled, number = given.enable == 1, all_true(ca.fabs(q) <= MAX_MAGNITUDE)  # what is none is named by the tick
    kept = ca.logic_or(enabled, ca.sum1(ca.fabs(goes_on)) > 0)
    reason = first_of([
        (ca.logic_not(enabled), ca.SX(NUMBER["NOT_ENABLED"])),
        (stamps.reason != 0, stamps.reason),
        (lost[0] > 0, ca.SX(NUMBER["NOT_FOLLOWED"])),
        (found.missing, ca.if_else(number, NUMBER["POSITIONS_IMPOSSIBLE"], 0)),
        (ca.SX(1), ca.SX(0)),
    ])  # fmt: skip
    of_joint = reason == NUMBER["NOT_FOLLOWED"]
    told = record.of(
        stamps=ca.if_else(untold, own.stamps, stamps.memory),
        watch=own.watch,
        lost=ca.if_else(kept, lost, 0),
        led=ca.if_else(kept, after, 0),
        reason=reason,
        element=ca.if_else(of_joint, lost[1], -1),
        details=ca.if_else(of_joint, ca.vertcat(lost[2], lost[0]), stamps.details),
        touched=rests,
        held=ca.SX(0),
        before=last,
    )
    inputs = [q, memory, own.column, given.column]
    outputs = [ca.densify(each) for each in (reference, ca.vertcat(goes_on, memory[n:]), told)]
    anew = ca.Function("judged_anew", inputs, outputs, {"cse": True})
    same = ca.Function("judged_before", inputs, inputs[:3])
    columns = [ca.MX.sym("column", each.numel()) for each in inputs]
    judge = ca.Function.if_else("judged", same, anew)
    return ca.Function("judged_state", columns, list(judge(columns[3][GIVEN["judged"]], *columns)))
