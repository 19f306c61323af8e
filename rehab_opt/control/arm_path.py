"""Plan postures of a person's arm along a whole recorded path of hand poses.

Many tracks of postures follow the path from different starts. Dynamic programming then picks one track for each section
of the path. To change from track to track, the arm moves straight through joint space while the recording waits.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.preview import turns_between
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.symbolic.buffered import mapped

__all__ = ["ArmPath", "Postures", "arm_path"]

Array = NDArray[np.float64]

KNOTS = 120
TRACKS, ENOUGH = (4, 100), 0.98
"""Number of tracks in each attempt; the second follows if fewer knots than the fraction `ENOUGH` are reached."""
FOUND, ROUNDS, STRIDE = 40, 5, 0.3
"""Solver steps to the first knot, solver steps to each further knot, and largest step [rad]."""
CHANGE = 0.5
"""[knots/rad] Cost of a change of posture per radian; a reached knot gains 1."""
JUMP = 0.4
"""[rad] Joint difference between knots above which the posture counts as changed."""
SPEED = 1.0
"""[rad/s] Mean speed of the joint that moves furthest during a change of posture."""
STEP = 0.03
"""[rad] Joint difference between samples above which the recording waits for the change of posture."""
NEAR, TURNED, TURN_LENGTH = 1e-3, math.radians(1.0), 0.1
"""[m, rad] Errors up to which a pose counts as reached, and [m/rad] weight of a rotation relative to a position."""
DAMPING, PULL = 1e-5, 1e-5
"""[m^2] Damping of a step, and [per rad^2] weight of the deviation from the straight line between knots."""


class ArmPath(NamedTuple):
    """Postures and tool poses of an arm along a path, N samples."""

    q: Array
    """(N, m) [rad] postures."""
    poses: Array
    """(N, 4, 4) poses of the tool in the hand."""
    twists: Array
    """(N, 6) [m/s, rad/s] mean twists over the previous tick; the first is zero."""
    reference_index: NDArray[np.int_]
    """(N,) index of the recorded tool pose; constant while the posture changes."""


def arm_path(arm: SerialChain, grip: Array, tools: Array, *, dt: float, seed: int = 0) -> ArmPath:
    """Plan postures of `arm` along tool poses (N, 4, 4), `dt` [s] apart; `grip` (4, 4): the tool's pose in the hand."""
    moves = Postures(replace(arm, tool=arm.tool @ grip))
    knots = np.unique(np.linspace(0, len(tools) - 1, KNOTS).astype(int))
    best = np.zeros((len(knots), arm.n))
    for count in TRACKS:
        tracks, missing = moves.tracks(tools[knots], count, np.random.default_rng(seed))
        chosen = np.arange(len(knots)), _best_way(tracks, missing)
        best = tracks[chosen]
        if np.mean(missing[chosen] <= 1.0) >= ENOUGH:
            break
    changed = np.abs(np.diff(best, axis=0)).max(axis=1, initial=0.0) > JUMP
    begin = np.searchsorted(knots, np.arange(len(tools)), side="right") - 1
    after = np.minimum(begin + 1, len(knots) - 1)
    part = (np.arange(len(tools)) - knots[begin]) / np.maximum(knots[after] - knots[begin], 1)
    part[np.append(changed, False)[begin]] = 0.0  # the posture stays until it changes at the next knot
    about = best[begin] + part[:, None] * (best[after] - best[begin])
    q, parts, reference_index = moves.nearest(about, tools, rounds=2 * ROUNDS, pull=PULL)[0], [], []
    begun = 0
    for k in (np.flatnonzero(np.abs(np.diff(q, axis=0)).max(axis=1, initial=0.0) > STEP) + 1).tolist():
        way = q[k] - q[k - 1]
        count = math.ceil(float(np.abs(way).max()) / (SPEED * dt))
        s = np.arange(1, count) / count
        parts += [q[begun:k], q[k - 1] + (s**3 * (10 - 15 * s + 6 * s**2))[:, None] * way]
        reference_index += [np.arange(begun, k), np.full(len(s), k)]
        begun = k
    joints = np.vstack([*parts, q[begun:]])
    poses = moves.at(joints)[0]
    twists = _ways(np.concatenate([poses[:1], poses[:-1]]), poses) / dt
    return ArmPath(joints, poses, twists, np.concatenate([*reference_index, np.arange(begun, len(q))]))


class Postures:
    """Kinematics of one arm, and least-squares fits of its postures to poses, for M postures at once."""

    def __init__(self, chain: SerialChain) -> None:
        self.chain, q = chain, ca.SX.sym("q", chain.n)
        told = ca.vertcat(ca.vec(chain.pose_expression(q)), ca.vec(chain.jacobian_expression(q)))
        self._at = mapped(ca.Function("arm", [q], [ca.densify(told)], {"cse": True}))

    def at(self, q: Array) -> tuple[Array, Array]:
        """Poses (M, 4, 4) and Jacobians (M, 6, m) at q (M, m)."""
        found = self._at(q)
        return (
            found[:, :16].reshape(-1, 4, 4).transpose(0, 2, 1),
            found[:, 16:].reshape(-1, self.chain.n, 6).transpose(0, 2, 1),
        )

    def nearest(self, q: Array, poses: Array, *, rounds: int, pull: float = 0.0) -> tuple[Array, Array]:
        """Fit postures to the poses (M, 4, 4), starting at q (M, m).

        Return the postures (M, m) and their pose errors (M,) as multiples of the tolerance.
        """
        lower, upper, n = self.chain.lower, self.chain.upper, self.chain.n
        about, damping = q, np.full(len(q), DAMPING)
        q = np.clip(q, lower, upper)
        error, jacobian = self._error(q, poses)
        size = (error**2).sum(axis=1) + pull * ((q - about) ** 2).sum(axis=1)
        for _ in range(rounds):
            free = np.ones(q.shape, dtype=bool)
            for _ in range(2):
                rows = jacobian * free[:, None, :]
                square = rows.transpose(0, 2, 1) @ rows + (damping[:, None, None] + pull) * np.eye(n)
                wanted = np.einsum("mij,mi->mj", rows, error) + pull * free * (about - q)
                step = free * np.linalg.solve(square, wanted[:, :, None])[:, :, 0]
                free = ~(((q <= lower) & (step < 0)) | ((q >= upper) & (step > 0)))
            step *= np.minimum(1.0, STRIDE / np.maximum(np.abs(step).max(axis=1), 1e-12))[:, None]
            tried = np.clip(q + step, lower, upper)
            new_error, new_jacobian = self._error(tried, poses)
            new_size = (new_error**2).sum(axis=1) + pull * ((tried - about) ** 2).sum(axis=1)
            better = new_size < size
            q, error = np.where(better[:, None], tried, q), np.where(better[:, None], new_error, error)
            jacobian = np.where(better[:, None, None], new_jacobian, jacobian)
            size = np.where(better, new_size, size)
            damping = np.clip(np.where(better, damping / 4, damping * 5), 1e-9, 1.0)
        missing = np.linalg.norm(error.reshape(-1, 2, 3), axis=2) / (NEAR, TURN_LENGTH * TURNED)
        return q, missing.max(axis=1)

    def tracks(self, poses: Array, count: int, rng: np.random.Generator) -> tuple[Array, Array]:
        """Let the arm follow K poses from `count` random start postures.

        Return the postures (K, count, m) and their pose errors (K, count) as multiples of the tolerance.
        """
        lower, upper, n = self.chain.lower, self.chain.upper, self.chain.n
        found, missing = np.empty((len(poses), count, n)), np.empty((len(poses), count))
        q = rng.uniform(lower, upper, (count, n))
        q[0] = (lower + upper) / 2
        rounds = FOUND
        for k, pose in enumerate(poses):
            targets = np.repeat(pose[None], count, axis=0)
            q, missing[k] = self.nearest(q, targets, rounds=rounds)
            found[k], rounds = q, ROUNDS
            if k % 10 == 9:
                lost = np.flatnonzero(missing[k] > 1.0)[: count // 4]
                q[lost], rounds = rng.uniform(lower, upper, (len(lost), n)), FOUND
        return found, missing

    def _error(self, q: Array, poses: Array) -> tuple[Array, Array]:
        here, jacobian = self.at(q)
        error = _ways(here, poses)
        error[:, 3:] *= TURN_LENGTH
        jacobian[:, 3:] *= TURN_LENGTH
        return error, jacobian


def _ways(here: Array, there: Array) -> Array:
    """(N, 6) [m, rad] differences between poses `here` and `there` (N, 4, 4)."""
    turns = turns_between(here[:, :3, :3], there[:, :3, :3])
    return np.concatenate([there[:, :3, 3] - here[:, :3, 3], turns], axis=1)


def _best_way(tracks: Array, missing: Array) -> NDArray[np.int_]:
    gain = np.where(missing <= 1.0, 1.0, -0.01 * np.minimum(missing, 100.0) / 100.0)
    value, before = gain[0], np.zeros(missing.shape, dtype=int)
    for k in range(1, len(tracks)):
        apart = np.abs(tracks[k][:, None] - tracks[k - 1][None]).max(axis=2)
        worth = value[None] - CHANGE * apart
        before[k] = worth.argmax(axis=1)
        value = worth.max(axis=1) + gain[k]
    way = np.empty(len(tracks), dtype=int)
    way[-1] = int(value.argmax())
    for k in range(len(tracks) - 1, 0, -1):
        way[k - 1] = before[k, way[k]]
    return way
