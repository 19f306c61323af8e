"""Whether a state may be acted on, by enable input, stamps and joints that do not follow, and where joints are led."""

from __future__ import annotations

from functools import cache

import casadi as ca

from rehab_opt.control.followed_joints import SAID, FollowedJoints
from rehab_opt.control.held_hand import largest
from rehab_opt.control.reasons import NUMBER
from rehab_opt.control.watchdog import NO_STAMP, STAMPS, checked_stamp, first_of
from rehab_opt.control.watched_joints import memory_of_watch, patience_of
from rehab_opt.symbolic.record import Record

__all__ = ["GIVEN", "judged_memory", "judged_state", "nothing_known"]

GIVEN = Record(stamp=1, kind=1, enable=1, judged=1)
"""Of a state: its stamp [s] and the kind of that, see `stamp_and_kind`; whether the dead-man input is true; and whether
the state was judged before: then what the memory says of it stands, and nothing is counted twice."""


@cache
def judged_memory(n: int, led: int, before: int) -> Record:
    """What is remembered of n joints: of stamps, of `memory_of_watch`, which one was seen not to follow (fault, joint,
    how far), and the `led` numbers of `FollowedJoints`.

    And of the state at hand: the number of the reason why it must not be acted on, 0 for none; which joint does not
    follow, -1 for none; details, of a joint how far [rad or m] and the fault of `SAID`; whether the hand is held from
    now on, and whether it is held; the command before where a hand is watched (n,).
    """
    return Record(
        stamps=STAMPS.size, watch=memory_of_watch(n).size, lost=3, led=led,
        reason=1, element=1, details=2, touched=1, held=1, before=before,
    )  # fmt: skip


def nothing_known(record: Record, led: ca.SX) -> ca.SX:
    """A `judged_memory` before the first state; `led` is what is known of led joints."""
    parts = {name: ca.SX.zeros(place.stop - place.start) for name, place in record.places.items()}
    stamps = STAMPS.of(last=ca.SX.nan(), lag=ca.SX(0), stamped=ca.SX(0), ahead=ca.SX(0))
    return record.of(**parts | {"stamps": stamps, "led": led, "element": ca.SX(-1)})


def judged_state(
    n: int, size: int, *, dt: float, max_age: float, watch: ca.Function | None, led: FollowedJoints | None, base: int,
    command_slice: slice,
) -> ca.Function:  # fmt: skip
    """Positions (n,), memory of a controller (size,), `judged_memory`, `GIVEN` -> the first three.

    A robot that is not enabled and rests is forgotten: it may be moved by hand, and a fault is acknowledged. Led joints
    are put in place of what was measured, and of the last command where a hand is held from now on.

    Parameters
    ----------
    dt, max_age : see `Watchdog`.
    watch : see `watched_joints`; None where joints are not watched so. led : see `FollowedJoints`, of the joints behind
        `base`. command_slice : part of the controller's memory that was sent.
    """
    record = judged_memory(n, led.size if led else 0, n if led and led.hand else 0)
    q, memory = ca.SX.sym("q", n), ca.SX.sym("memory", size)
    own, given = record.symbols("own"), GIVEN.symbols("given")
    stamped = STAMPS.parts(own.stamps)
    stamps = checked_stamp(stamped, given.stamp, given.kind, dt=ca.SX(dt), max_age=ca.SX(max_age))
    untold = ca.logic_and(given.kind == NO_STAMP, ca.logic_not(stamped.stamped))

    after, lost = own.watch, own.lost
    if watch is not None:
        after, longest = watch(own.watch, q, memory[command_slice])
        joints = memory_of_watch(n).parts(after)
        joint = largest(joints.wrong)[1]
        far = sum((ca.if_else(joint == i, ca.fabs(joints.apart[i]), 0) for i in range(n)), ca.SX(0))
        lost = ca.if_else(lost[0] > 0, lost, (longest > patience_of(dt)) * ca.vertcat(1, joint, far))
    fault, after_led, reference, remembered = lost, own.led, q, memory
    touched = held = ca.SX(0)
    if led is not None:
        last, place = memory[base:n], slice(2 * n, 2 * n + led.tick.numel_out(2))
        after_led, leads, guided, goes_on, said = led.tick(own.led, q[base:], last)
        found = SAID.parts(said)
        fault = ca.if_else(found.fault > 0, ca.vertcat(found.fault, base + found.joint, found.far), lost)
        touched, held = found.touched, found.held
        reference = ca.vertcat(q[:base], leads)
        remembered = ca.vertcat(memory[:base], goes_on, memory[n : 2 * n], guided, memory[place.stop :])

    enabled = given.enable == 1
    at_rest = ca.sum1(ca.fabs(remembered[command_slice])) == 0
    kept = ca.logic_or(enabled, ca.logic_not(at_rest))
    reason = first_of([
        (ca.logic_not(enabled), ca.SX(NUMBER["NOT_ENABLED"])),
        (stamps.reason != 0, stamps.reason),
        (fault[0] > 0, ca.SX(NUMBER["NOT_FOLLOWED"])),
        (ca.SX(1), ca.SX(0)),
    ])  # fmt: skip
    of_joint = reason == NUMBER["NOT_FOLLOWED"]
    judged = record.of(
        stamps=ca.if_else(untold, own.stamps, stamps.memory),
        watch=ca.if_else(kept, after, 0),
        lost=ca.if_else(kept, lost, 0),
        led=ca.if_else(kept, after_led, 0),
        reason=reason,
        element=ca.if_else(of_joint, fault[1], -1),
        details=ca.if_else(of_joint, ca.vertcat(fault[2], fault[0]), stamps.details),
        touched=touched,
        held=held,
        before=memory[:n] if record.size > record["before"] else ca.SX(0, 1),
    )
    inputs = [q, memory, own.column, given.column]
    outputs = [ca.densify(each) for each in (reference, remembered, judged)]
    anew = ca.Function("judged_anew", inputs, outputs, {"cse": True})
    same = ca.Function("judged_before", inputs, inputs[:3])
    columns = [ca.MX.sym("column", each.numel()) for each in inputs]
    judge = ca.Function.if_else("judged", same, anew)
    return ca.Function("judged_state", columns, list(judge(columns[3][GIVEN["judged"]], *columns)))
