"""The published landmarks: points where lines at equal angles leave the two workspaces. Section V, Rossa et al.

The map folds and leaves the target on workspaces that are not star-shaped around their centre; an audit measures this.
The paper leaves three choices open. The centre of a workspace is its centroid. If a line leaves a workspace several
times, the exit furthest from the centre counts. If the line misses a contour (centroid outside), its angle gives no
pair.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from rehab_opt.errors import ConfigurationError

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from shapely import Polygon

__all__ = ["LANDMARKS", "LandmarkPairs", "polar_landmarks"]

# Fig. 8.
LANDMARKS = 20
# Number of rotations that are compared for "best".
ROTATIONS = 360


class LandmarkPairs(NamedTuple):
    """Landmarks (n, 2) [m] in the source and their images (n, 2) [m]."""

    source: NDArray[np.float64]
    target: NDArray[np.float64]


def polar_landmarks(
    source: Polygon, target: Polygon, *, landmarks: int = LANDMARKS, rotation: float | Literal["best"] = 0.0
) -> LandmarkPairs:
    """Pairs of contour points at the angles 2 pi j / landmarks around both centroids.

    Parameters
    ----------
    source, target : sets [m].
    landmarks : number of lines, 3 at least.
    rotation : angle [rad], counterclockwise, by which the lines in the target are turned (Section VII-C); "best": the
        whole number of degrees for which the pairs fit a similarity best.

    Raises
    ------
    ConfigurationError : fewer than three lines meet both contours.
    """
    angles = 2.0 * np.pi / landmarks * np.arange(1.0, landmarks + 1.0)
    start = _contour_points(source, angles)
    if rotation == "best":
        turns = (2.0 * np.pi / ROTATIONS * np.arange(ROTATIONS)).tolist()
        turn: float = max(turns, key=lambda each: _fit(start, _contour_points(target, angles + each), each))
    else:
        turn = rotation
    end = _contour_points(target, angles + turn)
    met = np.isfinite(start).all(axis=1) & np.isfinite(end).all(axis=1)
    if met.sum() < 3:
        raise ConfigurationError("landmarks", landmarks, "three lines at least that meet both contours")
    return LandmarkPairs(start[met], end[met])


def _contour_points(polygon: Polygon, angles: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
    """Contour point furthest from the centroid at each angle, (n, 2) [m]; NaN if the line misses the contour."""
    from shapely import LineString, distance, get_coordinates, intersection, points  # noqa: PLC0415

    centre = polygon.centroid
    origin = np.asarray(centre.coords[0])
    length = 2.0 * np.hypot(*np.ptp(np.asarray(polygon.envelope.exterior.coords), axis=0))
    found = np.full((len(angles), 2), np.nan)
    for k, angle in enumerate(angles):
        line = LineString([origin, origin + length * np.array([np.cos(angle), np.sin(angle)])])
        crossings = get_coordinates(intersection(line, polygon.exterior))
        if len(crossings):
            found[k] = crossings[np.argmax(distance(points(crossings), centre))]
    return found


def _fit(start: NDArray[np.float64], end: NDArray[np.float64], rotation: float) -> float:
    """How well a similarity with this rotation fits the pairs, from 0 to 1 (exactly); -inf below three pairs."""
    both = np.isfinite(start).all(axis=1) & np.isfinite(end).all(axis=1)
    if both.sum() < 3:
        return -np.inf
    z, w = (each[both] @ np.array([1.0, 1.0j]) for each in (start, end))
    z, w = z - z.mean(), w - w.mean()
    along = float((np.exp(-1j * rotation) * np.conj(z) @ w).real)
    return max(along, 0.0) / float(np.linalg.norm(w) * np.linalg.norm(z))
