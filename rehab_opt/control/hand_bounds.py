"""Manipulability floor and keep-out planes of an arm, each as a `Limit`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.limit import Limit
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.kinematics.room import KeepOut

__all__ = ["GuardedPoint", "HandBounds", "KeepOut", "guarded_points"]

Array = NDArray[np.float64]

SAMPLES = 5
"""Number of random postures; balls that coincide at all these postures count as one."""
SAME = 1e-9
"""[m] Smaller differences of distances count as rounding."""


@dataclass(frozen=True, eq=False)
class HandBounds:
    """Limits of one arm: a manipulability floor (see `max_manipulability`), and planes for `guarded_points`."""

    chain: SerialChain
    floor: float
    max_manipulability: float
    planes: Sequence[KeepOut] = ()

    @property
    def limits(self) -> list[Limit]:
        """Manipulability floor, and one limit for each plane."""
        return [
            _Floor(self._above_floor, max_manipulability=self.max_manipulability),
            *(Limit(partial(self._above, plane)) for plane in self.planes),
        ]

    def _above_floor(self, chain: SerialChain, q: ca.SX) -> ca.SX:
        return chain.manipulability_expression(q) / self.max_manipulability - self.floor

    def _above(self, plane: KeepOut, chain: SerialChain, q: ca.SX) -> ca.SX:
        return ca.vertcat(*self.heights(chain.frames_expression(q), plane))

    @cached_property
    def guarded(self) -> tuple[GuardedPoint, ...]:
        """Points that stay out of the planes."""
        return guarded_points(self.chain)

    def manipulability(self, q: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Manipulability ratio w / w_max, and its gradient (n,)."""
        w, gradient = self.chain.manipulability_expression(q), self.chain.manipulability_gradient_expression(q)
        return w / self.max_manipulability, gradient / self.max_manipulability

    def min_heights(self, q: Array, plane: KeepOut) -> Array:
        """Least height [m] (M,) of the guarded points above a plane at q (M, n); negative beyond it."""
        symbol = ca.SX.sym("q", self.chain.n)
        heights = ca.vertcat(*self.heights(self.chain.frames_expression(symbol), plane))
        return np.array(ca.Function("height", [symbol], [ca.mmin(heights)])(q.T)).ravel()

    def heights(self, frames: list[ca.SX], plane: KeepOut) -> list[ca.SX]:
        """Height [m] of each guarded point's ball above a plane."""
        normal = ca.DM(plane.normal)
        return [
            ca.dot(normal, centre) - (plane.offset + point.radius)
            for point, centre in zip(self.guarded, self._centres(frames), strict=True)
        ]

    def _centres(self, frames: list[ca.SX]) -> list[ca.SX]:
        return [frames[i][:3, :3] @ ca.sparsify(ca.DM(offset)) + frames[i][:3, 3] for i, offset, _ in self.guarded]


@dataclass(frozen=True, eq=False)
class _Floor(Limit):
    """w(q) / w_max - floor >= 0 with the manipulability w; the slope is zero at w = 0."""

    max_manipulability: float = 1.0

    def slopes(self, chain: SerialChain, q: ca.SX) -> ca.SX:
        return chain.manipulability_gradient_expression(q).T / self.max_manipulability


# ------------------------------------------- balls that stand for an arm before a plane: capsules, frames and the tool
class GuardedPoint(NamedTuple):
    """A ball that moves with a frame of a chain."""

    frame: int
    """Number of the frame as in `LinkCapsule`: joints 1 to `frame` move the ball."""
    offset: tuple[float, float, float]
    """(3,) [m] centre in the frame."""
    radius: float


def guarded_points(chain: SerialChain) -> tuple[GuardedPoint, ...]:
    """Balls that stand for the whole arm: if they are all clear of a plane, so is the arm.

    The balls are the ends of the capsules, and the origins of all frames; those of the tool come first. A ball that
    lies inside another one is left out.
    """
    origin = (0.0, 0.0, 0.0)
    balls = [GuardedPoint(frame, origin, 0.0) for frame in range(chain.n + 2)]
    balls += [GuardedPoint(each.frame, end, each.radius) for each in chain.capsules for end in (each.start, each.end)]
    balls.sort(key=lambda ball: (-ball.radius, ball.frame))  # of two coincident balls, fewer joints move the first
    q = ca.SX.sym("q", chain.n)
    frames = chain.frames_expression(q)
    centres = ca.horzcat(*(frames[i][:3, :3] @ ca.DM(offset) + frames[i][:3, 3] for i, offset, _ in balls))
    drawn = np.random.default_rng(0).uniform(-1.0, 1.0, (SAMPLES, chain.n))
    places = np.array([ca.Function("centres", [q], [centres])(each) for each in drawn]).transpose(2, 0, 1)
    kept: list[int] = []
    for i, ball in enumerate(balls):
        moves = np.ptp(places[i], axis=0).max() > SAME
        apart = np.linalg.norm(places[kept] - places[i], axis=2)  # (kept, samples)
        rides = np.ptp(apart, axis=1) <= SAME
        within = apart.max(axis=1) <= [balls[k].radius - ball.radius + SAME for k in kept]
        if moves and not np.any(rides & within):
            kept.append(i)
    return tuple(sorted((balls[i] for i in kept), key=lambda ball: -ball.frame))
