"""Evaluate many seats and grips: how much of a hand's path a robot can follow above its manipulability floor."""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.mirror import MirrorTracker
from rehab_opt.control.preview import turns_between
from rehab_opt.symbolic.buffered import mapped

__all__ = ["Seats", "Walk"]

Array = NDArray[np.float64]

TURN_LENGTH = 0.1
"""[m/rad] Weight of the hand's rotation relative to its position."""
NEAR, TURNED = 1e-3, math.radians(1.0)
"""[m, rad] Tolerance of a reached pose; stricter than that of the later measurement."""
ABOVE = 1.05
"""A posture counts as above the floor if w / w_max exceeds this multiple of the floor, a reserve for the tracker."""
STARTS = 1.01
"""Factor on the floor for a start posture, so that rounded printed values are above the floor, too."""
HEAVY = 3.0
"""[m] Weight of a shortfall of w / w_max below the floor, relative to an error of the hand's position."""
WOUND = 4 * math.pi
"""[rad] On a walk, a joint with a range of more than a full turn may pass its limits by this much."""
DAMPING, ROUNDS, STRIDE = 1e-4, 4, 0.25
"""Damping of a step [m^2], steps per pose, and largest step [rad or m]."""


@dataclass(frozen=True, eq=False)
class Walk:
    """M walks, each a sequence of postures along N poses.

    Parameters
    ----------
    q : (N, M, n) [rad, m] postures.
    done : (N, M) whether the posture reaches the pose, above the manipulability floor and outside every keep-out.
    above : (N, M) ratio w / w_max of manipulability to its maximum.
    elbows : (N, M, k, 2) [m] positions of the joints before the wrist, seen from above.
    """

    q: Array
    done: NDArray[np.bool_]
    above: Array
    elbows: Array


class Seats:
    """Compute how far a tracker's robot follows many paths of poses, by kinematics only, without time.

    From one pose of the path, damped Gauss-Newton steps lead to the next pose within the joint limits; a shortfall
    below the manipulability floor counts as a further error. If a pose is out of reach, the walk continues from the
    nearest posture of the same branch.
    """

    def __init__(self, tracker: MirrorTracker) -> None:
        self.chain, self.floor, self.near = tracker.chain, ABOVE * tracker.floor, 1
        bounds, chain = tracker.hand_bounds, tracker.chain
        q = ca.SX.sym("q", chain.n)
        frames = chain.frames_expression(q)
        w, slope = bounds.manipulability(q)
        height = ca.mmin(ca.vertcat(*(ca.mmin(ca.vertcat(*bounds.heights(frames, p))) for p in bounds.planes), 1.0))
        self.joints = range(1, max(chain.n - 3, 2))
        elbows = ca.vertcat(*(frames[i][:2, 3] for i in self.joints))
        everything = ca.vertcat(
            ca.vec(frames[-1][:3, :4]), ca.vec(chain.jacobian_expression(q)), w, slope, height, elbows
        )
        function = ca.Function("seat", [q], [ca.densify(everything)], {"cse": True})
        self._at = mapped(function)
        turning = np.array([not row.prismatic for row in chain.rows])
        self.round = (
            turning & np.isfinite(chain.lower) & np.isfinite(chain.upper) & (chain.upper - chain.lower >= 2 * np.pi)
        )
        more = np.where(self.round, WOUND, 0.0)
        self.lower, self.upper = chain.lower - more, chain.upper + more

    def at(self, q: Array) -> tuple[Array, Array, Array, Array, Array, Array]:
        """Tools (M, 3, 4), Jacobians (M, 6, n), w / w_max (M,), its slopes (M, n), heights over planes (M,) [m].

        The last output holds the joints before the wrist, seen from above (M, k, 2) [m].
        """
        n = self.chain.n
        tool, jacobian, w, slope, height, elbows = np.split(self._at(q), np.cumsum((12, 6 * n, 1, n, 1)), axis=1)
        return (
            tool.reshape(-1, 4, 3).transpose(0, 2, 1), jacobian.reshape(-1, n, 6).transpose(0, 2, 1), w[:, 0], slope,
            height[:, 0], elbows.reshape(len(q), -1, 2),
        )  # fmt: skip

    def walk(self, paths: Array, start: Array, anchor: int) -> Walk:
        """Walk along paths (N, M, 4, 4) in both directions from the postures `start` (M, n) at pose number `anchor`."""
        count, many = paths.shape[:2]
        q = np.empty((count, many, self.chain.n))
        done, above = np.zeros((count, many), dtype=bool), np.zeros((count, many))
        elbows = np.empty((count, many, len(self.joints), 2))
        for way in (range(anchor, count), range(anchor, -1, -1)):
            here = start.copy()
            for k in way:
                here, done[k], above[k], elbows[k] = self._next(here, paths[k])
                q[k] = here
        lower, upper = (np.where(self.round, each, 0.0) for each in (self.chain.lower, self.chain.upper))
        middle = (lower + upper) / 2
        q += self.round * 2 * np.pi * np.rint((middle - (q.min(axis=0) + q.max(axis=0)) / 2) / (2 * np.pi))
        within = np.all((q >= self.chain.lower) & (q <= self.chain.upper), axis=2)
        starts = within[0] & (above[0] >= self.floor * STARTS / ABOVE)
        return Walk(q, done & within & starts, above, elbows)

    def _next(self, q: Array, poses: Array) -> tuple[Array, NDArray[np.bool_], Array, Array]:
        chain = self.chain
        for round_ in range(ROUNDS + 1):
            tool, jacobian, w, slope, height, elbows = self.at(q)
            error, turn = poses[:, :3, 3] - tool[:, :, 3], turns_between(tool[:, :, :3], poses[:, :3, :3])
            if round_ == ROUNDS:
                break
            under = np.maximum(self.floor - w, 0.0)
            wanted = np.concatenate([error, TURN_LENGTH * turn, HEAVY * under[:, None]], axis=1)
            rows = jacobian.copy()
            rows[:, 3:] *= TURN_LENGTH
            rows = np.concatenate([rows, HEAVY * slope[:, None, :] * (under > 0)[:, None, None]], axis=1)
            square = rows.transpose(0, 2, 1) @ rows + DAMPING * np.eye(chain.n)
            step = np.linalg.solve(square, np.einsum("mij,mi->mj", rows, wanted)[:, :, None])[:, :, 0]
            step *= np.minimum(1.0, STRIDE / np.maximum(np.abs(step).max(axis=1), 1e-12))[:, None]
            q = np.clip(q + step, self.lower, self.upper)
        far, turned = np.linalg.norm(error, axis=1), np.linalg.norm(turn, axis=1)
        near = (far < self.near * NEAR) & (turned < self.near * TURNED)
        return q, near & (w >= self.floor * (1 - 1e-3)) & (height > 0.0), w, elbows
