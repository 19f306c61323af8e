"""Functions of one tick of a bounded force, also for C code: check the hand's sample, then bound the force."""

from __future__ import annotations

import math
from functools import cache
from typing import NamedTuple

import casadi as ca

from rehab_opt.control.assistance_statement import EXACT, TINY, assistance_statement
from rehab_opt.control.command import NUMBERED, Relaxed, Status
from rehab_opt.control.energy_tank import EnergyTank, tank_record
from rehab_opt.control.hand import HAND, SAMPLE, looked_at
from rehab_opt.control.reasons import NUMBER
from rehab_opt.control.watchdog import STAMPS, checked_stamp, first_of
from rehab_opt.optim.certificate import NEGLIGIBLE, all_true, delivered_fraction
from rehab_opt.optim.fused import FUSED_SOLVERS
from rehab_opt.symbolic.record import Record, Values

__all__ = [
    "BEYOND",
    "DESIRED",
    "LEAP",
    "MESSAGE",
    "MODEL",
    "NUMBERS",
    "SOLVED",
    "VIEW",
    "ForceTick",
    "affordable",
    "anew",
    "force_tick",
    "give",
    "hear",
    "say",
    "watched_record",
]

MISSED = 1e-6
"""Least relative difference between commanded and desired force that counts as a relaxed task."""
MODEL = Record(
    dt=1, max_age=1, force_limit=1, slew_limit=1, growth_limit=1, speed_cap=1, velocity_lag=1, trust_stillness=1,
    budget=1, window=1, tail=1, jitter=1, learns=1, tolerance=1,
)  # fmt: skip
"""Parameters of `BoundedForce`; window [s] and tail of `EnergyTank`; jitter [m], the largest displacement by noise
between two samples; learns, whether the jitter is learnt.
"""
VIEW = Record(x=2, v=2, reason=1, details=3, at_once=1, ceiling=1, left=1, repeats=1, grown=1)
"""Checked sample of the hand: position x [m], velocity v [m/s], reason why it is invalid and details of the reason,
whether the force is released at once, largest force [N] by energy and force limit (ceiling), energy left [J], whether
the position repeats, largest force [N] by the growth limit (grown).
"""
DESIRED = Record(force=2, lets_go=1)
"""Desired force [N] before any bound, possibly NaN; whether the force is let go although the tick is valid, with the
status `BLOCKED`.
"""
SOLVED = Record(asks=1, value=2, status=1, residual=1, solver=1, relaxed=1, scale=1, reason=1, details=3, desired=2)
"""Command of a tick: whether another solver should be tried; force [N]; index of the status in `NUMBERED`; certificate
residual, infinite for a release; index of the solver; relaxed bounds; delivered fraction of the desired force; reason
and its details; desired force [N], zero for an invalid state.
"""
FORGOTTEN = 2.0
"""[s] Time in which the record of the largest recent force falls from the force limit to zero. A force below a recent
one does not surprise a person.
"""
BEYOND = 1e6
"""[m, N] A message with a larger number is corrupt."""
MESSAGE = Record(place=2, force=2, energy=1, serial=1)
"""Message of a side: hand position [m], NaN if invalid; force on the hand [N]; energy sent [J]; serial number."""
LEAP = 100
"""Largest accepted increase of the serial number; after a larger one, the next message must confirm it."""
NUMBERS = Record(said=1, newest=1, heard=1)
"""Serial numbers of the last sent message, of the newest accepted message, and of the last received message."""
LATEST = 1.0
"""[s] Longest time between two ticks for which energy is reserved."""


@cache
def watched_record(slots: int) -> Record:
    """Memory of stamps, hand and tank, and `felt` [N], the largest recent force."""
    return Record(stamps=STAMPS.size, hand=HAND.size, tank=tank_record(slots).size, felt=1)


class ForceTick(NamedTuple):
    """Functions of a tick; inputs and outputs are records, or the last force (2,)."""

    judge: ca.Function
    """`MODEL`, `watched_record`, last force (2,), `SAMPLE` -> `watched_record`, `VIEW`."""
    conclude: ca.Function
    """`MODEL`, last force, `VIEW`, `DESIRED` -> `SOLVED`, by the QP's closed form."""
    precompute: ca.Function
    """`MODEL`, `VIEW`, `DESIRED` -> parameters of the QP, and whether the QP is to be solved."""
    finish: ca.Function
    """`MODEL`, last force, `VIEW`, `DESIRED`, a solver's force, residual and number (4,) -> `SOLVED`."""


@cache
def force_tick(slots: int) -> ForceTick:
    """Functions of a tick for every `BoundedForce`; the parameters of a controller are in `MODEL`."""
    statement, precompute, finish = assistance_statement(), _precompute(), _finish()
    inputs = model, last, view, desired = finish.sx_in()[:4]
    parameters, _ = precompute(model, view, desired)
    answer, residual, _ = statement.screen(parameters, last)
    _, force, _ = statement.finish(parameters, last, answer[: statement.n])
    known = ca.vertcat(force, residual, FUSED_SOLVERS.index("closed form"))
    solved = finish(model, last, view, desired, known)
    conclude = ca.Function("force_conclude", inputs, [solved], {"cse": True})
    return ForceTick(_judge(slots), conclude, precompute, finish)


def _judge(slots: int) -> ca.Function:
    model, watched, sample = MODEL.symbols("model"), watched_record(slots).symbols("watched"), SAMPLE.symbols("sample")
    force = ca.SX.sym("force", 2)
    stamped, limits = STAMPS.parts(watched.stamps), {"dt": model.dt, "max_age": model.max_age}
    stamps = checked_stamp(stamped, sample.stamp, sample.kind, **limits, any_period=True)
    tank = _tank(watched.tank, model, slots)
    stale = stamps.reason, stamps.details
    hand = looked_at(HAND.parts(watched.hand), tank, sample, force=force, stale=stale, model=model)
    ceiling, left = _affordable(hand.tank, model)
    felt, grown = _growth(watched.felt, force, model)
    least = ca.norm_2(force) - model.slew_limit * model.dt
    spent = all_true(hand.tank.ceiling <= model.force_limit, least > ceiling, ca.logic_not(hand.at_once))
    released = ca.logic_and(ca.logic_not(sample.enable), ca.logic_not(hand.at_once))
    own = [(spent, ca.SX(NUMBER["ENERGY_SPENT"])), (released, ca.SX(NUMBER["NOT_ENABLED"]))]
    reason = first_of([*own, (ca.SX(1), hand.reason)])
    seen = HAND.parts(hand.memory)
    view = VIEW.of(
        x=seen.x,
        v=seen.v,
        reason=reason,
        details=hand.details,
        at_once=ca.logic_or(hand.at_once, spent),
        ceiling=ceiling,
        left=left,
        repeats=hand.tank.numbers.gap,
        grown=grown,
    )
    after = watched_record(slots).of(stamps=stamps.memory, hand=hand.memory, tank=hand.tank.numbers.column, felt=felt)
    inputs = [model.column, watched.column, force, sample.column]
    return ca.Function("force_judge", inputs, [after, view], {"cse": True})


def _precompute() -> ca.Function:
    model, view, wanted = MODEL.symbols("model"), VIEW.symbols("view"), DESIRED.symbols("desired")
    desired = wanted.force
    size, ceiling = ca.norm_2(desired), ca.fmin(view.ceiling, view.grown)
    fitting = ca.if_else(size <= ceiling, 1, ceiling / size * EXACT)
    parameters = ca.vertcat(desired * fitting, ceiling, model.slew_limit * model.dt, model.force_limit)
    solves = all_true(view.reason == 0, size < ca.inf)
    return ca.Function(
        "force_precompute", [model.column, view.column, wanted.column], [parameters, solves], {"cse": True}
    )


def _finish() -> ca.Function:
    model, view, wanted = MODEL.symbols("model"), VIEW.symbols("view"), DESIRED.symbols("desired")
    desired, lets_go = wanted.force, wanted.lets_go != 0
    last, answer, size = ca.SX.sym("last", 2), ca.SX.sym("answer", 4), ca.norm_2(desired)
    given, residual, who = ca.vertsplit(answer, [0, 2, 3, 4])
    meant = all_true(view.reason == 0, size < ca.inf)
    found = all_true(meant, residual >= 0, residual <= model.tolerance)

    missed = ca.norm_2(given - desired) > MISSED * size + TINY
    enough = NEGLIGIBLE * ca.fmin(1, model.force_limit / size)  # fraction of the desired force within the force limit
    scale = ca.if_else(lets_go, 0, delivered_fraction(given, desired, missed, least=TINY, enough=enough))
    blocked, dry = scale == 0, view.ceiling <= enough * size
    # Last stage: no force.
    strength, step = ca.norm_2(last), model.slew_limit * model.dt
    hasty = ca.logic_and(view.at_once, view.reason != 0)
    keep = ca.if_else(ca.logic_or(hasty, strength <= step), 0, 1 - step * EXACT / strength)
    weaker = ca.if_else(keep > 0, last * keep, ca.SX.zeros(2))
    torn = int(Relaxed.TASK) + int(Relaxed.SLEW) * ca.logic_and(hasty, strength > step)
    field = ca.logic_not(size < ca.inf)
    short = view.ceiling < ca.fmin(size, model.force_limit)
    allowed = ca.if_else(dry, 0, ca.vertcat(view.left, view.ceiling, 0))
    reasons = [
        (all_true(found, lets_go), ca.SX(NUMBER["HAND_STANDS"]), ca.SX.zeros(3)),
        (all_true(found, blocked, ca.logic_not(dry)), ca.SX(NUMBER["NOTHING_LEFT"]), ca.SX.zeros(3)),
        (all_true(found, short, view.repeats), ca.SX(NUMBER["POSITION_REPEATS"]), allowed),
        (all_true(found, short), ca.SX(NUMBER["ENERGY_LOW"]), allowed),
        (found, ca.SX(0), ca.SX.zeros(3)),
        (view.reason != 0, view.reason, view.details),
        (field, ca.SX(NUMBER["FIELD_NO_NUMBER"]), ca.SX.zeros(3)),
        (ca.SX(1), ca.SX(NUMBER["NOT_CERTIFIED"]), ca.vertcat(residual, 0, 0)),
    ]
    number = NUMBERED.index
    solved = SOLVED.of(
        asks=ca.logic_and(meant, ca.logic_not(found)),
        value=ca.if_else(found, given, weaker),
        status=ca.if_else(
            found,
            ca.if_else(blocked, number(Status.BLOCKED), number(Status.OK)),
            ca.if_else(keep > 0, number(Status.RELEASING), number(Status.RELEASED)),
        ),
        residual=ca.if_else(found, residual, ca.inf),
        solver=ca.if_else(found, who, -1),
        relaxed=ca.if_else(found, int(Relaxed.TASK) * ca.logic_or(missed, blocked), torn),
        scale=ca.if_else(found, scale, 0),
        reason=first_of([(when, reason) for when, reason, _ in reasons]),
        details=first_of([(when, details) for when, _, details in reasons]),
        desired=ca.if_else(found, desired, ca.SX.zeros(2)),
    )
    inputs = [model.column, last, view.column, wanted.column, answer]
    return ca.Function("force_finish", inputs, [solved], {"cse": True})


@cache
def affordable(slots: int) -> ca.Function:
    """Function: `MODEL`, `watched_record`, last force (2,) -> three values.

    The values are the largest force [N] that the energy and the force limit allow; the remaining energy [J]; and the
    largest force [N] that the growth limit allows.
    """
    model, watched, force = MODEL.symbols("model"), watched_record(slots).symbols("watched"), ca.SX.sym("force", 2)
    ceiling, left = _affordable(_tank(watched.tank, model, slots), model)
    grown = _growth(watched.felt, force, model)[1]
    return ca.Function("force_affordable", [model.column, watched.column, force], [ca.vertcat(ceiling, left, grown)])


def _affordable(tank: EnergyTank, model: Values) -> tuple[ca.SX, ca.SX]:
    return ca.fmin(tank.ceiling, model.force_limit), ca.fmax(tank.left, 0)


def _growth(felt: ca.SX, force: ca.SX, model: Values) -> tuple[ca.SX, ca.SX]:
    """Two results: largest recent force [N], `force` (2,) included; largest force [N] that may be commanded next."""
    fades = model.force_limit / FORGOTTEN * model.dt
    now = ca.fmax(ca.norm_2(force), felt - fades)
    return now, now + model.growth_limit * model.dt


@cache
def anew(slots: int) -> ca.Function:
    """Function: `MODEL`, `watched_record`, last and new force (4,) -> `watched_record` after a reset that does not
    refill the tank.
    """
    model, watched = MODEL.symbols("model"), watched_record(slots).symbols("watched")
    forces = ca.SX.sym("forces", 4)
    tank = _tank(watched.tank, model, slots).left_alone(forces[:2], model.dt, forces[2:])
    none = ca.SX(math.nan)
    after = watched_record(slots).of(
        stamps=STAMPS.of(last=none, lag=ca.SX(0), stamped=ca.SX(0), ahead=ca.SX(0)),
        hand=HAND.of(
            x=ca.vertcat(none, none),
            v=ca.SX.zeros(2),
            estimated=ca.SX.zeros(2),
            halfway=ca.SX.zeros(2),
            scatter=ca.SX(0),
            stamp=none,
        ),
        tank=tank.numbers.column,
        felt=ca.norm_2(forces[2:]),
    )
    return ca.Function("force_anew", [model.column, watched.column, forces], [after])


@cache
def hear(slots: int) -> ca.Function:
    """Function: `MODEL`, `watched_record`, `NUMBERS`, message (4,) -> `watched_record`, `NUMBERS`, two values.

    The message holds an energy [J], a serial number and two values. A message is new if its serial number is above
    that of the newest accepted message, and at most `LEAP` above that of the newest accepted or the last received
    message. A message that is not new gives NaN values and no energy.
    """
    model, watched = MODEL.symbols("model").column, watched_record(slots).symbols("watched").column
    numbers, (energy, serial, *told) = NUMBERS.symbols("numbers"), ca.vertsplit(heard := ca.SX.sym("heard", 4))
    follows = [ca.logic_and(serial > each, serial <= each + LEAP) for each in (numbers.newest, numbers.heard)]
    new = ca.logic_and(serial > numbers.newest, ca.logic_or(*follows))  # NaN fails
    after = take(slots)(model, watched, ca.if_else(new, energy, 0))
    known = all_true(new, *(ca.fabs(each) < BEYOND for each in told))
    counted = NUMBERS.changed(numbers, newest=ca.if_else(new, serial, numbers.newest), heard=serial)
    outputs = [after, counted.column, ca.if_else(known, heard[2:], math.nan)]
    return ca.Function("hear", [model, watched, numbers.column, heard], outputs)


@cache
def say(slots: int) -> ca.Function:
    """Function that writes a side's next message, with energy from its tank; the first inputs are those of `give`."""
    energies, view, numbers = give(slots).sx_in(), VIEW.symbols("view"), NUMBERS.symbols("numbers")
    after, energy = give(slots)(*energies)
    place, serial = ca.if_else(view.reason == 0, view.x, math.nan), numbers.said + 1
    message = MESSAGE.of(place=place, force=energies[2], energy=energy, serial=serial)
    inputs = [*energies, view.column, numbers.column]
    return ca.Function("say", inputs, [after, NUMBERS.changed(numbers, said=serial).column, message])


@cache
def give(slots: int) -> ca.Function:
    """Function: `MODEL`, `watched_record`, last force (2,), fraction of the energy -> `watched_record`, energy [J]."""
    model, watched = MODEL.symbols("model"), watched_record(slots).symbols("watched")
    force, fraction = ca.SX.sym("force", 2), ca.SX.sym("fraction")
    tank, energy = _tank(watched.tank, model, slots).given(fraction, force)
    after = watched_record(slots).changed(watched, tank=tank.numbers.column).column
    return ca.Function("give", [model.column, watched.column, force, fraction], [after, energy])


@cache
def take(slots: int) -> ca.Function:
    """Function: `MODEL`, `watched_record`, energy from another tank [J] -> `watched_record`."""
    model, watched, energy = MODEL.symbols("model"), watched_record(slots).symbols("watched"), ca.SX.sym("energy")
    tank = _tank(watched.tank, model, slots).filled(energy)
    after = watched_record(slots).changed(watched, tank=tank.numbers.column).column
    return ca.Function("take", [model.column, watched.column, energy], [after])


def _tank(numbers: ca.SX, model: Values, slots: int) -> EnergyTank:
    return EnergyTank(
        tank_record(slots).parts(numbers),
        slots,
        budget=model.budget,
        slew=model.slew_limit,
        speed_cap=model.speed_cap,
        late=ca.fmax(model.dt, ca.fmin(model.max_age, LATEST)),
        window=model.window,
        dt=model.dt,
        tail=model.tail,
    )
