"""When assistance acts: Eq. (23), Rossa et al., and its counterpart of section VI."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Literal, get_args

from rehab_opt.errors import ConfigurationError

if TYPE_CHECKING:
    from rehab_opt.field.potential import PotentialField
    from rehab_opt.workspace.region import Workspace

__all__ = ["Mode", "WantedForce", "kept_inside", "wanted_force"]

Mode = Literal["stretch", "assist", "resist", "follow", "hold"]
WantedForce = Callable[[float, float, float, float], tuple[float, float]]
"""x, y [m] and velocity [m/s] of the hand -> the force that is wanted [N], before any bound."""


def wanted_force(
    field: PotentialField,
    comfortable: Workspace,
    mode: Mode,
    *,
    pull_limit: float,
    onset: float,
    return_stiffness: float,
    return_force: float,
    carried: Sequence[float] | None = None,
) -> WantedForce:
    """The field, where the mode lets it act.

    stretch, assist, resist (therapy): nothing inside the comfortable workspace, the field outside, growing to its full
    size over `onset` [m] beyond the boundary. follow, hold (help in a task): the field inside; outside a pull back to
    the nearest comfortable point, of `return_stiffness` [N/m] and at most `return_force` [N].

    The pull of the field is `pull_limit` [N] at most, and its damping comes off that: of a pull that is cut only
    together with the damping nothing would slow a hand far from its target, up to the speed at which it is let go.

    `carried` is read in every tick: how far [m] the field then stands from where it was made. Where it is no number,
    neither the field nor the pull back acts.

    Raises
    ------
    ConfigurationError : a mode that does not exist, or does not go with the field's drag.
    """
    if mode not in get_args(Mode):
        raise ConfigurationError("mode", mode, f"one of {', '.join(get_args(Mode))}")
    resists = field.drag < 0 or (field.drag > 0 and field.drag_along == "travelled")
    if mode == "resist" and not resists and field.drag == field.drag:  # of a learnt field nobody knows beforehand
        raise ConfigurationError("mode", mode, "another mode for a field without drag against the motion")
    if mode != "resist" and resists:
        raise ConfigurationError("mode", mode, "'resist' for a field that drags against the motion")
    damping_x, damping_y = field.damping.tolist()
    where = comfortable.signed_distance_and_foot
    pull = _limited(field.pull if carried is None else _carried(field.pull, carried), pull_limit)

    def outside(x: float, y: float, vx: float, vy: float) -> tuple[float, float]:
        beyond = where((x, y))[0]
        if beyond <= 0.0:
            return 0.0, 0.0
        share = 1.0 if beyond >= onset else beyond / onset
        fx, fy = pull(x, y)
        return share * (fx - damping_x * vx), share * (fy - damping_y * vy)

    def inside(x: float, y: float, vx: float, vy: float) -> tuple[float, float]:
        fx, fy = pull(x, y)
        return fx - damping_x * vx, fy - damping_y * vy

    if mode not in ("follow", "hold"):
        return outside
    return kept_inside(
        inside, comfortable, return_stiffness=return_stiffness, return_force=return_force, known=carried or ()
    )


def kept_inside(
    inside: WantedForce,
    workspace: Workspace,
    *,
    return_stiffness: float,
    return_force: float,
    known: Iterable[float] = (),
) -> WantedForce:
    """A force inside a workspace; outside a pull to its nearest point, of a stiffness [N/m] and at most a force [N].

    Where one of `known`, read in every tick, is no number, outside there is no force either, but NaN: a release.
    """
    where = workspace.signed_distance_and_foot

    def force(x: float, y: float, vx: float, vy: float) -> tuple[float, float]:
        beyond, foot_x, foot_y = where((x, y))
        if beyond <= 0.0:
            return inside(x, y, vx, vy)
        if not all(map(math.isfinite, known)):
            return math.nan, math.nan
        size = min(return_stiffness, return_force / beyond)
        return size * (foot_x - x), size * (foot_y - y)

    return force


def _carried(
    pull: Callable[[float, float], tuple[float, float]], by: Sequence[float]
) -> Callable[[float, float], tuple[float, float]]:
    return lambda x, y: pull(x - by[0], y - by[1])


def _limited(
    pull: Callable[[float, float], tuple[float, float]], limit: float
) -> Callable[[float, float], tuple[float, float]]:
    """The pull, of a size [N] at most; NaN stays."""

    def limited(x: float, y: float) -> tuple[float, float]:
        fx, fy = pull(x, y)
        size = math.hypot(fx, fy)
        return (fx * (limit / size), fy * (limit / size)) if size > limit else (fx, fy)

    return limited
