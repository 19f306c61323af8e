"""A posture brought near a slice and a probe from anywhere: damped least squares, for starts the programme fails from.

Far from the slice the linearised rows of `PlaneStatement.nearest` often have no common point: for a range of motion of
240 deg a joint from nine starts in ten. Near a folded elbow its full steps go round and round. Either way reachable
points were called unreachable.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rehab_opt.symbolic import BufferedFunction, Compile
from rehab_opt.workspace.plane_statement import PlaneStatement

__all__ = ["PlaneApproach"]

Array = NDArray[np.float64]

STEPS = 60
LONGEST = 1.0
"""[rad or m] Longest change of a joint in a step."""
DAMPING, LESS, MORE = 1e-3, 0.25, 5.0
LEAST, MOST = 1e-12, 1e6
ARRIVED = 1e-10
"""Cost from which the programme itself goes on: 1e-5 of the chain's size."""
STALLED = 1e-6
"""Share of the cost by which a step must lower it, five times in a row at the latest."""


class PlaneApproach:
    """Levenberg's method on `PlaneStatement.approach` within the joint limits. One thread at a time.

    Parameters
    ----------
    statement : of the arm.
    compile : as for `SQP`.
    """

    def __init__(self, statement: PlaneStatement, *, compile: Compile = None) -> None:
        k = len(statement.free)
        x, damping, p = ca.SX.sym("x", k), ca.SX.sym("damping"), ca.SX.sym("p", statement.approach.size1_in(1))
        off = statement.approach(x, p)
        lower, upper = p[:k], p[k : 2 * k]
        slopes = ca.jacobian(off, x)
        downhill = -slopes.T @ off
        held = ca.logic_or(ca.logic_and(x <= lower, downhill < 0), ca.logic_and(x >= upper, downhill > 0))
        slopes = slopes @ ca.diag(1 - held)  # a joint at its limit that would leave it
        step = ca.solve(slopes.T @ slopes + damping * ca.SX.eye(k), (1 - held) * downhill)
        taken = ca.fmax(lower, ca.fmin(upper, x + ca.fmax(-LONGEST, ca.fmin(LONGEST, step))))
        costs = [ca.sumsqr(off), ca.sumsqr(statement.approach(taken, p))]
        outputs = [ca.densify(taken), *map(ca.densify, costs)]
        function = ca.Function("plane_approach_step", [x, damping, p], outputs, {"cse": True})
        self._step = BufferedFunction(function, compile=compile)

    def near(self, parameters: Array, start: Array) -> Array:
        """(k,) a posture, from `start` (k,), that is near the slice and the probe; parameters as of `nearest`."""
        step = self._step
        x, damping, p = step.inputs
        taken, cost, next_cost = step.outputs
        x[:], damping[...], p[:] = start, DAMPING, parameters
        stalls = 0
        for _ in range(STEPS):
            step.evaluate()
            before, after = float(cost.item()), float(next_cost.item())
            if after < before:
                x[:] = taken
                damping[...] = max(LEAST, LESS * float(damping.item()))
            else:
                damping[...] = min(MOST, MORE * float(damping.item()))
            stalls = 0 if after < (1 - STALLED) * before else stalls + 1
            if min(before, after) <= ARRIVED or stalls >= 5:
                break
        return np.array(x)
