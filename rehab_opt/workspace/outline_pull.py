"""How strongly the image of an outline is drawn to another outline, and whether it crosses itself."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from shapely import Polygon

__all__ = ["OutlinePull"]

# Share of their distance before under which points count as close, and the first weight of keeping them apart.
CLOSE = 0.15
APART = 0.3


class OutlinePull:
    """Mean squared distance from an outline, weighted by the side on which a point lies.

    Parameters
    ----------
    polygon : set whose outline attracts.
    values : (b, n), linear map from the unknowns Y (n, 2) to the points (b, 2) that are attracted, in order along a
        closed curve.
    before : (b, 2), those points where the curve comes from.
    inside, outside : weights of a squared distance on either side.
    """

    def __init__(
        self,
        polygon: Polygon,
        values: NDArray[np.float64],
        before: NDArray[np.float64],
        *,
        inside: float,
        outside: float,
    ) -> None:
        from shapely import get_coordinates, prepare  # noqa: PLC0415  (light to import)

        self._polygon, self._values = polygon, values
        prepare(polygon)
        ring = get_coordinates(polygon.exterior)
        self._start, self._edge = ring[:-1], np.diff(ring, axis=0)
        self._length2 = (self._edge**2).sum(axis=1)
        self._inside, self._outside, self._apart = inside, outside, 0.0
        self._before = np.linalg.norm(before[:, None] - before, axis=2)

    def __call__(self, Y: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        """Cost and its derivative with respect to Y (n, 2)."""
        away, out = self._away(self._values @ Y)
        weights = np.where(out, self._outside, self._inside) / len(away)
        value, slope = float(weights @ (away**2).sum(axis=1)), 2.0 * weights[:, None] * away
        if self._apart > 0.0:
            more, by = self._touching(self._values @ Y)
            value, slope = value + self._apart * more, slope + self._apart * by
        return value, self._values.T @ slope

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

    def keep_apart(self) -> None:
        """Cost from now on what brings points closer than `CLOSE` times their distance before; more at each call."""
        self._apart = APART if self._apart == 0.0 else 3.0 * self._apart

    def _touching(self, points: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        """Sum of ln(CLOSE before / now)^2 over pairs closer than that, over their number, and its derivative (b, 2)."""
        x, y = (points[:, None, k] - points[None, :, k] for k in range(2))
        now2 = x**2 + y**2
        i, j = np.nonzero(now2 < (CLOSE * self._before) ** 2)
        now2 = np.maximum(now2[i, j], 1e-30)
        log = np.log(CLOSE * self._before[i, j]) - 0.5 * np.log(now2)
        slope = np.zeros_like(points)
        for k, d in enumerate((x, y)):
            slope[:, k] = np.bincount(i, -4.0 * log * d[i, j] / now2, len(points))
        return float(log @ log) / len(points), slope / len(points)

    def _away(self, points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Vectors (b, 2) from the nearest point of the outline, and which points are outside."""
        from shapely import contains_xy  # noqa: PLC0415

        d = points[:, None] - self._start
        along = np.clip((d * self._edge).sum(axis=2) / self._length2, 0.0, 1.0)
        away = d - along[..., None] * self._edge
        nearest = (away**2).sum(axis=2).argmin(axis=1)
        return away[np.arange(len(points)), nearest], ~contains_xy(self._polygon, points[:, 0], points[:, 1])
