"""Differential inverse kinematics whose commands can always be braked without violating a limit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property
from threading import get_ident
from typing import ClassVar, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.control.clearance import Clearance
from rehab_opt.control.command import Command
from rehab_opt.control.damped import DAMPING, damped_velocity
from rehab_opt.control.jerk_bounds import JerkBounds
from rehab_opt.control.limit import Limit, all_limits
from rehab_opt.control.limits_ahead import (
    ROUNDING,
    Bodies,
    Bound,
    HandSpeed,
    JointAcceleration,
    JointSpeed,
    Kept,
    Posture,
    Rows,
    State,
    UserLimits,
    Way,
)
from rehab_opt.control.manoeuvre import ROUNDED, Intervals, Manoeuvre, further
from rehab_opt.control.pose_inputs import PoseInputs
from rehab_opt.control.reasons import NUMBER
from rehab_opt.control.stopping import ticks_to_rest
from rehab_opt.control.thread_owner import setting
from rehab_opt.control.velocity_controller import checked_number
from rehab_opt.control.watchdog import first_of
from rehab_opt.control.within_rows import LEAVING, within_rows
from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.chain import SerialChain, per_joint
from rehab_opt.kinematics.plausible import check_speeds, checked_posture
from rehab_opt.kinematics.rigid import is_rigid, rotation_vector
from rehab_opt.kinematics.room import MovingCapsule
from rehab_opt.optim.certificate import all_true, clipped
from rehab_opt.optim.qp import Statement
from rehab_opt.optim.rows import parameter, variable, within
from rehab_opt.symbolic import Compile
from rehab_opt.symbolic.tick import Stages

__all__ = ["PoseTracker"]

Array = NDArray[np.float64]

CALMING = 0.5
"""[m/rad^2] Damping per metre of pose error that remains because of limits or singular postures; it shortens steps."""
MISSED = 0.02
"""Fraction of a twist that the least damping removes at regular postures; if more is missing, limits are the cause."""
PASSES = 2
"""Passes of a damped solve; each further pass reduces the damping's error at regular postures."""
BRAKES = 0.7
"""Fraction of the accelerations that is used in the approach to a target."""
ASIDE_SPEED, FREE_TURN = 0.1, 0.5
"""Largest self-motion, as a fraction of the largest joint speeds; [rad] rotation error at which self-motion ends."""
ASIDE = 3
"""Rounds in which a command is moved away from approaching bodies."""
SECANTS = 2
"""Rounds of the search for the best blend of a forbidden command with braking."""
TINY = 1e-12


class Now(NamedTuple):
    """State at the start of a tick, as expressions."""

    state: State
    braked: ca.SX
    """(n,) velocity after a tick of braking."""
    ends: Intervals
    outside: ca.SX
    """Whether a joint or the posture is beyond a limit."""


class Task(NamedTuple):
    """Least squares: min |J (u - base) - rate|^2 + damping |u - centre|^2 over u (n,) within `lower` and `upper`.

    The velocity `base` (n,) follows from a tick of braking; w (n,) is the solution without bounds.
    """

    J: ca.SX
    base: ca.SX
    rate: ca.SX
    """(6,) weighted pose error at the stop posture, divided by the time of its correction."""
    centre: ca.SX
    """(n,) velocity to which the damping pulls: `base`, or, if no limit affects w, a velocity close to w."""
    damping: ca.SX
    seconds: ca.SX
    """[s] S, derivative of the stop posture with respect to u."""
    lower: ca.SX
    upper: ca.SX
    w: ca.SX


class PoseTracker(PoseInputs):
    """Joint velocities for a tool that follows a pose and a twist.

    A command u is *allowed* if u and the braking after it (`Manoeuvre`) satisfy every limit. If the last command was
    allowed, a tick of braking is allowed, so an allowed command always exists. A tick has three steps:

    1. min |J (u - b) - e/S|^2 + d |u - b|^2  s.t. low <= u <= high, and the tangents of `limits` at the stop posture

       Here J is the Jacobian and e the pose error at the stop posture, b the velocity after a tick of braking, and
       S [s] the derivative of the stop posture with respect to u. The damping d grows with the error that remains
       because of limits.
    2. The velocity changes along a straight line towards the result, as far as accelerations and hand speeds allow.
    3. If the result is not allowed, it is blended with braking until it is.

    The tracker computes with commanded joint positions (`FrontEnd`). An object belongs to one thread, see `OneThread`.

    Parameters
    ----------
    chain : any serial chain with its limits.
    lower, upper, velocity, acceleration : (n,) or scalar; replace the chain's limits.
    gain : [1/s] rate at which a pose error decays near the target.
    linear_speed, angular_speed : [m/s, rad/s] largest hand speeds.
    task_weights : (6,) relative weights of the twist's components in the base frame; zero frees a component.
    posture : (n,) joint positions that a redundant chain approaches by self-motion; by default the middle of each
        joint's range, if there are more than six joints and no zero weights.
    limits : further limits of the posture, each a `Limit`.
    dt : nominal tick [s].
    recovery_speed : return speed of a joint outside its limits, as a fraction of its velocity limit.
    solver, backup : see `FallbackChain`. tolerance : largest accepted residual [the statement's units].
    max_age : [s] see `Watchdog`. compile : see `BufferedFunction`.
    """

    name: ClassVar[str] = "pose_tracker"
    names_what_blocks = True

    jerk: JerkBounds | None = setting()

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
        jerk: ArrayLike | None = None,
        posture: ArrayLike | None = None,
        limits: Sequence[Limit | Clearance] = (),
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
        limited = chain.with_limits(lower=lower, upper=upper, velocity=velocity, acceleration=acceleration)
        check_speeds(limited, linear=self.linear_speed, angular=self.angular_speed)
        self.posture = checked_posture("posture", posture, chain)
        checked_number("dt", dt, above=0.0, below=1.0)
        checked_number("recovery_speed", recovery_speed, above=0.0, below=1.0)
        self.limits = all_limits(limits, limited, dt, recovery_speed)
        if jerk is None:
            self.jerk = None
        else:
            if len(self.limits):
                raise ConfigurationError("jerk", jerk, "None with limits, whose bounds take precedence over a drive's")
            self.jerk = JerkBounds.checked(limited, jerk, dt, recovery_speed)
            if not self.gain <= self.jerk.fastest_gain:
                expected = f"at most {self.jerk.fastest_gain:.4g} /s with this jerk: a larger gain oscillates"
                raise ConfigurationError("gain", gain, expected)
        super().__init__(
            limited, dt=dt, recovery_speed=recovery_speed, solver=solver, backup=backup, tolerance=tolerance,
            max_age=max_age, compile=compile,
        )  # fmt: skip

    def statement(self) -> Statement:
        """QP of one tick; parameters q (n,), pose (16, row by row), twist (6,); memory as in `VelocityController`."""
        n, tick, moves = self.chain.n, Stages(), self.limits.moving_size
        q, entries, twist = parameter("q", n), parameter("pose", 16), parameter("twist", 6)
        parameters = [q, entries, twist, *([parameter("obstacles", moves)] if moves else [])]
        moving = parameters[-1] if moves else ca.SX(0, 1)
        memory, target = parameter("memory", self._memory_size), ca.reshape(entries, 4, 4).T
        now = self._now(tick, State(q, memory[:n], tick.once(self.chain.jacobian_expression(q)), moving), memory)
        error = tick.once(_error(target, self.chain.pose_expression(q)))
        task = self._task(tick, now, target, error, twist)

        velocity = variable("velocity", n, lower=task.lower, upper=task.upper)
        variables, analytic, subject_to, u = [velocity], task.w, [], velocity.symbol
        towards, outside, rows = tick.once(self._towards(now, u)), now.outside, None
        far = price = ca.SX(0)
        if self.kept is not None:
            aim, far, rows = self._rows(tick, now, task, self.kept)
            task = _held(tick, task, far, rows)
            leaving = variable("leaving", 1, lower=0, upper=1)
            variables.append(leaving)
            price = LEAVING * (1 - leaving.symbol) ** 2
            analytic = ca.vertcat(task.w, 1)
            subject_to.append(within(leaving.symbol * rows.away - rows.slopes @ u, -ca.inf, rows.upper))
            free, far = towards, all_true(far, ca.fabs(towards - aim) <= TINY)
            towards = tick.once(tick.when(far, free, lambda: self._within(tick, now, task, rows, free)))
        cost = ca.sumsqr(task.J @ (u - task.base) - task.rate) + task.damping * ca.sumsqr(u - task.centre) + price
        command = tick.once(self._allowed(tick, now, memory, towards, far))
        told = ca.DM(np.sqrt(self.task_weights))
        whole = twist + self._settling * error
        report = self.report(memory[:n], command, told * (now.state.jacobian @ command), told * whole, outside)
        report = ca.vertcat(report, self._blocking(target, task, rows, outside))
        return Statement(
            name=self.name, parameters=parameters, variables=variables, minimise=cost / 2, subject_to=subject_to,
            active_set=True, requires=[is_rigid(target)], analytic=analytic, tick=tick, memory=memory,
            report=self.told(q, error, twist, command, report), remember=self.memory_after(q, memory[:n], command),
        )  # fmt: skip

    def told(self, q: ca.SX, error: ca.SX, twist: ca.SX, command: ca.SX, report: ca.SX) -> ca.SX:
        """Report of a tick from pose error (6,), twist (6,) and command (n,); subclasses add to it."""
        return report

    def _rows(self, tick: Stages, now: Now, task: Task, kept: Kept) -> tuple[ca.SX, ca.SX, Rows]:
        """Three results: target velocity without rows; whether it is far from all limits; if not, the limits' rows."""
        brake = self._manoeuvre
        aim = tick.once(clipped(clipped(task.w, task.lower, task.upper), -brake.speed, brake.speed))
        far = tick.once(kept.far(tick, Way(now.state, aim, further(brake.ticks(aim)))))
        sizes = [each.shape for each in kept.no_rows()]

        def column(rows: Rows) -> ca.SX:
            return ca.vertcat(*(ca.vec(ca.densify(each)) for each in rows))

        def rows() -> ca.SX:
            return column(kept.rows(tick, now.state, now.braked, now.ends.least, now.ends.most))

        found = tick.once(tick.when(far, column(kept.no_rows()), rows))
        ends = np.cumsum([0, *(a * b for a, b in sizes)]).tolist()
        parts = [ca.reshape(part, *size) for part, size in zip(ca.vertsplit(found, ends), sizes, strict=True)]
        return aim, far, Rows(*parts)

    def _blocking(self, target: ca.SX, task: Task, rows: Rows | None, outside: ca.SX) -> ca.SX:
        """Number of the reason why a command delivers none of the reference motion, and the joint at fault or -1."""
        beyond = ca.fmax(task.w - task.upper, task.lower - task.w)
        most = ca.mmax(beyond)
        joint = first_of([(beyond[i] >= most, ca.SX(i)) for i in range(self.chain.n)])
        far = ca.norm_2(target[:3, 3] - ca.DM(self.chain.base[:3, 3])) > self._hand.reach
        held = ca.SX(0) if rows is None else ca.mmax(rows.away - rows.slopes @ task.w - rows.upper) > 0
        nothing = ca.SX([NUMBER["NOTHING_LEFT"], -1])
        return first_of([
            (outside, nothing),
            (far, ca.SX([NUMBER["OUT_OF_REACH"], -1])),
            (most > 0, ca.vertcat(NUMBER["JOINT_BLOCKS"], joint)),
            (held, ca.SX([NUMBER["LIMIT_BLOCKS"], -1])),
            (task.damping > DAMPING, ca.SX([NUMBER["POSTURE_SINGULAR"], -1])),
            (ca.SX(1), nothing),
        ])  # fmt: skip

    def _now(self, tick: Stages, state: State, memory: ca.SX) -> Now:
        n, brake = self.chain.n, self._manoeuvre
        if self.jerk is not None:
            jerky = self.jerk.interval(state.q, state.last, memory[2 * n : 3 * n])
            own = jerky.lower, jerky.upper
            ends = tick.once(Intervals(*own, *own, jerky.stop_lower, jerky.stop_upper))
            return Now(state, tick.once(jerky.brake_lower), ends, jerky.outside)
        ends, outside = tick.once(brake.intervals(state.q, state.last)), brake.outside(state.q)
        if self.kept is not None:
            outside = ca.logic_or(outside, self.kept.outside(tick, state.q, state.moving))
        return Now(state, tick.once(clipped(brake.braked(state.last), ends.least, ends.most)), ends, outside)

    def _task(self, tick: Stages, now: Now, target: ca.SX, error: ca.SX, twist: ca.SX) -> Task:
        """Levenberg-Marquardt step on the pose error at the stop posture; `error` (6,) is the present pose error."""
        chain, dt, brake, ends = self.chain, self.dt, self._manoeuvre, now.ends
        weights = ca.DM(np.sqrt(self.task_weights / self.task_weights.max()))
        movable = ca.diag(ca.DM(~chain.locked))
        # The twist of a target that is far away is not followed.
        damping = DAMPING + CALMING * ca.norm_2(error[:3])
        follow = tick.once(
            damped_velocity(
                ca.diag(weights) @ now.state.jacobian @ movable, weights * twist, damping=damping, passes=PASSES
            )
        )
        relative = now.state.last - follow
        ticks = tick.once(ticks_to_rest(relative, BRAKES * brake.change))
        there = tick.once(now.state.q + dt * further(ticks) * relative)
        J, error = tick.once(
            (
                ca.diag(weights) @ chain.jacobian_expression(there) @ movable,
                _error(target, chain.pose_expression(there)),
            )
        )
        S = tick.once(ca.fmax(1 / self._settling, dt * (1 + ticks)))
        braking = relative * (1 - 1 / ca.fmax(ticks, 1))
        aside, error = tick.once((self.self_motion(there, error[3:], J, S, braking), weights * error))
        base = tick.once(follow + braking)
        unweighted = ca.DM(1 / np.where(self.task_weights > 0, np.array(weights).ravel(), np.inf))
        rate = tick.once(error / S / ca.fmax(1, self._hand.over(unweighted * error / S)))

        far = 1e3 * brake.speed  # beyond a speed limit, the velocity still turns towards the task
        low = ca.if_else(ends.low <= -brake.speed, -far, ends.low)
        high = ca.if_else(ends.high >= brake.speed, far, ends.high)
        lower, upper = tick.once((ca.fmin(low, ends.high), high))
        beside = rate - J @ aside
        first, last = (damped_velocity(J, beside, damping=DAMPING, passes=passes) for passes in (PASSES - 1, PASSES))
        free = tick.once(base + aside + last)
        left = ca.norm_2(rate - J @ (clipped(free, lower, upper) - base)) - MISSED * ca.norm_2(beside)
        d = tick.once(DAMPING + CALMING * S * ca.fmax(left, 0))
        # The remaining error has precedence over the posture: damping towards the posture would increase it.
        centre = tick.once(base + ca.if_else(left > 0, 0, aside + first))
        w = tick.when(left > 0, lambda: base + damped_velocity(J, rate, damping=d, passes=1), free)
        return Task(J, base, rate, centre, d, S, lower, upper, w)

    def braking(self) -> ca.Function:
        """Function: q, memory, moving capsules if any -> memory after a tick of braking, and its report."""
        n, tick, moves = self.chain.n, Stages(), self.limits.moving_size
        q, memory, moving = ca.SX.sym("q", n), ca.SX.sym("memory", self._memory_size), ca.SX.sym("moving", moves)
        now = self._now(tick, State(q, memory[:n], ca.SX(6, n), moving), memory)
        rest = now.braked
        if self.jerk is None:
            brake, last = self._manoeuvre, memory[:n]
            change = (1 + ROUNDED) * brake.change
            least = ca.fmin(now.ends.least, ca.fmax(last - change, 0))
            rest = clipped(brake.braked(last), least, ca.fmax(now.ends.most, ca.fmin(last + change, 0)))
        if self.kept is not None:
            rest = tick.once(rest)
            rest = tick.call(self.limits.keeping, q, moving, rest, rest)[0]
        report = self.report(memory[:n], rest, ca.SX(0), ca.SX(1), now.outside)
        inputs = [q, memory, moving] if moves else [q, memory]
        return tick.function("braking", inputs, [self.memory_after(q, memory[:n], rest), report])

    def memory_after(self, q: ca.SX, last: ca.SX, velocity: ca.SX) -> ca.SX:
        """Output of `remember`, plus the change of velocity if jerk is bounded."""
        change = ca.SX(0, 1) if self.jerk is None else (velocity - last) / self.dt
        return ca.vertcat(self.remember(q, velocity), change)

    @property
    def _memory_size(self) -> int:
        return self.chain.n * (2 if self.jerk is None else 3)

    @cached_property
    def _manoeuvre(self) -> Manoeuvre:
        return Manoeuvre(self.chain, self.dt, recovery_speed=self.recovery_speed)

    @cached_property
    def _hand(self) -> HandSpeed:
        return HandSpeed(self.chain, self._manoeuvre, linear=self.linear_speed, angular=self.angular_speed)

    @cached_property
    def kept(self) -> Kept | None:
        """Limits of the posture, or None."""
        own, pairs = self.limits.limits, self.limits.clearance
        kinds: list[Posture] = [UserLimits(own, self.chain)] if own else []
        kinds += [] if pairs is None else [Bodies(pairs)]
        return Kept(kinds, self.chain, self._manoeuvre) if kinds else None

    @property
    def _settling(self) -> float:
        """Rate [1/s] that removes the fraction 1 - exp(-gain dt) of the error in a tick, so it never overshoots."""
        return (1 - math.exp(-self.gain * self.dt)) / self.dt

    @property
    def _rest_posture(self) -> ca.DM:
        """(n,) posture that self-motion approaches; infinite for joints without limits."""
        if self.posture is not None:
            return ca.DM(self.posture)
        lower, upper = self.chain.lower, self.chain.upper
        ends = np.isfinite(lower) & np.isfinite(upper)
        return ca.DM(np.where(ends, np.where(ends, lower, 0) / 2 + np.where(ends, upper, 0) / 2, np.inf))

    def self_motion(self, q: ca.SX, turn: ca.SX, jacobian: ca.SX, seconds: ca.SX, braking: ca.SX) -> ca.SX:
        """(n,) [rad/s] self-motion from q (n,) towards the rest posture, added to `braking` (n,).

        If a rotation component has zero weight, the self-motion fades as the rotation error `turn` (3,) [rad] grows to
        `FREE_TURN`.
        """
        chain, away = self.chain, self._rest_posture - q
        if self.posture is None and (np.any(self.task_weights == 0) or np.sum(~chain.locked) <= len(self.task_weights)):
            return ca.SX.zeros(chain.n)

        def free(velocity: ca.SX) -> ca.SX:
            return velocity - damped_velocity(jacobian, jacobian @ velocity, damping=DAMPING, passes=PASSES)

        away = ca.DM(~chain.locked) * ca.if_else(ca.fabs(away) < ca.inf, away, 0) / seconds
        if np.any(self.task_weights[3:] == 0):
            away *= clipped(1 - ca.norm_2(turn) / FREE_TURN, 0, 1)
        moved = free(braking + away)
        over = ca.mmax(ca.fabs(moved) / ca.DM(min(self.recovery_speed, ASIDE_SPEED) * chain.velocity))
        return moved / ca.fmax(over, 1) - free(braking)

    def _towards(self, now: Now, w: ca.SX) -> ca.SX:
        """(n,) last velocity, changed straight towards an aim, as far as the accelerations allow.

        The aim lies between braking and w (n,), as near to w as the speed limits allow.
        """
        brake, way = self._manoeuvre, w - now.braked
        room = (brake.speed - ca.fabs(now.braked)) / ca.fmax(ca.fabs(w) - ca.fabs(now.braked), TINY)
        part = ca.mmin(ca.if_else(ca.fabs(w) > brake.speed, room, 1))
        part = ca.fmin(part, self._hand.part(now.state.jacobian, now.braked, way))
        aimed = now.braked + part * way
        if self.jerk is not None:
            return clipped(aimed, *self.jerk.towards(now.state.last, now.ends.least, now.ends.most, aimed))
        change = aimed - now.state.last
        return clipped(
            now.state.last + change / ca.fmax(1, brake.ticks(change)), now.ends.gentle_least, now.ends.gentle_most
        )

    def _within(self, tick: Stages, now: Now, task: Task, rows: Rows, u: ca.SX) -> ca.SX:
        """(n,) velocity nearest to u that satisfies the curved rows; the accelerations may have moved u out of them."""
        assert self.kept is not None
        upper = tick.once(self.kept.bent(tick, rows, now.state, now.braked, u))
        H = task.J.T @ task.J + task.damping * ca.SX.eye(self.chain.n)
        ends = now.ends.gentle_least, now.ends.gentle_most
        again = within_rows(self.chain.n, rows.upper.numel())
        kept = all_true(rows.away - rows.slopes @ u <= upper)
        return tick.when(kept, u, lambda: tick.call(again, H, u, rows.slopes, rows.away, upper, *ends)[0])

    def _clear(self, tick: Stages, now: Now, memory: ca.SX, u: ca.SX) -> ca.SX:
        """(n,) u if it violates no limit in this tick; else a velocity that satisfies the limits.

        The latter may exceed the accelerations.
        """
        if self.kept is None:
            return u
        limits, q, moving = self.limits, now.state.q, now.state.moving
        pairs = limits.clearance
        u = tick.once(u)

        def back() -> ca.SX:
            return tick.call(limits.keeping, q, moving, u, now.braked)[0]

        if pairs is None or not limits.moving:
            return tick.when(tick.call(limits.judged, q, moving, u)[0], u, back)

        def aside(u: ca.SX, rounds: int) -> ca.SX:
            """Correct u by Newton steps until it violates no limit; the last step is accepted if no worse than rest."""
            contacts = tick.call(pairs.nearest, q, u, moving, ca.SX(2 * self.dt))[0]
            led = tick.once(limits.led_clear(u, self.bounds(q, memory), contacts))
            if rounds > 1:
                return tick.when(tick.call(limits.all_clear, q, moving, led)[0], led, lambda: aside(led, rounds - 1))
            return tick.when(tick.call(limits.judged, q, moving, led)[0], led, back)

        def otherwise() -> ca.SX:
            return aside(tick.once(tick.when(tick.call(limits.judged, q, moving, u)[0], u, back)), ASIDE)

        return tick.when(tick.call(limits.all_clear, q, moving, u)[0], u, otherwise)

    def _allowed(self, tick: Stages, now: Now, memory: ca.SX, u: ca.SX, far: ca.SX) -> ca.SX:
        """(n,) u if it is allowed, else its largest blend with braking that violates no limit more than braking does.

        far : whether u is far from all limits.
        """
        brake, braked, kept = self._manoeuvre, now.braked, self.kept
        usual: list[Bound] = [JointSpeed(brake), JointAcceleration(brake), self._hand]
        bounds = [*usual, kept] if kept else usual

        def way(u: ca.SX) -> Way:
            return Way(now.state, u, further(brake.ticks(u)))

        def excess(u: ca.SX) -> ca.SX:
            return ca.vertcat(*(bound.excess(tick, way(u)) for bound in bounds))

        aimed = tick.once(u)
        slow = all_true(*(bound.at_most(tick, way(aimed)) <= ROUNDING for bound in usual))

        def blended() -> ca.SX:
            least, found = tick.once((excess(braked), excess(aimed)))
            most = tick.once(ca.fmax(least, 0))
            share = ca.SX(1)
            for _ in range(SECANTS):
                part = 0.999 * (most - least) / ca.fmax(found - least, TINY)
                share = tick.once(share * ca.mmin(ca.if_else(found > most + ROUNDING, part, 1)))
                found = tick.once(excess(braked + share * (aimed - braked)))
            return braked + ca.if_else(all_true(found <= most + ROUNDING), share, 0) * (aimed - braked)

        if kept is None:
            return tick.when(slow, aimed, blended)

        def judged() -> ca.SX:
            keeps = all_true(slow, kept.at_most(tick, way(aimed)) <= ROUNDING)
            return self._clear(tick, now, memory, tick.when(keeps, aimed, blended))

        return tick.when(ca.logic_and(far, slow), aimed, judged)

    def step(
        self,
        q: ArrayLike,
        pose: ArrayLike,
        twist: ArrayLike,
        *,
        obstacles: Sequence[MovingCapsule] | Array | None = None,
        enable: object = True,
        stamp: float | None = None,
    ) -> Command:
        """Joint velocity (n,) [rad/s, m/s] to hold until the next tick.

        An invalid state or pose gives a tick of braking. Arguments of a wrong shape raise `ConfigurationError`.

        Parameters
        ----------
        q : (n,) measured joint positions [rad, m].
        pose : (4, 4) reference pose of the tool in the base frame.
        twist : (6,) its twist, linear [m/s] first, then angular [rad/s], in the base frame.
        obstacles : current moving capsules in the base frame, if the `Clearance` has moving capsules. The array (k, 14)
            of `moving_numbers` is the fast form.
        enable : dead man's switch; anything but True decelerates to rest.
        stamp : [s] time of the state; the watchdog checks it.
        """
        if self._owner != get_ident():
            self._claim()
        self._take(q, pose, twist, obstacles)
        return self._tick(enable, stamp)


def _error(target: ca.SX, pose: ca.SX) -> ca.SX:
    """Error (6,) from a pose (4, 4) to the target: position and rotation vector in the base frame."""
    return ca.vertcat(target[:3, 3] - pose[:3, 3], rotation_vector(target[:3, :3] @ pose[:3, :3].T))


def _held(tick: Stages, task: Task, far: ca.SX, rows: Rows) -> Task:
    """The task with more damping, in proportion to the hand velocity that the rows take away from its solution w."""

    def calmed() -> ca.SX:
        u, need = task.w, rows.away - rows.upper
        for i in range(need.numel()):
            slope = rows.slopes[i, :].T
            u += slope * ca.fmax(need[i] - ca.dot(slope, u), 0) / ca.fmax(ca.sumsqr(slope), TINY)
        left = ca.norm_2(task.J @ (task.w - u))
        return ca.vertcat(task.damping + CALMING * task.seconds * left, ca.if_else(left > 0, task.base, task.centre))

    found = tick.once(tick.when(far, ca.vertcat(task.damping, task.centre), calmed))
    return task._replace(damping=found[0], centre=found[1:])
