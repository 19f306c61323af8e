"""The three NLPs of an arm's inverse kinematics, over the joints that can move.

    posture   min posture cost        s.t.  hand at the target, handle within its tilt of vertical, joint limits
    nearest   min distance^2          s.t.                      handle within its tilt of vertical, joint limits
    upright   min 1 - x_n . z_0       s.t.                                                          joint limits

Here x_n is the handle's axis and z_0 the vertical. The Euler angles of Rossa et al. (Eqs. 4 and 5) are not used, since
they are singular for an upright handle.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.optim.nlp import NLP
from rehab_opt.optim.rows import equal, parameter, variable
from rehab_opt.symbolic.matrices import determinant
from rehab_opt.workspace.plane_statement import handle_rows

__all__ = ["IKStatements"]


class IKStatements:
    """NLPs for one arm, one pattern of locked joints and one kind of handle constraint.

    Limits, values of locked joints (`still`), tilt and weights are parameters, so people who differ only in these share
    compiled code.

    Attributes
    ----------
    posture : NLP whose report is [distance from the target [m], handle tilt [rad]].
        Parameters: lower (k,), upper (k,), still (n,), tilt, target (3,), weight (k,), centre (k,), dexterity.
    nearest : NLP with the same report. Parameters: lower, upper, still, tilt, target, scale.
    upright : NLP with the same report. Parameters: lower, upper, still, tilt, target.
    free : (k,) indices of the joints that can move. fixed_size : number of parameter values before the target.
    """

    def __init__(self, arm: SerialChain, *, handle_tilt: float | None, manipulability: bool = False) -> None:
        self.free = np.flatnonzero(~arm.locked)
        k = len(self.free)
        lower, upper, still, tilt = (
            parameter(name, size) for name, size in (("lower", k), ("upper", k), ("still", arm.n), ("tilt", 1))
        )
        target, weight, centre = parameter("target", 3), parameter("weight", k), parameter("centre", k)
        dexterity, scale = parameter("dexterity", 1), parameter("scale", 1)
        x = variable("x", k, lower=lower, upper=upper)
        q = ca.vertcat(*ca.vertsplit(still))
        for i, joint in enumerate(self.free):
            q[int(joint)] = x.symbol[i]
        pose = arm.pose_expression(q)
        hand, axis = pose[:3, 3], pose[:3, 0]
        handle = handle_rows(axis, tilt, handle_tilt)
        report = ca.vertcat(ca.norm_2(hand - target), ca.atan2(ca.norm_2(axis[:2]), axis[2]))
        fixed = [lower, upper, still, tilt]
        self.fixed_size = sum(int(each.numel()) for each in fixed)
        cost = ca.dot(weight, (x.symbol - centre) ** 2) / 2
        if manipulability:
            cost += dexterity * squared_manipulability(arm, q, self.free)
        self.posture = NLP(
            "ik_posture",
            parameters=[*fixed, target, weight, centre, dexterity],
            variables=[x],
            minimise=cost,
            subject_to=[equal(hand, target), *handle],
            report=report,
        )
        self.nearest = NLP(
            "ik_nearest",
            parameters=[*fixed, target, scale],
            variables=[x],
            minimise=scale * ca.sumsqr(hand - target) / 2,
            subject_to=handle,
            report=report,
        )
        self.upright = NLP(
            "ik_upright",
            parameters=[*fixed, target],
            variables=[x],
            minimise=1 - axis[2],
            report=report,
        )
        self.measure = ca.Function(
            "ik_measure",
            [x.symbol, still],
            [hand, axis, ca.densify(ca.jacobian(axis[:2], x.symbol))],
            {"cse": True},
        )
        self.square = ca.Function(
            "ik_manipulability", [x.symbol, still], [squared_manipulability(arm, q, self.free)], {"cse": True}
        )


def squared_manipulability(arm: SerialChain, q: ca.SX, free: np.ndarray) -> ca.SX:
    """Squared manipulability w^2 = det(J J') over the joints that can move; smooth everywhere."""
    jacobian = arm.jacobian_expression(q)[:, [int(i) for i in free]]
    gram = jacobian @ jacobian.T if len(free) >= 6 else jacobian.T @ jacobian
    return determinant(gram)
