"""Preview of a whole recording: the reference clock's position and pace in each tick, if nothing slows the clock."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["Layout", "Preview", "angles_between", "turned_each", "turns_between"]

Array = NDArray[np.float64]

NEAR = 1e-12
"""Relative margin of the preview to the hand's largest speeds, for rounding."""


class Layout(NamedTuple):
    """Reference of the next K ticks."""

    poses: Array
    """(K, 4, 4) poses of the reference."""
    twists: Array
    """(K, 6) twists at the clock's pace [m/s, rad/s]."""
    paces: list[float]
    """Seconds of the reference per second."""
    places: list[tuple[int, float]]
    """The clock after each tick: index of a sample, and fraction of the step to the next one."""


class Preview:
    """A whole recording of N samples with linear interpolation of positions and rotations.

    Parameters
    ----------
    poses, twists : (N, 4, 4), (N, 6). seconds : (N,) [s] since the sample before.
    paces : (N,) largest pace that later samples allow.
    linear_speed, angular_speed : [m/s, rad/s] largest speeds of the reference.
    """

    def __init__(
        self, poses: Array, twists: Array, seconds: Array, paces: Array, *, linear_speed: float, angular_speed: float
    ) -> None:
        self._poses, self._twists, self._seconds, self._paces = poses, twists, seconds.tolist(), paces.tolist()
        ways = turns_between(poses[:-1, :3, :3], poses[1:, :3, :3])
        self._turns = np.append(ways, np.zeros((1, 3)), axis=0)  # none from the last sample, which may be the only one
        self._limits = np.array([linear_speed, angular_speed]) * (1.0 - NEAR)
        self._fastest = self._speeds(twists).tolist()

    def _speeds(self, twists: Array) -> Array:
        linear, angular = np.linalg.norm(twists[:, :3], axis=1), np.linalg.norm(twists[:, 3:], axis=1)
        return np.asarray(np.maximum(linear / self._limits[0], angular / self._limits[1]))

    def ahead(self, place: tuple[int, float], pace: float, most: int, *, dt: float, quickening: float) -> Layout:
        """Lay out at most `most` ticks from `place`, up to a bridge.

        The pace rises by at most 1 in `quickening` seconds.
        """
        at, fraction = place
        last, rise = len(self._seconds) - 1, dt / quickening
        seconds, fastest, paces = self._seconds, self._fastest, self._paces
        taken, places, longest = [], [], 1.5 * dt
        for _ in range(most):
            fast = fastest[at] if fraction == 0.0 else fastest[at] + fraction * (fastest[at + 1] - fastest[at])
            pace = min(1.0, paces[at], 1.0 / fast if fast > 1.0 else 1.0, pace + rise)
            left = pace * dt
            if at < last and left < (1.0 - fraction) * seconds[at + 1] <= longest:  # the usual case, and the fast one
                fraction += left / seconds[at + 1]
                taken.append(pace)
                places.append((at, fraction))
                continue
            while at < last and left > 0.0:
                length = seconds[at + 1]
                if length > longest:
                    break
                to_next = length * (1.0 - fraction)
                if left < to_next:
                    fraction += left / length
                    left = 0.0
                    break
                left -= to_next
                at, fraction = at + 1, 0.0
            if at < last and left > 0.0:
                break  # before a bridge
            taken.append(pace)
            places.append((at, fraction))
        return Layout(*self._read(places, np.array(taken)), taken, places)

    def _read(self, places: list[tuple[int, float]], paces: Array) -> tuple[Array, Array]:
        at = np.array([each[0] for each in places], dtype=np.int64)
        fraction = np.array([each[1] for each in places])
        after = np.minimum(at + 1, len(self._poses) - 1)
        poses, here = self._poses[at], self._poses[at]
        poses[:, :3, 3] += fraction[:, None] * (self._poses[after, :3, 3] - here[:, :3, 3])
        poses[:, :3, :3] = turned_each(here[:, :3, :3], fraction[:, None] * self._turns[at])
        twists = self._twists[at] + fraction[:, None] * (self._twists[after] - self._twists[at])
        twists *= (paces / np.maximum(1.0, paces * self._speeds(twists)))[:, None]
        return poses, twists


def turns_between(before: Array, after: Array) -> Array:
    """Rotation vectors (N, 3) [rad] in the base frame, below half a turn, from `before` to `after` (N, 3, 3)."""
    skew, sine, angle = _between(before, after)
    return np.asarray(skew * np.where(sine > 1e-9, angle / np.maximum(sine, 1e-300), 1.0)[:, None])


def angles_between(before: Array, after: Array) -> Array:
    """Angles (N,) [rad], up to half a turn, from rotations `before` to `after` (N, 3, 3)."""
    return _between(before, after)[2]


def _between(before: Array, after: Array) -> tuple[Array, Array, Array]:
    """Three results for the rotation from `before` to `after`: axis times sine (N, 3), sine (N,), angle (N,) [rad]."""
    r = after @ before.transpose(0, 2, 1)
    skew = 0.5 * np.stack([r[:, 2, 1] - r[:, 1, 2], r[:, 0, 2] - r[:, 2, 0], r[:, 1, 0] - r[:, 0, 1]], axis=1)
    sine = np.linalg.norm(skew, axis=1)
    return skew, sine, np.arctan2(sine, 0.5 * (np.trace(r, axis1=1, axis2=2) - 1.0))


def turned_each(rotations: Array, vectors: Array) -> Array:
    """Rotations (N, 3, 3) rotated by rotation vectors (N, 3) in the base frame, after Rodrigues."""
    angle = np.linalg.norm(vectors, axis=1)[:, None, None]
    small = angle < 1e-6
    safe = np.where(small, 1.0, angle)
    x, y, z = vectors.T
    nought = np.zeros_like(x)
    k = np.stack([nought, -z, y, z, nought, -x, -y, x, nought], axis=1).reshape(-1, 3, 3)
    first = np.where(small, 1.0 - angle**2 / 6.0, np.sin(safe) / safe)
    second = np.where(small, 0.5, (1.0 - np.cos(safe)) / safe**2)
    step = first * k + second * (k @ k)
    return np.asarray(rotations + step @ rotations)
