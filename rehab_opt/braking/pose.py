"""Joint velocities that make the tool follow a pose, by the one law of braking."""

from __future__ import annotations

import math
from collections.abc import Sequence
from threading import get_ident
from typing import Any, ClassVar

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.braking.front_end import FrontEnd, judged
from rehab_opt.control.judged_state import judged_memory
from rehab_opt.control.velocity_tick import velocity_tick
from rehab_opt.braking.manoeuvre import Manoeuvre, further
from rehab_opt.control.command import Command
from rehab_opt.control.limit import Limit, smallest_rows
from rehab_opt.control.thread_owner import setting
from rehab_opt.control.velocity_controller import VelocityController, checked_number
from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.chain import SerialChain, per_joint
from rehab_opt.kinematics.rigid import is_rigid, rotation_vector
from rehab_opt.optim.certificate import all_true, clipped
from rehab_opt.optim.qp import Statement
from rehab_opt.optim.rows import parameter, variable, within
from rehab_opt.symbolic import Compile
from rehab_opt.symbolic.tick import Stages
from rehab_opt.control.stopping import gentle_speed, ticks_to_rest

__all__ = ["StopTracker"]

Array = NDArray[np.float64]
LEAST_DAMPING = 4e-4
"""[m^2/rad^2] of the step: square of the singular value below which a direction counts as lost."""
DAMPING = 0.5
"""[m/rad^2] of damping a metre of the error that limits or singular postures leave: without it steps are too long."""
PASSES = 3
"""Of a damped solve: each further one takes out what damping left where the arm is regular."""
APPROACH = 30.0
"""[1/s] rate at which a joint comes to its limit at last: servos overshoot the end of a hard deceleration."""
BRAKES = 0.7
"""Share of the accelerations that the approach to a target counts on."""
SECANTS = 2
"""Rounds in which a command that is not allowed is blended with braking."""
ROUNDING = 1e-10
PLACES = (0.0, 0.5, 1.0)
"""Of the way to rest, where limits make rows."""
WAY = 6
"""Places on the way to rest where limits are judged."""
ROWS = 3
LEAVING, PUSH, CLEAR, MARGIN = 10.0, 0.3, 5e-5, 10.0
DRIFT_SPEED = 0.1
"""Share of the velocity limits at which a redundant arm drifts to its posture."""


class StopTracker(VelocityController):
    requirement = "pose is not a rigid transform"
    name: ClassVar[str] = "stop_tracker"

    gain: float = setting()
    linear_speed: float = setting()
    angular_speed: float = setting()
    limits: tuple[Limit, ...] = setting()

    def __init__(
        self,
        chain: SerialChain,
        *,
        limits: Sequence[Limit] = (),
        gain: float = 50.0,
        linear_speed: float = 1.0,
        angular_speed: float = math.pi,
        dt: float = 0.001,
        recovery_speed: float = 0.1,
        solver: str = "qrqp",
        backup: str | None = None,
        tolerance: float = 1e-8,
        max_age: float | None = None,
        compile: Compile = None,
    ) -> None:
        self.gain = checked_number("gain", gain, above=0.0)
        self.linear_speed = checked_number("linear_speed", linear_speed, above=0.0)
        self.angular_speed = checked_number("angular_speed", angular_speed, above=0.0)
        self.limits = tuple(limits)
        self.manoeuvre = Manoeuvre(chain, dt, recovery_speed=recovery_speed)
        super().__init__(
            chain, dt=dt, recovery_speed=recovery_speed, solver=solver, backup=backup, tolerance=tolerance,
            max_age=max_age, compile=compile,
        )

    def _front_end(self):
        return FrontEnd(self.chain, dt=self.dt, max_age=self.max_age)

    def _functions(self):
        stated, n = self.stated, self.chain.n
        judge = judged(n, int(stated.memory.numel()), dt=self.dt, max_age=self.max_age, led=self.led)
        return velocity_tick(
            stated, judge, self.judged, stop=self.stopping(), faulty=self.faulty(), law=None, hurried=self.hurried,
            tolerance=self.tolerance,
        )

    @property
    def judged(self):
        return judged_memory(self.chain.n, self.led.size, 0)

    def braking(self):
        q, memory = ca.SX.sym("q", self.chain.n), ca.SX.sym("memory", self.stated.memory.numel())
        v = memory[: self.chain.n]
        least, most, *_ = self.manoeuvre.intervals(q, v)
        rest = clipped(self.manoeuvre.braked(v), ca.fmin(least, ca.fmax(most, 0)), ca.fmax(most, ca.fmin(least, 0)))
        report = self.report(v, rest, ca.SX(0), ca.SX(1), self.manoeuvre.outside(q))
        return ca.Function("braking", [q, memory], [ca.densify(self.remember(q, rest)), report])

    @property
    def shapes(self) -> tuple[tuple[int, ...], ...]:  # type: ignore[override]
        return (4, 4), (6,)

    @property
    def _settling(self) -> float:
        """[1/s] what removes a share 1 - exp(-gain dt) of the error in one tick: never an overshoot, at any dt."""
        return (1 - math.exp(-self.gain * self.dt)) / self.dt

    def statement(self) -> Statement:
        chain, dt, n, brake = self.chain, self.dt, self.chain.n, self.manoeuvre
        tick = Stages()
        q, entries, twist = parameter("q", n), parameter("pose", 16), parameter("twist", 6)
        memory = parameter("memory", 2 * n)
        v, target = memory[:n], ca.reshape(entries, 4, 4).T
        J = tick.once(chain.jacobian_expression(q))
        pose = chain.pose_expression(q)
        whole = tick.once(twist + self._settling * _error(target, pose))

        # 1. A step on the error at the posture where the arm would rest beside the target.
        apart = ca.norm_2(target[:3, 3] - pose[:3, 3])
        follow = tick.once(damped(J, twist, LEAST_DAMPING + DAMPING * apart, PASSES))
        relative = v - follow
        ticks = ticks_to_rest(relative, BRAKES * brake.change)
        there = tick.once(q + dt * further(ticks) * relative)
        base = tick.once(follow + relative * (1 - 1 / ca.fmax(ticks, 1)))
        Jt, error = tick.once((chain.jacobian_expression(there), _error(target, chain.pose_expression(there))))
        S = tick.once(ca.fmax(1 / self._settling, dt * (1 + ticks)))  # [s] of u's change to the stop posture's
        asked = tick.once(error / S / ca.fmax(1, self._over(error / S)))

        # 2. Within the limits at the stop posture; all joints wait for the slowest.
        least, most, low, high = tick.once(brake.intervals(q, v))
        ub = tick.once(clipped(brake.braked(v), least, most))
        seconds = dt * (1 + further(brake.ticks(v) + 1))
        up, down = ca.fmax(brake.high - q, 0), ca.fmax(q - brake.low, 0)
        gently_up, gently_down = (gentle_speed(room, brake.change / dt, APPROACH) for room in (up, down))
        gently = tick.once((clipped(-gently_down, least, most), clipped(gently_up, least, most)))
        high = ca.if_else(high > 0, ca.fmin(high, ca.fmin(gently_up, up / seconds)), high)
        low = ca.if_else(low < 0, -ca.fmin(-low, ca.fmin(gently_down, down / seconds)), low)
        far = 1e3 * brake.speed  # a speed is no limit of the way: the command is led towards w
        lower, upper = tick.once((ca.if_else(low <= -brake.speed, -far, low), ca.if_else(high >= brake.speed, far, high)))
        step = damped(Jt, asked, LEAST_DAMPING, PASSES)
        left = ca.norm_2(asked - Jt @ (clipped(base + step, lower, upper) - base)) * S
        damping = tick.once(LEAST_DAMPING + DAMPING * left)
        w = tick.once(base + damped(Jt, asked, damping, 1))

        velocity = variable("velocity", n, lower=ca.fmin(lower, upper), upper=upper)
        u = velocity.symbol
        cost = ca.sumsqr(Jt @ (u - base) - asked) + damping * ca.sumsqr(u - base)
        variables, rows, analytic = [velocity], [], w
        if self.limits:
            slopes, away, upmost, values, levers = tick.once(self._rows(q, v, ub, least, most))
            leaving = variable("leaving", 1, lower=0, upper=1)
            cost += LEAVING * (1 - leaving.symbol) ** 2
            variables.append(leaving)
            rows.append(within(leaving.symbol * away - slopes @ u, -ca.inf, upmost))
            analytic = ca.vertcat(w, 1)
        towards = tick.once(self._reached(v, ub, u, J, *gently))
        if self.limits:
            F = further(brake.ticks(towards))
            true = ca.vertcat(*(self._h_least(brake.stop(q, towards, part * F)) for part in PLACES))
            missed = ca.fmax(values / levers + slopes @ (towards - ub) - true / levers, 0)
            less = tick.once(ca.fmax(upmost - missed, -slopes @ ub))
            towards = tick.when(all_true(away - slopes @ towards <= less), towards, lambda: tick.call(_qp(n, less.numel()), Jt.T @ Jt + damping * ca.SX.eye(n), towards, ca.horzcat(-slopes, away), less, least, most)[0])
        command = self._allowed(tick, q, v, J, ub, towards)
        report = self.report(v, command, J @ command, whole, brake.outside(q))
        return Statement(
            name=self.name, parameters=[q, entries, twist], variables=variables, minimise=cost / 2, active_set=True,
            subject_to=rows, requires=[is_rigid(target)], analytic=analytic, tick=tick, report=report, memory=memory,
            remember=self.remember(q, command),
        )

    def _h(self, q):
        return ca.vertcat(ca.SX(0, 1), *(each.at(self.chain, q) for each in self.limits))

    def _h_least(self, q):
        """As the rows' values, in their order."""
        return self._values(q)

    def _rows(self, q, v, ub, least, most):
        """slopes, away, upper: -slopes u + s away <= upper keeps the limits' tangents on the way to rest of braking."""
        brake, dt, z = self.manoeuvre, self.dt, ca.SX.sym("z", self.chain.n)
        tables = []
        for each in self.limits:
            h = each.at(self.chain, z)
            tables.append(smallest_rows(ca.horzcat(h, ca.jacobian(h, z)), min(ROWS, h.numel())))
        self._values = lambda q: ca.Function("v", [z], [ca.vertcat(*tables)[:, 0]])(q)
        tangents = ca.Function("tangents", [z], [ca.vertcat(*tables)])
        N, found = brake.ticks(v), []
        for part in PLACES:
            there = brake.stop(q, ub, part * further(ca.fmax(N - 1, 0)))
            lever = dt * (1 + part * further(N + 1))
            table = tangents(there)
            value, slope = table[:, 0], table[:, 1:]
            margin = CLEAR + MARGIN * (lever * ca.norm_2(brake.change)) ** 2
            can = lever * (ca.fmax(slope, 0) @ (most - ub) + ca.fmin(slope, 0) @ (least - ub))
            away = ca.fmax(ca.fmin(PUSH * (margin - value), 0.5 * can), 0)
            found.append((
                slope, away / lever, ca.fmax(value - margin, 0) / lever - slope @ ub, value,
                lever * ca.SX.ones(value.numel()),
            ))
        return tuple(ca.vertcat(*column) for column in zip(*found, strict=True))

    def _over(self, twist: ca.SX) -> ca.SX:
        return ca.fmax(ca.norm_2(twist[:3]) / self.linear_speed, ca.norm_2(twist[3:]) / self.angular_speed)

    def _reached(self, v, ub, w, J, least, most):
        """From braking towards w as far as speeds allow, straight there from v within accelerations."""
        brake, way = self.manoeuvre, w - ub
        parts = [
            _part(J[k : k + 3, :] @ ub, J[k : k + 3, :] @ way, limit)
            for k, limit in ((0, self.linear_speed), (3, self.angular_speed))
        ]
        room = (brake.speed - ca.fabs(ub)) / ca.fmax(ca.fabs(w) - ca.fabs(ub), 1e-12)
        part = ca.fmin(ca.fmin(*parts), ca.mmin(ca.if_else(ca.fabs(w) > brake.speed, room, 1)))
        d = ub + part * way - v
        return clipped(v + d / ca.fmax(1, brake.ticks(d)), least, most)

    def _excess(self, q, v, J, u):
        chain, brake, dt = self.chain, self.manoeuvre, self.dt
        F = further(brake.ticks(u))
        then, half = q + dt * u, brake.stop(q, u, F / 2)
        over = ca.SX(0, 1)
        if self.limits:
            h = [self._h(then), *(self._h(brake.stop(q, u, F * k / WAY)) for k in range(1, WAY + 1))]
            for a, b, e in zip(h, h[1:], h[2:]):  # lowest of a parabola through three, where a limit bends
                fall, bow = ca.fmax(3 * a - 4 * b + e, 0), ca.fmax(a - 2 * b + e, 1e-12)
                over = ca.vertcat(over, -ca.if_else(fall < 4 * bow, a - 1.1 * fall**2 / (8 * bow), e))
            over = ca.vertcat(over, *(-each for each in h))
        return ca.vertcat(
            over, ca.fabs(u) - brake.speed, ca.fabs(u - v) - brake.change * (1 + 1e-9), self._over(J @ u) - 1,
            self._over(chain.jacobian_expression(then) @ u) - 1,
            self._over(chain.jacobian_expression(half) @ u * 0.5) - 1,
        )

    def _allowed(self, tick, q, v, J, ub, u):
        """u, or as much of the way from braking to it as breaks nothing more than braking does."""
        u = tick.once(u)
        f = tick.once(self._excess(q, v, J, u))

        def blended():
            b = tick.once(self._excess(q, v, J, ub))
            most = tick.once(ca.fmax(b, 0))
            share, over = ca.SX(1), f
            for _ in range(SECANTS):
                part = ca.if_else(over > most + ROUNDING, 0.999 * (most - b) / ca.fmax(over - b, 1e-300), 1)
                share = tick.once(share * ca.mmin(part))
                over = tick.once(self._excess(q, v, J, ub + share * (u - ub)))
            kept = all_true(over <= most + ROUNDING)
            return ub + ca.if_else(kept, share, 0) * (u - ub)

        return tick.when(all_true(f <= ROUNDING), u, blended)

    def step(self, q, pose, twist, *, enable=True, stamp=None) -> Command:
        if self._owner != get_ident():
            self._claim()
        try:
            views: tuple[Any, ...] = self._views
            views[0][:], views[2][:] = q, twist
            views[1][:] = pose.ravel()
        except (ValueError, TypeError):
            self._write((q, pose, twist))
        return self._tick(enable, stamp)


def _qp(n, m):
    shapes = (n, n), (n, 1), (m, n + 1), (m, 1), (n, 1), (n, 1)
    H, r, A, most, lo, hi = given = [ca.MX.sym(a, *b) for a, b in zip("HrAmlh", shapes)]
    options = {"error_on_fail": False, "max_iter": 50} | dict.fromkeys(("print_iter", "print_header", "print_info", "print_lincomb"), False)
    qp = ca.conic("qp", "qrqp", {"h": ca.Sparsity.dense(n + 1, n + 1), "a": ca.Sparsity.dense(m, n + 1)}, options)
    x = qp(h=ca.densify(ca.diagcat(H, LEAVING)), g=ca.vertcat(-H @ r, -LEAVING), a=A, lba=-ca.inf * ca.DM.ones(m), uba=most,
           lbx=ca.vertcat(lo, 0), ubx=ca.vertcat(hi, 1), x0=ca.vertcat(r, 0))["x"]
    return ca.Function("again", given, [ca.fmin(ca.fmax(x[:n], lo), hi)])


def _across(u, rows, upper, least, most):
    for i in [*range(rows.size1())] * 3:
        row = rows[i, :].T
        over = ca.fmax(ca.dot(row, u) - upper[i], 0)
        u = clipped(u - row * (over / ca.fmax(ca.sumsqr(row), 1e-12)), least, most)
    return u


def _error(target, pose):
    """(6,)"""
    return ca.vertcat(target[:3, 3] - pose[:3, 3], rotation_vector(target[:3, :3] @ pose[:3, :3].T))


def _part(a, b, most):
    """Largest part, of at most 1, of b that may be added to a until it is longer than `most`."""
    bb, ab, room = ca.fmax(ca.sumsqr(b), 1e-18), ca.dot(a, b), ca.fmax(most**2 - ca.sumsqr(a), 0)
    return ca.fmin((ca.sqrt(ab**2 + bb * room) - ab) / bb, 1)


def damped(J, twist, damping, passes):
    """(n,) joint motion for a twist (6,) by damped least squares; each further pass takes out damping's error."""
    D, LT, p = ca.ldl(ca.densify(J @ J.T + damping * ca.SX.eye(6)), False)
    total, rest = ca.SX.zeros(6), twist
    for _ in range(passes):
        solved = ca.ldl_solve(ca.densify(rest), D, LT, p)
        total, rest = total + solved, damping * solved
    return J.T @ total
