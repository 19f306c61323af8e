"""The set of hand positions a limb can reach in a horizontal plane with the handle upright (II-D, Rossa et al.)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.symbolic import Compile
from rehab_opt.workspace.lattice import TooManyNodesError
from rehab_opt.workspace.outline import THINNEST
from rehab_opt.workspace.placement import ShoulderPlacement
from rehab_opt.workspace.plane_search import PlaneSearch
from rehab_opt.workspace.plane_statement import PlaneStatement
from rehab_opt.workspace.point_arguments import real_number
from rehab_opt.workspace.slice_search import SliceSearch
from rehab_opt.workspace.why_empty import last_try

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

    from rehab_opt.workspace.region import Workspace

__all__ = ["Slice", "checked_placement", "checked_plane", "planar_workspace", "slice_at"]

SPREAD = 512
"""Number of postures at the start of the search."""
REPAIRS = 3
CHECKED = 0.9
"""Distance of the probes from the polygon, as a fraction of the accuracy; the rest covers points between probes."""
MORE = 1024
"""Number of further postures if the first ones gave nothing."""
CONSTANT = 1e-6
"""[m, rad] Tolerance of a height or tilt that no joint changes."""
FAR = 100.0
"""[m] Largest accepted magnitude of a prismatic joint's limit."""


class Slice(NamedTuple):
    """A reachable set in the shoulder's frame, with its accuracy."""

    polygon: BaseGeometry
    accuracy: float
    """[m] as requested, or more if the check failed."""
    reason: str
    failed: int
    """Number of probes that still contradicted the polygon at the requested accuracy."""
    probes: int
    solves: int
    uncertified: int
    failures: int
    """Numbers of solver calls: all, without a certified minimum, and off the plane or with a tilted handle."""


def planar_workspace(
    arm: SerialChain,
    *,
    height: float = -0.24,
    handle_tilt: float | None = math.radians(2.0),
    accuracy: float = 1e-3,
    resolution: float | None = None,
    placement: ShoulderPlacement | None = None,
    compile: Compile = None,
) -> Workspace:
    """All points of a horizontal plane that the hand reaches within the joint limits with the handle upright.

        W = {(x, y): some q with lower <= q <= upper, p(q) = (x, y, height), x_n(q) . z_0 >= cos(handle_tilt)}

    W is not sampled: nonlinear programming decides whether the distance from a node to W is zero, and finds each
    boundary vertex as the point of W nearest to an outside probe. The finished boundary is probed on both sides.

    Parameters
    ----------
    arm : any chain; the handle is the last frame's x axis. Joints with equal limits are locked.
    height : [m] of the plane in the shoulder's (the chain's base) frame.
    handle_tilt : [rad] 0 to pi, largest angle between the handle and +z; None for no such constraint.
    accuracy : [m] 1e-5 to 0.05; largest distance between the true boundary and the polygon's. If the check cannot
        confirm it, the result states a larger value.
    resolution : [m] largest spacing of the nodes inside, at most 1/24 of the set; None for 8 mm. Holes that contain a
        disc of 1.42 times that diameter are found, smaller ones only if a node lies in them. The search starts at 512
        spread postures: a separate part with less than about 1 % of all postures may be missed.
    placement : of the shoulder in the robot's frame, in which the polygon is given.
    compile : see `BufferedFunction`; a new kind of arm compiles once, in two seconds.

    Returns
    -------
    A workspace; empty, with a reason, if the reachable set has no area.

    Raises
    ------
    ConfigurationError : an invalid argument; an accuracy too fine for the size of the set.
    """
    import shapely  # noqa: PLC0415  (heavy)

    from rehab_opt.workspace.region import Workspace  # noqa: PLC0415  (brings shapely)

    placement = checked_placement(placement)
    found = slice_at(
        arm, height=height, handle_tilt=handle_tilt, accuracy=accuracy, resolution=resolution, compile=compile
    )
    placed = shapely.transform(found.polygon, placement.to_robot)
    return Workspace(
        placed, accuracy=found.accuracy, height=height, handle_tilt=handle_tilt, placement=placement,
        reason=found.reason,
    )  # fmt: skip


def slice_at(
    arm: SerialChain,
    *,
    height: float,
    handle_tilt: float | None,
    accuracy: float,
    resolution: float | None = None,
    compile: Compile = None,
) -> Slice:
    """The slice of `planar_workspace` in the shoulder's frame, with the counts of its search."""
    checked_plane(arm, height, handle_tilt, accuracy, resolution)
    limit = None if handle_tilt is None or handle_tilt >= math.pi else float(handle_tilt)
    if arm.locked.all():
        return _empty(_of_one_posture(arm, height, limit), accuracy)
    height, accuracy = float(height), float(accuracy)  # numpy's single precision overflows in comparisons
    statement = PlaneStatement(arm, handle_tilt=limit)
    still, upright = statement.constant_height, statement.constant_tilt
    if still is not None and not abs(still - height) <= CONSTANT:
        return _empty(f"height {height:.4g} m is out of reach: the hand stays at {still:.4g} m", accuracy)
    if limit is not None and upright is not None and not upright <= limit + CONSTANT:
        least, most = math.degrees(upright), math.degrees(limit)
        return _empty(
            f"no posture holds the handle within {most:.4g} deg of vertical: it stays at {least:.4g} deg", accuracy
        )
    search = PlaneSearch(statement, height=height, compile=compile)
    seeds = search.spread(SPREAD) or search.spread(MORE)
    if not seeds:
        seeds, reason = last_try(search, limit)
        if not seeds:
            return _empty(reason, accuracy, search)
    try:
        return _searched(SliceSearch(search, seeds, accuracy=accuracy, resolution=resolution))
    except TooManyNodesError:
        raise ConfigurationError("accuracy", accuracy, "a coarser one for a set of this size") from None


def _searched(slice_search: SliceSearch) -> Slice:
    """Search the slice, check it, repair contradictions, and state the accuracy that the check confirms."""
    search, accuracy = slice_search.search, slice_search.accuracy
    slice_search.fill()
    slice_search.surround()
    polygon = slice_search.polygon()
    wrong, probes = slice_search.contradictions(polygon, CHECKED * accuracy)
    for _ in range(REPAIRS):
        if not wrong:
            break
        slice_search.repair(wrong)
        polygon = slice_search.polygon()
        wrong, probes = slice_search.contradictions(polygon, CHECKED * accuracy)
    if polygon.is_empty:
        return _empty(f"what is reached is thinner than {1e3 * THINNEST:.2g} mm", accuracy, search)
    stated = accuracy
    while wrong and stated < polygon.length:
        stated *= 2
        if not slice_search.contradictions(polygon, CHECKED * stated, deep=CHECKED * stated)[0]:
            break
    return Slice(polygon, stated, "", len(wrong), probes, search.solves, search.uncertified, search.failures)


def _of_one_posture(arm: SerialChain, height: float, handle_tilt: float | None) -> str:
    pose = arm.pose(arm.lower)
    tilt = math.atan2(math.hypot(pose[0, 0], pose[1, 0]), pose[2, 0])
    where = f"every joint is locked: the hand is at ({pose[0, 3]:.4g}, {pose[1, 3]:.4g}, {pose[2, 3]:.4g}) m"
    if abs(pose[2, 3] - height) <= CONSTANT and (handle_tilt is None or tilt <= handle_tilt + CONSTANT):
        return f"{where}, a point without area"
    return f"{where}, the handle {math.degrees(tilt):.4g} deg from vertical"


def _empty(reason: str, accuracy: float, search: PlaneSearch | None = None) -> Slice:
    import shapely  # noqa: PLC0415  (heavy)

    counts = (0, 0, 0) if search is None else (search.solves, search.uncertified, search.failures)
    return Slice(shapely.Polygon(), accuracy, reason, 0, 0, *counts)


def checked_plane(arm: object, height: object, handle_tilt: object, accuracy: object, resolution: object) -> None:
    """Raise `ConfigurationError` for invalid arguments of a slice."""
    if not isinstance(arm, SerialChain):
        raise ConfigurationError("arm", arm, "a SerialChain")
    tilt, widest = 0.0 if handle_tilt is None else handle_tilt, 1.0 if resolution is None else resolution
    for name, value, low, high, expected in (
        ("height", height, -1e3, 1e3, "a finite height in metres"),
        ("handle_tilt", tilt, 0.0, math.pi, "an angle from 0 to pi rad, or None"),
        ("accuracy", accuracy, 1e-5, 0.05, "a length from 1e-5 to 0.05 m"),
        ("resolution", widest, 1e-5, 1.0, "a length from 1e-5 to 1 m, or None"),
    ):
        if not low <= real_number(value) <= high:
            raise ConfigurationError(name, value, expected)
    for row, name, low, high in zip(arm.rows, arm.names, arm.lower, arm.upper, strict=True):
        if row.prismatic and not -FAR <= low <= high <= FAR:
            raise ConfigurationError(f"limits of {name}", (float(low), float(high)), f"a slide within {FAR:g} m")


def checked_placement(placement: object) -> ShoulderPlacement:
    """`placement`, at the origin by default."""
    if placement is None:
        return ShoulderPlacement()
    if not isinstance(placement, ShoulderPlacement):
        raise ConfigurationError("placement", placement, "a ShoulderPlacement, or None")
    return placement
