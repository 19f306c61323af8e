"""Differential inverse kinematics: joint velocities that make the tool follow a pose, as a QP."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from threading import get_ident
from typing import Any, ClassVar, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.control.clearance import Clearance
from rehab_opt.control.command import Command
from rehab_opt.control.damped import damped_velocity
from rehab_opt.control.jerk_bounds import JerkBounds
from rehab_opt.control.limit import Limit, PostureLimits, all_limits
from rehab_opt.control.reference_velocity import CALMING, HELD, MISSED, ReferenceVelocity, held_after
from rehab_opt.control.stopping import VelocityBounds, max_change, nearest_to_rest, slowed_together
from rehab_opt.control.thread_owner import setting
from rehab_opt.control.tool_speed import speed_ahead, tool_acceleration
from rehab_opt.control.velocity_controller import VelocityController, checked_number
from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.chain import SerialChain, per_joint
from rehab_opt.kinematics.plausible import check_speeds, checked_posture
from rehab_opt.kinematics.rigid import is_rigid, rotation_vector
from rehab_opt.kinematics.room import MOVING, MovingCapsule
from rehab_opt.optim.certificate import clipped
from rehab_opt.optim.qp import Statement
from rehab_opt.optim.rows import parameter, variable, within
from rehab_opt.symbolic import Compile
from rehab_opt.symbolic.tick import Stages

__all__ = ["Inputs", "PoseTracker", "Rows", "TickSolution"]

DIRECTION_KEEPING = 1e-5
"""Price of slowing down against leaving the reference direction: at a twentieth of the speed it is left by 0.01 deg."""
STEADYING = 1e-5
"""Weight of the joint velocities against the squared twist error: it settles what the task leaves open."""
FAR_OFF = 0.99
"""Of the twist that removes the error: where less is commanded, the target is far off."""
DRIFT_SPEED = 0.1
"""Share of the velocity limits at which a redundant chain drifts to its posture."""
DRIFT_SIZE = 1e-2
"""[m] Joint velocities count as this much of a hand speed each."""
BRAKES = 0.7
"""Share of the accelerations with which a hand brakes towards its target: the rest is for how the target goes on."""
TINY = 1e-12
"""[m/s] A speed that is no motion."""
OVER, CHORDS = 1e-6, 3
"""Of the hand speeds, what rounding may add; rounds in which a motion that is too fast is slowed."""

POSE, TWIST = 16, 6
"""Numbers of each."""

Array = NDArray[np.float64]
_ndarray = np.ndarray


class Inputs(NamedTuple):
    """Inputs of a tick, as expressions."""

    q: ca.SX
    target: ca.SX
    """(4, 4)"""
    twist: ca.SX
    others: list[ca.SX]
    """Further inputs of a tracker with more bounds."""
    moving: ca.SX
    """Numbers of the moving capsules, none where there are no such."""
    memory: ca.SX

    @property
    def last(self) -> ca.SX:
        """(n,) the last velocity."""
        return self.memory[: self.q.numel()]


class Rows(NamedTuple):
    """Linear bounds R q' <= r on the joint velocities of a tick, and intervals that have room for them."""

    matrix: ca.SX
    """(m, n) R"""
    upper: ca.SX
    """(m,) r"""
    bounds: VelocityBounds
    posture: tuple[ca.SX, ...] = ()
    """Further quantities of the posture, for `outcome`."""


class TickSolution(NamedTuple):
    """Solution of a tick, as expressions."""

    velocity: ca.SX
    """(n,) of the QP."""
    command: ca.SX
    """(n,)"""
    scale: ca.SX
    """Fraction of the reference velocity; zero of none."""
    speed: ca.SX
    """Size of the reference velocity."""
    delivered: ca.SX
    """(6,) twist of the command, weighted."""
    commanded: ca.SX
    """(6,) twist, with all feedback, weighted."""
    rows: Rows


class PoseTracker(VelocityController):
    """Joint velocities for a tool that follows a pose and a twist.

    min  |J (q' - s w)|^2 + small |q' - s w|^2 + price |w|^2 (1 - s)^2   over q', 0 <= s <= 1
    s.t. lower(q, q'_last) <= q' <= upper(q, q'_last),  grad h . q' >= -rate h  of each of `limits`

    w are the joint velocities that would deliver the reference twist, or as much of it as the arm can at this pose
    (`damped_velocity`); the reference twist is `twist` plus `gain` times the pose error, less where the joints could
    not stop at the target, and no faster than the hand speeds allow. s slows the motion down where the bounds demand,
    so that its direction is kept. The interval is that of `velocity_bounds`: it is never empty. An object belongs to
    one thread: see `OneThread`.

    The direction of the reference twist is left where
    - w would bring a joint to its position limit faster than it can stop there: w is then the nearest motion with that
      joint slow enough (`ReferenceVelocity`); keeping the direction would stop the whole arm. In the tick in which this
      begins, up to 0.4 of the hand's motion was seen across the reference;
    - a joint is too fast to be brought into the direction within its acceleration bound and the hand speeds;
    - the pose is nearly singular, a singular value of J below 0.03, and lost directions are left out of w.

    It acts on where the joints have been led, and comes to what is measured slowly (`FrontEnd`): neither servos up to
    0.1 s late nor noise of encoders move it. A joint that moves less than 8 % of the way that it is commanded is
    blocked, its encoder stands still, or it turns the wrong way: the arm brakes within 0.2 s and 0.045 rad over the
    commanded speed, the reason says which joint, and it rests until `reset`, or until `enable` was released. Positions
    that no joint can have come to are not acted on. Call `reset` between states that are not one motion.

    Parameters
    ----------
    chain : any serial chain with its limits.
    lower, upper, velocity, acceleration : (n,) or scalar; replace the chain's limits.
    gain : [1/s] rate at which a pose error decays; slower from farther off than the accelerations can brake from.
    linear_speed, angular_speed : [m/s, rad/s] largest hand speeds; faster requests are slowed, not cut. Who brakes
        keeps to them, too: joints wait for the one that rests last. A hand is commanded faster, and `Relaxed.TASK`
        flagged, only where joints that are fast against each other cannot brake sooner, as before a joint limit, and
        where keeping `limits` or `jerk` asks for it.
    task_weights : (6,) weights of the twist's components in the base frame; a zero frees one.
    jerk : (n,) or scalar [rad/s^3, m/s^3] largest jerk, for drives that stop on more: of the finite differences of what
        is sent, braking and fallbacks included. Velocity, acceleration and jerk then never yield; a joint that is put
        where it cannot stop before its limit any more goes beyond it. Not together with `limits`; the
        gain is then a quarter of jerk over acceleration at most. None for no such bound.
    posture : (n,) joint positions that a redundant chain drifts to where the task leaves it free, or None.
    limits : what the posture has to keep besides, each a `Limit`: an elbow above a table, say. They come before
        accelerations and hold while braking, too.
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

    gain: float = setting()
    linear_speed: float = setting()
    angular_speed: float = setting()
    task_weights: Array = setting()
    posture: Array | None = setting()
    limits: PostureLimits = setting()
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
        limits: Sequence[Limit | Clearance] | PostureLimits = (),
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
        self.limits = limits if isinstance(limits, PostureLimits) else all_limits(limits, limited, dt, recovery_speed)
        if jerk is not None:
            self._check_jerk_alone(jerk)
            self.jerk = JerkBounds.checked(limited, jerk, dt, recovery_speed)
            if not self.gain <= self.jerk.fastest_gain:
                expected = f"at most {self.jerk.fastest_gain:.4g} /s with this jerk: a faster one swings for good"
                raise ConfigurationError("gain", gain, expected)
        else:
            self.jerk = None
        super().__init__(
            limited,
            dt=dt,
            recovery_speed=recovery_speed,
            solver=solver,
            backup=backup,
            tolerance=tolerance,
            max_age=max_age,
            compile=compile,
        )

    def statement(self) -> Statement:
        """The QP of one tick; parameters q (n,), pose (16, by rows), twist (6,); memory as `VelocityController`."""
        tick, n, weights = Stages(), self.chain.n, ca.sqrt(ca.DM(self.task_weights))
        q, entries, twist, others = parameter("q", n), parameter("pose", POSE), parameter("twist", TWIST), self.others()
        memory = parameter("memory", self._memory_size)
        inputs = Inputs(q, _pose(entries), twist, others, others[-1] if self.limits.moving else ca.SX(0, 1), memory)

        J = tick.once(self._weighted(q))
        reference, whole = self._reference_twist(J, self.chain.pose_expression(q), inputs.target, twist)
        held = HELD.parts(memory[-HELD.size :]) if self.holds_targets else None
        if held is not None:
            reference /= ca.fmax(self._over(reference) / (1 - held.slowed), 1)
        commanded, whole = tick.once((weights * reference, weights * whole))
        rows = tick.once(self.rows(tick, inputs, self.bounds(q, memory)))
        bend = partial(self._bend, q, J, ca.norm_2(whole) / ca.fmax(ca.norm_2(commanded), TINY))
        w, delivered = ReferenceVelocity(
            J, commanded, self._drift(q), rows.bounds, self.chain.velocity, self.chain.locked, rows.matrix, rows.upper
        ).stated(tick, q, inputs.last, excess=partial(self.excess, inputs, J), bend=bend)
        lower, upper = rows.bounds.lower, rows.bounds.upper
        if self.jerk is not None:
            lower, upper = tick.once(self.jerk.towards(inputs.last, lower, upper, w))

        velocity = variable("velocity", n, lower=lower, upper=upper)
        # Progress is s times the size of the reference velocity: in units of velocity like the rest, so that one
        # tolerance fits all variables. A drift that moves no hand is a motion, too.
        speed = ca.sqrt(ca.sumsqr(delivered) + DRIFT_SIZE**2 * ca.sumsqr(w))
        progress = variable("progress", 1, lower=0, upper=speed)
        u, s = velocity.symbol, progress.symbol / ca.fmax(speed, TINY)
        # What damps the reference where rows leave some of it undone damps here, too: a joint that its acceleration
        # holds back would else swing all others, by the scale and by directions that hardly matter.
        left = ca.norm_2(commanded - delivered) - MISSED * ca.norm_2(commanded)
        calm = CALMING * ca.fmax(left, 0) if self.among_bodies else 0
        cost = (
            ca.sumsqr(J @ u - s * delivered)
            + (STEADYING + calm) * ca.sumsqr(u - s * w)
            + (DIRECTION_KEEPING + calm) * ca.sumsqr(progress.symbol - speed)
        )
        ways = self._ways_to_brake(inputs.last, rows.bounds.lower, rows.bounds.upper)
        command = self.command(tick, inputs, self.slow_enough(tick, q, J, u, ways))
        motion = TickSolution(u, command, s, speed, J @ command, whole, rows)
        report, remember = self.outcome(tick, inputs, motion)
        if held is not None:
            matters, fastest = self.task_weights > 0, ca.DM(self.chain.velocity)
            unweighted = ca.DM(matters / np.sqrt(np.where(matters, self.task_weights, 1.0))) * whole
            after = partial(
                held_after, held, ca.vertcat(inputs.target[:3, 3], ca.vec(inputs.target[:3, :3])), dt=self.dt,
                error=unweighted / self._settling, last=inputs.last / fastest, wanted=w / fastest,
            )  # fmt: skip
            far = ca.norm_2(commanded) < FAR_OFF * ca.norm_2(whole)
            remember = ca.vertcat(remember, tick.when(far, after, ca.SX.zeros(HELD.size)))
        return Statement(
            name=self.name,
            parameters=[q, entries, twist, *others],
            variables=[velocity, progress],
            minimise=cost / 2,
            subject_to=[within(rows.matrix @ u, -ca.inf, rows.upper)] if self.row_count else [],
            active_set=True,
            requires=[is_rigid(inputs.target)],
            analytic=ca.vertcat(w, speed),
            tick=tick,
            report=report,
            memory=memory,
            remember=remember,
        )

    @property
    def shapes(self) -> tuple[tuple[int, ...], ...]:  # type: ignore[override]
        """Shapes of the statement's parameters after q: pose, twist, and moving capsules where there are such."""
        moving = self.limits.moving
        return ((4, 4), (6,), *([(moving, MOVING)] if moving else []))

    @property
    def row_count(self) -> int:
        """Number of linear bounds on the joint velocities besides their intervals."""
        return len(self.limits)

    @property
    def _memory_size(self) -> int:
        return 2 * self.chain.n + self.memory_extra + HELD.size * self.holds_targets

    @property
    def memory_extra(self) -> int:
        """Numbers remembered besides velocity and position: with a jerk the last change of velocity."""
        return 0 if self.jerk is None else self.chain.n

    def others(self) -> list[ca.SX]:
        """Parameters besides q, pose and twist."""
        return [parameter("obstacles", self.limits.moving_size)] if self.limits.moving else []

    def outcome(self, tick: Stages, inputs: Inputs, motion: TickSolution) -> tuple[ca.SX, ca.SX]:
        """The report of a tick, what was relaxed and the scale first; and the memory that it leaves."""
        outside = motion.rows.bounds.outside
        report = self.report(inputs.last, motion.command, motion.delivered, motion.commanded, outside)
        return report, self.memory_after(inputs.q, inputs.last, motion.command)

    def memory_after(self, q: ca.SX, last: ca.SX, velocity: ca.SX) -> ca.SX:
        """What `remember` gives, with a jerk the change of velocity besides."""
        change = ca.SX(0, 1) if self.jerk is None else (velocity - last) / self.dt
        return ca.vertcat(self.remember(q, velocity), change)

    def bounds(self, q: ca.SX, memory: ca.SX) -> VelocityBounds:
        """Intervals of the joint velocities; beyond a `Limit` is outside, too."""
        if self.jerk is not None:
            n = self.chain.n
            return self.jerk.interval(q, memory[:n], memory[2 * n : 3 * n])
        found = super().bounds(q, memory)
        return found._replace(outside=ca.logic_or(found.outside, self.limits.beyond(q)))

    @property
    def among_bodies(self) -> bool:
        """Whether a `Clearance` is among the limits, whose rows come and go."""
        return self.limits.clearance is not None

    holds_targets: ClassVar[bool] = True
    """Whether a target may be held out of reach, where joints swing that overshoot: see `held_after`."""
    takes_jerk: ClassVar[bool] = True
    """Whether nothing here comes before what a drive bounds."""

    def _check_jerk_alone(self, jerk: ArrayLike) -> None:
        others = ((type(self).__name__, not self.takes_jerk), ("limits", len(self.limits)))
        for name, given in others:
            if given:
                raise ConfigurationError("jerk", jerk, f"None with {name}, which has bounds that come before a drive's")

    def rows(self, tick: Stages, inputs: Inputs, bounds: VelocityBounds) -> Rows:
        """The linear bounds, and the intervals `bounds` opened where they have to yield."""
        if not len(self.limits):
            return Rows(ca.SX(0, self.chain.n), ca.SX(0, 1), bounds)
        contacts = self.contacts(tick, inputs.q, inputs.last, inputs.moving, ticks=1)
        return Rows(*self.limits.rows(inputs.q, inputs.last, bounds, contacts))

    def contacts(self, tick: Stages, q: ca.SX, last: ca.SX, moving: ca.SX, *, ticks: int) -> ca.SX:
        """Nearest contacts within that many ticks, see `PostureLimits.contacts`."""
        if not self.limits.contacts_size:
            return ca.SX(0, 1)
        given = [ca.MX.sym(name, each.numel()) for name, each in (("q", q), ("last", last), ("moving", moving))]
        nearest = ca.Function("contacts", given, [self.limits.contacts(*given, ticks=ticks)])
        return tick.call(nearest, q, last, moving)[0]

    def excess(self, inputs: Inputs, jacobian: ca.SX, velocity: ca.SX) -> ca.SX:
        """By how much a reference velocity (n,) is too fast, at the weighted Jacobian (6, n): it is slowed by that.

        The asked twist is within the hand speeds, but the motion nearest to it, where a joint is held at its limit,
        may move the hand faster: turning is traded for it.
        """
        return self._hand_over(inputs.q, jacobian, velocity)

    def slow_enough(self, tick: Stages, q: ca.SX, jacobian: ca.SX, velocity: ca.SX, ways: Sequence[ca.SX]) -> ca.SX:
        """(n,) the velocity; where it is too fast, as little of the way to the first of `ways` (n,) as ends that.

        The QP bounds the reference alone, which joints that accelerate as they may do not follow; and joints that
        brake as they can come to rest one after the other, also those that cancel each other out at the hand. Of
        `ways` one that is too fast, too, gives way to a slower one.
        """
        over = partial(self._hand_over, q, jacobian)
        fast = tick.once(over(velocity))

        def slower() -> ca.SX:
            braked, *others = ways
            slow = over(braked)
            for other in others:
                then = over(other)
                better = ca.logic_and(slow > 1, then < slow)
                braked, slow = ca.if_else(better, other, braked), ca.if_else(better, then, slow)
            part, high = ca.SX(1), slow
            for _ in range(CHORDS):  # convex: where a chord is at the bound, the speed is below it
                part = part * clipped((fast - 1) / ca.fmax(fast - high, TINY), 0, 1)
                high = over(velocity + part * (braked - velocity))
            return velocity + ca.if_else(slow < 1, part, slow < fast) * (braked - velocity)

        return tick.when(fast > 1 + OVER, slower, velocity)

    def _ways_to_brake(self, last: ca.SX, lower: ca.SX, upper: ca.SX) -> list[ca.SX]:
        """(n,) each: all joints alike, which has the hand no faster than before; and as each can, within bounds."""
        ways = slowed_together(last, max_change(self.chain, self.dt)), ca.SX.zeros(self.chain.n)
        return [clipped(way, lower, upper) for way in ways]

    def _towards_rest(self, tick: Stages, q: ca.SX, last: ca.SX, bounds: VelocityBounds) -> ca.SX:
        """(n,) the velocity nearest to rest; where the hand is too fast so, joints wait for the one that rests last.

        That one brakes as it can all the while: the arm rests no later. Limits keep the room that stopping takes, and
        nothing is led back to them. A `jerk` comes first.
        """
        rest = nearest_to_rest(bounds)
        if self.jerk is not None:
            return rest
        alike, _ = self._ways_to_brake(last, ca.fmin(rest, bounds.lower), ca.fmax(rest, bounds.upper))
        return self.slow_enough(tick, q, tick.once(self._weighted(q)), rest, [alike])

    def _weighted(self, q: ca.SX) -> ca.SX:
        """(6, n) Jacobian, weighted."""
        return ca.diag(ca.sqrt(ca.DM(self.task_weights))) @ self.chain.jacobian_expression(q)

    def _hand_over(self, q: ca.SX, jacobian: ca.SX, velocity: ca.SX) -> ca.SX:
        """Hand speeds of a velocity (n,), over their limits, at the weighted Jacobian (6, n)."""
        J = self._unweighted(q, jacobian)
        linear = speed_ahead(self.chain, q, J, velocity, self.dt)
        return ca.fmax(linear / self.linear_speed, ca.norm_2(J[3:, :] @ velocity) / self.angular_speed)

    def command(self, tick: Stages, inputs: Inputs, velocity: ca.SX) -> ca.SX:
        """(n,) the QP's velocity, or what of it keeps the user's limits: its rows are tangents.

        To what comes by itself it gives way by more than the acceleration, where the rows' tangents do not.
        """
        limits = self.limits
        if not len(limits):
            return velocity
        state = inputs.q, inputs.moving

        def back() -> ca.SX:
            return tick.call(limits.keeping, *state, velocity, self._slowed(tick, *state, inputs.memory))[0]

        if not limits.moving:
            return tick.when(tick.call(limits.judged, *state, velocity)[0], velocity, back)

        def led_clear() -> ca.SX:
            contacts = self.contacts(tick, inputs.q, velocity, inputs.moving, ticks=2)
            aside = tick.once(limits.led_clear(velocity, self.bounds(inputs.q, inputs.memory), contacts))
            return tick.when(tick.call(limits.all_clear, *state, aside)[0], aside, velocity)

        def otherwise() -> ca.SX:
            return tick.when(tick.call(limits.judged, *state, velocity)[0], led_clear, back)

        return tick.when(tick.call(limits.all_clear, *state, velocity)[0], velocity, otherwise)

    def _slowed(self, tick: Stages, q: ca.SX, moving: ca.SX, memory: ca.SX) -> ca.SX:
        """(n,) the velocity nearest to rest that keeps the limits."""
        last, bounds = memory[: self.chain.n], self.bounds(q, memory)
        rest = self._towards_rest(tick, q, last, bounds)
        if not len(self.limits):
            return rest
        contacts = self.contacts(tick, q, last, moving, ticks=1)
        u = tick.once(self.limits.slower(q, last, bounds, contacts, rest=rest))
        return tick.call(self.limits.keeping, q, moving, u, u)[0]

    @property
    def brakes_beside_bounds(self) -> bool:
        """Whether the safe command, too, keeps hand speeds and limits by its own motion."""
        return True

    def braking(self) -> ca.Function:
        """As a controller's of joints alone, but for moving capsules, where there are such, as a third input."""
        if not self.brakes_beside_bounds:
            return super().braking()
        tick, q, memory = Stages(), ca.SX.sym("q", self.chain.n), ca.SX.sym("memory", self._memory_size)
        last, moving = memory[: self.chain.n], ca.SX.sym("moving", self.limits.moving_size)
        rest, contacts = self._slowed(tick, q, moving, memory), self.contacts(tick, q, last, moving, ticks=1)
        outside = ca.logic_or(self.bounds(q, memory).outside, self.limits.inside(contacts))
        report = self.report(last, rest, ca.SX(0), ca.SX(1), outside)  # nothing of the task is delivered
        inputs = [q, memory, moving] if self.limits.moving else [q, memory]
        return tick.function("braking", inputs, [self.memory_after(q, last, rest), report])

    def _drift(self, q: ca.SX) -> ca.SX:
        """(n,) towards the posture, slowed as a whole so that its direction is kept."""
        if self.posture is None:
            return ca.SX.zeros(self.chain.n)
        drift = ca.DM(~self.chain.locked * self._settling) * (ca.DM(self.posture) - q)
        return drift / ca.fmax(ca.mmax(ca.fabs(drift) / ca.DM(DRIFT_SPEED * self.chain.velocity)), 1)

    def _bend(self, q: ca.SX, jacobian: ca.SX, slower: ca.SX, way: ca.SX) -> ca.SX:
        """(6,) by which the weighted twist of a motion of one rad changes before its error is gone, see `damped`.

        A twist `slower` than its error asks takes longer: not counted, steps would be too long to brake in.
        """
        turned = tool_acceleration(self._unweighted(q, jacobian), way)
        return ca.sqrt(ca.DM(self.task_weights)) * turned * slower / self._settling

    def _unweighted(self, q: ca.SX, jacobian: ca.SX) -> ca.SX:
        """(6, n) Jacobian, from the weighted one where that has all of it."""
        weights = ca.sqrt(ca.DM(self.task_weights))
        return ca.diag(1 / weights) @ jacobian if np.all(self.task_weights > 0) else self.chain.jacobian_expression(q)

    def _reference_twist(self, jacobian: ca.SX, pose: ca.SX, target: ca.SX, twist: ca.SX) -> tuple[ca.SX, ca.SX]:
        """(6,) twist plus feedback on the pose error, slowed to what can be braked and to the hand speeds.

        And the same before slowing, of which `Command.scale` is the delivered fraction.
        """
        position_error = target[:3, 3] - pose[:3, 3]
        rotation_error = rotation_vector(target[:3, :3] @ pose[:3, :3].T)
        controlled = ca.DM(self.task_weights > 0)
        feedback = controlled * self._settling * ca.vertcat(position_error, rotation_error)
        whole = controlled * twist + feedback
        reference = whole - (1 - self._braked(jacobian, feedback)) * feedback
        return reference / ca.fmax(self._over(reference), 1), whole

    def _over(self, twist: ca.SX) -> ca.SX:
        """Hand speeds of a twist (6,) over their limits."""
        return ca.fmax(ca.norm_2(twist[:3]) / self.linear_speed, ca.norm_2(twist[3:]) / self.angular_speed)

    def _braked(self, jacobian: ca.SX, feedback: ca.SX) -> ca.SX:
        """Share of the feedback (6,) that lets the joints still stop at the target, at the weighted Jacobian.

        The joint velocities of v = k e take T = max_j |q'_j| / a_j to stop, and evenly braked the hand has 2 / k for
        that. With `BRAKES` of the accelerations, k e is kept while r = k T / BRAKES <= 1; beyond, sqrt(2 r - 1) / r of
        it is v^2 = 2 a (|e| - e_1 / 2), the hand's even braking a up to |e| = e_1, where r is 1.
        """
        movable = ca.DM(~self.chain.locked)
        velocity = damped_velocity(
            jacobian @ ca.diag(movable), ca.sqrt(ca.DM(self.task_weights)) * feedback, ca.SX(self.chain.n, 1)
        )
        r = self._settling / BRAKES * ca.mmax(ca.fabs(velocity) / ca.DM(self.chain.acceleration))
        r = ca.fmax(r, 1)
        return ca.sqrt(2 * r - 1) / r

    @property
    def _settling(self) -> float:
        """[1/s] what removes a share 1 - exp(-gain dt) of the error in one tick: never an overshoot, at any dt."""
        return (1 - math.exp(-self.gain * self.dt)) / self.dt

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

        Never raises on numbers: what is not usable gives the safe command, decelerating within the limits, and its
        reason.

        Parameters
        ----------
        q : (n,) joint positions now [rad, m].
        pose : (4, 4) where the tool should be now, in the base frame.
        twist : (6,) how that moves, linear [m/s] first, then angular [rad/s], in the base frame.
        obstacles : what moves, now, in the base frame; asked for in every tick of a tracker whose `Clearance` was told
            of moving capsules, and by no other. The array (k, 14) of `moving_numbers` is the quick form.
        enable : the dead-man input; anything but true decelerates to rest.
        stamp : time of the state [s]; checked by the watchdog when given.

        Raises
        ------
        ConfigurationError : an argument of the wrong shape. SharingError : a second thread, see `OneThread`.
        """
        if self._owner != get_ident():
            self._claim()
        self._take(q, pose, twist, obstacles)
        return self._tick(enable, stamp)

    def _take(
        self, q: ArrayLike, pose: ArrayLike, twist: ArrayLike, obstacles: Sequence[MovingCapsule] | Array | None
    ) -> None:
        """Write what `step` was told, or say what is wrong with it."""
        usual = False
        # A masked array would be read through its mask.
        if q.__class__ is _ndarray and twist.__class__ is _ndarray and pose.__class__ is _ndarray:
            try:
                # From view to view: half of numpy's cost, and any other type or size is refused.
                views: tuple[Any, ...] = self._views
                views[0][:], views[2][:] = q, twist
                views[1][:] = pose.ravel()
                usual = pose.ndim == 2 and len(pose) == 4
            except (ValueError, TypeError):
                usual = False
        if not usual:
            self._write((q, pose, twist, *self._inputs[2:]))
        if obstacles is not None or self.limits.moving:
            self._inputs[-1][:] = self.limits.capsule_numbers("obstacles", obstacles)


def _pose(entries: ca.SX) -> ca.SX:
    """(4, 4) from its entries by rows."""
    return ca.reshape(entries, 4, 4).T
