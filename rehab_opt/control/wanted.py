"""Joint velocities for a twist when speed is no matter: damped at singular poses, joints at their limits held."""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.stopping import VelocityBounds
from rehab_opt.optim.certificate import clipped

__all__ = ["WantedVelocity", "wanted_velocity"]

DAMPING = 4e-4
"""Square of the singular value [m/rad or 1] below which a direction counts as lost."""
PASSES = 3
"""Passes of the damped solve: each removes the damping's error where the arm is far from singular."""


def wanted_velocity(jacobian: ca.SX, twist: ca.SX, drift: ca.SX) -> ca.SX:
    """(n,) iterated damped least squares: J'(K^-1 + d K^-2 + d^2 K^-3) v with K = J J' + d I.

    `drift` (n,) is added where it does not move the hand: a posture, for redundant chains.
    """
    k = jacobian.size1()
    diagonal, factor, order = ca.ldl(ca.densify(jacobian @ jacobian.T) + DAMPING * ca.SX.eye(k), False)
    remaining, total = twist - jacobian @ drift, ca.SX.zeros(k)
    for _ in range(PASSES):
        solved = ca.ldl_solve(remaining, diagonal, factor, order)
        total += solved
        remaining = DAMPING * solved
    return ca.densify(drift + jacobian.T @ total)


class WantedVelocity(NamedTuple):
    """What is wanted of the joints, in expressions of a controller's parameters and memory.

    Joints that would move faster than they can still stop at their position limits are held at that speed while the
    others make up for them; that second solve is left out where no joint is held. Without it, keeping the direction
    of an undeliverable motion would stop the arm where going on to the nearest pose is wanted.
    """

    jacobian: ca.SX
    """(k, n)"""
    twist: ca.SX
    """(k,)"""
    drift: ca.SX
    """(n,) joint velocity where the twist leaves it free."""
    bounds: VelocityBounds
    speed: NDArray[np.float64]
    """(n,) velocity limits."""
    locked: NDArray[np.bool_]
    """(n,) joints that cannot move at all."""

    def prepare(self, parameters: ca.SX, memory: ca.SX) -> ca.Function:
        """Parameters, memory -> Jacobian by columns, twist, lower, upper, outside, wanted velocity, its twist."""
        bounds, movable = self.bounds, ca.diag(ca.sparsify(ca.DM(~self.locked)))
        moving = ca.sparsify(self.jacobian @ movable)
        wanted = wanted_velocity(moving, self.twist, self.drift)
        low, high = bounds.stop_lower, bounds.stop_upper
        at_most = clipped(wanted, -self.speed, self.speed)  # a speed that no bound allows is not why a joint is held
        leaves = ca.sum1(ca.logic_or(at_most > high, at_most < low)) > 0
        task = ca.vertcat(ca.vec(ca.densify(self.jacobian)), self.twist)
        kept = ca.vertcat(bounds.lower, bounds.upper, bounds.outside)
        outputs = [task, kept, ca.vertcat(wanted, moving @ wanted), ca.vertcat(low, high, self.drift), leaves]
        first = ca.Function("first", [parameters, memory], [ca.densify(each) for each in outputs], {"cse": True})

        p, last = ca.MX.sym("p", parameters.numel()), ca.MX.sym("memory", memory.numel())
        told, within, motion, limits, needed = first.call([p, last])
        motion = ca.Function.if_else("hold", *self._hold(movable)).call([needed, told, motion, limits])[0]
        return ca.Function("prepare", [p, last], [ca.vertcat(told, within, motion)])

    def _hold(self, movable: ca.DM) -> tuple[ca.Function, ca.Function]:
        """Task, wanted motion, stopping speeds and drift -> wanted motion with joints held; and with none."""
        k, n = self.jacobian.shape
        flat, twist, motion = ca.SX.sym("jacobian", k * n), ca.SX.sym("twist", k), ca.SX.sym("motion", n + k)
        low, high, drift = ca.SX.sym("low", n), ca.SX.sym("high", n), ca.SX.sym("drift", n)
        jacobian, wanted = ca.reshape(flat, k, n) @ movable, motion[:n]
        at_most = clipped(wanted, -self.speed, self.speed)
        free = ca.logic_and(at_most <= high, at_most >= low)
        held = ca.if_else(free, 0, clipped(wanted, low, high))
        others = wanted_velocity(jacobian @ ca.diag(free), twist - jacobian @ held, free * drift)
        velocity = ca.if_else(free, others, held)
        inputs = [ca.vertcat(flat, twist), motion, ca.vertcat(low, high, drift)]
        second = ca.Function("second", inputs, [ca.densify(ca.vertcat(velocity, jacobian @ velocity))], {"cse": True})
        return second, ca.Function("enough", inputs, [motion])
