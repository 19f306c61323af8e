"""The NLPs of a reachable slice, over the joints that can move.

    nearest    min distance^2 of the hand to a probe   s.t.  hand in the plane, handle within its tilt, joint limits
    vertical   min -+ z                                s.t.                     handle within its tilt, joint limits
    upright    min 1 - x_n . z_0                       s.t.                                             joint limits

A probe is reachable if the minimum of `nearest` is zero; otherwise its minimiser is the nearest boundary point.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from functools import lru_cache
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.kinematics.link import ChainRow
from rehab_opt.optim.nlp import NLP
from rehab_opt.optim.rows import Row, Variable, equal, parameter, variable, within

__all__ = ["FIRMNESS", "PlaneStatement", "handle_rows", "spread_postures"]

Array = NDArray[np.float64]

UNBOUNDED = 1e6
"""[rad] Value that replaces an infinite joint limit."""
ALMOST_EXACT = 1e-5
"""[rad] Least tilt with a cone constraint; for a smaller tilt the handle is aligned exactly."""
STILL = 1e-11
"""[m or rad per joint unit] A quantity whose derivatives are all smaller counts as constant."""
CHECKED_POSTURES = 16
FIRMNESS = 5.0
"""Weight of plane and handle in `approach` relative to the distance to the probe, which may be out of reach."""
KINDS = 16
"""Size of the cache of expressions by kind of arm; making them takes longer than a small slice."""


class PlaneStatement:
    """NLPs for one arm, one pattern of locked joints and one kind of handle constraint.

    Limits, locked values, segment lengths, tilt and height are parameters: people who differ only in these share
    compiled code, which takes more than a second to make.

    Parameters
    ----------
    arm : the chain; at least one joint can move.
    handle_tilt : [rad] or None.

    Attributes
    ----------
    nearest : report [distance to the probe [m], x, y of the hand [m]].
        Parameters: fixed, height, probe (2,), scale.
    vertical, vertical_free : with and without the handle's rows; report [z]. Parameters: fixed, sign (1 for the lowest,
        -1 for the highest hand).
    upright : report [handle tilt [rad]]. Parameters: fixed.
    approach : function (x, parameters of `nearest`) -> residuals between hand and probe and, times `FIRMNESS`, between
        hand and plane (over `size`) and between handle and cone (rad). Zero if the probe is reached. See
        `PlaneApproach`.
    fixed : values of the common parameters: lower (k,), upper (k,), still (n,), lengths, tilt.
    free : (k,) indices of the joints that can move.
    constant_height : [m] height of a hand that no joint moves up or down, which then needs no row; else None.
    constant_tilt : [rad] tilt of a handle that no joint tilts, which then needs no row; else None.
    size : [m] sum of all lengths, at least 1e-3.
    """

    def __init__(self, arm: SerialChain, *, handle_tilt: float | None) -> None:
        self.arm = arm
        self.free = np.flatnonzero(~arm.locked)
        numbers = np.array([length for row in arm.rows for length in row.lengths])
        self.lower = np.maximum(arm.lower[self.free], -UNBOUNDED)
        self.upper = np.minimum(arm.upper[self.free], UNBOUNDED)
        self.fixed = np.concatenate(
            [self.lower, self.upper, np.where(arm.locked, arm.lower, 0.0), numbers, [handle_tilt or 0.0]]
        )
        self.size = max(1e-3, float(np.abs(numbers).sum() + np.linalg.norm(arm.tool[:3, 3])))
        kind = _Kind(arm, handle_tilt)
        self.measure = _posed(kind).measure
        self._find_what_moves()
        nlps = _nlps(kind, self.constant_height is None, self.constant_tilt is None)
        self.nearest, self.approach, self.vertical, self.vertical_free, self.upright = nlps

    def _find_what_moves(self) -> None:
        """Find constraints that no joint affects, such as a planar chain's height; they are left out (no gradient)."""
        postures = spread_postures(self.arm, self.free, CHECKED_POSTURES)
        at, along, rises, tilts = (each.full() for each in self.measure(postures.T, self.fixed))
        self.constant_height = None if np.abs(rises).max() > STILL else float(at[2, 0])
        across = float(np.hypot(along[0, 0], along[1, 0]))
        self.constant_tilt = None if np.abs(tilts).max() > STILL else float(np.arctan2(across, along[2, 0]))


class _Kind:
    """Key for caching an arm's expressions; it is equal for arms that differ only in numerical values."""

    def __init__(self, arm: SerialChain, handle_tilt: float | None) -> None:
        self.arm, self.handle_tilt = arm, handle_tilt
        ones = itertools.repeat(1.0)
        rows = [(row.prismatic, ca.DM(ca.SX(row.with_lengths(ones).after)).full().tobytes()) for row in arm.rows]
        given = tuple(len(row.lengths) for row in arm.rows)
        self._key = (
            *rows,
            given,
            arm.base.tobytes(),
            arm.tool.tobytes(),
            arm.locked.tobytes(),
            handle_kind(handle_tilt),
        )

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Kind) and other._key == self._key

    def __hash__(self) -> int:
        return hash(self._key)


class _Posed(NamedTuple):
    """Symbols of a posture, and expressions of the hand's pose in it."""

    fixed: list[ca.SX]
    """Symbols of lower, upper, still, lengths and tilt."""
    x: Variable
    hand: ca.SX
    axis: ca.SX
    measure: ca.Function
    """Function (x, fixed parameters) -> (hand, axis, derivatives of the hand's height and of the axis)."""


class _NLPs(NamedTuple):
    nearest: NLP
    approach: ca.Function
    vertical: NLP
    vertical_free: NLP
    upright: NLP


@lru_cache(maxsize=KINDS)
def _posed(kind: _Kind) -> _Posed:
    arm = kind.arm
    free = np.flatnonzero(~arm.locked)
    k, count = len(free), sum(len(row.lengths) for row in arm.rows)
    sizes = {"lower": k, "upper": k, "still": arm.n, "lengths": count, "tilt": 1}
    lower, upper, still, lengths, _ = fixed = [parameter(name, size) for name, size in sizes.items()]
    x = variable("x", k, lower=lower, upper=upper)
    q = ca.vertcat(*ca.vertsplit(still))
    for i, joint in enumerate(free):
        q[int(joint)] = x.symbol[i]
    pose = arm.pose_expression(q, _with_lengths(arm, lengths))
    hand, axis = pose[:3, 3], pose[:3, 0]
    outputs = [hand, axis, ca.jacobian(hand[2], x.symbol), ca.jacobian(axis, x.symbol)]
    measure = ca.Function("plane_measure", [x.symbol, ca.vertcat(*fixed)], [ca.densify(each) for each in outputs])
    return _Posed(fixed, x, hand, axis, measure)


@lru_cache(maxsize=KINDS)
def _nlps(kind: _Kind, rises: bool, tilts: bool) -> _NLPs:
    """NLPs of an arm; `rises` and `tilts` say whether its joints move the hand vertically and tilt the handle."""
    fixed, x, hand, axis, _ = _posed(kind)
    height, probe, scale, sign = (
        parameter(n, size) for n, size in (("height", 1), ("probe", 2), ("scale", 1), ("sign", 1))
    )
    handle = handle_rows(axis, fixed[-1], kind.handle_tilt) if tilts else []
    plane = [equal(hand[2], height)] if rises else []
    away = hand[:2] - probe
    nearest = NLP(
        "plane_nearest",
        parameters=[*fixed, height, probe, scale],
        variables=[x],
        minimise=scale * ca.sumsqr(away) / 2,
        subject_to=[*plane, *handle],
        report=ca.vertcat(ca.norm_2(away), hand[:2]),
    )
    left = [away * ca.sqrt(scale)]
    if plane:
        left.append(FIRMNESS * (hand[2] - height) * ca.sqrt(scale))
    if handle:
        left.append(FIRMNESS * beyond_cone(axis, fixed[-1]))
    parameters = ca.vertcat(*fixed, height, probe, scale)
    approach = ca.Function("plane_approach", [x.symbol, parameters], [ca.densify(ca.vertcat(*left))])
    vertical, vertical_free = (
        NLP(name, parameters=[*fixed, sign], variables=[x], minimise=sign * hand[2], subject_to=rows, report=hand[2])
        for name, rows in (("plane_vertical", handle), ("plane_vertical_free", []))
    )
    tilt = ca.atan2(ca.norm_2(axis[:2]), axis[2])
    upright = NLP("plane_upright", parameters=fixed, variables=[x], minimise=1 - axis[2], report=tilt)
    return _NLPs(nearest, approach, vertical, vertical_free, upright)


def _with_lengths(arm: SerialChain, lengths: ca.SX) -> list[ChainRow]:
    """The chain's rows, with symbols in place of nonzero lengths."""
    symbols: Iterator[Any] = iter(ca.vertsplit(lengths)) if lengths.numel() else iter(())
    return [row.with_lengths(symbols) for row in arm.rows]


def spread_postures(arm: SerialChain, free: NDArray[np.int64], count: int) -> Array:
    """(count, k) values of the `free` joints, evenly over their limits by the (deterministic) Sobol sequence.

    Unlimited revolute joints get one turn, prismatic ones the chain's size.
    """
    from scipy.stats import qmc  # noqa: PLC0415  (heavy)

    lower, upper = arm.lower[free], arm.upper[free]
    size = sum(row.across + abs(row.along) for row in arm.rows) + 1.0
    half = np.array([size if arm.rows[i].prismatic else math.pi for i in free])
    centre = np.clip(0.0, lower + half, np.maximum(upper - half, lower + half))
    low, high = np.maximum(lower, centre - half), np.minimum(upper, centre + half)
    return np.asarray(np.clip(low + (high - low) * qmc.Sobol(len(free), seed=0).random(count), lower, upper))


def handle_kind(handle_tilt: float | None) -> str:
    """Kind of constraint on the handle for a tilt [rad]."""
    if handle_tilt is None or handle_tilt >= np.pi:
        return "free"
    if handle_tilt < ALMOST_EXACT:
        return "line"
    return "cone" if handle_tilt <= np.pi / 2 else "wide cone"


def handle_rows(axis: ca.SX, tilt: ca.SX, handle_tilt: float | None) -> list[Row]:
    """Constraint rows that keep the handle axis within the angle `tilt` of +z0.

    The cone is x_n . z_0 >= cos(tilt), divided by sin(tilt) up to 90 deg so that its unit is the radian. Exact
    alignment has zero horizontal components and a vertical one that is not negative. Euler angles, Eqs. (4)-(5), Rossa
    et al., are not used, because they are singular exactly at their own goal.
    """
    kind = handle_kind(handle_tilt)
    if kind == "free":
        return []
    if kind == "line":
        return [equal(axis[:2], ca.SX.zeros(2)), within(axis[2], 0.0, ca.inf)]
    # Below horizontal the unit does not matter, and near straight down the sine is almost zero.
    slope = ca.sin(tilt) if kind == "cone" else 1.0
    return [within((axis[2] - ca.cos(tilt)) / slope, 0.0, ca.inf)]


def beyond_cone(axis: ca.SX, tilt: ca.SX) -> ca.SX:
    """(3,) by how much a handle axis is outside the cone: differentiable, zero inside, in rad if small.

    The residual is axis - z0, shortened to the part outside the cone. It replaces the inequality in least squares.
    """
    off = axis - ca.vertcat(0, 0, 1)
    length = ca.sqrt(ca.sumsqr(off) + 1e-20)
    return off * ca.fmax(0, 1 - 2 * ca.sin(tilt / 2) / length)
