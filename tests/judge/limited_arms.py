"""Arms with limits drawn around the posture that they start in: joints', a user's own, a plane below a probe."""

from __future__ import annotations

from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rehab_opt import Interaction, KeepOut, Limit, LinkCapsule, MirrorTracker, PoseTracker, ur5
from tests.judge.references import good_posture
from tests.judge.ur5_numbers import LARGEST, LIMIT, frames, manipulability

Array = NDArray[np.float64]


class Own(NamedTuple):
    """A user's limit: planes and a ball in the space of the joints."""

    ways: Array
    """(k, 6) unit normals."""
    rooms: Array
    """(k,) [rad] at the start."""
    middle: Array
    """(6,) of the ball."""
    radius: float
    rate: float | None

    def distances(self, start: Array) -> Any:
        """As `Limit` wants it."""

        def found(_: object, q: ca.SX) -> ca.SX:
            planes = ca.DM(self.ways) @ (q - ca.DM(start)) + ca.DM(self.rooms)
            return ca.vertcat(planes, (self.radius**2 - ca.sumsqr(q - ca.DM(self.middle))) / (2 * self.radius))

        return found

    def numbers(self, q: Array, start: Array) -> Array:
        """(N, k + 1) the distances at q (N, 6)."""
        ball = (self.radius**2 - ((q - self.middle) ** 2).sum(axis=1)) / (2 * self.radius)
        return np.column_stack([(q - start) @ self.ways.T + self.rooms, ball])

    def slopes(self, q: Array) -> Array:
        """(N, k + 1, 6) of them."""
        planes = np.repeat(self.ways[None], len(q), axis=0)
        return np.concatenate([planes, -((q - self.middle) / self.radius)[:, None]], axis=1)


class Probe(NamedTuple):
    """A ball on a link, and a plane that it stays above."""

    frame: int
    place: Array
    radius: float
    normal: Array
    offset: float

    def heights(self, q: Array) -> Array:
        """(N, 6) [m] of the probe and of the origins of the five frames that joints move, at q (N, 6)."""
        poses = frames(q)
        probe = poses[:, self.frame, :3, :3] @ self.place + poses[:, self.frame, :3, 3]
        origins = poses[:, 2:, :3, 3] @ self.normal
        return np.asarray(np.column_stack([probe @ self.normal - self.radius, origins]) - self.offset)


def own(rng: np.random.Generator, start: Array) -> Own:
    """One of two to four distances, some way off."""
    ways = rng.standard_normal((int(rng.integers(1, 4)), 6))
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    radius, out = rng.uniform(0.3, 1.0), rng.standard_normal(6)
    middle = start + (radius - rng.uniform(0.02, 0.1)) * out / np.linalg.norm(out)
    rate = None if rng.random() < 0.5 else float(rng.uniform(5.0, 30.0))
    return Own(ways, rng.uniform(0.02, 0.15, len(ways)), middle, radius, rate)


def probe(rng: np.random.Generator, start: Array) -> Probe | None:
    """A probe that stands out towards some plane; None where none was found."""
    found = frames(start[None])[0]
    for _ in range(100):
        frame, place, radius = int(rng.integers(4, 7)), rng.uniform(-0.25, 0.25, 3), float(rng.uniform(0.01, 0.04))
        normal = rng.standard_normal(3)
        normal /= np.linalg.norm(normal)
        lowest = float((found[frame, :3, :3] @ place + found[frame, :3, 3]) @ normal) - radius
        if lowest < (found[1:, :3, 3] @ normal).min() - 0.1:
            return Probe(frame, place, radius, normal, lowest - float(rng.uniform(0.005, 0.03)))
    return None


class Arm(NamedTuple):
    """An arm, its limits and its tracker."""

    control: MirrorTracker | PoseTracker
    dt: float
    start: Array
    lower: Array
    upper: Array
    wishes: list[Own]
    beside: Probe | None
    floor: float
    weights: Array
    """(6,) of the hand's places and turns."""

    @property
    def mirror(self) -> bool:
        """Whether a `MirrorTracker` leads it."""
        return isinstance(self.control, MirrorTracker)


def draw(rng: np.random.Generator, *, mirror: bool) -> Arm:
    """An arm in a good posture, limits around it."""
    dt, start = float(rng.choice([0.01, 0.02])), good_posture(rng, 0.5)
    lower, upper = -LIMIT, LIMIT.copy()
    if rng.random() < 0.5:
        lower = np.maximum(lower, start - rng.uniform(0.02, 0.3, 6))
        upper = np.minimum(upper, start + rng.uniform(0.02, 0.3, 6))
    wishes = [own(rng, start) for _ in range(int(rng.integers(1, 3)))] if rng.random() < 0.7 or not mirror else []
    beside = probe(rng, start) if mirror and (rng.random() < 0.7 or not wishes) else None
    velocity, acceleration = rng.uniform(1.0, 2.5, 6), rng.uniform(5.0, 30.0, 6)
    length = float(rng.choice([0.05, 0.1, 0.3]))
    floor = float(manipulability(start[None])[0]) * float(rng.choice([0.1, 0.9, 0.98]))
    weights = np.r_[np.ones(3), np.full(3, length**2)]
    capsules = ()
    if beside is not None:
        x, y, z = beside.place.tolist()
        capsules = (LinkCapsule("probe", beside.frame, (x, y, z), (x, y, z), beside.radius),)  # type: ignore[assignment]
    arm = ur5(lower=lower, upper=upper, velocity=velocity, acceleration=acceleration, capsules=capsules)
    limits = [Limit(each.distances(start), rate=each.rate) for each in wishes]
    control: MirrorTracker | PoseTracker
    if mirror:
        control = MirrorTracker(
            arm, floor=floor, max_deviation=0.2, linear_speed=1.0, angular_speed=3.0, turn_length=length,
            max_manipulability=LARGEST, interaction=Interaction(), dt=dt, limits=limits, compile=False,
            keep_out=[] if beside is None else [KeepOut.through(beside.normal * beside.offset, beside.normal)],
        )  # fmt: skip
    else:
        control = PoseTracker(arm, task_weights=weights, dt=dt, limits=limits, compile=False)
    return Arm(control, dt, start, lower, upper, wishes, beside, floor, weights)
