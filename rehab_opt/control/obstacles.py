"""Obstacles on the floor as linear bounds (rows) on the chair's velocity, valid for any tick length."""

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
"""Number of values that describe an obstacle."""
TINY = 1e-100
"""[m] A distance whose square underflows."""
_NONE, HALF_PLANE, DISC = 0.0, 1.0, 2.0


class HalfPlane(NamedTuple):
    """Wall in the world frame, at points p with normal . p > offset."""

    normal: tuple[float, float]
    """Normal into the wall, of any positive length."""
    offset: float
    """[m] for a unit normal; for any other, multiplied by the normal's length."""


class Disc(NamedTuple):
    """Post in the world frame."""

    centre: tuple[float, float]
    """[m]"""
    radius: float
    """[m]"""


Obstacle = HalfPlane | Disc


class ObstacleRows(NamedTuple):
    """Rows matrix @ (forward, left, turn) <= room that one obstacle imposes; a chair at rest always satisfies them."""

    matrix: ca.SX
    """(2, 3)"""
    room: ca.SX
    """(2,) [m/s]"""
    inside: ca.SX
    """1 if the chair is inside the obstacle."""
    wall: ca.SX
    """(3,) normal n and offset [m] of the obstacle's wall in the chassis frame; points p with n . p < offset are free.
    """
    post: ca.SX
    """(3,) centre in the chassis frame and radius [m] of a disc."""
    is_post: ca.SX
    """1 for a disc."""


def obstacle_numbers(obstacles: Sequence[Obstacle], max_obstacles: int) -> Array:
    """Obstacles as a parameter (4 max_obstacles,): four values each, the kind last; kind 0 marks an unused entry.

    Raises `ConfigurationError` for too many obstacles, another type, or an invalid number.
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
    """Function: kind (0 for none), x, y and size of an obstacle (4,) -> its four parameters, whether it is invalid."""
    told = ca.SX.sym("told", 4)
    kind, x, y, size = ca.vertsplit(told)
    largest = ca.fmax(ca.fabs(x), ca.fabs(y))  # so that no square is too large or too small
    length = ca.if_else(kind == HALF_PLANE, largest * ca.sqrt((x / largest) ** 2 + (y / largest) ** 2), 1)
    row = told[1:] / length
    valid = all_true(length < ca.inf, *(ca.fabs(each) <= MAX_MAGNITUDE for each in ca.vertsplit(row)))  # NaN fails
    valid = ca.logic_and(valid, ca.logic_or(kind != DISC, size >= 0))
    return ca.Function("obstacle", [told], [ca.vertcat(row, kind), ca.logic_not(valid)])


def _row(obstacle: object) -> Array | None:
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
    """Rows that keep the chair's outline out of one obstacle for any turn within the tick.

    If the velocity satisfies the rows and turns no faster than `turn`, an outline outside the obstacle stays outside at
    every instant. An outline inside gets no deeper. Depth is the shortest translation out of the obstacle.

    A disc is replaced by a wall, fixed in the chassis, that touches it. The wall's normal n is the outline's outward
    normal at the point nearest to the disc's centre c. The bound does not jump when another edge becomes the nearest.

    A turn at the rate w moves a corner p off its straight path by at most |p| (w dt)^2/2. An arc adds
    drive |w| dt^2/2, or twice that for the centre c in the chassis frame. With both deviations, the largest allowed
    speed towards the wall is a concave function of w, not negative at w = 0. The rows are two chords of this function,
    from w = 0 to the largest turn rate on either side.

    Parameters
    ----------
    numbers : (4,) of `obstacle_numbers`. place : (3,) q1, q2, q3 of the chair.
    dt : tick [s]. turn : [rad/s] largest turn rate in this tick. drive : [m/s] largest speed.
    horizon : [s] a corner's closing speed is at most its gap divided by `horizon`; at least dt and the time to stop.
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
        """Largest closing speeds (3,) of a point: without a turn, and at the largest turn rate to either side."""
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
    """Unit normal (2,) of the outline at its point nearest to (x, y), both in the chassis frame."""
    beyond = [ca.fmax(outline.rear - x, x - outline.front), ca.fmax(outline.right - y, y - outline.left)]
    side = [
        ca.if_else(x - outline.front >= outline.rear - x, 1, -1),
        ca.if_else(y - outline.left >= outline.right - y, 1, -1),
    ]
    at_corner = ca.fmin(*beyond) > TINY
    # Not hypot, a library call: numbers too large for a square never come here.
    distance = ca.fmax(ca.sqrt(beyond[0] * beyond[0] + beyond[1] * beyond[1]), TINY)
    at_end = beyond[0] >= beyond[1]
    edge = [at_end, ca.logic_not(at_end)]
    return [s * ca.if_else(at_corner, b / distance, e) for s, b, e in zip(side, beyond, edge, strict=True)]
