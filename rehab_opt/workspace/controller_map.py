"""A map as a controller holds it: one point at a time, never raising, never outside the target."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from rehab_opt.workspace.audit import Audit
    from rehab_opt.workspace.region import Workspace
    from rehab_opt.workspace.spline import ThinPlateSpline

__all__ = ["ControllerMap"]


@dataclass(frozen=True, eq=False)
class ControllerMap:
    """Made by `WorkspaceMap.for_controller` alone, which refuses a map that fails its audit.

    A point outside the source counts as the nearest point of the source. NaN gives NaN; nothing raises on numbers.

    Attributes
    ----------
    audit : of the map; `audit.passed` is False for one that was handed out with unsafe=True.
    """

    source: Workspace
    spline: ThinPlateSpline
    audit: Audit

    def image(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """Where a point (2,) [m] is mapped, (2,) [m]."""
        return self.spline(self._inside(point))

    def jacobian(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """Derivatives d image_i / d point_j (2, 2) at a point (2,) [m]."""
        return self.spline.jacobian(self._inside(point))

    def push_force(self, point: NDArray[np.float64], force: NDArray[np.float64]) -> NDArray[np.float64]:
        """A force (2,) [N] at the image of a point (2,) [m], as felt at the point: J' F, equal power on both sides."""
        return self.jacobian(point).T @ force

    def _inside(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        return point if self.source.contains(point) else self.source.nearest(point)
