"""Differential inverse kinematics that commands only what can still be braked without passing a limit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from threading import get_ident
from typing import Any, ClassVar, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.braking.limits import (
    LEAVING,
    ROUNDING,
    Bound,
    HandSpeed,
    JointAcceleration,
    JointSpeed,
    Kept,
    Rows,
    Way,
    within_rows,
)
from rehab_opt.braking.manoeuvre import Intervals, Manoeuvre, further
from rehab_opt.control.command import Command
from rehab_opt.control.limit import Limit, checked_limits
from rehab_opt.control.stopping import ticks_to_rest
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

__all__ = ["PoseTracker"]

Array = NDArray[np.float64]

LEAST_DAMPING, DAMPING = 4e-4, 0.5
"""[m^2/rad^2] of a step at least: the square of the singular value below which a direction counts as lost; and
[m/rad^2] for each metre of the error that limits or singular postures leave, where steps would else be too long."""
MISSED = 0.02
"""Share of a twist that the least damping takes where the arm is regular: no limit leaves that."""
PASSES = 3
"""Of a damped solve: each further one takes out what damping left where the arm is regular."""
BRAKES = 0.7
"""Share of the accelerations that the approach to a target counts on."""
DRIFT_SPEED = 0.1
"""Share of the velocity limits at which a redundant arm moves to its posture."""
SECANTS = 2
"""Rounds in which a command that is not allowed is blended with braking."""
TINY = 1e-12


class Now(NamedTuple):
    """The state of a tick, as expressions."""

    q: ca.SX
    last: ca.SX
    """(n,) velocity commanded before."""
    jacobian: ca.SX
    braked: ca.SX
    """(n,) velocity after a tick of braking."""
    ends: Intervals


class Wanted(NamedTuple):
    """min |J (u - base) - asked|^2 + damping |u - base|^2 within lower and upper; w is its answer without these."""

    J: ca.SX
    base: ca.SX
    asked: ca.SX
    damping: ca.SX
    lower: ca.SX
    upper: ca.SX
    w: ca.SX


class PoseTracker(VelocityController):
    """Joint velocities for a tool that follows a pose and a twist.

    A command u is *allowed* if u and the braking behind it (`Manoeuvre`) keep every limit. If the last command was
    allowed, a tick of braking is, so that there always is one. A tick:

    1. min |J (u - b) - e/S|^2 + d |u - b|^2  s.t. low <= u <= high, and the tangents of `limits` at the stop posture

       with J and the pose error e where the arm would be at rest beside the target if it braked now, b the velocity
       after a tick of doing so, and S [s] by how much u moves that place: Levenberg-Marquardt, d grows with what the
       limits leave of e;
    2. the velocity changes straight towards that, within accelerations and hand speeds;
    3. if it is not allowed, it is blended with braking until it is.

    It acts on where the joints are led (`FrontEnd`). An object belongs to one thread: see `OneThread`.

    Parameters
    ----------
    chain : any serial chain with its limits.
    lower, upper, velocity, acceleration : (n,) or scalar; replace the chain's limits.
    gain : [1/s] rate at which a pose error decays near the target.
    linear_speed, angular_speed : [m/s, rad/s] largest hand speeds.
    task_weights : (6,) weights of the twist's components in the base frame, one against the other; a zero frees one.
    posture : (n,) joint positions that a redundant chain moves to where the task leaves it free, or None.
    limits : what the posture has to keep besides, each a `Limit`.
    dt : nominal tick [s].
    recovery_speed : share of the velocity limit at which a joint outside its limits comes back.
    solver, backup : see `FallbackChain`. tolerance : largest certificate residual accepted [the statement's units].
    max_age : [s] see `Watchdog`.
    compile : see `BufferedFunction`.

    Raises
    ------
    ConfigurationError : an argument that cannot be used.
    """

    requirement = "pose is not a rigid transform"
    name: ClassVar[str] = "pose_tracker"
    shapes: ClassVar[tuple[tuple[int, ...], ...]] = ((4, 4), (6,))

    gain: float = setting()
    linear_speed: float = setting()
    angular_speed: float = setting()
    task_weights: Array = setting()
    posture: Array | None = setting()
    limits: tuple[Limit, ...] = setting()

    def __init__(
        self,
        chain: SerialChain,
        *,
        lower: ArrayLike | None = None,
        upper: ArrayLike | None = None,
        velocity: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
        gain: float = 50.0,
        linear_speed: float = 1.0,
        angular_speed: float = math.pi,
        task_weights: ArrayLike = 1.0,
        posture: ArrayLike | None = None,
        limits: Sequence[Limit] = (),
        dt: float = 0.001,
        recovery_speed: float = 0.1,
        solver: str = "qrqp",
        backup: str | None = None,
        tolerance: float = 1e-8,
        max_age: float | None = None,
        compile: Compile = None,
    ) -> None:
        if not isinstance(chain, SerialChain):
            raise ConfigurationError("chain", chain, "a SerialChain")
        self.gain = checked_number("gain", gain, above=0.0)
        self.linear_speed = checked_number("linear_speed", linear_speed, above=0.0)
        self.angular_speed = checked_number("angular_speed", angular_speed, above=0.0)
        self.task_weights = per_joint("task_weights", task_weights, 6, finite=True)
        if not (np.all(self.task_weights >= 0) and np.any(self.task_weights > 0)):
            raise ConfigurationError("task_weights", task_weights, "weights of zero or more, one of them above zero")
        self.posture = None if posture is None else per_joint("posture", posture, chain.n, finite=True)
        limited = chain.with_limits(lower=lower, upper=upper, velocity=velocity, acceleration=acceleration)
        checked_number("dt", dt, above=0.0, below=1.0)
        checked_number("recovery_speed", recovery_speed, above=0.0, below=1.0)
        self.limits = checked_limits(limits, limited)
        super().__init__(
            limited, dt=dt, recovery_speed=recovery_speed, solver=solver, backup=backup, tolerance=tolerance,
            max_age=max_age, compile=compile,
        )  # fmt: skip

    def statement(self) -> Statement:
        """The QP of one tick; parameters q (n,), pose (16, by rows), twist (6,); memory as `VelocityController`."""
        n, tick, brake = self.chain.n, Stages(), self._manoeuvre
        q, entries, twist = parameter("q", n), parameter("pose", 16), parameter("twist", 6)
        memory = parameter("memory", 2 * n)
        target, jacobian = ca.reshape(entries, 4, 4).T, tick.once(self.chain.jacobian_expression(q))
        ends = tick.once(brake.intervals(q, memory[:n]))
        braked = tick.once(clipped(brake.braked(memory[:n]), ends.least, ends.most))
        now = Now(q, memory[:n], jacobian, braked, ends)
        wanted = self._wanted(tick, now, target, twist)

        velocity = variable("velocity", n, lower=wanted.lower, upper=wanted.upper)
        variables, analytic, subject_to, u = [velocity], wanted.w, [], velocity.symbol
        cost = ca.sumsqr(wanted.J @ (u - wanted.base) - wanted.asked) + wanted.damping * ca.sumsqr(u - wanted.base)
        towards = tick.once(self._towards(now, u))
        outside = brake.outside(q)
        if self.limits:
            rows = tick.once(self._kept.rows(q, now.last, braked, ends.least, ends.most))
            leaving = variable("leaving", 1, lower=0, upper=1)
            variables.append(leaving)
            cost += LEAVING * (1 - leaving.symbol) ** 2
            analytic = ca.vertcat(wanted.w, 1)
            subject_to.append(within(leaving.symbol * rows.away - rows.slopes @ u, -ca.inf, rows.upper))
            towards = self._within(tick, now, wanted, rows, towards)
            outside = ca.logic_or(outside, self._kept.outside(q))
        command = self._allowed(tick, now, towards)
        told = ca.DM(np.sqrt(self.task_weights))
        whole = twist + self._settling * tick.once(_error(target, self.chain.pose_expression(q)))
        return Statement(
            name=self.name, parameters=[q, entries, twist], variables=variables, minimise=cost / 2,
            subject_to=subject_to, active_set=True, requires=[is_rigid(target)], analytic=analytic, tick=tick,
            report=self.report(now.last, command, told * (jacobian @ command), told * whole, outside),
            memory=memory, remember=self.remember(q, command),
        )  # fmt: skip

    def _wanted(self, tick: Stages, now: Now, target: ca.SX, twist: ca.SX) -> Wanted:
        """The step on the error where the arm would come to rest beside the target if it braked now."""
        chain, dt, brake, ends = self.chain, self.dt, self._manoeuvre, now.ends
        weights = ca.DM(np.sqrt(self.task_weights / self.task_weights.max()))
        movable, error = ca.diag(ca.DM(~chain.locked)), tick.once(_error(target, chain.pose_expression(now.q)))
        # A target that is far away is not followed by its twist.
        damping = LEAST_DAMPING + DAMPING * ca.norm_2(error[:3])
        follow = tick.once(_damped(ca.diag(weights) @ now.jacobian @ movable, weights * twist, damping, 1))
        relative = now.last - follow
        ticks = tick.once(ticks_to_rest(relative, BRAKES * brake.change))
        there = tick.once(now.q + dt * further(ticks) * relative)
        J, error = tick.once(
            (
                ca.diag(weights) @ chain.jacobian_expression(there) @ movable,
                weights * _error(target, chain.pose_expression(there)),
            )
        )
        S = tick.once(ca.fmax(1 / self._settling, dt * (1 + ticks)))
        drift = tick.once(self._drift(there, J, S))
        base = tick.once(follow + relative * (1 - 1 / ca.fmax(ticks, 1)) + drift)
        unweighted = ca.DM(1 / np.where(self.task_weights > 0, np.array(weights).ravel(), np.inf))
        asked = tick.once(error / S / ca.fmax(1, self._hand.over(unweighted * error / S)))

        far = 1e3 * brake.speed  # where a speed ends it, the velocity is led towards what the task wants beyond
        low = ca.if_else(ends.low <= -brake.speed, -far, ends.low)
        high = ca.if_else(ends.high >= brake.speed, far, ends.high)
        lower, upper = tick.once((ca.fmin(low, ends.high), high))
        free = tick.once(base + _damped(J, asked, LEAST_DAMPING, 1))
        left = ca.norm_2(asked - J @ (clipped(free, lower, upper) - base)) - MISSED * ca.norm_2(asked)
        d = tick.once(LEAST_DAMPING + DAMPING * S * ca.fmax(left, 0))
        w = tick.when(left > 0, lambda: base + _damped(J, asked, d, 1), free)
        return Wanted(J, base, asked, d, lower, upper, w)

    def braking(self) -> ca.Function:
        """q, memory -> what is remembered of a tick of braking, and its report; nothing is led back to a limit."""
        n, brake = self.chain.n, self._manoeuvre
        q, memory = ca.SX.sym("q", n), ca.SX.sym("memory", 2 * n)
        last, ends = memory[:n], brake.intervals(q, memory[:n])
        rest = clipped(
            brake.braked(last), ca.fmin(ends.least, ca.fmax(ends.most, 0)), ca.fmax(ends.most, ca.fmin(ends.least, 0))
        )
        report = self.report(last, rest, ca.SX(0), ca.SX(1), brake.outside(q))
        return ca.Function("braking", [q, memory], [ca.densify(self.remember(q, rest)), report])

    @property
    def _manoeuvre(self) -> Manoeuvre:
        return Manoeuvre(self.chain, self.dt, recovery_speed=self.recovery_speed)

    @property
    def _hand(self) -> HandSpeed:
        return HandSpeed(self.chain, self._manoeuvre, linear=self.linear_speed, angular=self.angular_speed)

    @property
    def _kept(self) -> Kept:
        return Kept(self.limits, self.chain, self._manoeuvre)

    @property
    def _settling(self) -> float:
        """[1/s] what removes a share 1 - exp(-gain dt) of the error in one tick: never an overshoot, at any dt."""
        return (1 - math.exp(-self.gain * self.dt)) / self.dt

    def _drift(self, q: ca.SX, jacobian: ca.SX, seconds: ca.SX) -> ca.SX:
        """(n,) [rad/s] towards the posture from q (n,), slowed as a whole, as far as it does not move the hand."""
        if self.posture is None:
            return ca.SX.zeros(self.chain.n)
        drift = ca.DM(~self.chain.locked) * (ca.DM(self.posture) - q) / seconds
        drift /= ca.fmax(ca.mmax(ca.fabs(drift) / ca.DM(DRIFT_SPEED * self.chain.velocity)), 1)
        return drift - _damped(jacobian, jacobian @ drift, LEAST_DAMPING, PASSES)

    def _towards(self, now: Now, w: ca.SX) -> ca.SX:
        """(n,) from braking towards w as far as speeds allow, straight there from the last within accelerations."""
        brake, way = self._manoeuvre, w - now.braked
        room = (brake.speed - ca.fabs(now.braked)) / ca.fmax(ca.fabs(w) - ca.fabs(now.braked), TINY)
        part = ca.mmin(ca.if_else(ca.fabs(w) > brake.speed, room, 1))
        part = ca.fmin(part, self._hand.part(now.jacobian, now.braked, way))
        change = now.braked + part * way - now.last
        return clipped(now.last + change / ca.fmax(1, brake.ticks(change)), now.ends.gentle_least, now.ends.gentle_most)

    def _within(self, tick: Stages, now: Now, wanted: Wanted, rows: Rows, u: ca.SX) -> ca.SX:
        """(n,) what accelerations leave, u, within the rows once more: how they bend is known now."""
        upper = tick.once(self._kept.bent(rows, now.q, now.braked, u))
        H = wanted.J.T @ wanted.J + wanted.damping * ca.SX.eye(self.chain.n)
        ends = now.ends.gentle_least, now.ends.gentle_most
        again = within_rows(self.chain.n, len(self._kept))
        kept = all_true(rows.away - rows.slopes @ u <= upper)
        return tick.when(kept, u, lambda: tick.call(again, H, u, rows.slopes, rows.away, upper, *ends)[0])

    def _allowed(self, tick: Stages, now: Now, u: ca.SX) -> ca.SX:
        """(n,) u, or as much of the way to it from braking as passes no limit further than braking does."""
        brake, braked = self._manoeuvre, now.braked
        bounds: list[Bound] = [JointSpeed(brake), JointAcceleration(brake), self._hand]
        if self.limits:
            bounds.append(self._kept)

        def way(u: ca.SX) -> Way:
            return Way(now.q, now.last, u, further(brake.ticks(u)), now.jacobian)

        def excess(u: ca.SX) -> ca.SX:
            return ca.vertcat(*(bound.excess(way(u)) for bound in bounds))

        wanted = tick.once(u)
        at_most = ca.vertcat(*(bound.at_most(way(wanted)) for bound in bounds))

        def blended() -> ca.SX:
            least, found = tick.once((excess(braked), excess(wanted)))
            most = tick.once(ca.fmax(least, 0))
            share = ca.SX(1)
            for _ in range(SECANTS):
                part = 0.999 * (most - least) / ca.fmax(found - least, TINY)
                share = tick.once(share * ca.mmin(ca.if_else(found > most + ROUNDING, part, 1)))
                found = tick.once(excess(braked + share * (wanted - braked)))
            return braked + ca.if_else(all_true(found <= most + ROUNDING), share, 0) * (wanted - braked)

        return tick.when(all_true(at_most <= ROUNDING), wanted, blended)

    def step(
        self, q: ArrayLike, pose: ArrayLike, twist: ArrayLike, *, enable: object = True, stamp: float | None = None
    ) -> Command:
        """Joint velocity (n,) [rad/s, m/s] to hold until the next tick.

        Never raises on numbers: what is not usable gives the safe command, a tick of braking, and its reason.

        Parameters
        ----------
        q : (n,) joint positions measured now [rad, m].
        pose : (4, 4) where the tool should be now, in the base frame.
        twist : (6,) how that moves, linear [m/s] first, then angular [rad/s], in the base frame.
        enable : the dead-man input; anything but true decelerates to rest.
        stamp : time of the state [s]; checked by the watchdog when given.

        Raises
        ------
        ConfigurationError : an argument of the wrong shape. SharingError : a second thread, see `OneThread`.
        """
        if self._owner != get_ident():
            self._claim()
        if type(q) is type(twist) is type(pose) is np.ndarray and np.shape(pose) == (4, 4):
            try:
                views: tuple[Any, ...] = self._views
                views[0][:], views[2][:] = q, twist
                views[1][:] = pose.ravel()
            except (ValueError, TypeError):
                self._write((q, pose, twist))
        else:
            self._write((q, pose, twist))
        return self._tick(enable, stamp)


def _error(target: ca.SX, pose: ca.SX) -> ca.SX:
    """(6,) from a pose (4, 4) to the target: position, and rotation vector, in the base frame."""
    return ca.vertcat(target[:3, 3] - pose[:3, 3], rotation_vector(target[:3, :3] @ pose[:3, :3].T))


def _damped(jacobian: ca.SX, twist: ca.SX, damping: ca.SX | float, passes: int) -> ca.SX:
    """(n,) J'(K^-1 + d K^-2 + ...) v with K = J J' + d I, of so many terms."""
    diagonal, factor, order = ca.ldl(ca.densify(jacobian @ jacobian.T) + damping * ca.SX.eye(6), False)
    total, rest = ca.SX.zeros(6), twist
    for _ in range(passes):
        solved = ca.ldl_solve(ca.densify(rest), diagonal, factor, order)
        total, rest = total + solved, damping * solved
    return ca.densify(jacobian.T @ total)
