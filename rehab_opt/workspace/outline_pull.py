"""How strongly the image of an outline is drawn to another outline, and whether it crosses itself."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from shapely import Polygon

__all__ = ["OutlinePull"]


class OutlinePull:
    """Mean squared distance from an outline, weighted by the side on which a point lies.

    Parameters
    ----------
    polygon : set whose outline attracts.
    values : (b, n), linear map from the unknowns Y (n, 2) to the points (b, 2) that are attracted, in order along a
        closed curve.
    inside, outside : weights of a squared distance on either side.
    """

    def __init__(self, polygon: Polygon, values: NDArray[np.float64], inside: float, outside: float) -> None:
        from shapely import get_coordinates, prepare  # noqa: PLC0415  (light to import)

        self._polygon, self._values = polygon, values
        prepare(polygon)
        ring = get_coordinates(polygon.exterior)
        self._start, self._edge = ring[:-1], np.diff(ring, axis=0)
        self._length2 = (self._edge**2).sum(axis=1)
        self._inside, self._outside = inside, outside

    def __call__(self, Y: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        """Cost and its derivative with respect to Y (n, 2)."""
        away, out = self._away(self._values @ Y)
        weights = np.where(out, self._outside, self._inside) / len(away)
        return float(weights @ (away**2).sum(axis=1)), self._values.T @ (2.0 * weights[:, None] * away)

    def outside(self, Y: NDArray[np.float64]) -> float:
        """Largest distance of a point outside; 0 where none is."""
        away, out = self._away(self._values @ Y)
        return float(np.hypot(*away[out].T).max(initial=0.0))

    def simple(self, Y: NDArray[np.float64]) -> bool:
        """Whether the curve through the points does not cross itself."""
        from shapely import LinearRing  # noqa: PLC0415

        return bool(LinearRing(self._values @ Y).is_simple)

    def tighten(self) -> None:
        """Weigh points outside five times as much from now on."""
        self._outside *= 5.0

    def _away(self, points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Vectors (b, 2) from the nearest point of the outline, and which points are outside."""
        from shapely import contains_xy  # noqa: PLC0415

        d = points[:, None] - self._start
        along = np.clip((d * self._edge).sum(axis=2) / self._length2, 0.0, 1.0)
        away = d - along[..., None] * self._edge
        nearest = (away**2).sum(axis=2).argmin(axis=1)
        return away[np.arange(len(points)), nearest], ~contains_xy(self._polygon, points[:, 0], points[:, 1])
