"""The QP of one tick of assistance: math of the bounds on a force, of its rate and of its energy."""

from __future__ import annotations

import math
from functools import cache

import casadi as ca

from rehab_opt.optim.certificate import all_true
from rehab_opt.optim.qp import Statement
from rehab_opt.optim.rows import parameter, variable, within

__all__ = ["EXACT", "TINY", "assistance_statement"]

EXACT = 1 - 1e-12
"""Shrinking aims so far below a bound that rounding stays below it, too."""
TINY = 1e-12
"""[N] A force that is none."""
ENERGY_ROUNDING = 1e-9
"""[J]"""


@cache
def assistance_statement() -> Statement:
    """Min |F - F_desired|^2  s.t.  |F| <= ceiling, |F - F_last| <= step, F.v dt <= energy left.

    Parameters are the desired force (2,), velocity (2,), ceiling, energy left, force limit, step and dt; the memory is
    the last force; the report says whether every bound holds for the force that is remembered, which is the one to
    send.

    The desired force comes no larger than the ceiling, the smaller of `force_limit` and what the tank affords: the
    nearest point of a disc is known. The disc of the slew bound is replaced by the square inside it that has a corner
    on the way to the desired force, which therefore is approached at full rate; on the way to none, where only that is
    fast enough for a ceiling that fell. What the ceiling's tangent leaves outside the disc, and solvers outside the
    square, is shrunk after the solve, and judged again.
    """
    desired, velocity = parameter("desired", 2), parameter("velocity", 2)
    ceiling, left, last = parameter("ceiling", 1), parameter("left", 1), parameter("last", 2)
    force_limit, step, dt = (parameter(name, 1) for name in ("force_limit", "step", "dt"))
    force = variable("force", 2)
    F = force.symbol
    falls = ca.norm_2(last) - ceiling > math.sqrt(0.5) * step
    along = _direction(ca.if_else(falls, -last, desired - last))
    diagonals = ca.vertcat(ca.horzcat(along[0] - along[1], along[1] + along[0]),
                           ca.horzcat(along[0] + along[1], along[1] - along[0]))  # fmt: skip
    # Both shrinkings keep what the other bounds say: F_last is in the disc, and so is what lies between.
    moved = F - last
    near = last + moved * ca.fmin(1, EXACT * step / ca.fmax(ca.norm_2(moved), TINY))
    bounded = near * ca.fmin(1, EXACT * force_limit / ca.fmax(ca.norm_2(near), TINY))
    holds = all_true(
        ca.norm_2(bounded) <= force_limit,
        ca.norm_2(bounded - last) <= step + TINY,
        ca.dot(bounded, velocity) * dt <= left + ENERGY_ROUNDING,
    )
    return Statement(
        name="assistance",
        parameters=[desired, velocity, ceiling, left, force_limit, step, dt],
        variables=[force],
        minimise=ca.sumsqr(F - desired) / 2,
        subject_to=[
            within(diagonals @ (F - last), -step, step),
            within(ca.dot(_direction(last), F), -ca.inf, ceiling),
            within(ca.dot(F, velocity) * dt, -ca.inf, left),
        ],
        requires=[ceiling >= 0, left >= 0],
        analytic=desired,
        memory=last,
        remember=bounded,
        report=holds,
    )


def _direction(vector: ca.SX) -> ca.SX:
    """Unit vector, or along x where there is none."""
    size = ca.norm_2(vector)
    return ca.if_else(size > TINY, vector / ca.fmax(size, TINY), ca.SX([1, 0]))
