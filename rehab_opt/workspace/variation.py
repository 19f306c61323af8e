"""How often a person reaches each point if the limits vary between trials or days (VII-A, Rossa et al.)."""

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
from rehab_opt.kinematics.real_array import real_array
from rehab_opt.workspace.point_arguments import real_number
from rehab_opt.workspace.reachability import ReachabilityMap, fractions
from rehab_opt.workspace.used_range import named_ranges

if TYPE_CHECKING:
    from rehab_opt.workspace.placement import ShoulderPlacement
    from rehab_opt.workspace.region import Workspace

__all__ = ["ReachabilityMap", "reachability_map", "varied_ranges"]

Array = NDArray[np.float64]


FURTHEST = 2.0
"""Number of standard deviations at which the normal distribution is cut."""


def varied_ranges(
    range_of_motion: str | Mapping[str, Sequence[float]],
    *,
    spread: float | Mapping[str, float | Sequence[float]],
    count: int,
    seed: int,
) -> tuple[dict[str, tuple[float, float]], ...]:
    """`count` ranges of motion, each valid as `human_arm(range_of_motion=...)`.

    Each limit is drawn from a normal distribution around its nominal value. The distribution is cut at two standard
    deviations, which reduces its standard deviation to 0.88 of `spread`. Limits are independent, whereas those of a
    person tend to vary together; inverted pairs are drawn again. Joints with equal limits stay locked.

    Parameters
    ----------
    range_of_motion : nominal (lower, upper) [rad] by joint, or a name of `human_arm`.
    spread : [rad] standard deviation of every limit, or by joint, for both limits or (lower, upper). Missing joints do
        not vary. `ReachGroup.spread` has this form.
    count, seed : number of draws, and seed. Equal seeds give equal ranges; a larger count begins with the same ones.

    Raises
    ------
    ConfigurationError : an unknown joint, an inverted range, a negative spread, no draws.
    """
    nominal = named_ranges("range_of_motion", range_of_motion)
    if not isinstance(count, int | np.integer) or not count >= 1:
        raise ConfigurationError("count", count, "a whole number of 1 or more")
    if not isinstance(seed, int | np.integer) or not seed >= 0:
        raise ConfigurationError("seed", seed, "a whole number of 0 or more")
    deviations = dict.fromkeys(nominal, (0.0, 0.0))
    for name, given in spread.items() if isinstance(spread, Mapping) else [(name, spread) for name in nominal]:
        if name not in nominal:
            raise ConfigurationError("spread", name, f"joint names among {', '.join(nominal)}")
        deviations[name] = _deviations(name, given)
    rng = np.random.default_rng(seed)
    drawn = []
    for _ in range(count):
        limits = {}
        for name, (lower, upper) in nominal.items():
            kept = lower == upper or deviations[name] == (0.0, 0.0)
            limits[name] = (lower, upper) if kept else _pair((lower, upper), deviations[name], rng)
        drawn.append(limits)
    return tuple(drawn)


def _pair(
    nominal: tuple[float, float], deviation: tuple[float, float], rng: np.random.Generator
) -> tuple[float, float]:
    # Symmetric about an ordered pair: every draw is in order with probability 1/2 or more.
    while True:
        z = rng.standard_normal(2)
        lower, upper = nominal[0] + deviation[0] * float(z[0]), nominal[1] + deviation[1] * float(z[1])
        if np.abs(z).max() <= FURTHEST and lower <= upper:
            return lower, upper


def _deviations(name: str, given: float | Sequence[float]) -> tuple[float, float]:
    try:
        lower, upper = (float(given),) * 2 if np.ndim(given) == 0 else (float(part) for part in given)  # type: ignore
    except (TypeError, ValueError, OverflowError):
        lower = upper = math.nan
    if not (0 <= lower < math.inf and 0 <= upper < math.inf):
        raise ConfigurationError(f"spread[{name!r}]", given, "an angle of 0 or more, or (lower, upper) of such")
    return lower, upper


MAX_NODES = 4_000_000


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
    """Fraction of several trials or days in which each point of a plane is reachable.

    Parameters
    ----------
    limbs : one per trial: a range of motion (`range_of_motion`, `varied_ranges`), an arm, or a finished workspace. All
        must have the same plane, tilt and placement.
    weights : (n,) of the trials, not negative, of any sum; equal by default.
    height, handle_tilt, placement, options : of `planar_workspace`, for ranges and arms.
    spacing : [m] of the grid.
    segments, side : of `human_arm`, for ranges.
    executor : pool of processes, or executor of a dask client, that computes the workspaces, one per task; None: this
        process.

    Raises
    ------
    ConfigurationError : no limbs, weights that do not fit, workspaces of different planes, a grid too fine; and as in
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
    grid = fractions(workspaces, given, nodes).reshape(len(y), len(x))
    return ReachabilityMap(x, y, grid, workspaces, given)


def _workspace(arm: SerialChain, asked: Mapping[str, Any]) -> Workspace:
    from rehab_opt.workspace.reach import planar_workspace  # noqa: PLC0415  (brings shapely and the solver)

    return planar_workspace(arm, **asked)


def _checked_weights(weights: ArrayLike | None, n: int) -> Array:
    try:
        given = np.ones(n) if weights is None else real_array(weights)
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
    """Multiples of `spacing` from below to above every workspace; none if all are empty."""
    bounds = np.array([workspace.polygon.bounds for workspace in workspaces if not workspace.empty]).reshape(-1, 4)
    if not len(bounds):
        return np.empty(0), np.empty(0)
    low, high = np.floor(bounds[:, :2].min(axis=0) / spacing), np.ceil(bounds[:, 2:].max(axis=0) / spacing)
    if not np.prod(high - low + 1) <= MAX_NODES:
        raise ConfigurationError("spacing", spacing, f"at most {MAX_NODES} nodes around the workspaces")
    return spacing * np.arange(low[0], high[0] + 1), spacing * np.arange(low[1], high[1] + 1)
