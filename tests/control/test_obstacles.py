"""The rows of an obstacle alone, without a controller: whatever twist keeps them, the chair's outline stays out.

The judge is plain numpy in the world frame: four corners of the chair at 11 instants of the tick, and the distance of
the disc's centre from the polygon between them. It shares no formula with `approach`.
"""

import math
from typing import NamedTuple

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray

from rehab_opt import ardis
from rehab_opt.control.chair_obstacles import ChairObstacles
from rehab_opt.control.obstacles import NUMBERS, Disc, HalfPlane, Obstacle, approach, obstacle_numbers
from rehab_opt.control.stopping import BrakingTogether
from rehab_opt.kinematics.ardis import ARDIS_READY
from rehab_opt.kinematics.mobile_arm import Outline

Array = NDArray[np.float64]

INSTANTS = np.linspace(0.0, 1.0, 11)
ROUNDING = 1e-12
"""[m]"""
TURN = 2.0
"""[rad/s] Fastest turn."""
DRIVE = 2.0
"""[m/s] Fastest speed."""


class Ticks(NamedTuple):
    """N ticks, each from one place of the chair beside one obstacle."""

    obstacles: list[Obstacle]
    places: Array
    """(N, 3) x, y, heading of the chair in the world."""
    twists: Array
    """(N, 3) forward, left, turn; they keep the rows."""


def corners_at(outline: Outline, place: Array) -> Array:
    """(..., 4, 2) corners in the world, counter-clockwise, of chairs at (..., 3) places."""
    rear, front, right, left = outline
    own = np.array([[rear, right], [front, right], [front, left], [rear, left]])
    cos, sin = np.cos(place[..., 2]), np.sin(place[..., 2])
    turned = np.stack([np.stack([cos, -sin], axis=-1), np.stack([sin, cos], axis=-1)], axis=-2)
    return np.einsum("...ij,kj->...ki", turned, own) + place[..., None, :2]


def distance_to_polygon(point: Array, corners: Array) -> Array:
    """(...) distance of points (..., 2) from convex polygons (..., 4, 2), negative inside."""
    edge = np.roll(corners, -1, axis=-2) - corners
    to_point = point[..., None, :] - corners
    length = np.linalg.norm(edge, axis=-1)
    outward = (edge[..., 1] * to_point[..., 0] - edge[..., 0] * to_point[..., 1]) / length
    along = np.clip((edge * to_point).sum(axis=-1) / length**2, 0.0, 1.0)
    from_edges = np.linalg.norm(to_point - along[..., None] * edge, axis=-1).min(axis=-1)
    return np.where(np.all(outward <= 0, axis=-1), outward.max(axis=-1), from_edges)


def clearances(outline: Outline, obstacles: list[Obstacle], places: Array) -> Array:
    """(N, T) distance of N obstacles from the chair at (N, T, 3) places, negative by how deep it is inside."""
    corners = corners_at(outline, places)
    discs = np.array([isinstance(each, Disc) for each in obstacles])
    vectors, sizes = np.array([each[0] for each in obstacles]), np.array([each[1] for each in obstacles])[:, None]
    posts = distance_to_polygon(np.broadcast_to(vectors[:, None], (*places.shape[:2], 2)), corners) - sizes
    with np.errstate(divide="ignore", invalid="ignore"):  # a post's centre is no normal
        walls = (sizes - np.einsum("ntki,ni->ntk", corners, vectors).max(axis=-1)) / np.linalg.norm(vectors, axis=1)[
            :, None
        ]
    return np.where(discs[:, None], posts, walls)


def driven(ticks: Ticks, dt: float, *, arcs: bool) -> Array:
    """(N, 11, 3) places of the chair within the ticks: straight in the world, or as wheels roll."""
    forward, left, turn = (each[:, None] for each in ticks.twists.T)
    angle = dt * INSTANTS * turn
    heading = ticks.places[:, 2, None] + (angle / 2 if arcs else 0 * angle)
    chord = dt * INSTANTS * (np.sinc(angle / 2 / np.pi) if arcs else 1.0)
    east = chord * (np.cos(heading) * forward - np.sin(heading) * left)
    north = chord * (np.sin(heading) * forward + np.cos(heading) * left)
    return ticks.places[:, None, :] + np.stack([east, north, angle], axis=-1)


def random_outline(rng: np.random.Generator) -> Outline:
    """Around the chair's origin or beside it, where turning alone brings the near side nearer."""
    centre, half = rng.uniform(-0.8, 0.8, 2), 10 ** rng.uniform(-2, 0, 2)
    (rear, right), (front, left) = (centre - half).tolist(), (centre + half).tolist()
    return Outline(rear, front, right, left)


def random_obstacle(rng: np.random.Generator, outline: Outline, place: Array) -> Obstacle:
    """A wall or a post that is free of the chair at `place`, touches it, or is more or less inside it."""
    corners = corners_at(outline, place)
    kind, gap = rng.integers(5), float(rng.choice([0.0, 1e-12, 1e-9, rng.uniform(0, 0.02), rng.uniform(-0.3, 0.3)]))
    if kind == 0:
        normal = rng.standard_normal(2)
        size = float(np.linalg.norm(normal))
        return HalfPlane((float(normal[0]), float(normal[1])), float((corners @ normal).max()) + gap * size)
    radius = float(rng.choice([0.0, 1e-9, rng.uniform(0, 0.1), rng.uniform(0, 1)]))
    i = rng.integers(4)
    if kind == 1:  # anywhere under the chair
        weights = rng.dirichlet(np.ones(4))
        point = weights @ corners
    elif kind == 2:  # off a corner
        point = corners[i] + (gap + radius) * np.array([math.cos(at := rng.uniform(-math.pi, math.pi)), math.sin(at)])
    else:  # off an edge
        edge = corners[(i + 1) % 4] - corners[i]
        outward = np.array([edge[1], -edge[0]]) / np.linalg.norm(edge)
        point = corners[i] + rng.uniform() * edge + (gap + radius) * outward
    return Disc((float(point[0]), float(point[1])), radius)


def random_ticks(rng: np.random.Generator, count: int, *, dt: float, at_once: bool) -> tuple[Outline, Ticks]:
    """Ticks at the rows' limits, which let a gap be used up in a second or less; `at_once` in this tick."""
    outline, horizon = random_outline(rng), dt + (0.0 if at_once else rng.uniform(0.0, 1.0))
    numbers, place = ca.SX.sym("numbers", NUMBERS), ca.SX.sym("place", 3)
    rows = approach(numbers, place, outline, dt=dt, horizon=horizon, turn=TURN, drive=DRIVE)
    function = ca.Function("rows", [numbers, place], [rows.matrix, rows.room, rows.inside])
    places = rng.uniform(-3, 3, (count, 3)) * [1, 1, 2]
    obstacles = [random_obstacle(rng, outline, each) for each in places]
    stated = np.stack([obstacle_numbers([each], 1) for each in obstacles])
    matrix, room, _ = (np.array(each) for each in function.map(count)(stated.T, places.T))
    matrix, room = matrix.reshape(2, count, 3).transpose(1, 0, 2), room.T
    twists = rng.standard_normal((count, 3)) * [1.0, 1.0, 2.0] * 10 ** rng.uniform(-2, 1, (count, 1))
    twists[:, 2] = np.clip(np.where(rng.uniform(size=count) < 0.3, 10 * twists[:, 2], twists[:, 2]), -TURN, TURN)
    # Rows that the twist breaks are kept by retreating along their own normal, or by less of all of it.
    over = np.einsum("nij,nj->ni", matrix, twists) - room
    retreat = np.maximum(over.max(axis=1), 0.0)[:, None] * matrix[:, 0, :2]
    backing = rng.uniform(size=count) < 0.5
    twists[backing, :2] -= retreat[backing]
    towards = np.einsum("nij,nj->ni", matrix, twists)
    with np.errstate(divide="ignore", invalid="ignore"):
        fraction = np.where(towards > room, room / towards, 1.0).min(axis=1)
    twists *= fraction[:, None]
    return outline, Ticks(obstacles, places, twists / np.maximum(np.hypot(*twists[:, :2].T) / DRIVE, 1)[:, None])


def test_no_twist_within_the_rows_takes_the_chair_in_or_deeper() -> None:
    """Ticks of 1 to 50 ms, half of them with rows as wide as may be."""
    rng, batch, lost, counts = np.random.default_rng(13), 500, [], np.zeros(4)
    for _ in range(8):
        dt = float(rng.choice([1e-3, 5e-3, 1e-2, 2e-2, 5e-2]))
        outline, ticks = random_ticks(rng, batch, dt=dt, at_once=bool(rng.integers(2)))
        gaps = clearances(outline, ticks.obstacles, driven(ticks, dt, arcs=bool(rng.integers(2))))
        gap, size = gaps[:, 0], np.abs(ticks.twists)
        lost.append((np.minimum(gap, 0.0) - gaps.min(axis=1)).max())
        met = (size.max(axis=1) < 1e-9, gap < -1e-6, np.abs(gap) <= 1e-6, size[:, 2] > 0.9 * TURN)
        counts += [each.mean() / 8 for each in met]
    assert max(lost) <= ROUNDING
    still, inside, touching, turning = counts
    assert still < 0.4
    assert min(inside, touching, turning) > 0.1


@pytest.mark.parametrize("dt", [0.02])
def test_a_twist_that_leads_no_deeper_does_so_at_no_instant_of_the_tick(dt: float) -> None:
    """Asked at half the tick and at its end only, 210 of 42 494 went up to 4.7 mm deeper before them."""
    robot, rng, count = ardis(), np.random.default_rng(13), 4_000
    chair = ChairObstacles(robot, BrakingTogether(robot.chain, dt, moving=range(7)), dt)
    places = np.tile(ARDIS_READY[:3], (count, 1))
    near = [random_obstacle(rng, robot.outline, each) for each in places]
    ticks = Ticks(near, places, rng.uniform(-1, 1, (count, 3)) * robot.chain.velocity[:3])
    stated = np.stack([obstacle_numbers([each], 1) for each in near])
    says = np.array(chair.no_deeper.map(count)(stated.T, places.T, ticks.twists.T)).ravel() > 0
    gaps = np.stack([clearances(robot.outline, near, driven(ticks, dt, arcs=arcs)) for arcs in (False, True)])
    deeper = (np.minimum(gaps[..., :1], 0.0) - gaps).max(axis=(0, 2))
    assert deeper[says].max() <= ROUNDING
    assert says.mean() > 0.3
    assert (says | (deeper > 0)).mean() > 0.98  # nor is it refused for nothing
