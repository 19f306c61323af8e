"""Move many postures towards a slice and its probes, by damped least squares within joint limits.

A step takes 1 us, a step of the NLP 10 us. Least squares also converge far from the slice or near a folded elbow, where
the NLP's linearised rows may be infeasible or its full steps may cycle.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rehab_opt.symbolic import BufferedFunction, Compile
from rehab_opt.workspace.plane_statement import FIRMNESS, PlaneStatement

__all__ = ["Approached", "PlaneApproach"]

Array = NDArray[np.float64]

STEPS = 4
"""Steps between two checks of convergence."""
LOOKS, ROUNDS = 2, 10
"""Checks per round, after which stalled postures are dropped; largest number of rounds."""
TOGETHER = 16
"""Number of postures per call."""
PASSES = 2
LONGEST = 1.0
"""[rad or m] Longest change of a joint in a step."""
DAMPING, LESS, MORE = 1e-4, 0.1, 8.0
LEAST, MOST = 1e-13, 1e6
SLOW = 0.01
STALLED = 0.003
"""Least relative decrease of the cost in a round; below it the posture is dropped."""
FORESEEN = 2.0
"""Largest expected decrease of the cost in later rounds, as a multiple of the last decrease."""
SLACK = 1.1
FIRMER = 20.0
"""Factor on the weight of plane and handle in the last round, which serves probes out of reach."""
ARRIVED = 1e-9
"""[m, rad] Tolerance of convergence to the probe, the plane and the handle's cone."""


class Approached(NamedTuple):
    """Result for N postures."""

    postures: Array
    """(N, k) positions of the free joints, within their limits."""
    hands: Array
    """(N, 2) [m]"""
    distances: Array
    """(N,) [m] from hand to probe."""
    misses: Array
    """(N,) [m] violation of the plane or of the handle's cone (angle times the arm's size)."""


class PlaneApproach:
    """Levenberg's method on `PlaneStatement.approach` within the joint limits. One thread at a time.

    Parameters
    ----------
    statement : of an arm; all arms with the same `PlaneStatement.approach` can share this object.
    compile : as for `SQP`.
    """

    def __init__(self, statement: PlaneStatement, *, compile: Compile = None) -> None:
        k, numbers = len(statement.free), statement.approach.size1_in(1)
        x, damping, probe, firm, p = (
            ca.MX.sym(name, size)
            for name, size in (("x", k), ("damping", 1), ("probe", 2), ("firm", 1), ("p", numbers - 2))
        )
        step, measure = _step(statement), _measure(statement)
        whole = ca.vertcat(p[:-1], probe, p[-1])
        at, now = x, damping
        for _ in range(STEPS):
            at, now = step(at, now, firm, whole)
        one = ca.Function("plane_approach", [x, damping, probe, firm, p], [at, now, measure(at, whole)])
        self._several = BufferedFunction(one.map("plane_approaches", "serial", TOGETHER, [3, 4], []), compile=compile)

    def near(self, parameters: Array, probes: Array, starts: Array, below: Array | float = math.inf) -> Approached:
        """Move each posture of `starts` (N, k) towards the slice and its probe in (N, 2) [m].

        Parameters
        ----------
        parameters : of `PlaneStatement.nearest`; its probe is ignored.
        below : (N,) or scalar [m] largest useful distance; postures that seem to end further off are dropped.
        """
        k = starts.shape[1]
        x, damping = np.clip(starts, parameters[:k], parameters[k : 2 * k]), np.full(len(probes), DAMPING)
        found = np.full((len(probes), 5), np.inf)
        several = self._several
        several.inputs[4][:] = np.concatenate([parameters[:-3], parameters[-1:]])
        busy = np.arange(len(probes))
        enough = np.broadcast_to(parameters[-1] * (SLACK * np.asarray(below)) ** 2, len(probes))
        of_round = np.full(len(probes), np.inf)
        for look in range(1, ROUNDS * LOOKS + 1):
            before = found[busy, 4]
            self._go_on(busy, probes, x, damping, found, firm=1.0)
            cost = found[busy, 4]
            nearer = (cost - FORESEEN * (before - cost) <= enough[busy]) & (cost < (1 - SLOW) * before)
            on_its_way = (cost == before) | nearer
            if look % LOOKS == 0:
                on_its_way &= cost < (1 - STALLED) * of_round[busy]
                of_round[busy] = cost
            busy = busy[on_its_way & ((found[busy, 2] > ARRIVED) | (found[busy, 3] > ARRIVED))]
            if not len(busy):
                break
        away = np.flatnonzero((found[:, 2] > ARRIVED) & (found[:, 4] <= enough))
        damping[away] = DAMPING
        self._go_on(away, probes, x, damping, found, firm=FIRMER)
        return Approached(x, found[:, :2], found[:, 2], found[:, 3])

    def _go_on(
        self, busy: NDArray[np.intp], probes: Array, x: Array, damping: Array, found: Array, *, firm: float
    ) -> None:
        """Do `STEPS` more steps for the `busy` postures; update their hand, distance, violation, cost in `found`."""
        (starts, dampings, goals, firmness, _), (ends, after, measured) = self._several.inputs, self._several.outputs
        firmness[...] = firm
        for first in range(0, len(busy), TOGETHER):
            some = busy[first : first + TOGETHER]
            n = len(some)
            starts.T[:n], dampings.T[:n, 0], goals.T[:n] = x[some], damping[some], probes[some]
            self._several.evaluate()
            x[some], damping[some], found[some] = ends.T[:n], after.T[:n, 0], measured.T[:n]


def _step(statement: PlaneStatement) -> ca.Function:
    """Function (x, damping, weight of plane and handle, parameters) -> (next x, next damping)."""
    k = len(statement.free)
    x, damping, firm = ca.SX.sym("x", k), ca.SX.sym("damping"), ca.SX.sym("firm")
    p = ca.SX.sym("p", statement.approach.size1_in(1))
    lower, upper = p[:k], p[k : 2 * k]
    rows = statement.approach.size1_out(0)
    weights = ca.vertcat(1, 1, *[firm] * (rows - 2))
    off = weights * statement.approach(x, p)
    slopes = ca.jacobian(off, x)
    downhill = -slopes.T @ off
    held = ca.logic_or(ca.logic_and(x <= lower, downhill < 0), ca.logic_and(x >= upper, downhill > 0))
    least, most = ca.fmax(lower - x, -LONGEST), ca.fmin(upper - x, LONGEST)
    step = ca.SX.zeros(k)
    for _ in range(PASSES):  # joints stop at their limits, and the other joints compensate
        free = slopes @ ca.diag(1 - held)
        root = ca.chol(ca.densify(free @ free.T + damping * ca.SX.eye(rows)))
        others = -free.T @ ca.solve(root, ca.solve(root.T, off + slopes @ (held * step)))
        step = ca.fmax(least, ca.fmin(most, ca.if_else(held, step, others)))
        held = ca.logic_or(held, ca.logic_or(step <= least, step >= most))
    taken = ca.fmax(lower, ca.fmin(upper, x + step))
    nearer = ca.sumsqr(weights * statement.approach(taken, p)) < ca.sumsqr(off)
    at = ca.if_else(nearer, taken, x)
    now = ca.if_else(nearer, ca.fmax(LEAST, LESS * damping), ca.fmin(MOST, MORE * damping))
    return ca.Function("plane_approach_step", [x, damping, firm, p], [at, now], {"cse": True})


def _measure(statement: PlaneStatement) -> ca.Function:
    """Function (x, parameters) -> column of hand position (2,), distance to the probe, violation, cost."""
    x, p = ca.SX.sym("x", len(statement.free)), ca.SX.sym("p", statement.approach.size1_in(1))
    off = statement.approach(x, p)
    away, missed = off[:2] / ca.sqrt(p[-1]), off[2:] / (FIRMNESS * ca.sqrt(p[-1]))
    miss = ca.mmax(ca.fabs(missed)) if missed.numel() else ca.SX(0)
    found = ca.vertcat(p[-3:-1] + away, ca.norm_2(away), miss, ca.sumsqr(off))
    return ca.Function("plane_approach_measure", [x, p], [ca.densify(found)], {"cse": True})
