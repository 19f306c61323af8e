"""The part of a plane that a hand can reach, with the questions a controller asks of it a thousand times a second."""

from __future__ import annotations

import math
from functools import cached_property
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.workspace.edge_lookup import EdgeLookup
from rehab_opt.workspace.placement import ShoulderPlacement

if TYPE_CHECKING:
    import shapely

__all__ = ["Workspace"]

Array = NDArray[np.float64]
_FLOATS = np.dtype(np.float64)

ON_BOUNDARY = 1e-12
"""[m], and per metre of coordinate: nearer to the boundary than this counts as on it, and so as inside."""


class Workspace:
    """A closed set of points (x, y) in a horizontal plane; immutable, comparable by identity, picklable.

    Parameters
    ----------
    polygon : shapely Polygon or MultiPolygon [m] in the robot's frame; holes and several parts allowed, or empty.
    accuracy : [m] largest distance between the true boundary and the polygon's.
    height : [m] of the plane in the shoulder's frame.
    handle_tilt : [rad] largest angle of the handle from the vertical that was allowed; None for any.
    placement : where the shoulder stands.
    reason : why it is empty; "" where it is not.

    Raises
    ------
    ConfigurationError : what is no valid polygon, an accuracy below zero, numbers that are not finite.
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
        """Whether it has no area."""
        return bool(self.polygon.is_empty)

    @property
    def area(self) -> float:
        """[m^2]"""
        return float(self.polygon.area)

    @property
    def components(self) -> int:
        """Number of separate parts."""
        return 0 if self.empty else len(getattr(self.polygon, "geoms", (self.polygon,)))

    @property
    def holes(self) -> int:
        """Number of holes, of all parts."""
        parts = getattr(self.polygon, "geoms", (self.polygon,))
        return sum(len(part.interiors) for part in parts)

    @property
    def robot_height(self) -> float:
        """[m] of the plane in the robot's frame."""
        return self.height + self.placement.position[2]

    # ----------------------------------------------------------------------------------------------------- queries
    def contains(self, points: ArrayLike) -> bool | NDArray[np.bool_]:
        """Whether points [m] are reachable: (2,) -> bool, (N, 2) -> (N,).

        The boundary, to rounding, is inside; what is not a finite number is not.
        """
        point = _one(points)
        if point is None:
            return self._all_contained(_many(points))
        lookup = self._lookup
        if lookup is None:
            return False
        status = lookup.status(*point)
        if status >= 0:
            return status == 1
        x, y = point
        return lookup.signed(x, y)[0] - ON_BOUNDARY * (1.0 + abs(x) + abs(y)) <= 0.0  # so that inf - inf fails

    def distance(self, points: ArrayLike) -> float | Array:
        """Signed distance to the boundary [m], negative inside: (2,) -> float, (N, 2) -> (N,).

        Exact for the polygon to rounding; infinite where the workspace is empty, NaN for a point that is NaN.
        """
        point = _one(points)
        if point is None:
            return np.array([self.distance(each) for each in _many(points).tolist()])
        lookup = self._lookup
        if lookup is None:
            return math.nan if any(map(math.isnan, point)) else math.inf
        return lookup.signed(*point)[0]

    def nearest(self, point: ArrayLike) -> Array:
        """(2,) [m] the reachable point nearest to `point` (2,), itself where it is reachable.

        NaN where the workspace is empty or the point is not finite.
        """
        found = _one(point)
        if found is None:
            raise ConfigurationError("point", np.shape(point), "two numbers")
        distance, x, y = self.signed_distance_and_foot(found)
        return np.array(found) if distance <= 0.0 else np.array((x, y))

    def signed_distance_and_foot(self, point: ArrayLike) -> tuple[float, float, float]:
        """`distance` of a point (2,), and the x and y of the boundary's nearest point: one look-up for both."""
        found = _one(point)
        if found is None:
            raise ConfigurationError("point", np.shape(point), "two numbers")
        lookup = self._lookup
        if lookup is None:
            return math.inf, math.nan, math.nan
        return lookup.signed(*found)

    def placed(self, placement: ShoulderPlacement) -> Workspace:
        """The same set for a shoulder placed there instead; the plane keeps its height below the shoulder."""
        import shapely  # noqa: PLC0415

        def moved(points: Array) -> Array:
            return placement.to_robot(self.placement.to_shoulder(points))

        return Workspace(
            shapely.transform(self.polygon, moved),
            accuracy=self.accuracy,
            height=self.height,
            handle_tilt=self.handle_tilt,
            placement=placement,
            reason=self.reason,
        )

    @cached_property
    def _lookup(self) -> EdgeLookup | None:
        return None if self.empty else EdgeLookup(self.polygon)

    def _all_contained(self, points: Array) -> NDArray[np.bool_]:
        import shapely  # noqa: PLC0415

        inside: NDArray[np.bool_] = np.zeros(len(points), dtype=bool)
        if self.empty:
            return inside
        shapely.prepare(self.polygon)
        finite = np.isfinite(points).all(axis=1)
        inside[finite] = shapely.contains_xy(self.polygon, points[finite, 0], points[finite, 1])
        # Points on the boundary, which shapely leaves out, and those that its rounding and ours see on other sides.
        near = finite & ~inside
        slack = 1e3 * ON_BOUNDARY * (1 + float(np.abs(points[near]).max(initial=0.0)))
        near[near] = shapely.dwithin(self.polygon, shapely.points(points[near]), slack)
        for i in np.flatnonzero(near):
            inside[i] = self.contains(points[i])
        return inside


def _rebuilt(given: dict[str, Any]) -> Workspace:
    return Workspace(**given)


def _one(points: ArrayLike) -> tuple[float, float] | None:
    """The coordinates of a single point; None where these are several, or none."""
    if isinstance(points, np.ndarray):
        if points.shape != (2,):
            return None
        x, y = points.tolist()
        if points.dtype is _FLOATS:  # the usual case, in a tick
            return x, y
        return (float(x), float(y)) if points.dtype.kind in "fiu" else None
    if not isinstance(points, tuple | list):
        return None
    try:
        x, y = points
        return float(x), float(y)
    except (TypeError, ValueError, OverflowError):
        return None


def _many(points: ArrayLike) -> Array:
    try:
        array = np.asarray(points, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as problem:
        raise ConfigurationError("points", points, "points (2,) or (N, 2) in metres") from problem
    if array.ndim != 2 or array.shape[1] != 2:
        raise ConfigurationError("points", f"an array of shape {array.shape}", "points (2,) or (N, 2) in metres")
    return array


def _checked(polygon: Any) -> Any:
    import shapely  # noqa: PLC0415

    expected = "a valid shapely Polygon or MultiPolygon in metres"
    if not isinstance(polygon, shapely.Polygon | shapely.MultiPolygon):
        raise ConfigurationError("polygon", polygon, expected)
    if not np.isfinite(shapely.get_coordinates(polygon)).all():
        raise ConfigurationError("polygon", "coordinates that are not finite", expected)
    if not polygon.is_valid:
        raise ConfigurationError("polygon", shapely.is_valid_reason(polygon), expected)
    return shapely.force_2d(polygon)


def _number(argument: str, value: object, *, low: float = -math.inf) -> float:
    if isinstance(value, int | float | np.integer | np.floating) and low <= value < math.inf:
        return float(value)
    raise ConfigurationError(argument, value, "a finite number" + (f" of at least {low:g}" if low == 0 else ""))
