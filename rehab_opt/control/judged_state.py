"""Check a measured state: enable input, time stamps, joints that do not follow their commands.

The check also computes the commanded positions of the joints.
"""

from __future__ import annotations

from functools import cache

import casadi as ca

from rehab_opt.control.front_end import JUMP, LATE, SAID, FrontEnd, led_memory
from rehab_opt.control.reasons import NUMBER
from rehab_opt.control.watchdog import NO_STAMP, STAMPS, checked_stamp, first_of
from rehab_opt.optim.certificate import all_true
from rehab_opt.optim.rows import MAX_MAGNITUDE
from rehab_opt.symbolic.record import Record

__all__ = ["GIVEN", "judged_memory", "judged_state", "nothing_known"]

GIVEN = Record(stamp=1, kind=1, enable=1, judged=1)
"""Stamp [s] of a state and its kind, see `stamp_and_kind`; dead man's switch; whether the state was already judged in
this tick, so that nothing counts twice.
"""


@cache
def judged_memory(n: int, led: int) -> Record:
    """Memory of the checks for n joints; `led` is the memory size of their `FrontEnd`, 0 without one.

    For all states: stamps, a joint that does not follow, the front end, and whether the last stamp went back. For the
    current state: the number of the reason why the state is invalid (0 for none), the joint that does not follow (-1
    for none), details, whether the joints restart at rest, and the previous command (n,).
    """
    return Record(
        stamps=STAMPS.size, lost=3, led=led, back=1, reason=1, element=1, details=2, rested=1,
        before=n if led else 0,
    )  # fmt: skip


def nothing_known(record: Record) -> ca.SX:
    """`judged_memory` before the first state."""
    parts = {name: ca.SX.zeros(place.stop - place.start) for name, place in record.places.items()}
    stamps = STAMPS.of(last=ca.SX.nan(), lag=ca.SX(0), stamped=ca.SX(0), ahead=ca.SX(0))
    return record.of(**parts | {"stamps": stamps, "element": ca.SX(-1)})


def judged_state(
    n: int, size: int, *, dt: float, max_age: float, led: FrontEnd | None, sent: slice, motion: slice
) -> ca.Function:
    """Function: positions (n,), memory of a controller (size,), `judged_memory`, `GIVEN` -> new values of the first
    three.

    The commanded positions replace the measured ones. After a pause of the stamps the joints restart at rest at their
    measured positions, unless they have continued as commanded. The memory of a resting robot that is not enabled is
    cleared: the robot may be moved by hand.

    Parameters
    ----------
    dt, max_age : see `Watchdog`. led : front end; None for joints that are exactly at their commanded positions.
    sent : slice of the controller's memory with the command.
    motion : slice of the memory, after velocity and position, that is zero at rest.
    """
    record = judged_memory(n, led.size if led else 0)
    q, memory = ca.SX.sym("q", n), ca.SX.sym("memory", size)
    own, given = record.symbols("own"), GIVEN.symbols("given")
    stamped = STAMPS.parts(own.stamps)
    stamps = checked_stamp(stamped, given.stamp, given.kind, dt=ca.SX(dt), max_age=ca.SX(max_age))
    untold = ca.logic_and(given.kind == NO_STAMP, ca.logic_not(stamped.stamped))

    last = memory[sent]
    after, reference, rests, lost, missing = own.led, q, ca.SX(0), own.lost, ca.SX(0)
    if led is not None:
        # After a stamp that went back, a jump forward is no pause.
        paused = ca.logic_and(stamps.reason == NUMBER["STAMP_GAP"], ca.logic_not(own.back))
        moved, gap = led.shortest(q - led_memory(n).parts(own.led).seen), stamps.details[0]
        went_on = ca.logic_and(
            ca.dot(moved, last) > 0.5 * ca.sumsqr(last) * gap,
            ca.norm_2(moved) <= 2 * ca.norm_2(last) * gap + JUMP,
        )
        rests = ca.logic_and(paused, ca.logic_not(went_on))
        # A late servo keeps its past commands, except after a long pause. A first sample may be wrong.
        numbers = all_true(ca.fabs(q) <= MAX_MAGNITUDE)
        commanded = ca.if_else(ca.logic_and(paused, numbers), moved / dt, last)
        parts = led_memory(n).parts(own.led)
        remembered = led_memory(n).changed(parts, known=ca.if_else(rests, ca.fmin(parts.known, 1), parts.known))
        forgotten = ca.logic_and(rests, gap > 3 * LATE)
        after, reference, said = led.tick(
            ca.if_else(forgotten, 0, remembered.column), q, ca.if_else(forgotten, 0, commanded)
        )
        found = SAID.parts(said)
        lost = ca.if_else(lost[0] > 0, lost, found.fault * ca.vertcat(1, found.joint, found.far))
        missing = ca.logic_and(found.missing, all_true(ca.fabs(q) <= MAX_MAGNITUDE))  # the tick reports others
    goes_on = ca.SX(memory)
    for part in (slice(n), motion):
        goes_on[part] = ca.if_else(rests, 0, goes_on[part])

    enabled = given.enable == 1
    kept = ca.logic_or(enabled, ca.sum1(ca.fabs(goes_on[sent])) > 0)
    reason = first_of([
        (ca.logic_not(enabled), ca.SX(NUMBER["NOT_ENABLED"])),
        (stamps.reason != 0, stamps.reason),
        (lost[0] > 0, ca.SX(NUMBER["NOT_FOLLOWED"])),
        (missing, ca.SX(NUMBER["POSITIONS_IMPOSSIBLE"])),
        (ca.SX(1), ca.SX(0)),
    ])  # fmt: skip
    of_joint = reason == NUMBER["NOT_FOLLOWED"]
    told = record.of(
        stamps=ca.if_else(untold, own.stamps, stamps.memory),
        lost=ca.if_else(kept, lost, 0),
        led=ca.if_else(kept, after, 0),
        back=stamps.reason == NUMBER["STAMP_BACKWARDS"],
        reason=reason,
        element=ca.if_else(of_joint, lost[1], -1),
        details=ca.if_else(of_joint, ca.vertcat(lost[2], 0), stamps.details),
        rested=rests,
        before=memory[:n] if led else ca.SX(0, 1),
    )
    inputs = [q, memory, own.column, given.column]
    outputs = [ca.densify(each) for each in (reference, goes_on, told)]
    anew = ca.Function("judged_anew", inputs, outputs, {"cse": True})
    same = ca.Function("judged_before", inputs, inputs[:3])
    columns = [ca.MX.sym("column", each.numel()) for each in inputs]
    judge = ca.Function.if_else("judged", same, anew)
    return ca.Function("judged_state", columns, list(judge(columns[3][GIVEN["judged"]], *columns)))
