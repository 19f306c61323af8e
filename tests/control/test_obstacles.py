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

from rehab_opt import RedundancyResolver, ardis
from rehab_opt.control.obstacles import NUMBERS, Disc, HalfPlane, Obstacle, approach, obstacle_numbers
from rehab_opt.kinematics.ardis import ARDIS_READY
from rehab_opt.kinematics.mobile_arm import Outline

Array = NDArray[np.float64]

INSTANTS = np.linspace(0.0, 1.0, 11)
ROUNDING = 1e-12
"""[m]"""
TURN = 2.0
"""[rad/s] Fastest turn."""


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


def clearance(outline: Outline, obstacle: Obstacle, place: Array) -> Array:
    """(...) distance between chair and obstacle, negative by how deep it is inside."""
    corners = corners_at(outline, place)
    if isinstance(obstacle, Disc):
        return distance_to_polygon(np.broadcast_to(obstacle.centre, (*place.shape[:-1], 2)), corners) - obstacle.radius
    normal = np.asarray(obstacle.normal)
    return (obstacle.offset - (corners @ normal).max(axis=-1)) / float(np.linalg.norm(normal))


def lost(outline: Outline, ticks: Ticks, dt: float) -> Array:
    """(N,) [m] by which a tick takes the chair into an obstacle that it was out of, or deeper into one it was in."""
    heading = ticks.places[:, 2]
    forward, left, turn = ticks.twists.T
    world = np.stack(
        [np.cos(heading) * forward - np.sin(heading) * left, np.sin(heading) * forward + np.cos(heading) * left, turn],
        axis=-1,
    )
    places = ticks.places[:, None, :] + dt * INSTANTS[:, None] * world[:, None, :]
    gaps = np.array(
        [clearance(outline, obstacle, place) for obstacle, place in zip(ticks.obstacles, places, strict=True)]
    )
    return np.minimum(gaps[:, 0], 0.0) - gaps.min(axis=1)


def random_outline(rng: np.random.Generator) -> Outline:
    centre, half = rng.uniform(-0.3, 0.3, 2), rng.uniform(0.05, 0.6, 2)
    return Outline(centre[0] - half[0], centre[0] + half[0], centre[1] - half[1], centre[1] + half[1])


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


def random_ticks(rng: np.random.Generator, count: int, *, dt: float, wider: bool) -> tuple[Outline, Ticks]:
    """Ticks at the rows' limits; `wider` by all that they may be."""
    outline, horizon = random_outline(rng), float(rng.choice([dt, dt + rng.uniform(0.0, 1.0)]))
    numbers, place = ca.SX.sym("numbers", NUMBERS), ca.SX.sym("place", 3)
    rows = approach(numbers, place, outline, dt=dt, horizon=horizon, turn=TURN)
    function = ca.Function("rows", [numbers, place], [rows.matrix, rows.room, rows.more, rows.inside])
    places = rng.uniform(-3, 3, (count, 3)) * [1, 1, 2]
    obstacles = [random_obstacle(rng, outline, each) for each in places]
    stated = np.stack([obstacle_numbers([each], 1) for each in obstacles])
    matrix, room, more, _ = (np.array(each) for each in function.map(count)(stated.T, places.T))
    matrix, room = matrix.reshape(2, count, 3).transpose(1, 0, 2), room.T + more.T * wider
    twists = rng.standard_normal((count, 3)) * [1.0, 1.0, 2.0] * 10 ** rng.uniform(-2, 1, (count, 1))
    twists[:, 2] = np.clip(np.where(rng.uniform(size=count) < 0.3, 10 * twists[:, 2], twists[:, 2]), -TURN, TURN)
    # Rows that the twist breaks are kept by retreating along their own normal, or by less of all of it.
    over = np.einsum("nij,nj->ni", matrix, twists) - room
    retreat = np.maximum(over.max(axis=1), 0.0)[:, None] * matrix[:, 0, :2]
    backing = rng.uniform(size=count) < 0.5
    twists[backing, :2] -= retreat[backing]
    towards = np.einsum("nij,nj->ni", matrix, twists)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(towards > room, room / towards, 1.0).min(axis=1)
    return outline, Ticks(obstacles, places, twists * share[:, None])


@pytest.mark.parametrize("dt", [1e-3, 1e-2, 5e-2])
@pytest.mark.parametrize("wider", [False, True])
def test_no_twist_that_keeps_the_rows_takes_the_chair_in_or_deeper(dt: float, wider: bool) -> None:
    rng = np.random.default_rng(13)
    stopped = 0
    for _ in range(8):
        outline, ticks = random_ticks(rng, 400, dt=dt, wider=wider)
        assert lost(outline, ticks, dt).max() <= ROUNDING
        stopped += int(np.count_nonzero(np.abs(ticks.twists).max(axis=1) < 1e-9))
    assert stopped < 8 * 400 / 2  # most of them do move


if __name__ == "__main__":  # a campaign: how many ticks, and by how much the worst is lost
    import sys, time

    t0 = time.time()
    generator, worst, n = np.random.default_rng(int(sys.argv[2])), 0.0, 0
    stopped = 0
    while n < int(sys.argv[1]):
        dt_ = float(generator.choice([1e-3, 5e-3, 1e-2, 2e-2, 5e-2]))
        o, t = random_ticks(generator, 1000, dt=dt_, wider=bool(generator.integers(2)))
        l = lost(o, t, dt_)
        n += 1000
        stopped += int(np.count_nonzero(np.abs(t.twists).max(axis=1) < 1e-9))
        i = int(l.argmax())
        if l[i] > worst:
            worst = l[i]
            print(n, worst, dt_, t.obstacles[i], o, t.places[i], t.twists[i])
    print(n, "worst", worst, "stopped", stopped, time.time()-t0)
