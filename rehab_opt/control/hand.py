"""Checked position and velocity of a hand, and the energy that the hand drew since the last sample."""

from __future__ import annotations

from typing import Any, NamedTuple

import casadi as ca

from rehab_opt.control.energy_tank import EnergyTank
from rehab_opt.control.reasons import NUMBER
from rehab_opt.control.watchdog import NUMBER_OF_SECONDS, first_of
from rehab_opt.kinematics.plausible import ROOM
from rehab_opt.optim.certificate import all_true, clipped
from rehab_opt.symbolic.record import Record, Values

__all__ = ["HAND", "SAMPLE", "HandState", "looked_at"]

ROUNDING = 1e-12
"""[m] Rounding error of a step at the speed cap."""
SCATTER_RATE, MAX_SCATTER = 0.01, 2e-3
"""[m/s, m] Learning rate of the scatter of positions, and largest scatter that counts as noise."""
SCATTER_PEAK = 3.6
"""Ratio of the peak noise between two samples to the scatter: 6 standard deviations to a median of 1.67."""
SAMPLE = Record(x=2, v=2, v_given=1, stamp=1, kind=1, enable=1)
"""Sample of a hand: position [m], velocity [m/s], whether a velocity is passed, stamp [s] and its kind (see
`stamp_and_kind`), dead man's switch.
"""
HAND = Record(x=2, v=2, estimated=2, halfway=2, scatter=1, stamp=1)
"""Memory of a hand: last valid position [m], NaN at first; velocity [m/s]; estimated velocity [m/s]; output of the
first of the two velocity filters [m/s]; median distance of samples from their prediction, called scatter [m]; stamp
[s], NaN at first.
"""


class HandState(NamedTuple):
    """State of a hand after one sample."""

    memory: ca.SX
    """`HAND`"""
    tank: EnergyTank
    reason: ca.SX
    """Number of the reason why the sample is invalid; 0 if it is valid."""
    details: ca.SX
    """(3,) details of the reason."""
    at_once: ca.SX
    """Whether the force must be released at once."""


def looked_at(
    memory: Values, tank: EnergyTank, sample: Values, *, force: ca.SX, stale: tuple[ca.SX, ca.SX], model: Values
) -> HandState:
    """Process one sample of a hand; `force` (2,) [N] has acted since the last sample.

    `stale` holds the watchdog's reason and its details, `model` the values of `force_tick.MODEL`.
    """
    cap = model.speed_cap
    timed = ca.logic_and(sample.kind == NUMBER_OF_SECONDS, ca.fabs(sample.stamp) < ca.inf)
    advance = sample.stamp - memory.stamp
    begun, told = ca.fabs(memory.x[0]) < ca.inf, ca.fabs(memory.stamp) < ca.inf
    least = ca.if_else(all_true(timed, ca.logic_not(begun), ca.logic_not(told)), tank.late, model.dt)  # since the reset
    seconds = ca.if_else(all_true(timed, model.dt < advance, advance < ca.inf), advance, least)
    # Jittering stamps add up to the elapsed time; without stamps, ticks do.
    surely = ca.if_else(all_true(timed, advance > 0, advance < ca.inf), advance, 0)
    waiting = tank.elapsed(force, seconds, ca.if_else(told, surely, model.dt))

    valid = all_true(*(ca.fabs(sample.x[i]) <= ROOM for i in range(2)))
    looks = ca.logic_and(stale[0] == 0, valid)
    moved, unseen = sample.x - memory.x, waiting.numbers.unseen
    distance = ca.hypot(moved[0], moved[1])
    first, still = ca.logic_not(distance < ca.inf), all_true(moved[0] == 0, moved[1] == 0)
    jitter = ca.if_else(model.learns, SCATTER_PEAK * memory.scatter, model.jitter)
    within = distance <= cap * unseen * (1 + 1e-9) + ROUNDING + jitter
    jumped = all_true(looks, ca.logic_not(first), ca.logic_not(still), ca.logic_not(within))
    # Two equal low-pass filters leave half of the noise of one filter with the same lag.
    fraction, fresh = unseen / (0.5 * model.velocity_lag + unseen), ca.logic_or(first, jumped)
    halfway = memory.halfway + fraction * (moved / unseen - memory.halfway)
    slower = memory.estimated + fraction * (halfway - memory.estimated)
    halfway, estimated = (
        ca.if_else(looks, ca.if_else(fresh, ca.SX.zeros(2), now), before)
        for now, before in ((halfway, memory.halfway), (slower, memory.estimated))
    )
    stray = ca.norm_2(moved - memory.estimated * unseen)
    learnt = memory.scatter + SCATTER_RATE * unseen * ca.sign(stray - memory.scatter)
    scatter = ca.if_else(ca.logic_and(looks, stray < ca.inf), clipped(learnt, 0, MAX_SCATTER), memory.scatter)
    here = waiting.or_else(first, waiting.jumped(ca.SX(0)))
    here = here.or_else(within, waiting.seen(moved))
    here = here.or_else(jumped, waiting.jumped(distance))
    here = here.or_else(ca.logic_and(still, ca.logic_not(model.trust_stillness)), waiting)
    here = waiting.or_else(looks, here)

    velocity = ca.if_else(sample.v_given, sample.v, estimated)
    given, seen = ca.hypot(sample.v[0], sample.v[1]), ca.hypot(estimated[0], estimated[1])
    slow = ca.logic_or(ca.logic_not(sample.v_given), given <= cap)
    runs = seen > cap * (1 + 1e-9) + jitter / model.velocity_lag
    fast = ca.logic_or(runs, ca.logic_and(ca.logic_not(slow), given < ca.inf))
    speed = ca.if_else(runs, seen, given)
    cases: list[tuple[ca.SX, str, tuple[Any, Any, Any]]] = [
        (fast, "HAND_TOO_FAST", (speed, cap, 0)),
        (jumped, "POSITION_JUMPED", (distance, unseen, cap)),
        (stale[0] != 0, "", (stale[1][0], stale[1][1], 0)),
        (ca.logic_not(valid), "POSITION_INVALID", (sample.x[0], sample.x[1], 0)),
        (ca.logic_not(slow), "VELOCITY_INVALID", (sample.v[0], sample.v[1], 0)),
        (ca.SX(1), "FINE", (0, 0, 0)),
    ]
    return HandState(
        memory=HAND.of(
            x=ca.if_else(looks, sample.x, memory.x),
            v=velocity,
            estimated=estimated,
            halfway=halfway,
            scatter=scatter,
            stamp=ca.if_else(timed, sample.stamp, memory.stamp),
        ),
        tank=here,
        reason=first_of([(when, ca.SX(NUMBER[name]) if name else stale[0]) for when, name, _ in cases]),
        details=first_of([(when, ca.vertcat(*told)) for when, _, told in cases]),
        at_once=ca.logic_or(fast, jumped),
    )
