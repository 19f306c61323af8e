"""Obstacles on the floor as rows on the chair's velocity: a stopping barrier that holds at any tick length."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.stopping import OUTSIDE
from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.mobile_arm import Outline
from rehab_opt.kinematics.real_array import is_real
from rehab_opt.optim.certificate import all_true
from rehab_opt.optim.rows import MAX_MAGNITUDE

__all__ = [
    "DISC", "HALF_PLANE", "NUMBERS", "Disc", "HalfPlane", "Obstacle", "ObstacleRows", "approach", "obstacle_function",
    "obstacle_numbers", "outward_normal",
]  # fmt: skip

Array = NDArray[np.float64]

NUMBERS = 4
"""How many numbers one obstacle is."""
TINY = 1e-100
"""[m] A distance whose square is no number above zero."""
_NONE, HALF_PLANE, DISC = 0.0, 1.0, 2.0


class HalfPlane(NamedTuple):
    """A wall in the world frame: points p with normal . p > offset are not free."""

    normal: tuple[float, float]
    """Into the wall; of any length above zero."""
    offset: float
    """[m] times the normal's length."""


class Disc(NamedTuple):
    """A post in the world frame."""

    centre: tuple[float, float]
    """[m]"""
    radius: float
    """[m]"""


Obstacle = HalfPlane | Disc


class ObstacleRows(NamedTuple):
    """Rows matrix @ (forward, left, turn) <= room of one obstacle; at rest they always hold."""

    matrix: ca.SX
    """(2, 3)"""
    room: ca.SX
    """(2,) [m/s]"""
    inside: ca.SX
    """1 where the chair is within the obstacle."""
    wall: ca.SX
    """(3,) normal n and offset [m] of the wall that stands for it, in the chassis frame: free is n . p < offset."""
    post: ca.SX
    """(3,) centre in the chassis frame and radius [m] of a disc."""
    is_post: ca.SX
    """1 where it is a disc."""


def obstacle_numbers(obstacles: Sequence[Obstacle], max_obstacles: int) -> Array:
    """(4 max_obstacles,) obstacles as a parameter: kind in the last place, what is free says that there is nothing.

    Raises
    ------
    ConfigurationError : no list or tuple, more obstacles than that, neither half-plane nor disc, a normal of length
        zero, a number that is none or no place in metres.
    """
    if not isinstance(obstacles, (list, tuple)) or isinstance(obstacles, Obstacle):
        raise ConfigurationError("obstacles", obstacles, "a list or tuple of HalfPlane and Disc")
    if len(obstacles) > max_obstacles:
        raise ConfigurationError("obstacles", len(obstacles), f"at most {max_obstacles}, as given at construction")
    numbers = np.zeros((max_obstacles, NUMBERS))
    for i, obstacle in enumerate(obstacles):
        row = _row(obstacle)
        if row is None:
            expected = (
                f"a HalfPlane of two numbers, not both zero, and one, or a Disc of two and one, up to {MAX_MAGNITUDE:g}"
            )
            raise ConfigurationError(f"obstacles[{i}]", obstacle, expected)
        numbers[i] = row
    return numbers.reshape(-1)


@cache
def obstacle_function() -> ca.Function:
    """Kind, x, y and size of an obstacle (4,) -> its numbers (4,), and whether it is refused.

    Those of a half-plane are divided by the length of its normal; a kind of zero says that there is nothing.
    """
    told = ca.SX.sym("told", 4)
    kind, x, y, size = ca.vertsplit(told)
    largest = ca.fmax(ca.fabs(x), ca.fabs(y))  # so that no square is too large or too small
    length = ca.if_else(kind == HALF_PLANE, largest * ca.sqrt((x / largest) ** 2 + (y / largest) ** 2), 1)
    row = told[1:] / length
    valid = all_true(length < ca.inf, *(ca.fabs(each) <= MAX_MAGNITUDE for each in ca.vertsplit(row)))  # NaN fails
    valid = ca.logic_and(valid, ca.logic_or(kind != DISC, size >= 0))
    return ca.Function("obstacle", [told], [ca.vertcat(row, kind), ca.logic_not(valid)])


def _row(obstacle: object) -> Array | None:
    """(4,) the numbers of one obstacle, None where it is none."""
    if not isinstance(obstacle, Obstacle):
        return None
    try:
        (x, y), size = (_number(each) for each in obstacle[0]), _number(obstacle[1])
    except (TypeError, ValueError, OverflowError):
        return None
    row, refused = obstacle_function()([HALF_PLANE if isinstance(obstacle, HalfPlane) else DISC, x, y, size])
    return None if refused else np.asarray(row).reshape(-1)


def _number(value: object) -> float:
    if not is_real(value):
        raise TypeError
    return float(value)


def approach(
    numbers: ca.SX, place: ca.SX, outline: Outline, *, dt: float, horizon: float, turn: ca.SX | float,
    drive: ca.SX | float,
) -> ObstacleRows:  # fmt: skip
    """Rows that keep the chair's outline out of one obstacle, wherever its corners turn to within the tick.

    Parameters
    ----------
    numbers : (4,) of `obstacle_numbers`. place : (3,) q1, q2, q3 of the chair.
    dt : tick [s]. turn : [rad/s] fastest turn in this tick. drive : [m/s] its fastest speed.
    horizon : [s] no corner comes nearer than its gap divided by this, per second. At least dt; and no less than the
        chair needs to stop from any speed when all its components slow down together: then a chair that kept these
        rows in the last tick can keep them in this one within its accelerations.

    Guaranteed at every instant of the tick, at any dt, for any twist within the rows that turns no faster than `turn`:
    an outline that is outside stays outside; one that is inside gets no deeper. Depth is the shortest way out of the
    obstacle by translation. The chair may move straight in the world while it turns, q + t value, or along the arc of
    wheels that hold their speeds.

    A disc is replaced by the wall, fixed in the chassis, that touches it and has the outline's outward normal n at the
    point nearest to the disc's centre c; the nearest edge's where c is on or under the outline. The distance of c from
    a rectangle of corners p, negative inside, is the largest n . c - max(n . p) of all unit vectors n, so it falls by
    no more than n . c does: where another edge becomes the nearest, what is allowed does not jump.

    A corner p turns by w dt within the tick and is then off its straight way by at most |p| (w dt)^2/2, and wheels by
    drive |w| dt^2/2; c, seen from the chassis, by twice that of wheels. With both, and over all corners, the largest
    speed towards the wall is a concave function of w, zero or more at w = 0. The rows are its two chords from there to
    the fastest turns.
    """
    cos, sin = ca.cos(place[2]), ca.sin(place[2])
    disc = numbers[3] == DISC

    def to_chassis(x: ca.SX, y: ca.SX) -> tuple[ca.SX, ca.SX]:
        return cos * x + sin * y, cos * y - sin * x

    centre = to_chassis(numbers[0] - place[0], numbers[1] - place[1])
    to_disc = outward_normal(outline, *centre)
    to_wall = to_chassis(numbers[0], numbers[1])
    there = numbers[3] != _NONE
    normal = [ca.if_else(disc, d, ca.if_else(there, w, 0)) for d, w in zip(to_disc, to_wall, strict=True)]
    offset = ca.if_else(
        disc,
        normal[0] * centre[0] + normal[1] * centre[1] - numbers[2],
        ca.if_else(there, numbers[2] - numbers[0] * place[0] - numbers[1] * place[1], horizon),
    )

    def turning(gap: ca.SX, x: float | ca.SX, y: float | ca.SX, bent: float | ca.SX) -> ca.SX:
        """(3,) how fast the gap of a place may close without a turn and at the fastest to either side."""
        lever, sweep = turn * (normal[1] * x - normal[0] * y), bent * turn * (dt / 2) * there
        return ca.fmax(gap, 0) / horizon + ca.vertcat(0, -lever - sweep, lever - sweep)

    corners = outline.corners.tolist()
    gaps = ca.vertcat(*(offset - normal[0] * x - normal[1] * y for x, y in corners))
    least = ca.mmin(gaps)
    walls = [turning(gaps[i], x, y, float(np.hypot(x, y)) * turn + drive) for i, (x, y) in enumerate(corners)]
    bent = (ca.norm_2(ca.vertcat(*centre)) + drive * dt) * turn + 2 * drive
    still, left, right = (
        ca.if_else(disc, post, ca.mmin(ca.vertcat(*wall)))
        for post, *wall in zip(*(ca.vertsplit(each) for each in (turning(least, *centre, bent), *walls)), strict=True)
    )
    matrix = ca.vertcat(
        ca.horzcat(normal[0], normal[1], (still - left) * (1 / turn)),
        ca.horzcat(normal[0], normal[1], (right - still) * (1 / turn)),
    )
    inside = ca.logic_and(there, least < -OUTSIDE)
    wall, post = ca.vertcat(*normal, offset), ca.vertcat(*centre, numbers[2])
    return ObstacleRows(matrix, ca.vertcat(still, still), inside, wall, post, disc)


def outward_normal(outline: Outline, x: ca.SX, y: ca.SX) -> list[ca.SX]:
    """(2,) unit normal of the outline at its point nearest to (x, y), both in the chassis frame."""
    beyond = [ca.fmax(outline.rear - x, x - outline.front), ca.fmax(outline.right - y, y - outline.left)]
    side = [
        ca.if_else(x - outline.front >= outline.rear - x, 1, -1),
        ca.if_else(y - outline.left >= outline.right - y, 1, -1),
    ]
    at_corner = ca.fmin(*beyond) > TINY
    # Not hypot, a call into a library: numbers far too large for a square never come here.
    distance = ca.fmax(ca.sqrt(beyond[0] * beyond[0] + beyond[1] * beyond[1]), TINY)
    at_end = beyond[0] >= beyond[1]
    edge = [at_end, ca.logic_not(at_end)]
    return [s * ca.if_else(at_corner, b / distance, e) for s, b, e in zip(side, beyond, edge, strict=True)]
