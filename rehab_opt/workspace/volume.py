"""The three-dimensional sets of Fig. 3(a), Rossa et al.: stacked slices, and a closed mesh around them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.kinematics.real_array import real_array
from rehab_opt.symbolic import Compile
from rehab_opt.workspace.layered_mesh import SurfaceMesh, closed_mesh, edges_of_slabs
from rehab_opt.workspace.placement import ShoulderPlacement
from rehab_opt.workspace.plane_statement import PlaneStatement
from rehab_opt.workspace.point_arguments import real_number
from rehab_opt.workspace.reach import checked_placement, checked_plane, planar_workspace
from rehab_opt.workspace.why_empty import heights as extreme_heights

if TYPE_CHECKING:
    from rehab_opt.workspace.region import Workspace

__all__ = ["ReachableVolume", "reachable_volume"]

Array = NDArray[np.float64]

SLABS = 24
"""Default number of slices between the lowest and the highest hand."""
MAX_SLABS = 10_000
ACROSS = 4.0
"""Spacing of the nodes inside a slice, as a multiple of the accuracy."""


@dataclass(frozen=True, eq=False)
class ReachableVolume:
    """Points that a hand reaches with the handle within a tilt of the vertical, or with the handle free (tilt None).

    Each slice represents a slab that ends halfway to its neighbours. Picklable.

    Parameters
    ----------
    heights : (n,) [m] of the slices in the shoulder's frame, increasing.
    slices : n workspaces in the robot's frame, some may be empty.
    vertices : (V, 3) [m] of the mesh, in the robot's frame.
    triangles : (T, 3) counterclockwise from outside; every edge belongs to two.
    reason : why it is empty; "" if it is not.
    """

    heights: Array
    slices: tuple[Workspace, ...]
    vertices: Array
    triangles: NDArray[np.int64]
    reason: str = ""

    @property
    def empty(self) -> bool:
        """Whether the reachable set has no volume."""
        return all(each.empty for each in self.slices)

    @cached_property
    def volume(self) -> float:
        """[m^3] volume of the slabs: the sum of area times thickness."""
        return float(self._thickness @ [each.area for each in self.slices]) if self.slices else 0.0

    @cached_property
    def volume_bound(self) -> float:
        """[m^3] bound of the difference between the volume of the mesh and `volume`.

        Between two slices A and B the mesh contains at least their intersection and at most their union; the slabs
        contain the mean of both. The bound is half of the symmetric difference plus the node spacing along the
        outlines.
        """
        if self.empty:
            return 0.0
        polygons = [each.polygon for each in self.slices]
        steps = np.diff(self.heights)
        between = [0.5 * step * a.symmetric_difference(b).area for step, a, b in zip(steps, polygons, polygons[1:])]  # noqa: B905
        outlines = [
            each.accuracy * each.polygon.length * thickness
            for each, thickness in zip(self.slices, self._thickness, strict=True)
        ]
        return float(sum(between) + sum(outlines))

    @cached_property
    def _thickness(self) -> Array:
        return np.diff(edges_of_slabs(self.heights))


def reachable_volume(
    arm: SerialChain,
    *,
    heights: Sequence[float] | Array | None = None,
    spacing: float | None = None,
    handle_tilt: float | None = math.radians(2.0),
    accuracy: float = 4e-3,
    placement: ShoulderPlacement | None = None,
    executor: Executor | None = None,
    compile: Compile = None,
) -> ReachableVolume:
    """All points that the hand reaches within the joint limits, as stacked slices and a closed mesh.

    Parameters
    ----------
    arm : as for `planar_workspace`.
    heights : (n,) [m] of at least two slices, increasing, in the shoulder's frame. None spreads them between the lowest
        and the highest hand, which optimisation finds.
    spacing : [m] between the spread slices; None for 1/24 of the range.
    handle_tilt : [rad] largest angle between handle and vertical; None drops the constraint, as Fig. 3(a) does.
    accuracy : [m] of the slices' outlines, and node spacing of the mesh. The default is coarser than a single slice's,
        so that a volume takes seconds. Holes narrower than six times the accuracy may be missed.
    placement : of the shoulder in the robot's frame.
    executor : pool of processes, or executor of a dask client, that computes the slices, one per task; None: this
        process.
    compile : see `BufferedFunction`.

    Raises
    ------
    ConfigurationError : an invalid argument.
    """
    placement = checked_placement(placement)
    checked_plane(arm, 0.0, handle_tilt, accuracy, None)
    if spacing is not None and not 0 < real_number(spacing) < math.inf:
        raise ConfigurationError("spacing", spacing, "a length above 0, or None")
    levels: Array | str = _spread(arm, handle_tilt, spacing) if heights is None else _checked_heights(heights)
    nothing = np.zeros((0, 3))
    if isinstance(levels, str):
        return ReachableVolume(np.zeros(0), (), nothing, nothing.astype(np.int64), levels)
    asked: list[dict[str, Any]] = [
        {
            "height": float(height), "handle_tilt": handle_tilt, "accuracy": accuracy,
            "resolution": ACROSS * accuracy, "placement": placement, "compile": compile,
        }
        for height in levels
    ]  # fmt: skip
    if executor is None:
        slices = tuple(planar_workspace(arm, **each) for each in asked)
    else:
        tasks = [executor.submit(planar_workspace, arm, **each) for each in asked]
        slices = tuple(task.result() for task in tasks)
    if all(each.empty for each in slices):
        return ReachableVolume(levels, slices, nothing, nothing.astype(np.int64), slices[len(slices) // 2].reason)
    mesh: SurfaceMesh = closed_mesh([each.polygon for each in slices], levels, spacing=accuracy)
    mesh.vertices[:, 2] += placement.position[2]
    return ReachableVolume(levels, slices, mesh.vertices, mesh.triangles)


def _spread(arm: SerialChain, handle_tilt: float | None, spacing: float | None) -> Array | str:
    """(n,) heights in the middles of equal slabs between the lowest and highest hand; or the reason for none."""
    if arm.locked.all():
        return "every joint is locked: the hand is at one point"
    statement = PlaneStatement(arm, handle_tilt=None if handle_tilt is None or handle_tilt >= math.pi else handle_tilt)
    low, high = extreme_heights(statement, held=True)
    if not max(low.violation, high.violation) <= 1e-8:
        return "no posture was found that holds the handle within its tilt"
    bottom, top = float(low.report[0]), float(high.report[0])
    if not top - bottom > 1e-6:
        return f"the hand stays at {bottom:.4g} m"
    count = SLABS if spacing is None else max(2, math.ceil((top - bottom) / spacing))
    if count > MAX_SLABS:
        raise ConfigurationError("spacing", spacing, f"at most {MAX_SLABS} slices")
    return bottom + (top - bottom) * (np.arange(count) + 0.5) / count


def _checked_heights(heights: object) -> Array:
    try:
        levels = np.array(real_array(heights))
    except (TypeError, ValueError, OverflowError):
        levels = np.empty(0)
    if levels.ndim != 1 or len(levels) < 2 or not np.all(np.isfinite(levels)) or not np.all(np.diff(levels) > 0):
        raise ConfigurationError("heights", heights, "at least two finite heights, increasing")
    return levels
