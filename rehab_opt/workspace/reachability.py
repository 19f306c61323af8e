"""Fraction of trials in which a point was reachable, and the region of points with at least a given fraction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.workspace.point_arguments import point_array, real_number

if TYPE_CHECKING:
    from rehab_opt.workspace.region import Workspace

__all__ = ["ReachabilityMap", "fractions"]

Array = NDArray[np.float64]

SNAPPING = 0.1
"""Grid for the overlay of workspaces, as a fraction of their accuracy."""
ROUNDING = 1e-9
"""Tolerance for rounding in sums of weights, so that nine times 0.1 reaches 0.9."""


@dataclass(frozen=True, eq=False)
class ReachabilityMap:
    """Weighted fraction of the trials in which each point was reachable.

    Parameters
    ----------
    x, y : (nx,), (ny,) [m] nodes in the robot's frame, at multiples of the spacing, around all workspaces.
    grid : (ny, nx) fraction at the nodes.
    workspaces : n sets of the same plane, one per trial.
    weights : (n,) summing to one.
    """

    x: Array
    y: Array
    grid: Array
    workspaces: tuple[Workspace, ...]
    weights: Array

    def __post_init__(self) -> None:
        for array in (self.x, self.y, self.grid, self.weights):
            array.flags.writeable = False

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.x, self.y, self.grid, self.workspaces, self.weights)  # pickle drops the read-only flag

    @property
    def empty(self) -> int:
        """Number of trials in which no point of the plane was reachable."""
        return sum(workspace.empty for workspace in self.workspaces)

    def probability(self, points: ArrayLike) -> Array | float:
        """Exact fraction of the trials that reach each of the points (2,) or (N, 2) [m]; 0 for a NaN point."""
        at = point_array(points)
        found = fractions(self.workspaces, self.weights, at.reshape(-1, 2))
        return float(found[0]) if at.ndim == 1 else found

    def region(self, at_least: float = 0.9) -> Workspace:
        """Set of points that were reachable in at least the fraction `at_least` of the trials.

        It comes from the overlaid polygons, not from the grid.

        Parameters
        ----------
        at_least : fraction, above 0, at most 1.

        Returns
        -------
        Its boundary consists of pieces of the trials' boundaries, with their accuracy plus `snapping`. Common lines or
        points of polygons without common area are left out.
        """
        from rehab_opt.workspace.region import Workspace  # noqa: PLC0415  (brings shapely)

        if not 0 < real_number(at_least) <= 1:
            raise ConfigurationError("at_least", at_least, "a fraction above 0, at most 1")
        faces, seen = self._overlay
        polygon = _union(faces[seen >= at_least - ROUNDING])
        first = self.workspaces[0]
        return Workspace(
            polygon,
            accuracy=max(workspace.accuracy for workspace in self.workspaces) + self.snapping,
            height=first.height,
            handle_tilt=first.handle_tilt,
            placement=first.placement,
            reason=f"no point is reachable in {100 * at_least:g} % of {len(self.workspaces)} trials"
            if polygon.is_empty
            else "",
        )

    @property
    def snapping(self) -> float:
        """[m] grid on which regions are overlaid, a tenth of the finest workspace's accuracy.

        Without it, boundaries that coincide within their accuracy would cross thousands of times.
        """
        return SNAPPING * float(min(workspace.accuracy for workspace in self.workspaces))

    @cached_property
    def _overlay(self) -> tuple[NDArray[Any], Array]:
        """Two results: faces (m,) between all boundaries, and the fraction (m,) of trials that contain each."""
        import shapely  # noqa: PLC0415  (heavy)

        rings = [workspace.polygon.boundary for workspace in self.workspaces if not workspace.empty]
        faces = (
            shapely.get_parts(shapely.polygonize([shapely.unary_union(rings, grid_size=self.snapping)]))
            if rings
            else np.array([])
        )
        inside = shapely.get_coordinates(shapely.point_on_surface(faces)) if len(faces) else np.empty((0, 2))
        return np.asarray(faces), fractions(self.workspaces, self.weights, inside)


def fractions(workspaces: Sequence[Workspace], weights: Array, points: Array) -> Array:
    """(N,) weighted fraction of the workspaces that contain each of the points (N, 2)."""
    total = np.zeros(len(points))
    for workspace, weight in zip(workspaces, weights, strict=True):
        if not workspace.empty and len(points):
            total += weight * np.asarray(workspace.contains(points))
    return np.where(total > 1 - ROUNDING, 1.0, total)  # exactly one if all trials contain the point


def _union(faces: NDArray[Any]) -> Any:
    """Union of faces as a polygon or multipolygon; an empty polygon if there are no faces."""
    import shapely  # noqa: PLC0415  (heavy)

    union = shapely.unary_union(faces) if len(faces) else shapely.Polygon()
    return union if isinstance(union, shapely.Polygon | shapely.MultiPolygon) else shapely.Polygon()
