"""QP of one assistance tick: force nearest to the desired one, within the discs of force limit and slew limit."""

from __future__ import annotations

from functools import cache

import casadi as ca

from rehab_opt.optim.qp import Statement
from rehab_opt.optim.rows import parameter, variable, within

__all__ = ["EXACT", "TINY", "assistance_statement"]

EXACT = 1 - 1e-12
"""Fraction of a bound to which a force is shortened, so that rounding does not violate the bound."""
TINY = 1e-12
"""[N] Largest force that counts as zero."""


@cache
def assistance_statement() -> Statement:
    """Min |F - F_desired|^2  s.t.  |F| <= ceiling, |F - F_last| <= step.

    The parameters, all in N, are the desired force (2,), the ceiling, the step and the force limit. The size of the
    desired force is at most the ceiling. The memory is the last force. The rows are tangents of both discs at the
    closed-form answer, so the multipliers certify the answer for the discs.
    """
    desired, last = parameter("desired", 2), parameter("last", 2)
    ceiling, step, force_limit = (parameter(name, 1) for name in ("ceiling", "step", "force_limit"))
    force = variable("force", 2)
    F = force.symbol
    towards = last + _within(desired - last, step)
    corner = ca.norm_2(towards) > ceiling * (1 + TINY)
    inward, size = _direction(last), ca.norm_2(last)
    along = (size + (ceiling - step) * (ceiling + step) / size) / 2
    beside = ca.sqrt(ca.fmax((ceiling - along) * (ceiling + along), 0)) * ca.sign(_cross(inward, desired))
    meet = ca.vertcat(inward[0] * along - inward[1] * beside, inward[1] * along + inward[0] * beside)
    answer = ca.if_else(corner, meet, towards)
    slews, caps, lacks = _direction(answer - last), _direction(answer), desired - answer
    turn = _cross(slews, caps)
    multipliers = ca.vertcat(
        ca.if_else(corner, _cross(lacks, caps) / turn, ca.norm_2(lacks)),
        ca.if_else(corner, _cross(slews, lacks) / turn, 0),
    )
    # Shortening to the force limit satisfies the slew limit, since the last force is within the force limit.
    sent = _within(last + _within(F - last, EXACT * step), EXACT * force_limit)
    return Statement(
        name="assistance",
        parameters=[desired, ceiling, step, force_limit],
        variables=[force],
        minimise=ca.sumsqr(F - desired) / 2,
        subject_to=[
            within(ca.dot(slews, F - last), -ca.inf, step),
            within(ca.dot(caps, F), -ca.inf, ceiling),
        ],
        requires=[ceiling >= 0],
        analytic=answer,
        dual=multipliers,
        memory=last,
        remember=sent,
    )


def _within(vector: ca.SX, radius: ca.SX) -> ca.SX:
    return vector * ca.fmin(1, radius / ca.fmax(ca.norm_2(vector), TINY))


def _cross(a: ca.SX, b: ca.SX) -> ca.SX:
    return a[0] * b[1] - a[1] * b[0]


def _direction(vector: ca.SX) -> ca.SX:
    size = ca.norm_2(vector)
    return ca.if_else(size > TINY, vector / ca.fmax(size, TINY), ca.SX([1, 0]))
