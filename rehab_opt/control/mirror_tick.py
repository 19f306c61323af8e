"""One tick of a mirrored hand as functions of (parameters, state, memory, inputs) -> (memory, command).

Between these functions, the caller stores the reference samples, evaluates the model of the led arm, and solves the QP.
C code is generated from the same functions.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import casadi as ca

from rehab_opt.control.between_poses import moving_tool_function, rigid_function
from rehab_opt.control.command import NUMBERED, Relaxed, Status
from rehab_opt.control.interaction import AT_LIMIT, FELT, INVALID, Interaction
from rehab_opt.control.judged_state import GIVEN
from rehab_opt.control.mirror_pace import AIMED, PACE, REMEMBERED, SAID, MirrorPace, counted
from rehab_opt.control.mirror_statement import WHOLE
from rehab_opt.control.reasons import NOTES, NUMBER
from rehab_opt.control.reference_clock import SAMPLE
from rehab_opt.control.velocity_tick import DONE, REPORT, below, relaxed_from_rest
from rehab_opt.control.watchdog import first_of
from rehab_opt.optim.certificate import all_true
from rehab_opt.symbolic.record import Record

if TYPE_CHECKING:
    from rehab_opt.control.mirror_statement import MirrorStatement

__all__ = ["NOTICED", "MirrorTick", "mirror_tick"]

VERDICT = Record(residual=1, valid=1, solver=1, relaxed=1, scale=1, reason=1, element=1, usual=1, then=1)
"""Verdict on the QP's answer; from `relaxed` on it is the QP's report, see `MirrorStatement.told`."""
NOTICED = Record(reason=1, input=1, element=1, here=16, hand=6)
"""Number of the reason to brake, 0 for none; index of the invalid argument of `step`, and of its element, -1 for none;
the tool's pose and twist.
"""
ORIGIN = [3, 7, 11]
"""Indices of the position in a pose, row by row."""
ACCELERATION, TASK = int(Relaxed.ACCELERATION), int(Relaxed.TASK)
"""Flags of `Relaxed` as numbers."""
NOTE = {note.name: 2**i for i, note in enumerate(NOTES)}
_FELT, _HELD = REMEMBERED.places["felt"], REMEMBERED.places["held"]


class MirrorTick(NamedTuple):
    """Functions of a tick; they share the QP's state and parameters, which begin with the positions (n,)."""

    notice: ca.Function
    """Parameters, state, `GIVEN`, force (3,) [N], whether it is measured, pose and twist (22,) of the last tick without
    clock, `REMEMBERED` -> positions (n,), state, `REMEMBERED`, `NOTICED`.
    """
    tried: ca.Function
    """See `MirrorPace.tried_function`."""
    concluded: ca.Function
    """See `MirrorPace.concluded_function`."""
    deliver: ca.Function
    """Parameters, state after a certified answer, its verdict, `SAID`, current sample, whether samples were skipped,
    `REMEMBERED` -> parameters, `REPORT`, `REMEMBERED`.
    """
    brake: ca.Function
    """Fallback command: parameters, state, the QP's verdict, the first three values of `NOTICED`, `REMEMBERED` ->
    state, `REPORT`, `REMEMBERED`.
    """


def mirror_tick(of: MirrorStatement, pace: MirrorPace, law: Interaction, *, person: bool) -> MirrorTick:
    """Functions of a tracker's tick; `person` is true if a model of the led arm limits the reference."""
    return MirrorTick(
        _notice(of, law), pace.tried_function(), pace.concluded_function(person=person), _deliver(of), _brake(of)
    )


def _notice(of: MirrorStatement, law: Interaction) -> ca.Function:
    n, size, begin = of.chain.n, of.stated.state_size, _begin(of)
    p, state, given, force, measured, accepted, memory = inputs = _columns(
        of.stated.parameter_size, size + of.judged.size, GIVEN.size, 3, 1, 22, REMEMBERED.size
    )
    q, known, own = of.functions.judge(p[:n], state[begin:size], state[size:], given)
    moving = moving_tool_function(of.chain)
    here, hand = moving(q, known[:n])
    seen = moving(p[:n], known[:n])[0]  # the force does its work at the measured hand
    old, last = REMEMBERED.symbols("memory"), ca.SX.sym("accepted", 22)
    after = REMEMBERED.changed(old, held=ca.if_else(old.live, last[ORIGIN], old.held), live=ca.SX(0))
    memory = ca.Function("left", [old.column, last], [after.column])(memory, accepted)
    felt, stop = law.felt_function(of.dt)(force, measured, memory[_FELT], seen[ORIGIN] - memory[_HELD])
    found = of.faulty()(ca.vertcat(q, p[n:]), rigid_function()(p[n : n + 16]))
    why = _first_reason(of)(own[of.judged["reason"]], own[of.judged["element"]], found, stop, force)
    outputs = [
        q, ca.vertcat(state[:begin], known, own), ca.vertcat(memory[: _FELT.start], felt, memory[_FELT.stop :]),
        ca.vertcat(why, here, hand),
    ]  # fmt: skip
    return ca.Function("notice", inputs, outputs)


def _first_reason(of: MirrorStatement) -> ca.Function:
    own, joint, found, stop, force = inputs = [ca.SX.sym("argument", size) for size in (1, 1, 3, 1, 3)]
    element = ca.SX(-1)
    for i in (2, 1, 0):
        element = ca.if_else(ca.fabs(force[i]) < ca.inf, element, i)
    why = first_of([
        (own != 0, ca.vertcat(own, -1, joint)),
        (found[0] != NUMBER["NOT_CERTIFIED"], ca.vertcat(found[0], ca.fmin(found[1], 3), found[2])),
        (stop == INVALID, ca.vertcat(NUMBER["INPUT_INVALID"], 3 + (of.limits.moving_size > 0), element)),
        (ca.SX(1), ca.vertcat(ca.if_else(stop == AT_LIMIT, NUMBER["FORCE_AT_LIMIT"], 0), -1, -1)),
    ])  # fmt: skip
    return ca.Function("first_reason", inputs, [ca.densify(why)], {"cse": True})


def _brake(of: MirrorStatement) -> ca.Function:
    n, size, begin = of.chain.n, of.stated.state_size, _begin(of)
    reason = size + of.judged["reason"]
    p, state, verdict, why, memory = inputs = _columns(
        of.stated.parameter_size, size + of.judged.size, VERDICT.size, 3, REMEMBERED.size
    )
    refused = ca.vertcat(state[:reason], why[0], state[reason + 1 :])
    after, told, q = of.functions.finish(p, refused, ca.DM([0, 0, 0, 1]), state[:size], verdict)  # judged before
    told, memory = _braked(of)(told, memory, q, after[begin : begin + n], why)
    own = state[size:reason], 0, state[reason + 1 :]
    return ca.Function("brake", inputs, [ca.vertcat(after[:size], *own), told, memory])


def _braked(of: MirrorStatement) -> ca.Function:
    told, past = REPORT.symbols("told"), REMEMBERED.symbols("memory")
    q, velocity, why = others = [ca.SX.sym("argument", size) for size in (of.chain.n, of.chain.n, 3)]
    unusable = why[0] == NUMBER["INPUT_INVALID"]
    after = REPORT.changed(
        told, input=ca.if_else(unusable, why[1], told.input), element=ca.if_else(unusable, why[2], told.element)
    )
    pace = PACE.changed(PACE.parts(past.pace), rate=ca.SX(0), waited=ca.SX(0), stood=ca.SX(0))
    memory = REMEMBERED.changed(
        past, pace=pace.column, live=ca.SX(0), then=of.hand_bounds.manipulability(q + of.dt * velocity)[0],
        counted=counted(past, braked=ca.SX(1), acceleration=_hurried(told.relaxed)),
    )  # fmt: skip
    return ca.Function("braked", [told.column, past.column, *others], [after.column, memory.column], {"cse": True})


def _deliver(of: MirrorStatement) -> ca.Function:
    n, size, begin = of.chain.n, of.stated.state_size, _begin(of)
    p, state, verdict, said, sample, thinned, memory = inputs = _columns(
        of.stated.parameter_size, size + of.judged.size, VERDICT.size, SAID.size, SAMPLE.size, 1, REMEMBERED.size
    )
    aimed = slice(n, n + AIMED.size)
    told, memory, next_one = _delivered(of)(
        verdict, state[size:], memory, said, sample, thinned, state[begin : begin + n], p[aimed]
    )
    return ca.Function("deliver", inputs, [ca.vertcat(p[:n], next_one, p[aimed.stop :]), told, memory])


def _delivered(of: MirrorStatement) -> ca.Function:
    verdict, own, past = VERDICT.symbols("verdict"), of.judged.symbols("own"), REMEMBERED.symbols("memory")
    said, sample, (fewer, velocity, aimed) = SAID.symbols("said"), SAMPLE.symbols("sample"), (
        ca.SX.sym("argument", size) for size in (1, of.chain.n, AIMED.size)
    )  # fmt: skip
    pace = PACE.parts(past.pace)
    relaxed = relaxed_from_rest(own, velocity, verdict.relaxed, of.hurried)
    slowed, blocked = pace.rate < WHOLE, verdict.scale == 0
    notes = {"SLOWED": slowed, "BRIDGING": said.bridging, "THINNED": fewer}
    told = REPORT.of(
        left=ca.SX(DONE), residual=verdict.residual, solver=verdict.solver,
        relaxed=ca.if_else(slowed, below(relaxed, TASK) + TASK, relaxed),
        scale=ca.fmin(pace.rate, 1) * verdict.scale,
        unusual=ca.SX(1), status=ca.if_else(blocked, NUMBERED.index(Status.BLOCKED), NUMBERED.index(Status.OK)),
        reason=verdict.reason * blocked, input=ca.SX(-1), element=ca.if_else(blocked, verdict.element, -1),
        details=ca.SX.zeros(2), note=sum((NOTE[name] * (each != 0) for name, each in notes.items()), ca.SX(0)),
    )  # fmt: skip
    person = ca.fabs(past.aim[0]) < ca.inf
    usual = all_true(
        *(ca.logic_not(each) for each in (person, FELT.parts(past.felt).active, said.short)),
        said.ahead <= 0, pace.rate >= WHOLE, verdict.usual,
    )  # fmt: skip
    memory = REMEMBERED.changed(
        past, pace=PACE.changed(pace, rate=ca.if_else(usual, 1, pace.rate)).column, live=usual, then=verdict.then,
        counted=counted(past, acceleration=_hurried(relaxed), slowed=slowed),
    )  # fmt: skip
    at_hand = ca.vertcat(sample.pose, ca.DM([0, 0, 0, 1]), sample.twist)
    inputs = [verdict.column, own.column, past.column, said.column, sample.column, fewer, velocity, aimed]
    outputs = [told, memory.column, ca.if_else(usual, at_hand, aimed)]
    return ca.Function("delivered", inputs, [ca.densify(each) for each in outputs], {"cse": True})


# ------------------------------------------------------------------------------------------------------- its parts
def _begin(of: MirrorStatement) -> int:
    """Index in a state at which the memory begins: last velocity, the position at its end, and more."""
    return of.stated.state_size - int(of.stated.memory.numel())


def _columns(*sizes: int) -> list[ca.MX]:
    return [ca.MX.sym("column", size) for size in sizes]


def _hurried(relaxed: ca.SX) -> ca.SX:
    return below(relaxed, TASK) >= ACCELERATION
