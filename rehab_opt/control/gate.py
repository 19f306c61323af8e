"""Gate of the assistance force, as functions for Python and C, after Eq. 23 and section VI of Rossa et al."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Literal, get_args

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.field.energy import field_function, field_function_in_blocks
from rehab_opt.field.potential import PotentialField
from rehab_opt.optim.certificate import all_true
from rehab_opt.symbolic.record import Record, Values
from rehab_opt.workspace.edge_distance import COLUMNS, distance_function

__all__ = [
    "FIELD",
    "GATE",
    "PULL_BACK",
    "SPRING",
    "DesiredForce",
    "Mode",
    "check_mode",
    "gated_force",
    "guided_force",
    "numbers_of",
    "reflected_force",
]

Array = NDArray[np.float64]
Mode = Literal["stretch", "assist", "resist", "follow", "hold"]
DesiredForce = Callable[[float, float, float, float], tuple[float, float]]
"""Function: x, y [m] and velocity [m/s] of the hand -> desired force [N], before any bound."""

PULL_BACK = Record(stiffness=1, force=1)
"""Pull of a hand back to the nearest point of a workspace: stiffness [N/m] and largest force [N]."""
GATE = Record(acts_inside=1, pull_limit=1, onset=1, back=PULL_BACK.size)
"""Whether the field acts inside the workspace; largest pull of the field [N]; distance [m] outside the boundary over
which the field's force grows to full size; `PULL_BACK`.
"""
SPRING = Record(stiffness=1, damping=1)
"""Stiffness [N/m] and damping [N s/m]."""
FIELD = Record(sharpness=1, damping=2)
"""Parameters of a field: 1 / sigma^2 [1/m^2] and damping [N s/m]."""


def check_mode(mode: Mode, field: PotentialField) -> None:
    """Raise `ConfigurationError` for an unknown mode, or a mode that does not fit the field's drag."""
    if mode not in get_args(Mode):
        raise ConfigurationError("mode", mode, f"one of {', '.join(get_args(Mode))}")
    resists = field.drag < 0 or (field.drag > 0 and field.drag_along == "travelled")
    if mode == "resist" and not resists and field.drag == field.drag:  # NaN, unknown, for a learnt field
        raise ConfigurationError("mode", mode, "another mode, or a field with drag against the motion")
    if mode != "resist" and resists:
        raise ConfigurationError("mode", mode, "'resist' for a field that drags against the motion")


def numbers_of(field: PotentialField) -> Array:
    """Values of the record `FIELD` for a field."""
    return FIELD.numbers(sharpness=1 / field.width**2, damping=field.damping)


@cache
def gated_force(edges: int, samples: int, *, in_blocks: bool = True) -> ca.Function:
    """Function that computes the desired force: the force of a field, gated by the mode.

    The modes stretch, assist and resist apply the field outside the comfortable workspace; the force grows over the
    distance `onset`. The modes follow and hold apply the field inside; outside, a bounded force pulls the hand back. A
    NaN offset of the field gives NaN. The field's pull is limited to `pull_limit` [N] before the damping is subtracted.

    Inputs: position [m] and velocity [m/s] of the hand (4,), offset of the field (2,) [m], `GATE`, `edge_columns` of
    the workspace, `FIELD`, samples of the field. With `in_blocks`, the samples are those of `field_function_in_blocks`.
    Output: desired force (2,) [N].
    """
    pull = field_function_in_blocks(samples) if in_blocks else field_function(samples)
    inputs = [ca.MX.sym("input", pull.sparsity_in(i)) for i in range(3)]
    field = ca.Function("field", inputs, [pull(*inputs)[1]])
    nothing = ca.Function("no_field", inputs, [ca.MX(ca.DM.nan(2))])
    hand, offset, numbers, table, of_field = (
        ca.MX.sym("input", n, m) for n, m in ((4, 1), (2, 1), (GATE.size, 1), (edges, COLUMNS), (FIELD.size, 1))
    )
    held = inputs[1]
    signed, closest = distance_function(edges)(hand[:2], table)
    where = ca.vertcat(signed, closest)
    acts = (where[0] <= 0) == numbers[GATE["acts_inside"]]
    elastic = ca.Function.if_else("field_where_it_acts", field, nothing)(
        acts, hand[:2] - offset, held, of_field[FIELD["sharpness"]]
    )
    force = _gated()(hand, offset, numbers, of_field, where, acts, elastic)
    return ca.Function(f"gated_force_{edges}_{samples}", [hand, offset, numbers, table, of_field, held], [force])


@cache
def _gated() -> ca.Function:
    hand, offset, where, elastic = (ca.SX.sym("input", n) for n in (4, 2, 3, 2))
    acts, gate, field = ca.SX.sym("acts"), GATE.symbols("gate"), FIELD.symbols("field")
    size = ca.hypot(elastic[0], elastic[1])
    damped = ca.if_else(size > gate.pull_limit, elastic * (gate.pull_limit / size), elastic) - field.damping * hand[2:]
    fraction = ca.if_else(ca.logic_or(gate.acts_inside, where[0] >= gate.onset), 1, where[0] / gate.onset)
    back = ca.if_else(
        all_true(ca.fabs(offset) < ca.inf), _pulled_back(PULL_BACK.parts(gate.back), hand, where), math.nan
    )
    force = ca.if_else(acts, fraction * damped, ca.if_else(gate.acts_inside, back, ca.SX.zeros(2)))
    inputs = [hand, offset, gate.column, field.column, where, acts, elastic]
    return ca.Function("gated", inputs, [force], {"cse": True})


@cache
def guided_force(edges: int) -> ca.Function:
    """Function that computes the desired force of a spring to a path point, damped only across the path.

    The force is gated as in `gated_force`.

    Inputs: position [m] and velocity [m/s] of the hand (4,), path point (2,) [m], direction of the path there (2,),
    fraction of the force, `SPRING`, `GATE`, `edge_columns` of the workspace. Output: desired force (2,) [N].
    """
    hand, place, along, fraction = (ca.SX.sym("input", n) for n in (4, 2, 2, 1))
    spring, gate, where = SPRING.symbols("spring"), GATE.symbols("gate"), ca.SX.sym("where", 3)
    across = hand[2:] - along * ca.dot(along, hand[2:])
    acts = (where[0] <= 0) == gate.acts_inside
    damping = FIELD.of(sharpness=ca.SX(0), damping=ca.vertcat(spring.damping, spring.damping))
    pull = spring.stiffness * (place - hand[:2])
    moving = ca.vertcat(hand[:2], across)
    force = fraction * _gated()(moving, ca.SX.zeros(2), gate.column, damping, where, acts, pull)
    inputs = [hand, place, along, fraction, spring.column, gate.column]
    inner = ca.Function("guided", [*inputs, where], [force], {"cse": True})
    told = [ca.MX.sym("input", each.numel()) for each in inputs]
    table = ca.MX.sym("edges", edges, COLUMNS)
    found = ca.vertcat(*distance_function(edges)(told[0][:2], table))
    return ca.Function(f"guided_force_{edges}", [*told, table], [inner(*told, found)])


@cache
def reflected_force(edges: int) -> ca.Function:
    """Function that maps a force at the hand's image back to the hand, by the map's transposed Jacobian, with damping.

    Inputs: position [m] and velocity [m/s] of the hand (4,), Jacobian there (2, 2), force at the image (2,) [N],
    damping [N s/m], `PULL_BACK`, `edge_columns` of the workspace. Output: desired force (2,) [N]; outside the workspace
    it pulls the hand back.
    """
    hand, jacobian, felt, damping = (ca.SX.sym("input", *size) for size in ((4, 1), (2, 2), (2, 1), (1, 1)))
    back, where = PULL_BACK.symbols("back"), ca.SX.sym("where", 3)
    reflected = -(jacobian.T @ felt) - damping * hand[2:]
    known = all_true(ca.fabs(felt) < ca.inf)
    force = ca.if_else(where[0] <= 0, reflected, ca.if_else(known, _pulled_back(back, hand, where), math.nan))
    inner = ca.Function("reflected", [hand, jacobian, felt, damping, back.column, where], [force], {"cse": True})
    inputs = [ca.MX.sym("input", inner.sparsity_in(i)) for i in range(5)]
    table = ca.MX.sym("edges", edges, COLUMNS)
    found = ca.vertcat(*distance_function(edges)(inputs[0][:2], table))
    return ca.Function(f"reflected_force_{edges}", [*inputs, table], [inner(*inputs, found)])


def _pulled_back(back: Values, hand: ca.SX, where: ca.SX) -> ca.SX:
    return ca.fmin(back.stiffness, back.force / where[0]) * (where[1:] - hand[:2])
