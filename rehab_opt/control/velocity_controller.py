"""Everything around a velocity QP: parameters into buffers, solve, certificate, fallbacks, safe command, Command."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.control.command import Bound, Command, Status
from rehab_opt.control.followed_joints import FollowedJoints, guidance
from rehab_opt.control.joint_feedback import JointFeedback
from rehab_opt.control.reasons import NUMBER, reason_number, reason_text
from rehab_opt.control.stopping import VelocityBounds, largest_change, nearest_to_rest, velocity_bounds
from rehab_opt.control.thread_owner import OneThread
from rehab_opt.control.watchdog import Watchdog
from rehab_opt.control.watched_joints import WatchedJoints, patience_of, watched_joints
from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.chain import SerialChain, per_joint
from rehab_opt.kinematics.real_array import is_finite, real_array
from rehab_opt.optim.certificate import clipped
from rehab_opt.optim.fallback_chain import FUSED, FallbackChain
from rehab_opt.optim.fused import FUSED_SOLVERS
from rehab_opt.optim.qp import Statement
from rehab_opt.optim.rows import PLAUSIBLE, Instance
from rehab_opt.symbolic import BufferedFunction, Compile
from rehab_opt.symbolic.record import Values

if TYPE_CHECKING:
    import qpsolvers

__all__ = ["VelocityController", "checked_number", "real_numbers"]

Array = NDArray[np.float64]
Column = TypeVar("Column", ca.SX, ca.MX)
MISSED = 1e-3
"""Fraction of the reference motion by which the delivered one must differ for the task to count as relaxed."""
ROUNDED = 1e-6
"""A bound by so much below zero is zero but for rounding."""
NOTHING_LEFT = "the bounds leave nothing of the commanded motion"
STILL = 1e-6
"""[m/s] Motions below this are none."""

# Bound once: each look-up of an attribute in the hot path would cost a hundredth of the tick.
_OK, _BLOCKED, _NAN, _new, _read_only = Status.OK, Status.BLOCKED, math.nan, tuple.__new__, np.frombuffer
# Looked up, since making an IntFlag costs half a microsecond; by the numbers of a verdict as they come.
_BOUNDS, _SOLVERS = {float(i): Bound(i) for i in range(8)}, {float(i): name for i, name in enumerate(FUSED_SOLVERS)}


class VelocityController(OneThread, ABC):
    """A controller whose command is a joint velocity held until the next tick.

    A subclass states its QP. Its first parameter is q (n,), its first variables are the joint velocities (n,), and its
    memory begins with the last velocity and the position it leads to (2 n,): `remember` gives both. Its `step` writes
    the inputs into `_views`, or through `_write`, and calls `_tick`. The command is the part `sent` of the memory, by
    default the last velocity, with the part `wheels` beside it.

    The velocity last commanded is part of the state: a new controller is at rest, `reset` says otherwise. An object
    belongs to one thread: see `OneThread`.

    Positions that do not follow the commands are a fault (`WatchedJoints`; with a `JointFeedback`, a following error):
    the robot brakes, the reason says which joint, and it rests until `reset`, or until `enable` was released. Call
    `reset` between states that are not one motion.
    """

    def __init__(
        self,
        chain: SerialChain,
        *,
        dt: float,
        recovery_speed: float,
        solver: str,
        backup: str | None,
        tolerance: float,
        max_age: float | None,
        compile: Compile,
        feedback: JointFeedback | None = None,
    ) -> None:
        if not isinstance(chain, SerialChain):
            raise ConfigurationError("chain", chain, "a SerialChain")
        self.chain = chain
        self.dt = checked_number("dt", dt, above=0.0, below=1.0)
        self.tolerance = tolerance
        self.recovery_speed = checked_number("recovery_speed", recovery_speed, above=0.0, below=1.0)
        self._watchdog = Watchdog(dt=dt, max_age=max_age)
        self.max_age = self._watchdog.max_age
        self.feedback = feedback
        self.led: FollowedJoints | None = None
        """Where a `feedback` leads the joints."""
        if feedback is not None:  # a hand that a base moves, too, is not watched
            hand = None if self.base else chain
            self.led = FollowedJoints(feedback, chain.names[self.base :], dt=self.dt, chain=hand)
            self._hurried = BufferedFunction(self.hurrying())
        self.approach = math.inf if feedback is None else feedback.approach
        """[1/s] see `velocity_bounds`."""
        self._solvers = FallbackChain(
            self.stated, solver=solver, backup=backup, tolerance=tolerance, compile=compile, beside=self.beside()
        )
        self._stopping = BufferedFunction(self.stopping())
        self._faulty = BufferedFunction(self.faulty())
        solvers, n = self._solvers, chain.n
        ends = np.cumsum([symbol.numel() for symbol in self.stated.parameters])
        first, *others = np.split(solvers.parameters, ends[:-1])
        self._q = first
        self._inputs = tuple(part.reshape(shape) for part, shape in zip(others, self.shapes, strict=True))
        self._fused, self._function, self._verdict = solver == FUSED, solvers.function, solvers.verdict
        before, after = solvers.everything
        self._keep, self._answer = before.data, after.data
        self._views: tuple[memoryview[Any], ...] = tuple(part.data for part in (first, *others))
        self._names = tuple(symbol[0].name().rsplit("_", 1)[0] for symbol in self.stated.parameters)
        self._last, self._predicted = solvers.memory[:n], solvers.memory[n : 2 * n]
        self._guided = solvers.memory[2 * n : 2 * n + self.guidance_size]
        self._sent = solvers.memory[slice(n) if self.sent is None else self.sent]
        self._velocity: memoryview[Any] = self._sent.data
        self._wheels = None if self.wheels is None else solvers.memory[self.wheels].data
        self._patience = patience_of(self.dt)
        self._watch = WatchedJoints(
            self.watch, chain.names, before[self.stated.state_size :], self._q, self._sent, patience=self._patience
        )
        self.reset()

    # ------------------------------------------------------------------------------------------- for subclasses
    shapes: ClassVar[tuple[tuple[int, ...], ...]] = ()
    """Shapes of the statement's parameters after q, as `step` takes them."""
    requirement: ClassVar[str] = ""
    """What is wrong when the statement's requirements are not met."""
    sent: slice | None = None
    """Part of the memory (n,) that is the command, None for the last velocity."""
    wheels: slice | None = None
    """Part of the memory that goes to wheels, None where there are none."""
    base: ClassVar[int] = 0
    """How many of the first joints are the place of a base that need not be measured, and is led by no `feedback`."""
    watched: ClassVar[bool] = True
    """Whether a joint that does not follow is a fault, where there is no `feedback`."""

    @property
    def watch(self) -> ca.Function:
        """What finds joints that do not follow, see `watched_joints`."""
        return watched_joints(self.chain, dt=self.dt, base=self.base, base_alone=self.feedback is not None)

    def beside(self) -> ca.Function:
        """See `fused`: `watch` on the positions and the command that led there, where those are watched."""
        n, watch = self.chain.n, self.watch
        p, memory = ca.MX.sym("p", self.stated.parameter_size), ca.MX.sym("memory", self.stated.memory.numel())
        watched = ca.MX.sym("watched", watch.numel_in(0))
        after, apart = watched, ca.MX(0)
        if self.watched and self.feedback is None:
            after, apart = watch(watched, p[:n], memory[slice(n) if self.sent is None else self.sent])
        return ca.Function("beside", [p, memory, watched], [after, apart])

    @abstractmethod
    def statement(self) -> Statement:
        """The QP of one tick."""

    @cached_property
    def stated(self) -> Statement:
        """The QP of one tick, made once."""
        return self.statement()

    def bounds(self, q: ca.SX, memory: ca.SX) -> VelocityBounds:
        """Intervals of the joint velocities."""
        last, guided = memory[: self.chain.n], self.guided(memory)
        led = {} if guided is None or self.feedback is None else {
            "strays": guided.apart, "margin": self.feedback.thrown(self.chain, last)
        }  # fmt: skip
        return velocity_bounds(
            self.chain, q, last, dt=self.dt, recovery_speed=self.recovery_speed, approach=self.approach, **led
        )

    @property
    def guidance_size(self) -> int:
        """How many numbers of the memory, behind velocity and position, are what `guidance` names."""
        return 0 if self.feedback is None else guidance(self.chain.n).size

    def guided(self, memory: ca.SX) -> Values | None:
        """Values of `guidance` in a memory; None where joints are not led."""
        n = self.chain.n
        return guidance(n).parts(memory[2 * n : 2 * n + self.guidance_size]) if self.guidance_size else None

    def report(self, last: ca.SX, velocity: ca.SX, delivered: ca.SX, asked: ca.SX, outside: ca.SX) -> ca.SX:
        """Relaxed bounds, a number of `Bound`, and the delivered fraction of the reference motion, 1 where it is zero.

        `delivered` and `asked` are twists, weighted alike; `outside` says that a joint is beyond its limit.
        """
        hurried = self.hurried(last, velocity)
        size = ca.sumsqr(asked)
        missed = ca.sumsqr(delivered - asked) > MISSED**2 * size + STILL**2
        along = clipped(ca.dot(delivered, asked) / ca.fmax(size, STILL**2), 0, 1)
        along = ca.if_else(along > MISSED, along, 0)
        yielded = int(Bound.POSITION) * outside + int(Bound.ACCELERATION) * hurried + int(Bound.TASK) * missed
        return ca.vertcat(yielded, ca.if_else(ca.logic_and(missed, size > STILL**2), along, 1))

    def hurried(self, last: Column, velocity: Column) -> Column:
        """1 where joints go from one velocity (n,) to the other faster than their accelerations allow."""
        allowed = largest_change(self.chain, self.dt) * (1 + 1e-9) + 1e-12
        return ca.sum1(ca.fabs(velocity - last) > allowed) > 0

    def hurrying(self) -> ca.Function:
        """`hurried` of two velocities (n,)."""
        last, velocity = ca.SX.sym("last", self.chain.n), ca.SX.sym("velocity", self.chain.n)
        return ca.Function("hurried", [last, velocity], [self.hurried(last, velocity)])

    def remember(self, q: ca.SX, velocity: ca.SX) -> ca.SX:
        """The velocity, where it leads by the next tick, and space for that tick's `guidance` of led joints."""
        return ca.vertcat(velocity, q + velocity * self.dt, ca.SX.zeros(self.guidance_size))

    def memory_after(self, q: ca.SX, last: ca.SX, velocity: ca.SX) -> ca.SX:
        """What a tick of the safe command remembers at q, after the last velocity."""
        return self.remember(q, velocity)

    def braking(self) -> ca.Function:
        """q, memory -> what is remembered of the safe command, and its report."""
        q, memory = ca.SX.sym("q", self.chain.n), ca.SX.sym("memory", self.stated.memory.numel())
        last = memory[: self.chain.n]
        bounds = self.bounds(q, memory)
        rest = nearest_to_rest(bounds)
        report = self.report(last, rest, ca.SX(0), ca.SX(1), bounds.outside)  # nothing of the task is delivered
        outputs = [ca.densify(self.memory_after(q, last, rest)), report]
        return ca.Function("braking", [q, memory], outputs)

    def fallback_command(self) -> Command | None:
        """Command where every solver failed and the parameters are valid; None for the safe command."""
        return None

    def stopping(self) -> ca.Function:
        """Parameters, state -> state after a tick of the safe command; what yielded and whether it moves; q (n,).

        The last good position stands in for one that is unusable, and of what else `braking` needs, the last
        parameters, nothing is there where one of its numbers is. The warm start is forgotten.
        """
        stated, n, brake = self.stated, self.chain.n, self.braking()
        p, state = ca.MX.sym("p", stated.parameter_size), ca.MX.sym("state", stated.state_size)
        memory = state[stated.state_size - stated.memory.numel() :]
        q = ca.if_else(ca.fabs(p[:n]) <= PLAUSIBLE, p[:n], memory[n : 2 * n])
        given = [q, memory]
        if brake.n_in() > len(given):
            around = p[p.numel() - brake.size1_in(2) :]
            usable = ca.sum1(ca.fabs(around) <= PLAUSIBLE) == around.numel()
            given.append(ca.if_else(usable, around, 0))
        kept, report = brake.call(given)
        after = ca.vertcat(kept, memory[kept.numel() :])  # what else a subclass remembers is its own to forget
        start = ca.vertcat(kept[:n], ca.MX.zeros(state.numel() - memory.numel() - n))
        moves = ca.sum1(after[slice(n) if self.sent is None else self.sent] != 0) > 0
        said = ca.vertcat(report[0], moves)
        return ca.Function("stopping", [p, state], [ca.vertcat(start, after), said, q])

    def faulty(self) -> ca.Function:
        """Parameters, whether they are sound -> number of the reason for no certified answer, input and element of it.

        Input and element, both counted from 0, are those of the first number that is not usable, else -1.
        """
        p, sound = ca.SX.sym("p", self.stated.parameter_size), ca.SX.sym("sound")
        where = [(i, k) for i, each in enumerate(self.stated.parameters) for k in range(each.numel())]
        reason = ca.if_else(ca.norm_2(p) <= PLAUSIBLE, reason_number(self.requirement), NUMBER["INPUT_TOO_LARGE"])
        found = ca.vertcat(ca.if_else(sound, NUMBER["NOT_CERTIFIED"], reason), -1, -1)
        for at, (i, k) in reversed(list(enumerate(where))):
            found = ca.if_else(ca.fabs(p[at]) <= PLAUSIBLE, found, ca.DM([NUMBER["INPUT_UNUSABLE"], i, k]))
        return ca.Function("faulty", [p, sound], [found])

    # -------------------------------------------------------------------------------------------------- the user's
    def reset(self, velocity: ArrayLike | None = None) -> None:
        """Forget the past, that of the solvers too; `velocity` (n,) is what the joints do now, rest by default."""
        n = self.chain.n
        speed = np.zeros(n) if velocity is None else per_joint("velocity", velocity, n, finite=True)
        if np.any(np.abs(speed) > self.chain.velocity):
            raise ConfigurationError("velocity", velocity, "joint speeds within their limits")
        self._claim()
        self._solvers.memory[:] = 0.0
        self._last[:] = speed
        self._solvers.forget(np.append(speed, np.zeros(self.stated.n - n)))
        lower, upper = np.maximum(self.chain.lower, -PLAUSIBLE), np.minimum(self.chain.upper, PLAUSIBLE)
        self._predicted[:] = (lower + upper) / 2
        self._watchdog.reset()
        self._forget_joints(speed)
        self._give_away()

    def instance(self, q: ArrayLike, *inputs: ArrayLike) -> Instance:
        """The QP that `step` would solve now, as numbers, for inspection."""
        return self.stated.instance(q, *inputs, memory=self._solvers.memory.copy())

    def to_qpsolvers(self, q: ArrayLike, *inputs: ArrayLike) -> qpsolvers.Problem:
        """The QP that `step` would solve now, as a `qpsolvers.Problem`."""
        from rehab_opt.optim.backends import to_qpsolvers  # noqa: PLC0415  (solvers load when used)

        return to_qpsolvers(self.instance(q, *inputs))

    # ---------------------------------------------------------------------------------------------------- one tick
    def _refusal(self, enable: object, stamp: float | None) -> str:
        """Why this state must not be acted on, or nothing."""
        reason = self._watchdog.check(stamp)
        if enable is not True and not (isinstance(enable, np.bool_ | int | float) and enable == 1):
            reason = "not enabled"
            if not self._sent.any():  # an arm that was switched off may be moved by hand, and a fault is acknowledged
                self._forget_joints(np.zeros(self.chain.n))
                return reason
        if reason:
            self._not_following()
        return reason

    def _forget_joints(self, velocity: Array) -> None:
        """Where the joints were is forgotten; they move at `velocity` (n,) now."""
        self._watch.reset()
        if self.led is not None:
            self.led.reset(velocity[self.base :])

    def _tick(self, enable: object, stamp: float | None) -> Command:
        """One step on what stands in the parameters."""
        if self.led is None:
            return self._decided(enable, stamp, self._watch.known)
        return self._led(lambda fault, note: self._decided(enable, stamp, fault, note))

    def _not_following(self) -> str:
        """Which joint does not follow, asked in each tick whose fused answer is not taken: with it, the function asks.

        Empty where all do, where none is `watched`, and where joints are led: see `_led`.
        """
        return self._watch.fault() if self.watched and self.led is None else ""

    def _led(self, decided: Callable[[str, str], Command]) -> Command:
        """What `decided` makes of where the joints are led, put in place of what was measured, of a fault and a note.

        Every controller passes here once a tick, after the positions are written and before anything acts on them.
        """
        if self.led is None:
            return decided("", "")
        watched = self._watch.fault() if self.base else ""  # of which no model is known
        led = self.led
        fault = led.lead(self._q[self.base :], self._last[self.base :], self._guided) or watched
        if not led.touched:
            return decided(fault, led.note)
        command = decided(fault, led.note)  # from rest: whatever held the hand has stopped the joints
        if self._hurried.of(led.before, self._last):
            command = command._replace(yielded=command.yielded | Bound.ACCELERATION)
        return command

    def _decided(self, enable: object, stamp: float | None, reason: str = "", note: str = "") -> Command:
        """The command on what stands in the parameters and in the memory; the safe one where there is a reason."""
        if enable is not True or stamp is not None or self._watchdog.stamped:
            reason = self._refusal(enable, stamp) or reason
        if reason:
            return self._safe(reason)
        if self._fused:  # the usual way, without the layers of Python: they would cost as much as the solve
            verdict = self._verdict
            verdict[0] = _NAN  # see `FallbackChain`: a failure inside leaves the outputs as they are
            self._function.evaluate()
            residual, _, who, yielded, scale, apart = verdict.tolist()
            if 0.0 <= residual <= self.tolerance and 0.0 <= apart <= self._patience:
                self._keep[:] = self._answer
                value = _read_only(self._velocity.tobytes())  # a copy
                wheels = None if self._wheels is None else _read_only(self._wheels.tobytes())
                name, bound = _SOLVERS[who], _BOUNDS[yielded]
                if scale:
                    return _new(Command, (value, _OK, name, residual, -1, note, bound, scale, wheels))
                return Command(value, _BLOCKED, name, residual, -1, _blocked(note), bound, scale, wheels)
        reason, solvers = self._not_following(), self._solvers
        if reason:
            return self._safe(reason)
        solver = solvers.solve_with_fallback() if self._fused else solvers()
        if not solver:
            return self.fallback_command() or self._safe(self._fault())
        status, reason = Status.OK, note
        if solver == solvers.backup != solvers.solver:
            status, reason = (
                Status.BACKUP,
                "; ".join(filter(None, (f"{solvers.solver} gave no certified answer", note))),
            )
        residual, _, _, yielded, scale, _ = solvers.verdict.tolist()
        if status is Status.OK and not scale:
            status, reason = Status.BLOCKED, _blocked(note)
        bound = _BOUNDS[yielded]
        value, wheels = self._sent_now()
        return Command(value, status, solver, residual, solvers.iterations, reason, bound, scale, wheels)

    def _sent_now(self) -> tuple[Array, Array | None]:
        """Copy of the command and the wheel speeds, read-only and without negative zeros."""
        value, wheels = self._sent + 0.0, None
        value.setflags(write=False)
        if self._wheels is not None:
            wheels = np.frombuffer(self._wheels.tobytes()) + 0.0
            wheels.setflags(write=False)
        return value, wheels

    def _write(self, values: tuple[ArrayLike, ...]) -> None:
        """Copy what is not a float array, or say what is wrong with it; numbers are judged by the certificate."""
        for target, value, name in zip((self._q, *self._inputs), values, self._names, strict=True):
            target[...] = real_numbers(name, value, target.shape)

    def _safe(self, reason: str) -> Command:
        """Decelerate within the bounds, from the last good position where this one is unusable."""
        stopping, solvers = self._stopping, self._solvers
        stopping.inputs[0][:], stopping.inputs[1][:] = solvers.parameters, solvers.state
        stopping()
        state, (yielded, moves), _ = stopping.outputs
        solvers.keep[:] = state.data
        value, wheels = self._sent_now()
        status = Status.BRAKING if moves else Status.HOLDING
        return Command(value, status, "", math.inf, -1, reason, _BOUNDS[yielded], 0.0, wheels)

    def _fault(self) -> str:
        return self._unusable(sound=bool(self._solvers.sound[0])) or reason_text(
            NUMBER["NOT_CERTIFIED"], self._solvers.residual
        )

    def _unusable(self, *, sound: bool) -> str:
        """What is wrong with the parameters; nothing where they are `sound` and every number is usable."""
        reason, i, k = self._faulty.of(self._solvers.parameters, sound).astype(int).tolist()
        if reason == NUMBER["NOT_CERTIFIED"]:
            return ""
        if i < 0:
            return reason_text(reason, ())
        array = (self._q, *self._inputs)[i]
        where = ", ".join(map(str, np.unravel_index(k, array.shape)))
        return f"{self._names[i]}[{where}] is {array.flat[k]}, not a usable number"


def _blocked(note: str) -> str:
    """Why nothing of the commanded motion is left, and what else is to be said."""
    return f"{NOTHING_LEFT}; {note}" if note else NOTHING_LEFT


def real_numbers(argument: str, value: ArrayLike, shape: tuple[int, ...]) -> Array:
    """`value` as an array of that shape, whatever its numbers are: an integer that no float holds is infinite."""
    expected = f"real numbers of shape {shape}"
    try:
        array = real_array(value)
    except OverflowError:
        return np.full(shape, math.inf)
    except (TypeError, ValueError) as problem:
        raise ConfigurationError(argument, value, expected) from problem
    if array.shape != shape:
        raise ConfigurationError(argument, value, expected)
    return array


def checked_number(
    argument: str, value: float, *, above: float, below: float = math.inf, most: float = math.inf
) -> float:
    """`value` as a float strictly between `above` and `below`, and at most `most`."""
    if is_finite(value) and above < value < below and value <= most:
        return float(value)
    least = "of at least 0" if -ROUNDED < above < 0 else f"above {above:g}"
    end = f" and below {below:g}" * math.isfinite(below) + f" and at most {most:g}" * math.isfinite(most)
    raise ConfigurationError(argument, value, f"a number {least}{end}")
