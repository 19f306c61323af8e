"""The arm's inverse kinematics stated from the chain's expressions alone and given to single solvers.

Nothing here uses ArmIK or `rehab_opt.optim`: a mistake there must not hide in its own yardstick.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rehab_opt import SerialChain
from rehab_opt.kinematics.human_arm import ARM_REST

__all__ = ["Answer", "Baseline", "nearest_point", "position_ik", "posture_cost", "projection"]

Array = NDArray[np.float64]

_QUIET: dict[str, object] = {"print_level": 0, "max_iter": 500}
_SETTINGS: dict[str, tuple[str, dict[str, object]]] = {
    # bound_relax_factor: an answer beyond a joint limit, by however little, would not count as solved. Fatrop has no
    # such option and keeps to its bounds within 3e-8.
    "ipopt": ("ipopt", {**_QUIET, "sb": "yes", "bound_relax_factor": 0.0}),
    "fatrop": ("fatrop", _QUIET),
    "fatrop, small barrier": ("fatrop", {**_QUIET, "mu_init": 1e-3, "bound_push": 1e-5, "bound_frac": 1e-5}),
}
"""Solver and options by the name they are asked for. The small barrier suits warm starts on some paths, not on all."""


class Answer(NamedTuple):
    """What a single solve gave."""

    q: Array
    found: bool
    """The solver's own word."""
    cost: float
    multipliers: tuple[ca.DM, ca.DM]


class Baseline:
    """One NLP over the joints that move, with the handle held within its tilt, solved by one solver from one start."""

    def __init__(
        self,
        arm: SerialChain,
        *,
        q: ca.SX,
        parameter: ca.SX,
        cost: ca.SX,
        equalities: ca.SX,
        tilt: float,
        solver: str,
    ) -> None:
        self.arm, self.free = arm, np.flatnonzero(~arm.locked)
        # In radians, like all the rest: unscaled, the cone of 2 deg is a row of width 6e-4 and fatrop gives up on it.
        handle = (arm.pose_expression(q)[2, 0] - math.cos(tilt)) / math.sin(tilt)
        joints = ca.SX.sym("joints", len(self.free))
        every = ca.SX(ca.DM(arm.lower))
        every[self.free.tolist()] = joints
        statement = ca.Function("statement", [q, parameter], [cost, ca.vertcat(equalities, handle)])
        cost, constraints = statement(every, parameter)
        nlp = {"x": joints, "p": parameter, "f": cost, "g": constraints}
        plugin, options = _SETTINGS[solver]
        arguments: dict[str, Any] = {"print_time": False, plugin: options}
        self.solver = ca.nlpsol("baseline", plugin, nlp, arguments)
        zeros = np.zeros(equalities.numel())
        self.bounds = {
            "lbx": ca.DM(arm.lower[self.free]),
            "ubx": ca.DM(arm.upper[self.free]),
            "lbg": ca.DM(np.append(zeros, 0.0)),
            "ubg": ca.DM(np.append(zeros, math.inf)),
        }

    def __call__(self, start: Array, parameter: Array, warm: Answer | None = None) -> Answer:
        """Solve from `start`; `warm` gives the multipliers of a neighbour."""
        multipliers = {"lam_x0": warm.multipliers[0], "lam_g0": warm.multipliers[1]} if warm else {}
        result = self.solver(x0=start[self.free], p=parameter, **self.bounds, **multipliers)
        found = bool(self.solver.stats()["success"])
        q = self.arm.lower.copy()
        q[self.free] = result["x"].full().ravel()
        return Answer(q, found, float(result["f"]), (result["lam_x"], result["lam_g"]))


def position_ik(arm: SerialChain, *, tilt: float, solver: str) -> Baseline:
    """Cheapest posture with the hand at the parameter (3,): the problem ArmIK solves by default."""
    q, target = ca.SX.sym("q", arm.n), ca.SX.sym("target", 3)
    missed = arm.pose_expression(q)[:3, 3] - target
    cost = 0.5 * ca.sumsqr((q - ca.DM(_rest(arm))) / ca.DM(_ranges(arm)))
    return Baseline(arm, q=q, parameter=target, cost=cost, equalities=missed, tilt=tilt, solver=solver)


def posture_cost(arm: SerialChain, q: Array) -> float:
    """Half the sum of squares of each joint's distance from rest, as a share of its range of motion."""
    return 0.5 * float(np.sum(((q - _rest(arm)) / _ranges(arm)) ** 2))


def nearest_point(arm: SerialChain, *, tilt: float) -> Baseline:
    """Hand as near as possible to the parameter (3,); the cost is in cm^2, for ipopt's absolute tolerance."""
    q, target = ca.SX.sym("q", arm.n), ca.SX.sym("target", 3)
    cost = ca.sumsqr(100 * (arm.pose_expression(q)[:3, 3] - target))
    return Baseline(arm, q=q, parameter=target, cost=cost, equalities=ca.SX(0, 1), tilt=tilt, solver="ipopt")


def projection(arm: SerialChain, *, tilt: float, height: float | None = None) -> Baseline:
    """Nearest joint angles to the parameter (n,) with the handle within `tilt`, the hand in the plane z = `height`."""
    q, wanted = ca.SX.sym("q", arm.n), ca.SX.sym("wanted", arm.n)
    plane = ca.SX(0, 1) if height is None else arm.pose_expression(q)[2, 3] - height
    cost = ca.sumsqr(q - wanted)
    return Baseline(arm, q=q, parameter=wanted, cost=cost, equalities=plane, tilt=tilt, solver="ipopt")


def _rest(arm: SerialChain) -> Array:
    return np.clip(ARM_REST, arm.lower, arm.upper)


def _ranges(arm: SerialChain) -> Array:
    return np.clip(arm.upper - arm.lower, 0.1, 2 * math.pi)
