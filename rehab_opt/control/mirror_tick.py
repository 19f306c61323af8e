"""One tick of a mirrored hand as functions of (parameters, state, memory, inputs) -> (memory, command).

In between, whoever ticks keeps the samples of the reference, asks the model of a led arm, and solves the QP. C is
generated from these functions.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import casadi as ca

from rehab_opt.control.between_poses import moving_tool_function, rigid_function
from rehab_opt.control.command import NUMBERED, Relaxed, Status
from rehab_opt.control.interaction import AT_LIMIT, FELT, INVALID, Interaction
from rehab_opt.control.judged_state import GIVEN
from rehab_opt.control.manipulability import escape_function
from rehab_opt.control.mirror_pace import PACE, REMEMBERED, SAID, MirrorPace, counted
from rehab_opt.control.mirror_statement import HELD, WHOLE
from rehab_opt.control.reasons import NOTES, NUMBER
from rehab_opt.control.reference_clock import SAMPLE
from rehab_opt.control.velocity_tick import DONE, REPORT, below, relaxed_from_rest
from rehab_opt.control.watchdog import first_of
from rehab_opt.optim.certificate import all_true
from rehab_opt.symbolic.record import Record

if TYPE_CHECKING:
    from rehab_opt.control.mirror_statement import MirrorStatement

__all__ = ["NOTICED", "MirrorTick", "mirror_tick"]

STALE = 200
"""Ticks without gain after which another way out is looked for."""
GAINED = 1e-7
"""Growth of w / w_max that counts as a gain."""
VERDICT = Record(residual=1, valid=1, solver=1, relaxed=1, scale=1, usual=1, kept=1, w=1, then=1, flat=1)
"""Of the QP, its report from `relaxed` on: see `MirrorStatement.outcome`."""
NOTICED = Record(reason=1, input=1, element=1, here=16, hand=6)
"""The number of the reason why the arm must brake, 0 for none; of an unusable number which argument of `step` it is in,
counted from 0, and which of its elements it is, -1 for none; the tool's pose, and how it moves."""
ORIGIN = [3, 7, 11]
"""Where it stands in a pose by rows."""
ACCELERATION, TASK = int(Relaxed.ACCELERATION), int(Relaxed.TASK)
"""The last two of what can yield here, as numbers."""
NOTE = {note.name: 2**i for i, note in enumerate(NOTES)}
_FELT, _HELD = REMEMBERED.places["felt"], REMEMBERED.places["held"]


class MirrorTick(NamedTuple):
    """The functions of a tick. Parameters are those of the QP, n of them positions; a state is that of its tick."""

    notice: ca.Function
    """Parameters, state, `GIVEN`, force (3,) [N], whether it is measured, pose and twist (22,) of the last tick that
    needed no clock, `REMEMBERED` -> positions (n,), state, `REMEMBERED`, `NOTICED`."""
    tried: ca.Function
    """See `MirrorPace.tried_function`."""
    aimed: ca.Function
    """See `MirrorPace.aimed_function`."""
    concluded: ca.Function
    """See `MirrorPace.concluded_function`."""
    deliver: ca.Function
    """Parameters, state after a certified answer, its verdict, velocity (n,) before it, `SAID`, the sample at hand,
    whether samples were left out, `REMEMBERED` -> parameters, state, `REPORT`, `REMEMBERED`.

    The step is shortened where the true state requires it. Where all is usual, the next tick needs no clock."""
    brake: ca.Function
    """Parameters, state, the QP's verdict, the first three of `NOTICED`, `REMEMBERED` -> state, `REPORT`, `REMEMBERED`.

    The safe command, and faster where the floor or the planes ask for it."""


def mirror_tick(of: MirrorStatement, pace: MirrorPace, law: Interaction, *, person: bool) -> MirrorTick:
    """The functions of a tracker; `person` says whether a model of the led arm limits its reference."""
    keeping = of.keeping()
    return MirrorTick(
        _notice(of, law),
        pace.tried_function(),
        pace.aimed_function(of.audit, of.braked, person=person),
        pace.concluded_function(person=person),
        _deliver(of, keeping),
        _brake(of, keeping),
    )


def _notice(of: MirrorStatement, law: Interaction) -> ca.Function:
    n, size, begin = of.chain.n, of.stated.state_size, _begin(of)
    p, state, given, force, measured, accepted, memory = inputs = _columns(
        of.stated.parameter_size, size + of.judged.size, GIVEN.size, 3, 1, 22, REMEMBERED.size
    )
    q, known, own = of.functions.judge(p[:n], state[begin:size], state[size:], given)
    moving = moving_tool_function(of.chain)
    here, hand = moving(q, known[:n])
    seen = moving(p[:n], known[:n])[0]  # work is done where the hand is measured
    old, last = REMEMBERED.symbols("memory"), ca.SX.sym("accepted", 22)
    after = REMEMBERED.changed(old, held=ca.if_else(old.live, _held(of, last), old.held), live=ca.SX(0))
    memory = ca.Function("left", [old.column, last], [after.column])(memory, accepted)
    felt, stop = law.felt_function(of.dt)(force, measured, memory[_FELT], seen[ORIGIN] - memory[_HELD][:3])
    found = of.faulty()(ca.vertcat(q, p[n:]), rigid_function()(p[n : n + 16]))
    why = _first_reason(of)(own[of.judged["reason"]], own[of.judged["element"]], found, stop, force)
    outputs = [
        q, ca.vertcat(state[:begin], known, own), ca.vertcat(memory[: _FELT.start], felt, memory[_FELT.stop :]),
        ca.vertcat(why, here, hand),
    ]  # fmt: skip
    return ca.Function("notice", inputs, outputs)


def _first_reason(of: MirrorStatement) -> ca.Function:
    """Reason and joint of a state, `faulty` of parameters, why forces stop the arm, force -> three of `NOTICED`."""
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


def _brake(of: MirrorStatement, keeping: ca.Function) -> ca.Function:
    n, size, begin = of.chain.n, of.stated.state_size, _begin(of)
    reason = size + of.judged["reason"]
    p, state, verdict, why, memory = inputs = _columns(
        of.stated.parameter_size, size + of.judged.size, VERDICT.size, 3, REMEMBERED.size
    )
    refused = ca.vertcat(state[:reason], why[0], state[reason + 1 :])
    after, told, q = of.functions.finish(p, refused, ca.DM([0, 0, 0, 1]), state[:size], verdict)  # judged before
    value, pose, old = after[begin : begin + n], ca.SX.sym("pose", 16), ca.SX.sym("held", HELD.size)
    near = ca.Function("near", [old, pose], [ca.if_else(ca.fabs(old[0]) < ca.inf, old, _held(of, pose))])
    held = near(memory[_HELD], moving_tool_function(of.chain)(q, value)[0])
    same = _columns(*(keeping.size1_in(i) for i in range(keeping.n_in())))
    still = ca.Function("still", same, [same[1], ca.DM.zeros(3)])
    moves = ca.sum1(value != 0) > 0
    part, ends = ca.Function.if_else("keeps", keeping, still)(
        moves, q, value, held, state[begin : begin + n], 0, p[p.numel() - of.limits.moving_size :]
    )
    told, memory = _braked(of)(told, state[size:], memory, part, ends, moves, why)
    nothing, own = ca.MX.zeros(size - begin - 2 * n), (state[size:reason], 0, state[reason + 1 :])
    after = ca.vertcat(after[:begin], part, q + of.dt * part, nothing, *own)
    return ca.Function("brake", inputs, [after, told, memory])


def _braked(of: MirrorStatement) -> ca.Function:
    """`REPORT` of the safe command, `judged_memory`, `REMEMBERED`, what `keeping` gives (n,), (3,), whether it was
    asked, three of `NOTICED` -> `REPORT`, `REMEMBERED`.
    """
    told, own, past = REPORT.symbols("told"), of.judged.symbols("own"), REMEMBERED.symbols("memory")
    velocity, ends, moves, why = others = [ca.SX.sym("argument", size) for size in (of.chain.n, 3, 1, 3)]
    then, shorter, _ = ca.vertsplit(ends)
    relaxed = relaxed_from_rest(own, velocity, _shortened(told.relaxed, ends), of.hurried)
    status = ca.if_else(ca.sum1(velocity != 0) > 0, NUMBERED.index(Status.BRAKING), NUMBERED.index(Status.HOLDING))
    unusable = why[0] == NUMBER["INPUT_INVALID"]
    after = REPORT.changed(
        told, status=ca.if_else(shorter, status, told.status),
        relaxed=relaxed, input=ca.if_else(unusable, why[1], told.input),
        element=ca.if_else(unusable, why[2], told.element),
    )  # fmt: skip
    pace = PACE.changed(PACE.parts(past.pace), rate=ca.SX(0), waited=ca.SX(0), stood=ca.SX(0))
    memory = REMEMBERED.changed(
        past, pace=pace.column, live=ca.SX(0), then=ca.if_else(moves, then, past.then),
        counted=counted(past, braked=ca.SX(1), shortened=shorter, acceleration=_hurried(relaxed)),
    )  # fmt: skip
    inputs = [told.column, own.column, past.column, *others]
    return ca.Function("braked", inputs, [after.column, memory.column], {"cse": True})


def _deliver(of: MirrorStatement, keeping: ca.Function) -> ca.Function:
    n, size, begin, lead = of.chain.n, of.stated.state_size, _begin(of), slice(of.chain.n + 25, 2 * of.chain.n + 25)
    p, state, verdict, before, said, sample, thinned, memory = inputs = _columns(
        of.stated.parameter_size, size + of.judged.size, VERDICT.size, n, SAID.size, SAMPLE.size, 1, REMEMBERED.size
    )
    broken, around = verdict[VERDICT["kept"]] == 0, p[p.numel() - of.limits.moving_size :]
    part, ends = keeping(p[:n], state[begin : begin + n], memory[_HELD], before, broken, around)
    told, memory, aimed, looks, again, leads = _delivered(of)(
        verdict, state[size:], memory, said, sample, thinned, part, ends, p[n : lead.start], p[lead]
    )
    nothing = ca.Function("nothing", _columns(n, 1), [ca.DM.zeros(n)])
    leads += ca.Function.if_else("escape", escape_function(of.chain), nothing)(looks, p[:n], again)
    state = ca.vertcat(state[:begin], part, p[:n] + of.dt * part, state[begin + 2 * n :])
    return ca.Function("deliver", inputs, [ca.vertcat(p[:n], aimed, leads, p[lead.stop :]), state, told, memory])


def _delivered(of: MirrorStatement) -> ca.Function:
    """`VERDICT`, `judged_memory`, `REMEMBERED`, `SAID`, sample, whether some were left out, what `keeping` gives (n,),
    (3,), pose, twist and offset (25,), way out (n,) -> `REPORT`, `REMEMBERED`; for the next tick the (25,), whether a
    way out is looked for, whether another one, and the way that stays.
    """
    verdict, own, past = VERDICT.symbols("verdict"), of.judged.symbols("own"), REMEMBERED.symbols("memory")
    said, sample, (fewer, velocity, ends, aimed, lead) = SAID.symbols("said"), SAMPLE.symbols("sample"), (
        ca.SX.sym("argument", size) for size in (1, of.chain.n, 3, 25, of.chain.n)
    )  # fmt: skip
    then, shorter, _ = ca.vertsplit(ends)
    pace = PACE.changed(PACE.parts(past.pace), share=verdict.scale)
    relaxed = relaxed_from_rest(own, velocity, _shortened(verdict.relaxed, ends), of.hurried)
    slowed = pace.rate < WHOLE
    stuck = all_true(shorter, ca.sum1(velocity != 0) == 0)
    asked = ca.if_else(slowed, below(relaxed, TASK) + TASK, relaxed)
    notes = {
        "SHORTENED": shorter, "SLOWED": slowed, "BRIDGING": said.bridging, "THINNED": fewer
    }  # fmt: skip
    told = REPORT.of(
        left=ca.SX(DONE), residual=verdict.residual, solver=verdict.solver,
        relaxed=asked,
        scale=ca.logic_not(stuck) * ca.fmin(pace.rate, 1) * verdict.scale,
        unusual=ca.SX(1), status=ca.if_else(stuck, NUMBERED.index(Status.BLOCKED), NUMBERED.index(Status.OK)),
        reason=NUMBER["NOTHING_LEFT"] * stuck, input=ca.SX(-1), element=ca.SX(-1),
        details=ca.SX.zeros(2), note=sum((NOTE[name] * (each != 0) for name, each in notes.items()), ca.SX(0)),
    )  # fmt: skip
    person = ca.fabs(past.aim[0]) < ca.inf
    usual = all_true(
        *(ca.logic_not(each) for each in (person, FELT.parts(past.felt).active, verdict.flat, said.short)),
        said.ahead <= 0, pace.rate >= WHOLE, verdict.scale >= WHOLE,
    )  # fmt: skip
    led, flat = ca.sum1(ca.fabs(lead)) > 0, verdict.flat
    age = ca.if_else(verdict.w > past.lead_w + GAINED, 0, past.lead_age + 1)
    looks = all_true(flat, ca.logic_or(ca.logic_not(led), age > STALE))
    memory = REMEMBERED.changed(
        past, pace=PACE.changed(pace, rate=ca.if_else(usual, 1, pace.rate)).column, live=usual,
        then=ca.if_else(shorter, then, verdict.then),
        lead_w=ca.if_else(flat, ca.if_else(led, ca.fmax(verdict.w, past.lead_w), verdict.w), past.lead_w),
        lead_age=ca.if_else(flat, ca.if_else(looks, 0, age), past.lead_age),
        counted=counted(past, acceleration=_hurried(relaxed), shortened=shorter, slowed=slowed),
    )  # fmt: skip
    at_hand = ca.vertcat(sample.pose, ca.DM([0, 0, 0, 1]), sample.twist, ca.SX.zeros(3))
    inputs = [verdict.column, own.column, past.column, said.column, sample.column, fewer, velocity, ends, aimed, lead]
    stays = ca.if_else(all_true(flat, ca.logic_not(looks)), lead, 0)
    outputs = [told, memory.column, ca.if_else(usual, at_hand, aimed), looks, age > 0, stays]
    return ca.Function("delivered", inputs, [ca.densify(each) for each in outputs], {"cse": True})


# ------------------------------------------------------------------------------------------------------- its parts
def _begin(of: MirrorStatement) -> int:
    """Where what is remembered begins in a state: the last velocity, the position it leads to, and more."""
    return of.stated.state_size - int(of.stated.memory.numel())


def _columns(*sizes: int) -> list[ca.MX]:
    return [ca.MX.sym("column", size) for size in sizes]


def _held(of: MirrorStatement, pose: ca.SX) -> ca.SX:
    """`HELD` of a hand that followed as usual."""
    return HELD.of(centre=pose[ORIGIN], target=pose[:16], turn=ca.SX(of.max_turn))


def _shortened(relaxed: ca.SX, ends: ca.SX) -> ca.SX:
    """What yields, where `keeping` says that the step is shorter and whether its acceleration yields."""
    _, shorter, hurried = ca.vertsplit(ends)
    return ca.if_else(shorter, below(relaxed, ACCELERATION) + TASK + ACCELERATION * hurried, relaxed)


def _hurried(relaxed: ca.SX) -> ca.SX:
    return below(relaxed, TASK) >= ACCELERATION
