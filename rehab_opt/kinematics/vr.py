"""Convert poses of virtual reality for a robot: handedness, frame registration, mirroring, and continuity.

Positions are (3,) or (N, 3) [m], quaternions (4,) or (N, 4) in the order x, y, z, w, rotations (3, 3) or (N, 3, 3),
poses (4, 4) or (N, 4, 4).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError

__all__ = [
    "FrameFit",
    "Mirror",
    "continuous_quaternions",
    "fit_frame",
    "poses_of",
    "quaternions_of",
    "robot_from_unity",
    "rotations_of",
]

Array = NDArray[np.float64]

COLLINEAR = 1e-3
"""Points count as collinear if their second largest extent is below this fraction of the largest."""


def robot_from_unity(positions: ArrayLike, quaternions: ArrayLike) -> tuple[Array, Array]:
    """Convert positions and quaternions from Unity (x right, y up, z forward, left-handed) to robot axes.

    Robot axes: x forward, y left, z up, right-handed. p = (z, -x, y), and the quaternion (x, y, z, w) becomes (-z, x,
    -y, w).
    """
    p, q = _columns("positions", positions, 3), _columns("quaternions", quaternions, 4)
    return (
        np.stack([p[..., 2], -p[..., 0], p[..., 1]], axis=-1),
        np.stack([-q[..., 2], q[..., 0], -q[..., 1], q[..., 3]], axis=-1),
    )


class FrameFit(NamedTuple):
    """Pose of one frame in another, fitted to corresponding points."""

    pose: Array
    """(4, 4) pose of the source frame in the target frame."""
    scale: float
    """Ratio of target lengths to source lengths; 1 unless `fit_frame` fits it."""
    residuals: Array
    """(N,) [m] distance of each transformed point from its partner."""

    @property
    def rms(self) -> float:
        """[m] root mean square of the residuals."""
        return float(np.sqrt(np.mean(self.residuals**2)))

    def points(self, points: ArrayLike) -> Array:
        """Transform points (..., 3) from the source frame to the target frame."""
        p = _columns("points", points, 3)
        return np.asarray(self.scale * p @ self.pose[:3, :3].T + self.pose[:3, 3])

    def poses(self, poses: ArrayLike) -> Array:
        """Transform poses (..., 4, 4) from the source frame to the target frame."""
        given = np.array(poses, dtype=np.float64)
        found = self.pose @ given
        found[..., :3, 3] = self.points(given[..., :3, 3])
        return np.asarray(found)


def fit_frame(source: ArrayLike, target: ArrayLike, *, scale: bool = False) -> FrameFit:
    """Least-squares rigid transform of points (N, 3) of a source frame to their partners in a target frame.

    The method is that of Kabsch, with singular values. The result is never a reflection: convert a left-handed frame
    first. `scale=True` also fits a scale (Umeyama), for a recording of another person's arm.

    Raises
    ------
    ConfigurationError : fewer than three points, not finite, or all near one line.
    """
    a, b = _columns("source", source, 3), _columns("target", target, 3)
    if a.ndim != 2 or a.shape != b.shape or len(a) < 3 or not np.all(np.isfinite([a, b])):
        raise ConfigurationError("source, target", (a.shape, b.shape), "the same three or more finite points, (N, 3)")
    from_centre, to_centre = a.mean(axis=0), b.mean(axis=0)
    x, y = a - from_centre, b - to_centre
    for name, points in (("source", x), ("target", y)):
        extents = np.linalg.svd(points, compute_uv=False)
        if not extents[1] > COLLINEAR * extents[0]:
            raise ConfigurationError(name, extents.tolist(), "points that do not lie on one line")
    u, s, vt = np.linalg.svd(y.T @ x)
    handed = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    rotation = (u * handed) @ vt
    size = float(s @ handed / np.sum(x**2)) if scale else 1.0
    pose = np.eye(4)
    pose[:3, :3] = rotation
    pose[:3, 3] = to_centre - size * rotation @ from_centre
    images = size * x @ rotation.T
    return FrameFit(pose, size, np.linalg.norm(images - y, axis=1))


@dataclass(frozen=True)
class Mirror:
    """Mirror positions, poses and twists in a plane, usually the patient's sagittal plane.

    A mirrored position is p' = M p, about a point of the plane, and a mirrored rotation R' = M R M_b. M is I - 2 n n^T,
    where n is the plane's unit normal. M_b reverses the axis of the hand frame that points across the hand. This axis
    depends on the tracker, so it has no default. With M R M instead, the mirrored fingers would point backwards for
    many trackers.
    """

    point: tuple[float, float, float]
    """[m] A point of the plane."""
    normal: tuple[float, float, float]
    """Normal of the plane, of any length."""
    lateral: Literal["x", "y", "z"]
    """Axis of the hand frame across the hand; the axes along the hand and out of its back keep their meaning."""

    def __post_init__(self) -> None:
        point, normal = _columns("point", self.point, 3), _columns("normal", self.normal, 3)
        if point.shape != (3,) or normal.shape != (3,) or not np.all(np.isfinite([point, normal])):
            raise ConfigurationError("point, normal", (self.point, self.normal), "three finite numbers each")
        if not np.linalg.norm(normal) > 1e-9:
            raise ConfigurationError("normal", self.normal, "a direction")
        if self.lateral not in ("x", "y", "z"):
            raise ConfigurationError("lateral", self.lateral, "'x', 'y' or 'z'")

    @property
    def matrix(self) -> Array:
        """(3, 3) reflection M in the plane."""
        n = np.array(self.normal, dtype=np.float64)
        n /= np.linalg.norm(n)
        return np.asarray(np.eye(3) - 2.0 * np.outer(n, n))

    @property
    def flip(self) -> Array:
        """(3, 3) reflection M_b of the hand frame."""
        return np.diag([-1.0 if axis == self.lateral else 1.0 for axis in "xyz"])

    def positions(self, positions: ArrayLike) -> Array:
        """(..., 3) mirrored positions."""
        about = np.array(self.point, dtype=np.float64)
        return np.asarray((_columns("positions", positions, 3) - about) @ self.matrix + about)

    def poses(self, poses: ArrayLike) -> Array:
        """(..., 4, 4) mirrored poses; mirroring twice gives the pose itself."""
        given = np.array(poses, dtype=np.float64)
        found = given.copy()
        found[..., :3, :3] = self.matrix @ given[..., :3, :3] @ self.flip
        found[..., :3, 3] = self.positions(given[..., :3, 3])
        return found

    def twists(self, twists: ArrayLike) -> Array:
        """(..., 6) mirrored twists: linear velocities times M, angular velocities (axial vectors) times -M."""
        given = np.array(twists, dtype=np.float64)
        return np.concatenate([given[..., :3] @ self.matrix, -given[..., 3:] @ self.matrix], axis=-1)


def continuous_quaternions(quaternions: ArrayLike, last: ArrayLike | None = None) -> Array:
    """(N, 4) unit quaternions whose signs do not jump: q and -q are one rotation.

    `last` (4,) is the quaternion before the first. A zero quaternion stays zero and is skipped.
    """
    q = _columns("quaternions", quaternions, 4)
    length = np.linalg.norm(q, axis=-1, keepdims=True)
    valid = np.isfinite(length[:, 0]) & (length[:, 0] > 1e-9)
    unit = np.where(valid[:, None], q / np.where(valid[:, None], length, 1.0), q)
    chain = unit[valid] if last is None else np.concatenate([_columns("last", last, 4)[None], unit[valid]])
    # The sign of a quaternion is the product of the signs of all dot products of neighbours so far, zeros left out.
    signs = np.cumprod(np.where(np.sum(chain[1:] * chain[:-1], axis=1) < 0.0, -1.0, 1.0))
    unit[valid] *= (np.concatenate([[1.0], signs]) if last is None else signs)[:, None]
    return np.asarray(unit)


def rotations_of(quaternions: ArrayLike) -> Array:
    """Rotations (..., 3, 3) from quaternions (..., 4) x, y, z, w of any length."""
    q = _columns("quaternions", quaternions, 4)
    x, y, z, w = np.moveaxis(q / np.linalg.norm(q, axis=-1, keepdims=True), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.asarray(np.moveaxis(np.array(rows), (0, 1), (-2, -1)))


def quaternions_of(rotations: ArrayLike) -> Array:
    """Continuous quaternions (N, 4) x, y, z, w of rotations (N, 3, 3)."""
    r = np.array(rotations, dtype=np.float64).reshape(-1, 3, 3)
    found = np.empty((len(r), 4))
    for i, m in enumerate(r):
        trace = float(np.trace(m))
        squares = np.array([1 + 2 * m[0, 0] - trace, 1 + 2 * m[1, 1] - trace, 1 + 2 * m[2, 2] - trace, 1 + trace])
        skew = [m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]]
        k = int(np.argmax(squares))
        if k == 3:
            row = [*skew, squares[3]]
        else:
            row = [m[k, j] + m[j, k] if j != k else squares[k] for j in range(3)] + [skew[k]]
        found[i] = np.array(row) / (2 * math.sqrt(squares[k]))
    return continuous_quaternions(found / np.linalg.norm(found, axis=1, keepdims=True))


def poses_of(positions: ArrayLike, quaternions: ArrayLike) -> Array:
    """Poses (N, 4, 4) from positions (N, 3) and quaternions (N, 4)."""
    p, q = _columns("positions", positions, 3), _columns("quaternions", quaternions, 4)
    poses = np.tile(np.eye(4), (*p.shape[:-1], 1, 1))
    poses[..., :3, :3], poses[..., :3, 3] = rotations_of(q), p
    return poses


def _columns(argument: str, value: ArrayLike, width: int) -> Array:
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as problem:
        raise ConfigurationError(argument, value, f"numbers of shape (..., {width})") from problem
    if array.ndim == 0 or array.shape[-1] != width:
        raise ConfigurationError(argument, array.shape, f"numbers of shape (..., {width})")
    return array
