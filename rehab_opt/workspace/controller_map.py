"""A workspace map for use in a tick: one point at a time, no exceptions, images inside the target."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from rehab_opt.errors import ConfigurationError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from rehab_opt.workspace.audit import Audit
    from rehab_opt.workspace.plane_map import PlaneMap
    from rehab_opt.workspace.region import Workspace

__all__ = ["ControllerMap"]


@dataclass(frozen=True, eq=False)
class ControllerMap:
    """A map for a controller, made by `WorkspaceMap.for_controller`, which refuses a map with a failed audit.

    The constructor itself does not check that the audit belongs to the spline. A point outside the source counts as the
    nearest point of the source. Numbers never raise an error, and NaN gives NaN. Immutable; threads may share it.

    Attributes
    ----------
    audit : of the map.
    unsafe : whether a failed audit was accepted.

    Raises
    ------
    ConfigurationError : the audit fails and `unsafe` is not True.
    """

    source: Workspace
    spline: PlaneMap
    audit: Audit
    unsafe: bool = field(default=False, kw_only=True)

    def __post_init__(self) -> None:
        """Refuse a failed map, and build the functions before the first tick."""
        if not self.audit.passed and self.unsafe is not True:
            expected = f"a map that passes its audit, or unsafe=True; this one: {'; '.join(self.audit.reasons)}"
            raise ConfigurationError("map", f"map of {self.spline.parameters} coefficients", expected)
        point = self.spline.known[0]
        self.image(point)
        self.jacobian(point)

    def image(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """Image (2,) [m] of a point (2,) [m]."""
        return self.spline(self.source.nearest(point))

    def jacobian(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """Derivatives d image_i / d point_j (2, 2) at a point (2,) [m]."""
        return self.spline.jacobian(self.source.nearest(point))

    def preimage(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """Point of the source (2,) [m] with this image, by Newton's method, for displays; NaN if none is found."""
        found = self.spline.inverse(point)
        return found if self.source.contains(found) else found * math.nan
