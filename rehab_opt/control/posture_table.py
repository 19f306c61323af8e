"""Postures spread over an arm's range of motion with the handle upright: where a search for a target may start."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.ik_statements import IKStatements
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.workspace.plane_statement import spread_postures

__all__ = ["PostureTable"]

Array = NDArray[np.float64]

ALIGNMENT_STEPS = 10
MAX_STEP = 0.5
"""[rad] of a joint in one alignment step."""
SLACK = math.radians(3.0)
"""A start this much outside the handle's cone is still a good one."""


class PostureTable:
    """Deterministic: the same arm gives the same table.

    Parameters
    ----------
    arm : the chain.
    statements : its statements; `measure` is evaluated.
    handle_tilt : [rad] or None.
    size : samples; a power of two keeps the Sobol sequence balanced.

    Attributes
    ----------
    postures : (N, k) [rad] free joints, inside their limits.
    tilts : (N,) [rad] of the handle; most upright first among those that missed the cone.
    hands : (N, 3) [m].
    """

    def __init__(self, arm: SerialChain, statements: IKStatements, *, handle_tilt: float | None, size: int) -> None:
        free = statements.free
        lower, upper = arm.lower[free], arm.upper[free]
        postures = spread_postures(arm, free, size)
        still = np.where(arm.locked, arm.lower, 0.0)
        limit = math.pi if handle_tilt is None else handle_tilt
        for _ in range(ALIGNMENT_STEPS):
            hands, axes, slopes = _measured(statements, postures, still)
            tilts = np.arctan2(np.hypot(axes[:, 0], axes[:, 1]), axes[:, 2])
            outside = tilts > limit
            if not outside.any():
                break
            step = _alignment(axes, slopes, limit)
            postures = np.where(outside[:, None], np.clip(postures + step, lower, upper), postures)
        hands, axes, _ = _measured(statements, postures, still)
        tilts = np.arctan2(np.hypot(axes[:, 0], axes[:, 1]), axes[:, 2])
        self.most_upright = postures[np.argsort(tilts)[:32]]
        self.within = bool(np.any(tilts <= limit))
        self._keep(tilts <= limit + SLACK, postures, hands)

    def _keep(self, chosen: NDArray[np.bool_], postures: Array, hands: Array) -> None:
        from scipy.spatial import cKDTree  # noqa: PLC0415

        self.postures, self.hands = postures[chosen], hands[chosen]
        self._tree = cKDTree(self.hands)

    def extend(self, postures: Array, hands: Array) -> None:
        """Add postures (m, k) with their hand positions (m, 3)."""
        postures = np.concatenate([self.postures, postures])
        self._keep(np.ones(len(postures), dtype=bool), postures, np.concatenate([self.hands, hands]))

    def near(self, target: Array, count: int) -> tuple[Array, Array]:
        """Postures (<= count, k) whose hand is nearest to `target` (3,), and their distances [m], nearest first."""
        count = min(count, len(self.postures))
        if count == 0:
            return self.postures, np.zeros(0)
        distances, indices = self._tree.query(target, count)
        return self.postures[np.atleast_1d(indices)], np.atleast_1d(distances)


def _measured(statements: IKStatements, postures: Array, still: Array) -> tuple[Array, Array, Array]:
    """Hands (N, 3), handle axes (N, 3) and d(axis_x, axis_y)/dx (N, 2, k)."""
    n, k = postures.shape
    hands, axes, slopes = (each.full() for each in statements.measure.map(n)(postures.T, np.tile(still[:, None], n)))
    return hands.T, axes.T, slopes.reshape(2, n, k).transpose(1, 0, 2)


def _alignment(axes: Array, slopes: Array, limit: float) -> Array:
    """(N, k) damped Gauss-Newton step of the axis towards the cone of half the limit."""
    horizontal = np.hypot(axes[:, 0], axes[:, 1])
    excess = axes[:, :2] * (1 - math.sin(min(limit, math.pi / 2)) * 0.7 / np.maximum(horizontal, 1e-12))[:, None]
    # Upside down: the components would shrink the wrong way round, so they are to grow instead.
    excess = np.where(axes[:, 2:] < 0, -axes[:, :2] / np.maximum(horizontal, 1e-12)[:, None] * 0.5, excess)
    gram = slopes @ slopes.transpose(0, 2, 1) + 1e-4 * np.eye(2)
    step = -np.einsum("nij,ni->nj", slopes, np.linalg.solve(gram, excess[..., None])[..., 0])
    clipped: Array = np.clip(step, -MAX_STEP, MAX_STEP)
    return clipped
