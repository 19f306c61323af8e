"""The largest undistorted copy of a drawing, turned and shifted, that fits into a workspace."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.real_array import checked_array
from rehab_opt.workspace.point_arguments import point_array, real_number

if TYPE_CHECKING:
    from shapely import Polygon

    from rehab_opt.workspace.region import Workspace

__all__ = ["Similarity", "checked_path", "largest_copy", "resampled"]

Array = NDArray[np.float64]

SAMPLES = 64
"""Number of path points that the search keeps inside."""
TURNS, CENTRES = 12, 3
"""Numbers of turns and positions at which the search starts."""
SMALLER = 0.99
"""Factor on a copy, applied until its whole path is inside."""


class Similarity(NamedTuple):
    """A similarity of the plane: x -> scale R(turn) x + shift.

    scale : [-]. turn : [rad], counterclockwise. shift : (2,) [m].
    """

    scale: float
    turn: float
    shift: Array

    def __call__(self, points: ArrayLike) -> Array:
        """Images [m] of points (2,) or (N, 2) [m]."""
        c, s = self.scale * math.cos(self.turn), self.scale * math.sin(self.turn)
        return np.asarray(point_array(points) @ np.array([[c, s], [-s, c]]) + self.shift)

    def about(self, point: Array, factor: float) -> Similarity:
        """The similarity, followed by a scaling with `factor` that keeps the image of `point` (2,) [m]."""
        centre = self(point)
        return Similarity(factor * self.scale, self.turn, centre + factor * (self.shift - centre))


def largest_copy(
    path: ArrayLike, target: Workspace, *, rotation: float | Literal["best"] = "best", margin: float = 0.0
) -> Similarity:
    """The largest similarity found that maps a path (N, 2) [m] into a workspace.

    A small nonlinear program over scale, turn and shift maximises the scale; the path stays inside, at least `margin`
    from the outline. It starts at several turns and positions and returns the best local maximum.

    Parameters
    ----------
    rotation : turn [rad], or "best".
    margin : [m] least distance from the outline.

    Raises
    ------
    ConfigurationError : a path that is one point, a target that is not one piece without holes, a margin that leaves
        nothing of it.
    """
    points = checked_path(path)
    if not (isinstance(rotation, str) and rotation == "best") and not math.isfinite(real_number(rotation)):
        raise ConfigurationError("rotation", rotation, 'an angle in radians, or "best"')
    if not 0.0 <= real_number(margin) < math.inf:
        raise ConfigurationError("margin", margin, "a length in metres")
    if target.components != 1 or target.holes:
        raise ConfigurationError("target", target, "a workspace of one piece without holes")
    inner = target.polygon.buffer(-margin)
    parts = [part for part in getattr(inner, "geoms", (inner,)) if not part.is_empty]
    if not parts:
        raise ConfigurationError("margin", margin, "less than what is left of the target")
    return _largest(points, max(parts, key=lambda part: part.area), rotation)


def _largest(points: Array, polygon: Polygon, rotation: float | Literal["best"]) -> Similarity:
    import shapely  # noqa: PLC0415  (light to import)
    from scipy.optimize import minimize  # noqa: PLC0415  (slow to import)

    middle = points.mean(axis=0)
    size = float(np.sqrt(((points - middle) ** 2).sum(axis=1).mean()))
    few = (resampled(points, SAMPLES) - middle) / size
    ring, unit = polygon.exterior, polygon.area**0.5
    shapely.prepare([polygon, ring])
    still = 0.0 if rotation == "best" else rotation
    cosine, sine = math.cos(still), math.sin(still)
    zero, one = np.zeros(len(few)), np.ones(len(few))
    by_x = np.stack([np.column_stack([few[:, 0], few[:, 1]]), np.column_stack([-few[:, 1], few[:, 0]])], axis=2)
    columns = np.concatenate([by_x, np.stack([[one, zero], [zero, one]]).transpose(2, 0, 1)], axis=2)
    if rotation != "best":  # scale and shift vary; the turn is given
        along = columns[:, :, 0] * cosine + columns[:, :, 1] * sine
        columns = np.concatenate([along[:, :, None], columns[:, :, 2:]], axis=2)
    k = columns.shape[2] - 2

    def room(z: Array) -> tuple[Array, Array]:
        """Two results: signed distances of the path's points inside the outline, over its size; their Jacobian."""
        at = unit * (columns @ z)
        asked = shapely.points(at)
        nearest = shapely.get_coordinates(ring.interpolate(shapely.line_locate_point(ring, asked)))
        away = at - nearest
        distance = np.maximum(np.hypot(*away.T), 1e-12)
        side = np.where(shapely.contains(polygon, asked), 1.0, -1.0)
        return side * distance / unit, np.einsum("mi,mij->mj", (side / distance)[:, None] * away, columns)

    best, best_scale = None, 0.0
    for centre in _centres(polygon):
        for turn in 2.0 * np.pi * np.arange(TURNS) / TURNS if k == 2 else [0.0]:
            first = 0.1 * np.array([np.cos(turn), np.sin(turn)])[:k]
            start = np.concatenate([first if k == 2 else [0.1], centre / unit])
            answer = minimize(
                lambda z: -float(z[:k] @ z[:k]), start, jac=lambda z: np.concatenate([-2.0 * z[:k], [0.0, 0.0]]),
                method="SLSQP", constraints={"type": "ineq", "fun": lambda z: room(z)[0], "jac": lambda z: room(z)[1]},
                options={"maxiter": 60, "ftol": 1e-8},
            )  # fmt: skip
            z = answer.x
            if not np.isfinite(z).all():
                continue
            scale = float(np.hypot(z[0], z[1])) if k == 2 else float(z[0])
            turned = float(np.arctan2(z[1], z[0])) if k == 2 else still
            if scale > best_scale:
                copy = _inside(Similarity(unit * scale / size, turned, unit * z[k:]), points, middle, polygon)
                if copy is not None and copy.scale * size / unit > best_scale:
                    best, best_scale = copy, copy.scale * size / unit
    if best is None:
        raise ConfigurationError("target", polygon, "a workspace that some copy of the path fits into")
    return best


def _inside(centred: Similarity, points: Array, middle: Array, polygon: Polygon) -> Similarity | None:
    """The copy, shrunk until its whole path is inside; None if it would shrink by more than a tenth."""
    from shapely import LineString  # noqa: PLC0415

    shift = centred.shift - Similarity(centred.scale, centred.turn, np.zeros(2))(middle)
    copy = Similarity(centred.scale, centred.turn, shift)
    for _ in range(10):
        if polygon.covers(LineString(copy(points))):
            return copy
        copy = copy.about(middle, SMALLER)
    return None


def _centres(polygon: Polygon) -> list[Array]:
    """Centres of the largest disc inside, and of the largest discs in the remaining area."""
    from shapely import Point, get_coordinates, maximum_inscribed_circle  # noqa: PLC0415

    found: list[Array] = []
    left = polygon
    while len(found) < CENTRES and left.area > 0.05 * polygon.area:
        line = maximum_inscribed_circle(left, tolerance=1e-2 * polygon.area**0.5)
        found.append(get_coordinates(line)[0])
        left = left.difference(Point(found[-1]).buffer(line.length))
    return found


def checked_path(path: ArrayLike) -> Array:
    """`path` as (N, 2) of finite points that are not all the same.

    Raises
    ------
    ConfigurationError : anything else; the error names `path`.
    """
    points = checked_array("path", path, "points (N, 2) in metres")
    if points.ndim != 2 or points.shape[1] != 2 or not len(points) or not np.isfinite(points).all():
        raise ConfigurationError("path", path, "finite points (N, 2) in metres")
    if not np.ptp(points, axis=0).max() > 0.0:
        raise ConfigurationError("path", path, "points that are not all the same")
    return points


def resampled(points: Array, count: int) -> Array:
    """Points (count, 2) evenly along a path (N, 2) [m]."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    at = np.linspace(0.0, along[-1], count)
    return np.column_stack([np.interp(at, along, points[:, k]) for k in (0, 1)])
