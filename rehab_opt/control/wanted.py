"""Joint velocities for a twist when speed is no matter: damped at singular poses, joints at their limits held."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.damped import DAMPING, PASSES, Bend, bent_motion, wanted_velocity
from rehab_opt.control.stopping import FAR, VelocityBounds
from rehab_opt.optim.active_set import active_set_round
from rehab_opt.optim.certificate import clipped
from rehab_opt.optim.dual_active_set import dual_active_set
from rehab_opt.optim.qp import Statement
from rehab_opt.optim.qrqp import qrqp
from rehab_opt.optim.rows import PLAUSIBLE, parameter, variable, within

__all__ = ["WantedVelocity"]

CLAIM_TOLERANCE = 1e-6
"""[rad/s] How far a claimed bounded answer may move on."""
ROW_PASSES = 2
"""Of the closed form with one row active: it is used away from singular poses, where the damping hardly errs."""
INSIDE = 1e-9
"""[rad/s] By how much the wanted motion stays inside its rows."""
MISSED = 1e-2
"""Share of the twist from which on the wanted motion leaves some of it: damped more then."""
CALMING = 0.1
"""[m s] What is left beside rows is an error that stays, and the way to its least bends: by a hand's curve (`damped`),
about its reach, and by its limits', which is not known here. Where that is not counted, joints near a stretched elbow
or at a curved limit swing past the least and back for good. Damping by a metre for what is left of a metre's error, at
the rate of feedback (20 /s in ticks of 20 ms), counts it; `PASSES` undo two thirds."""
MOMENTUM = 0.8
"""Share of the last velocity that `CALMING` is about, as of Polyak's heavy ball (1964). About rest, what hardly changes
the error, as a turn of a wrist that counts little, would creep for tens of seconds; so it goes on 1 / (1 - `MOMENTUM`)
times as fast, in ticks of any length. Nor does it swing more: with a share s of the last velocity kept, a tick's motion
may be up to 2 (1 + s) times the way to the least until it does, not 2 times."""

Excess = Callable[[ca.SX, ca.SX, ca.SX, ca.SX], ca.SX | None]


class WantedVelocity(NamedTuple):
    """What is wanted of the joints, in expressions of a controller's parameters, q first, and memory.

    Where a joint would move faster than it can still stop at its position limit, the joints' velocities are those of

    min |J q' - v|^2 + damping |q' - drift|^2    s.t.  q' within the speeds from which the joints can still stop,
                                                       R q' <= r,

    iterated as `wanted_velocity` is; that solve is left out where no joint is near its limit and no row is reached.
    Where there are rows and some of v is left undone, the damping grows with it (`CALMING`), as in Sugihara's
    Levenberg-Marquardt.
    Without it, keeping the direction of an undeliverable motion would stop the arm where going on to the nearest pose
    is wanted.
    """

    jacobian: ca.SX
    """(k, n)"""
    twist: ca.SX
    """(k,)"""
    slowdown: ca.SX
    """By what the twist was slowed before."""
    drift: ca.SX
    """(n,) joint velocity where the twist leaves it free."""
    bounds: VelocityBounds
    speed: NDArray[np.float64]
    """(n,) velocity limits."""
    locked: NDArray[np.bool_]
    """(n,) joints that cannot move at all."""
    rows: ca.SX
    """(m, n) R"""
    most: ca.SX
    """(m,) r"""
    told: ca.SX
    """What else is to be prepared."""

    def prepare(
        self, parameters: ca.SX, memory: ca.SX, excess: Excess, bend: Bend, around: tuple[ca.SX, ca.Function]
    ) -> ca.Function:
        """Parameters, memory -> Jacobian by columns, twist, slowdown, bounds, outside, R, r, told, wanted motion.

        Where `excess` of q (n,), Jacobian, wanted and last velocity is above 1, the wanted motion is slowed by it.
        `bend` says how the hand's twist changes (`damped`); with rows, which that does not know, it is not used.
        `around` is a column that the expressions may hold besides, and the function of parameters and memory that
        gives it.
        """
        bounds, movable = self.bounds, ca.diag(ca.sparsify(ca.DM(~self.locked)))
        moving = ca.sparsify(self.jacobian @ movable)
        wanted = wanted_velocity(moving, self.twist, self.drift)
        # A limit that is felt only above the velocity limit is not why a joint is held: the whole motion slows down.
        low = ca.if_else(bounds.stop_lower <= -self.speed, -FAR, bounds.stop_lower)
        high = ca.if_else(bounds.stop_upper >= self.speed, FAR, bounds.stop_upper)
        leaves = ca.sum1(ca.vertcat(wanted > high, wanted < low, self.rows @ wanted > self.most)) > 0
        finite = ca.sumsqr(ca.vertcat(parameters[: self.jacobian.size2()], wanted)) <= PLAUSIBLE**2
        leaves = ca.logic_and(leaves, finite)  # no solver sees what cannot be used
        task = ca.vertcat(ca.vec(ca.densify(self.jacobian)), self.twist)
        kept = ca.vertcat(self.slowdown, bounds.lower, bounds.upper, bounds.outside)
        kept_rows = ca.vertcat(ca.vec(ca.densify(self.rows)), self.most)
        motion_limits = [ca.vertcat(wanted, moving @ wanted), ca.vertcat(low, high, self.drift)]
        outputs = [task, kept, kept_rows, self.told, *motion_limits, leaves]
        near, looked = around
        dense = [ca.densify(each) for each in outputs]
        first = ca.Function("first", [parameters, memory, near], dense, {"cse": True})

        p, last = ca.MX.sym("p", parameters.numel()), ca.MX.sym("memory", memory.numel())
        n = self.jacobian.size2()
        told, within, rows, more, motion, limits, needed = first.call([p, last, looked(p, last)])
        solver = _solver(n, self.twist.numel(), m) if (m := self.rows.size1()) else None
        hold = ca.Function.if_else("hold", *self.hold(movable, solver))
        motion = hold(needed, told, motion, limits, rows)
        if solver is not None:
            motion = self._calmed(movable, solver)(last[:n], told, motion, limits, rows)
        else:
            motion = self._bent(movable, bend)(p[:n], last[:n], told, motion, limits)
        if (slowed := self._slowed(excess)) is not None:
            motion = slowed(p[:n], last[:n], told, motion)
        return ca.Function("prepare", [p, last], [ca.vertcat(told, within, rows, more, motion)])

    def _bent(self, movable: ca.DM, bend: Bend) -> ca.Function:
        """`bent_motion` where the wanted motion leaves some of the twist, else the wanted motion."""
        k, n = self.jacobian.shape
        calmer = bent_motion(k, n, movable=movable, bend=bend)
        same = ca.Function("same", calmer.sx_in(), [calmer.sx_in(3)])
        inputs = [
            ca.MX.sym(name, calmer.sparsity_in(i)) for i, name in enumerate(("q", "last", "task", "motion", "at"))
        ]
        twist = inputs[2][k * n :]
        misses = ca.sumsqr(twist - inputs[3][n:]) > MISSED**2 * ca.sumsqr(twist)
        chosen = ca.Function.if_else("bent_or_not", calmer, same).call([misses, *inputs])
        return ca.Function("bent_where_needed", inputs, chosen)

    def _slowed(self, excess: Excess) -> ca.Function | None:
        """Q, last velocity, task, wanted velocity and its twist as one column -> both slowed; None where nothing is."""
        k, n = self.jacobian.shape
        q, task, motion = ca.SX.sym("q", n), ca.SX.sym("task", k * n + k), ca.SX.sym("motion", n + k)
        last = ca.SX.sym("last", n)
        factor = excess(q, ca.reshape(task[: k * n], k, n), motion[:n], last)
        if factor is None:
            return None
        return ca.Function("slowed", [q, last, task, motion], [motion / ca.fmax(factor, 1)], {"cse": True})

    def hold(self, movable: ca.DM, solver: ca.Function | None) -> tuple[ca.Function, ca.Function]:
        """Task, wanted motion, stopping speeds and drift, rows -> motion within both; and as it was.

        `solver` is that of `_solver`, where there are rows.
        """
        k, n = self.jacobian.shape
        m = self.rows.size1()
        flat, twist, velocity = ca.SX.sym("jacobian", k * n), ca.SX.sym("twist", k), ca.SX.sym("velocity", n)
        jacobian = ca.reshape(flat, k, n) @ movable
        inputs = [ca.vertcat(flat, twist), velocity]
        hessian = jacobian.T @ jacobian + DAMPING * ca.SX.eye(n)
        gradient = -(jacobian.T @ twist) - DAMPING * velocity
        model = ca.Function("model", inputs, [ca.densify(hessian), ca.densify(gradient)], {"cse": True})
        task, motion, limits = ca.MX.sym("task", k * n + k), ca.MX.sym("motion", n + k), ca.MX.sym("limits", 3 * n)
        rows = ca.MX.sym("rows", m * n + m)
        low, high, answer = ca.vertsplit(limits, n)
        low, high = (ca.MX(ca.DM(~self.locked)) * each for each in (low, high))
        arguments = [task, motion, limits, rows]
        if solver is not None:
            residual = ca.MX(0)
            for _ in range(PASSES):
                found = solver(task, answer, low, high, rows, DAMPING)
                answer, residual = found[:n], found[-1]
            bounded = self._certified(jacobian, flat, twist)(task, answer, residual, low, high, motion[:n])
        else:
            bounded_qp = qrqp("bounded", n, m)
            for _ in range(PASSES):
                h, g = model(task, answer)
                answer = bounded_qp(h=h, g=g, lbx=low, ubx=high)["x"]
            bounded = self._checked(jacobian, flat, twist)(task, h, g, answer, low, high, motion[:n])
        held = ca.Function("within", arguments, [bounded])
        if m:
            held = self._by_the_first_row(model, held, jacobian, flat, twist)
        return held, ca.Function("enough", arguments, [motion])

    def _by_the_first_row(
        self, model: ca.Function, otherwise: ca.Function, jacobian: ca.SX, flat: ca.SX, twist: ca.SX
    ) -> ca.Function:
        """As `otherwise`, in closed form where the first row alone is active, which is the usual case."""
        k, n = self.jacobian.shape
        m = self.rows.size1()
        motion, limits, rows = ca.SX.sym("motion", n + k), ca.SX.sym("limits", 3 * n), ca.SX.sym("rows", m * n + m)
        task, x = ca.vertcat(flat, twist), limits[2 * n : 3 * n]
        low, high = (ca.DM(~self.locked) * each for each in (limits[:n], limits[n : 2 * n]))
        matrix, most = ca.reshape(rows[: m * n], m, n), rows[m * n :]
        normal = matrix[0, :].T
        factors = None
        multiplier = ca.SX(0)
        for _ in range(ROW_PASSES):
            h, g = model.call([task, x])
            if factors is None:
                factors = ca.ldl(ca.densify(h), False)
                diagonal, factor, order = factors
                towards = ca.ldl_solve(normal, diagonal, factor, order)
                stiffness = ca.fmax(ca.dot(normal, towards), 1e-12)
            free = -ca.ldl_solve(g, diagonal, factor, order)
            multiplier = (ca.dot(normal, free) - most[0] + INSIDE) / stiffness
            x = free - multiplier * towards
        fits = ca.vertcat(x >= low, x <= high, matrix @ x <= most)
        right = ca.logic_and(multiplier >= 0, ca.sum1(fits) == fits.numel())  # NaN fails
        arguments = [task, motion, limits, rows]
        outputs = [ca.densify(ca.vertcat(x, jacobian @ x)), right]
        closed = ca.Function("first_row", arguments, outputs, {"cse": True, "allow_free": False})
        given = [ca.MX.sym("given", otherwise.sparsity_in(i)) for i in range(4)]
        answer, fine = closed.call(given)
        held = ca.MX.sym("held", n + k)
        keep = ca.Function("keep", [held, *given], [held])
        go_on = ca.Function("go_on", [held, *given], otherwise.call(given))
        chosen = ca.Function.if_else("one_row", keep, go_on).call([fine, answer, *given])
        return ca.Function("within_rows", given, chosen)

    def _calmed(self, movable: ca.DM, solver: ca.Function) -> ca.Function:
        """Last velocity, task, motion, stopping speeds and drift, rows -> motion damped by what it leaves of the twist.

        Whether rows leave that or a singular pose does: a motion that is about to reach a row changes by no step there.
        """
        (k, n), m = self.jacobian.shape, self.rows.size1()
        flat, twist = ca.SX.sym("jacobian", k * n), ca.SX.sym("twist", k)
        task, motion = ca.MX.sym("task", k * n + k), ca.MX.sym("motion", n + k)
        limits, rows, last = ca.MX.sym("limits", 3 * n), ca.MX.sym("rows", m * n + m), ca.MX.sym("last", n)
        left = ca.MX.sym("left")
        low, high, drift = ca.vertsplit(limits, n)
        low, high = (ca.MX(ca.DM(~self.locked)) * each for each in (low, high))
        damping = DAMPING + CALMING * left
        # Where little is left, this is the motion as it was: that is about the drift.
        answer, residual = drift + MOMENTUM * CALMING * left / damping * (last - drift), ca.MX(0)
        for _ in range(PASSES):
            found = solver(task, answer, low, high, rows, damping)
            answer, residual = found[:n], found[-1]
        jacobian = ca.reshape(flat, k, n) @ movable
        damped = self._certified(jacobian, flat, twist)(task, answer, residual, low, high, motion[:n])
        inputs = [last, task, motion, limits, rows]
        damp, same = ca.Function("damp", [*inputs, left], [damped]), ca.Function("same", [*inputs, left], [motion])
        asked = task[k * n :]
        missing = ca.norm_2(asked - motion[n:]) - MISSED * ca.norm_2(asked)
        some = ca.logic_and(missing > 0, missing <= PLAUSIBLE)  # no solver sees what cannot be used
        return ca.Function("calmed", inputs, [ca.Function.if_else("calm", damp, same)(some, *inputs, missing)])

    def _certified(self, jacobian: ca.SX, flat: ca.SX, twist: ca.SX) -> ca.Function:
        """As `_checked`, of a claim with rows: they leave no way to tell a solution but its multipliers."""
        n = self.jacobian.size2()
        claim, low, high, free = (ca.SX.sym(name, n) for name in ("claim", "low", "high", "free"))
        residual = ca.SX.sym("residual")
        velocity = ca.if_else(residual <= CLAIM_TOLERANCE, claim, clipped(free, low, high))  # NaN fails
        inputs = [ca.vertcat(flat, twist), claim, residual, low, high, free]
        return ca.Function("certified", inputs, [ca.densify(ca.vertcat(velocity, jacobian @ velocity))], {"cse": True})

    def _checked(self, jacobian: ca.SX, flat: ca.SX, twist: ca.SX) -> ca.Function:
        """Task, H, g, claimed answer, low, high, free answer -> velocity and its twist.

        The velocity is the claim where it is the bounded QP's solution, else the free answer moved into the bounds.
        """
        n = self.jacobian.size2()
        hessian = ca.SX.sym("H", n, n)
        gradient, claim, low, high, free = (ca.SX.sym(name, n) for name in ("g", "claim", "low", "high", "free"))
        # A solution stays where it is when it goes down the slope and back into the bounds; NaN fails.
        fixed = ca.sumsqr(clipped(claim - hessian @ claim - gradient, low, high) - claim) <= CLAIM_TOLERANCE**2
        velocity = ca.if_else(fixed, clipped(claim, low, high), clipped(free, low, high))
        inputs = [ca.vertcat(flat, twist), hessian, gradient, claim, low, high, free]
        return ca.Function("checked", inputs, [ca.densify(ca.vertcat(velocity, jacobian @ velocity))], {"cse": True})


def _solver(n: int, k: int, m: int) -> ca.Function:
    """Task, what the damping is about, low, high, rows, damping -> x, multipliers, and the certificate's residual."""
    task, about, low, high = (
        parameter("task", k * n + k),
        parameter("about", n),
        parameter("low", n),
        parameter("high", n),
    )
    rows, damping = parameter("rows", m * n + m), parameter("damping", 1)
    velocity = variable("velocity", n, lower=low, upper=high)
    error = ca.reshape(task[: k * n], k, n) @ velocity.symbol - task[k * n :]
    cost = ca.sumsqr(error) + damping * ca.sumsqr(velocity.symbol - about)
    # Just inside the rows, so that rounding does not make the guess look as if it were outside.
    over = within(ca.reshape(rows[: m * n], m, n) @ velocity.symbol, -ca.inf, rows[m * n :] - INSIDE)
    stated = Statement("bounded", [task, about, low, high, rows, damping], [velocity], cost / 2, [over])
    exact = active_set_round(stated, looking=False, together=n, passes=2, softened=1e-13)
    given = [ca.MX.sym("given", each.numel()) for each in stated.parameters]
    full, memory = ca.vertcat(*given), ca.MX(0, 1)
    return ca.Function("bounded", given, [exact(full, memory, dual_active_set(stated)(full, memory))[0]])
