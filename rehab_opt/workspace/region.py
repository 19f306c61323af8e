"""The part of a plane that a hand can reach, with fast queries for a controller."""

from __future__ import annotations

import math
import threading
from functools import cached_property
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.plausible import ROOM
from rehab_opt.kinematics.real_array import is_finite
from rehab_opt.symbolic import PerThread
from rehab_opt.workspace.placement import ShoulderPlacement
from rehab_opt.workspace.point_arguments import one_point, point_array, single_point

if TYPE_CHECKING:
    import shapely
    from shapely.geometry.base import BaseGeometry

__all__ = ["Workspace"]

Array = NDArray[np.float64]

ON_BOUNDARY = 1e-12
"""[m], plus as much per metre of coordinate: a point nearer to the boundary than this is on the boundary and counts as
inside."""
SMALLEST = 1e-9
"""[m] Least size of a workspace."""
BEYOND = 1e100
"""[m] Coordinates beyond this count as infinite, because their squares overflow."""
WITHOUT_WORDS = np.errstate(divide="ignore", invalid="ignore")
"""Suppresses GEOS's warnings about edges whose squared length is zero in floating point; they do not affect the
result."""
COPYING = threading.Lock()
"""Prevents two threads from reading a polygon at once in GEOS."""


class Workspace:
    """A closed set of points (x, y) in a horizontal plane; immutable, comparable by identity, picklable.

    Any thread may query it; a thread's first query prepares the polygon in 1 ms or less. Numbers raise no error, not
    even NaN and infinity; other types and wrong shapes do.

    Parameters
    ----------
    polygon : shapely Polygon or MultiPolygon [m] in the robot's frame; holes and several parts allowed, or empty.
    accuracy : [m] largest distance between the true boundary and the polygon's.
    height : [m] of the plane in the shoulder's frame.
    handle_tilt : [rad] largest allowed angle of the handle from the vertical; None for any.
    placement : of the shoulder.
    reason : why it is empty; "" if it is not.

    Raises
    ------
    ConfigurationError : an invalid polygon, a negative accuracy, numbers that are not finite.
    """

    __slots__ = ("__dict__", "accuracy", "handle_tilt", "height", "placement", "polygon", "reason")

    polygon: shapely.Polygon | shapely.MultiPolygon
    accuracy: float
    height: float
    handle_tilt: float | None
    placement: ShoulderPlacement
    reason: str

    def __init__(
        self,
        polygon: shapely.Polygon | shapely.MultiPolygon,
        *,
        accuracy: float,
        height: float = 0.0,
        handle_tilt: float | None = None,
        placement: ShoulderPlacement = ShoulderPlacement(),  # noqa: B008  (immutable)
        reason: str = "",
    ) -> None:
        if not isinstance(placement, ShoulderPlacement):
            raise ConfigurationError("placement", placement, "a ShoulderPlacement")
        checked = {
            "polygon": _checked(polygon),
            "accuracy": _number("accuracy", accuracy, low=0.0),
            "height": _number("height", height),
            "handle_tilt": None if handle_tilt is None else _number("handle_tilt", handle_tilt, low=0.0),
            "placement": placement,
            "reason": str(reason),
        }
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    def __setattr__(self, name: str, value: object) -> NoReturn:
        raise AttributeError(f"a Workspace cannot be changed: {name}")

    def __delattr__(self, name: str) -> NoReturn:
        raise AttributeError(f"a Workspace cannot be changed: {name}")

    def __reduce__(self) -> tuple[Any, ...]:
        given = {name: getattr(self, name) for name in self.__annotations__}
        return _rebuilt, (given,)

    def __repr__(self) -> str:
        tilt = "any" if self.handle_tilt is None else f"{math.degrees(self.handle_tilt):g} deg"
        plane = f"height {self.height:g} m, handle tilt {tilt}"
        if self.empty:
            return f"Workspace(empty: {self.reason or 'no point is reachable'}; {plane})"
        size = f"{1e4 * self.area:.4g} cm^2 in {self.components} part{'s' if self.components > 1 else ''}"
        return f"Workspace({size}, {self.holes} holes, {plane}, accurate to {1e3 * self.accuracy:.2g} mm)"

    # -------------------------------------------------------------------------------------------------- what it is
    @property
    def empty(self) -> bool:
        """Whether the workspace has no area."""
        return bool(self.polygon.is_empty)

    @property
    def area(self) -> float:
        """[m^2]"""
        return float(self.polygon.area)

    @property
    def components(self) -> int:
        """Number of separate parts."""
        return sum(not part.is_empty for part in getattr(self.polygon, "geoms", (self.polygon,)))

    @property
    def holes(self) -> int:
        """Number of holes in all parts."""
        parts = getattr(self.polygon, "geoms", (self.polygon,))
        return sum(len(part.interiors) for part in parts)

    # ----------------------------------------------------------------------------------------------------- queries
    @WITHOUT_WORDS
    def contains(self, points: ArrayLike) -> bool | NDArray[np.bool_]:
        """Whether points (2,) or (N, 2) [m] are reachable.

        The boundary, to rounding, counts as inside; NaN and infinite points do not.
        """
        import shapely  # noqa: PLC0415

        point, polygon = one_point(points), self._prepared.mine[0]
        if point is not None:
            slack = ON_BOUNDARY * (1.0 + abs(point[0]) + abs(point[1]))
            return slack < ON_BOUNDARY * BEYOND and bool(shapely.dwithin(polygon, shapely.points(point), slack))
        rows = point_array(points)
        slacks = ON_BOUNDARY + np.abs(ON_BOUNDARY * rows).sum(axis=1)
        inside: NDArray[np.bool_] = slacks < ON_BOUNDARY * BEYOND
        inside[inside] = shapely.dwithin(polygon, shapely.points(rows[inside]), slacks[inside])
        return inside

    @WITHOUT_WORDS
    def distance(self, points: ArrayLike) -> float | Array:
        """Signed distance [m] of points (2,) or (N, 2) to the boundary, negative inside.

        Exact for the polygon to rounding; infinite for an empty workspace, NaN for a NaN point.
        """
        import shapely  # noqa: PLC0415

        point, (polygon, boundary) = one_point(points), self._prepared.mine
        if point is not None:
            return self.signed_distance_and_closest_point(point)[0]
        rows = point_array(points)
        distances: Array = np.where(np.isnan(rows).any(axis=1), np.nan, np.inf)
        near = (np.abs(rows) < BEYOND).all(axis=1) & (not self.empty)
        asked = shapely.points(rows[near])
        distances[near] = shapely.distance(boundary, asked) * np.where(shapely.contains(polygon, asked), -1.0, 1.0)
        return distances

    def nearest(self, point: ArrayLike) -> Array:
        """(2,) [m] reachable point nearest to `point` (2,); the point itself if it is inside.

        NaN if the workspace is empty or the point is not finite.
        """
        place = single_point(point)
        return np.array(place if self.contains(place) else self.signed_distance_and_closest_point(place)[1:])

    @WITHOUT_WORDS
    def signed_distance_and_closest_point(self, point: ArrayLike) -> tuple[float, float, float]:
        """`distance` of a point (2,), and the x and y of the boundary's nearest point.

        Away from the boundary the distance's gradient is (point - closest point) / distance.
        """
        import shapely  # noqa: PLC0415

        x, y = single_point(point)
        if self.empty or not (abs(x) < BEYOND and abs(y) < BEYOND):
            return (math.nan if math.isnan(x) or math.isnan(y) else math.inf), math.nan, math.nan
        asked, (polygon, boundary) = shapely.points((x, y)), self._prepared.mine
        closest_x, closest_y = shapely.get_coordinates(shapely.shortest_line(boundary, asked))[0].tolist()
        distance = math.hypot(x - closest_x, y - closest_y)
        return (-distance if shapely.contains(polygon, asked) else distance), closest_x, closest_y

    def placed(self, placement: ShoulderPlacement) -> Workspace:
        """The same set for another placement of the shoulder, at the same height in the shoulder's frame.

        Rounding may join touching rings: a hole that touches the outline may become a part of it.
        """
        import shapely  # noqa: PLC0415

        if not isinstance(placement, ShoulderPlacement):
            raise ConfigurationError("placement", placement, "a ShoulderPlacement")

        def moved(points: Array) -> Array:
            return placement.to_robot(self.placement.to_shoulder(points))

        polygon = shapely.transform(self.polygon, moved)
        if not polygon.is_valid:  # rings that touched now cross, by rounding
            polygon = polygon.buffer(0.0)
        return Workspace(
            polygon,
            accuracy=self.accuracy,
            height=self.height,
            handle_tilt=self.handle_tilt,
            placement=placement,
            reason=self.reason,
        )

    @cached_property
    def _prepared(self) -> PerThread[tuple[BaseGeometry, BaseGeometry]]:
        """The polygon and its boundary, one copy per thread, because GEOS modifies them in queries."""
        import shapely  # noqa: PLC0415

        def made() -> tuple[BaseGeometry, BaseGeometry]:
            with COPYING:
                polygon = shapely.force_2d(self.polygon)
            geometries = polygon, polygon.boundary
            shapely.prepare(geometries)
            return geometries

        return PerThread(made)


def _rebuilt(given: dict[str, Any]) -> Workspace:
    return Workspace(**given)


def _checked(polygon: Any) -> Any:
    import shapely  # noqa: PLC0415

    expected = "a valid shapely Polygon or MultiPolygon in metres"
    if not isinstance(polygon, shapely.Polygon | shapely.MultiPolygon):
        raise ConfigurationError("polygon", polygon, expected)
    if not (np.abs(shapely.get_coordinates(polygon)) <= ROOM).all():
        raise ConfigurationError(
            "polygon", f"coordinates that are not finite or above {ROOM:g} m (in millimetres?)", expected
        )
    if not polygon.is_valid:
        raise ConfigurationError("polygon", shapely.is_valid_reason(polygon), expected)
    low_x, low_y, high_x, high_y = polygon.bounds
    if not (polygon.is_empty or max(high_x - low_x, high_y - low_y) >= SMALLEST):
        raise ConfigurationError("polygon", f"one less than {SMALLEST:g} m wide", expected)
    return shapely.force_2d(polygon)


def _number(argument: str, value: object, *, low: float = -math.inf) -> float:
    if is_finite(value) and value >= low:
        return float(value)
    raise ConfigurationError(argument, value, "a finite number" + (f" of at least {low:g}" if low == 0 else ""))
