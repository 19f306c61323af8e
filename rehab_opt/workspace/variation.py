"""Where a person reaches how often, when the limits vary between trials or days (VII-A, Rossa et al.)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.kinematics.human_arm import ARM_SEGMENTS, human_arm
from rehab_opt.workspace.number_arguments import real_number
from rehab_opt.workspace.reachability import ReachabilityMap, shares
from rehab_opt.workspace.varied_ranges import varied_ranges

if TYPE_CHECKING:
    from rehab_opt.workspace.placement import ShoulderPlacement
    from rehab_opt.workspace.region import Workspace

__all__ = ["ReachabilityMap", "reachability_map", "varied_ranges"]

Array = NDArray[np.float64]

MOST_NODES = 4_000_000


def reachability_map(
    limbs: Sequence[Workspace | SerialChain | Mapping[str, Sequence[float]]],
    *,
    weights: ArrayLike | None = None,
    height: float = -0.24,
    handle_tilt: float | None = math.radians(2.0),
    spacing: float = 0.005,
    placement: ShoulderPlacement | None = None,
    segments: Mapping[str, float] | Sequence[float] = ARM_SEGMENTS,
    side: Literal["left", "right"] = "left",
    executor: Executor | None = None,
    **options: Any,
) -> ReachabilityMap:
    """How often each point of a plane is reachable, over the ranges of several trials or days.

    Parameters
    ----------
    limbs : one a trial: a range of motion (`range_of_motion`, `varied_ranges`), an arm, or a workspace already found.
        A workspace is taken as it is; all must be of one plane, tilt and placement.
    weights : (n,) of the trials, not negative, of any sum; equal by default.
    height, handle_tilt, placement, options : of `planar_workspace`, for ranges and arms.
    spacing : [m] of the grid.
    segments, side : of `human_arm`, for ranges.
    executor : where the workspaces are found, one task each: a pool of processes, or a dask client's. Here, in turn,
        without one.

    Raises
    ------
    ConfigurationError : no limbs, weights that do not fit, workspaces of different planes, a grid too fine; and as
        `planar_workspace` and `human_arm`.
    """
    from rehab_opt.workspace.region import Workspace  # noqa: PLC0415  (brings shapely)

    if isinstance(limbs, str) or not isinstance(limbs, Sequence) or not limbs:
        raise ConfigurationError("limbs", limbs, "a sequence of ranges of motion, arms or workspaces, at least one")
    if not 0 < real_number(spacing) < math.inf:
        raise ConfigurationError("spacing", spacing, "a length above 0")
    given = _checked_weights(weights, len(limbs))
    known = [limb if isinstance(limb, Workspace) else None for limb in limbs]
    arms = [
        limb if isinstance(limb, SerialChain) else human_arm(range_of_motion=limb, segments=segments, side=side)
        for limb in limbs
        if not isinstance(limb, Workspace)
    ]
    asked = {"height": height, "handle_tilt": handle_tilt, **options}
    if placement is not None:
        asked["placement"] = placement
    if executor is None:
        found = [_workspace(arm, asked) for arm in arms]
    else:
        found = [task.result() for task in [executor.submit(_workspace, arm, asked) for arm in arms]]
    rest = iter(found)
    workspaces = tuple(workspace if workspace is not None else next(rest) for workspace in known)
    _check_one_plane(workspaces)
    x, y = _nodes(workspaces, spacing)
    nodes = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    grid = shares(workspaces, given, nodes).reshape(len(y), len(x))
    return ReachabilityMap(x, y, grid, workspaces, given)


def _workspace(arm: SerialChain, asked: Mapping[str, Any]) -> Workspace:
    from rehab_opt.workspace.reach import planar_workspace  # noqa: PLC0415  (brings shapely and the solver)

    return planar_workspace(arm, **asked)


def _checked_weights(weights: ArrayLike | None, n: int) -> Array:
    try:
        given = np.ones(n) if weights is None else np.array(weights, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        given = np.empty(0)
    if given.shape != (n,) or not np.all(given >= 0) or not 0 < given.sum() < math.inf:
        raise ConfigurationError("weights", weights, f"{n} finite numbers of 0 or more, one above 0")
    return np.asarray(given / given.sum())


def _check_one_plane(workspaces: Sequence[Workspace]) -> None:
    first = workspaces[0]
    for workspace in workspaces[1:]:
        planes = [(w.height, w.handle_tilt, tuple(w.placement.position), w.placement.turn) for w in (first, workspace)]
        if planes[0] != planes[1]:
            raise ConfigurationError("limbs", planes[1], f"one (height, handle_tilt, placement), as {planes[0]}")


def _nodes(workspaces: Sequence[Workspace], spacing: float) -> tuple[Array, Array]:
    """Multiples of `spacing` that surround every workspace; none where all are empty."""
    bounds = np.array([workspace.polygon.bounds for workspace in workspaces if not workspace.empty]).reshape(-1, 4)
    if not len(bounds):
        return np.empty(0), np.empty(0)
    low, high = np.floor(bounds[:, :2].min(axis=0) / spacing), np.ceil(bounds[:, 2:].max(axis=0) / spacing)
    if not np.prod(high - low + 1) <= MOST_NODES:
        raise ConfigurationError("spacing", spacing, f"at most {MOST_NODES} nodes around the workspaces")
    return spacing * np.arange(low[0], high[0] + 1), spacing * np.arange(low[1], high[1] + 1)
