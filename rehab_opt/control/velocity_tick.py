"""One tick of a velocity QP as functions of (parameters, memory, given) -> (memory, command).

If the state is valid, the QP is solved; a certified answer becomes the command. Without one, the caller tries another
solver, and `finish` gives the command. C code is generated from the same functions.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import casadi as ca

from rehab_opt.control.command import NUMBERED, Relaxed, Status
from rehab_opt.control.judged_state import GIVEN
from rehab_opt.control.reasons import NUMBER
from rehab_opt.optim.certificate import all_true
from rehab_opt.optim.fused import FUSED_SOLVERS, fused
from rehab_opt.optim.qp import Statement
from rehab_opt.symbolic.record import Record, Values

__all__ = [
    "DONE",
    "LEFT_TO_OTHERS",
    "NOTHING_TO_SOLVE",
    "REPORT",
    "VELOCITY_SOLVERS",
    "VelocityTick",
    "below",
    "relaxed_from_rest",
    "velocity_tick",
]  # fmt: skip

VELOCITY_SOLVERS = (*FUSED_SOLVERS, "braking together")
"""Solvers by their number in `REPORT`; -1 for none."""
REPORT = Record(
    left=1, residual=1, solver=1, relaxed=1, scale=1, unusual=1, status=1, reason=1, input=1, element=1, details=2,
    note=1,
)  # fmt: skip
"""Work that remains for a command; residual; solver; relaxed bounds; delivered fraction of the task; a flag that is
zero for a plain OK. The rest matters only if the flag is set: status (index in `NUMBERED`), number of the reason, the
input and element that the reason is about (-1 for none), details of the reason, and the sum of the notes.
"""
DONE, LEFT_TO_OTHERS, NOTHING_TO_SOLVE = range(3)
"""Work that remains for a command: none; a solve by another solver, or from a cold start; the fallback command."""


_Branch = Callable[..., list[Any]]


class VelocityTick(NamedTuple):
    """Functions of a tick; a state is the state of `fused`, followed by a `judged_memory`."""

    judge: ca.Function
    """See `judged_state`."""
    tick: ca.Function
    """Parameters, state, `GIVEN` -> state, verdict of `fused`, `REPORT`; this function solves the QP itself."""
    finish: ca.Function
    """Parameters, state, `GIVEN`, the QP's answer (a state of `fused`) and verdict -> state, `REPORT`, positions (n,).

    The command is the answer if it is certified, else the result of `law` if there is one, else the fallback command.
    """


def velocity_tick(
    stated: Statement, judge: ca.Function, record: Record, *, stop: ca.Function, faulty: ca.Function,
    law: ca.Function | None, hurried: ca.Function, tolerance: float, named: bool = False,
) -> VelocityTick:  # fmt: skip
    """Functions of a controller's tick.

    Parameters
    ----------
    stated : its QP. judge, record : see `judged_state`, and its memory.
    stop, faulty, law, hurried : see `VelocityController`: `stopping`, `faulty`, `fallback_law`, `hurried`.
    tolerance : largest accepted residual and violation. named : see `VelocityController.names_what_blocks`.
    """
    name, n, size = stated.name, int(judge.numel_in(0)), stated.state_size
    begin, report = size - int(stated.memory.numel()), int(stated.report.numel())
    velocity = slice(begin, begin + n)
    p, everything = ca.MX.sym("p", stated.parameter_size), ca.MX.sym("state", size + record.size)
    given, answer, verdict = (ca.MX.sym("argument", each) for each in (GIVEN.size, size, 3 + report))

    certified = _certified(record, n, 3 + report, hurried, tolerance, named=named)
    fallen_back = _fallen_back(record, n, 3 + report, hurried, faulty)

    q, memory, own = judge(p[:n], everything[begin:size], everything[size:], given)
    state, parameters = everything[:size], p
    if own.numel() > record["before"]:  # commanded positions replace the measured ones
        state, parameters = ca.vertcat(everything[:begin], memory), ca.vertcat(q, p[n:])

    solve = fused(stated)
    skip = _function("skip", lambda _, state: [state, ca.DM.nan(3 + report)], p, state)
    may_act = own[record["reason"]] == 0
    solved, found = ca.Function.if_else(f"{name}_solve", solve, skip)(may_act, parameters, state)
    outputs = [ca.vertcat(solved, own), found, certified(own, solved[velocity], found)]
    tick = ca.Function(name, [p, everything, given], outputs)

    def stopped(p: ca.MX, state: ca.MX, own: ca.MX, verdict: ca.MX, *_: ca.MX) -> list[ca.MX]:
        after, said, at = stop(p, state)
        status = ca.if_else(said[1], NUMBERED.index(Status.BRAKING), NUMBERED.index(Status.HOLDING))
        said = ca.vertcat(status, ca.inf, -1, said[0], 0)
        return [after, fallen_back(own, after[velocity], verdict, p, said), at]

    def slowed(p: ca.MX, _: ca.MX, own: ca.MX, verdict: ca.MX, *made: ca.MX) -> list[ca.MX]:
        report, memory, violation = made
        said = ca.vertcat(NUMBERED.index(Status.BACKUP), violation, len(FUSED_SOLVERS), report)
        return [ca.vertcat(ca.MX.zeros(begin), memory), fallen_back(own, memory[:n], verdict, p, said), p[:n]]

    def uncertified(p: ca.MX, state: ca.MX, own: ca.MX, verdict: ca.MX, *_: ca.MX) -> list[ca.MX]:
        if law is None:
            return stopped(p, state, own, verdict)
        none = _function("none", lambda *_: [ca.DM.nan(law.size1_out(i)) for i in range(3)], p, state[begin:])
        wanted = ca.logic_and(own[record["reason"]] == 0, verdict[1])
        made = ca.Function.if_else(f"{name}_law", law, none)(wanted, p, state[begin:])
        holds = ca.logic_and(made[2] >= 0, made[2] <= tolerance)
        return _either(holds, slowed, stopped, p, state, own, verdict, *made)

    told = certified(own, answer[velocity], verdict)
    outputs = _either(
        told[REPORT["left"]] == DONE, lambda p, *others: [*others[-2:], p[:n]], uncertified,
        parameters, state, own, verdict, answer, told,
    )  # fmt: skip
    outputs[0] = ca.vertcat(outputs[0], own)
    finish = ca.Function(f"{name}_finish", [p, everything, given, answer, verdict], outputs)
    return VelocityTick(judge, tick, finish)


def _either(condition: ca.MX, this: _Branch, that: _Branch, *given: ca.MX) -> list[ca.MX]:
    first, second = _function("this", this, *given), _function("that", that, *given)
    return list(ca.Function.if_else("either", first, second)(condition, *given))


def _function(name: str, of: _Branch, *like: ca.MX) -> ca.Function:
    columns = [ca.MX.sym("column", each.numel()) for each in like]
    return ca.Function(name, columns, of(*columns))


def _columns(*sizes: int) -> list[ca.SX]:
    return [ca.SX.sym("column", size) for size in sizes]


def relaxed_from_rest(own: Values, last: ca.SX, relaxed: ca.SX, hurried: ca.Function) -> ca.SX:
    """`relaxed`, with accelerations added if joints restarted at rest and jumped in velocity; see `judged_state`."""
    if not own.before.numel():
        return relaxed
    there = below(relaxed, 2 * int(Relaxed.ACCELERATION)) >= int(Relaxed.ACCELERATION)
    more = all_true(own.rested, hurried(own.before, last), ca.logic_not(there))
    return relaxed + int(Relaxed.ACCELERATION) * more


def _certified(
    record: Record, n: int, size: int, hurried: ca.Function, tolerance: float, *, named: bool
) -> ca.Function:
    """Function: `judged_memory`, velocity (n,), verdict -> `REPORT`, whose `left` is `DONE` for a certified answer."""
    column, last, verdict = inputs = _columns(record.size, n, size)
    own, (residual, valid, who, relaxed, scale) = record.parts(column), ca.vertsplit(verdict)[:5]
    meant, blocked = own.reason == 0, scale == 0
    reason, joint = (verdict[5], verdict[6]) if named else (ca.SX(NUMBER["NOTHING_LEFT"]), ca.SX(-1))
    holds = all_true(meant, residual >= 0, residual <= tolerance)
    told = REPORT.of(
        left=ca.if_else(holds, DONE, ca.if_else(ca.logic_and(meant, valid), LEFT_TO_OTHERS, NOTHING_TO_SOLVE)),
        residual=residual, solver=who, relaxed=relaxed_from_rest(own, last, relaxed, hurried), scale=scale,
        unusual=blocked,
        status=ca.if_else(blocked, NUMBERED.index(Status.BLOCKED), NUMBERED.index(Status.OK)),
        reason=reason * blocked,
        input=ca.SX(-1), element=ca.if_else(blocked, joint, -1), details=ca.SX.zeros(2), note=ca.SX(0),
    )  # fmt: skip
    return ca.Function("certified", inputs, [told], {"cse": True})


def _fallen_back(record: Record, n: int, size: int, hurried: ca.Function, faulty: ca.Function) -> ca.Function:
    column, last, verdict, p, said = inputs = _columns(record.size, n, size, faulty.numel_in(0), 5)
    own, (status, residual, solver, relaxed, scale) = record.parts(column), ca.vertsplit(said)
    refused, joint = own.reason != 0, own.reason == NUMBER["NOT_FOLLOWED"]
    reason, where, element = ca.vertsplit(faulty(p, verdict[1]))
    told = REPORT.of(
        left=ca.SX(DONE), residual=residual, solver=solver, relaxed=relaxed_from_rest(own, last, relaxed, hurried),
        scale=scale, unusual=ca.SX(1), status=status, reason=ca.if_else(refused, own.reason, reason),
        input=ca.if_else(refused, -1, where),
        element=ca.if_else(refused, ca.if_else(joint, own.element, -1), element),
        details=ca.if_else(refused, own.details, ca.vertcat(verdict[0], 0)), note=ca.SX(0),
    )  # fmt: skip
    return ca.Function("fallen_back", inputs, [told], {"cse": True})


def below(relaxed: ca.SX, part: int) -> ca.SX:
    """Flags of a `Relaxed` number that are smaller than the flag `part`."""
    return relaxed - part * ca.floor(relaxed / part)
