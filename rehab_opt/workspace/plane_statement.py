"""The nonlinear programmes of a reachable slice, over the joints that can move.

    nearest    min distance^2 of the hand to a probe   s.t.  hand in the plane, handle within its tilt, joint limits
    vertical   min -+ z                                s.t.                     handle within its tilt, joint limits
    upright    min 1 - x_n . z_0                       s.t.                                             joint limits

A probe is reachable where the first one's minimum is zero; elsewhere its minimiser is the nearest boundary point.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.kinematics.link import ChainRow
from rehab_opt.optim.nlp import NLP
from rehab_opt.optim.rows import Row, equal, parameter, variable
from rehab_opt.workspace.handle import beyond_cone, handle_rows
from rehab_opt.workspace.spread import spread_postures

__all__ = ["PlaneStatement"]

Array = NDArray[np.float64]

UNBOUNDED = 1e6
"""[rad] An infinite joint limit counts as this."""
STILL = 1e-11
"""A quantity whose derivatives are all below this, in m or rad per joint unit, does not move."""
CHECKED_POSTURES = 16


class PlaneStatement:
    """Statements for one arm, one pattern of locked joints and one kind of handle constraint.

    Limits, locked values, segment lengths, tilt and height are parameters: people who differ in them alone share
    compiled code, which takes more than a second to make.

    Parameters
    ----------
    arm : the chain; at least one joint can move.
    handle_tilt : [rad] or None.

    Attributes
    ----------
    nearest : report [distance to the probe [m], x, y of the hand [m]].
        Parameters: fixed, height, probe (2,), scale.
    vertical, vertical_free : with the handle's rows and without; report [z].
        Parameters: fixed, sign (1 for the lowest, -1 for the highest hand).
    upright : report [handle tilt [rad]]. Parameters: fixed.
    approach : function (x, parameters of `nearest`) -> what is left between hand and probe and, times `firmness`, between
        hand and plane (in `size`s) and handle and cone (rad). Zero where the probe is reached. See `PlaneApproach`.
    fixed : numbers of the common parameters: lower (k,), upper (k,), still (n,), lengths, tilt.
    free : (k,) indices of the joints that can move.
    constant_height : [m] of a hand that no joint moves up or down, else None; then it is no row.
    constant_tilt : [rad] of a handle that no joint tilts, else None; then it is no row.
    size : [m] sum of all lengths, at least 1e-3.
    """

    firmness = 5.0
    """Of `approach`: plane and handle count so much more than the way to the probe, which may be out of reach."""

    def __init__(self, arm: SerialChain, *, handle_tilt: float | None) -> None:
        self.arm = arm
        self.free = np.flatnonzero(~arm.locked)
        k = len(self.free)
        numbers = np.array([length for row in arm.rows for length in row.lengths])
        lower, upper, still, lengths, tilt, height, probe, scale, sign = (
            parameter(name, size)
            for name, size in (
                ("lower", k), ("upper", k), ("still", arm.n), ("lengths", len(numbers)), ("tilt", 1), ("height", 1),
                ("probe", 2), ("scale", 1), ("sign", 1),
            )
        )  # fmt: skip
        self.lower = np.maximum(arm.lower[self.free], -UNBOUNDED)
        self.upper = np.minimum(arm.upper[self.free], UNBOUNDED)
        self.fixed = np.concatenate(
            [self.lower, self.upper, np.where(arm.locked, arm.lower, 0.0), numbers, [handle_tilt or 0.0]]
        )
        self.size = max(1e-3, float(np.abs(numbers).sum() + np.linalg.norm(arm.tool[:3, 3])))
        x = variable("x", k, lower=lower, upper=upper)
        q = ca.vertcat(*ca.vertsplit(still))
        for i, joint in enumerate(self.free):
            q[int(joint)] = x.symbol[i]
        pose = arm.pose_expression(q, _with_lengths(arm, lengths))
        hand, axis = pose[:3, 3], pose[:3, 0]
        fixed = [lower, upper, still, lengths, tilt]
        self._find_what_moves(ca.vertcat(*fixed), x.symbol, hand, axis)
        handle = [] if self.constant_tilt is not None else handle_rows(axis, tilt, handle_tilt)
        plane: list[Row] = [] if self.constant_height is not None else [equal(hand[2], height)]
        away = hand[:2] - probe
        self.nearest = NLP(
            "plane_nearest",
            parameters=[*fixed, height, probe, scale],
            variables=[x],
            minimise=scale * ca.sumsqr(away) / 2,
            subject_to=[*plane, *handle],
            report=ca.vertcat(ca.norm_2(away), hand[:2]),
        )
        left = [away * ca.sqrt(scale)]
        if plane:
            left.append(self.firmness * (hand[2] - height) * ca.sqrt(scale))
        if handle:
            left.append(self.firmness * beyond_cone(axis, tilt))
        self.approach = ca.Function(
            "plane_approach", [x.symbol, ca.vertcat(*fixed, height, probe, scale)], [ca.densify(ca.vertcat(*left))]
        )
        self.vertical, self.vertical_free = (
            NLP(
                name,
                parameters=[*fixed, sign],
                variables=[x],
                minimise=sign * hand[2],
                subject_to=rows,
                report=hand[2],
            )
            for name, rows in (("plane_vertical", handle), ("plane_vertical_free", []))
        )
        self.upright = NLP(
            "plane_upright",
            parameters=fixed,
            variables=[x],
            minimise=1 - axis[2],
            report=ca.atan2(ca.norm_2(axis[:2]), axis[2]),
        )

    def _find_what_moves(self, fixed: ca.SX, x: ca.SX, hand: ca.SX, axis: ca.SX) -> None:
        """A row that no joint changes has no gradient, and no solver should meet it: a planar chain's height, say."""
        outputs = [hand, axis, ca.jacobian(hand[2], x), ca.jacobian(axis, x)]
        measure = ca.Function("plane_measure", [x, fixed], [ca.densify(each) for each in outputs])
        self.measure = measure
        rises, tilts = 0.0, 0.0
        for posture in spread_postures(self.arm, self.free, CHECKED_POSTURES):
            at, along, rise, turn = (each.full() for each in measure(posture, self.fixed))
            rises, tilts = max(rises, float(np.abs(rise).max())), max(tilts, float(np.abs(turn).max()))
        self.constant_height = None if rises > STILL else float(at[2, 0])
        across = float(np.hypot(along[0, 0], along[1, 0]))
        self.constant_tilt = None if tilts > STILL else float(np.arctan2(across, along[2, 0]))


def _with_lengths(arm: SerialChain, lengths: ca.SX) -> list[ChainRow]:
    """The chain's rows with symbols for lengths; those that are zero stay so, and drop out."""
    symbols: Iterator[Any] = iter(ca.vertsplit(lengths)) if lengths.numel() else iter(())
    return [row.with_lengths(symbols) for row in arm.rows]
