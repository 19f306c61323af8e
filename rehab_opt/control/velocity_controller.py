"""Base of a controller around a velocity QP: parameters, solve, certificate, fallbacks, and Command."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, cast

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.control.command import NUMBERED, Command, Relaxed, Status
from rehab_opt.control.front_end import FrontEnd
from rehab_opt.control.judged_state import GIVEN, judged_memory, judged_state, nothing_known
from rehab_opt.control.reasons import NUMBER, reason_number, reason_text
from rehab_opt.control.stopping import APPROACH, VelocityBounds, max_change, velocity_bounds
from rehab_opt.control.thread_owner import OneThread, setting
from rehab_opt.control.velocity_tick import (
    LEFT_TO_OTHERS,
    NOTHING_TO_SOLVE,
    REPORT,
    VELOCITY_SOLVERS,
    VelocityTick,
    velocity_tick,
)
from rehab_opt.control.watchdog import NUMBER_OF_SECONDS, Watchdog, stamp_and_kind
from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.chain import SerialChain, per_joint
from rehab_opt.kinematics.plausible import farthest, implausible
from rehab_opt.kinematics.real_array import is_finite, is_true, real_array
from rehab_opt.optim.certificate import all_true, delivered_fraction
from rehab_opt.optim.fallback_chain import FUSED, FallbackChain
from rehab_opt.optim.fused import FUSED_SOLVERS
from rehab_opt.optim.qp import Statement
from rehab_opt.optim.rows import MAX_MAGNITUDE, Instance
from rehab_opt.symbolic import BufferedFunction, Compile
from rehab_opt.symbolic.record import Record
from rehab_opt.symbolic.shared import form_of_parts, remembered

if TYPE_CHECKING:
    import qpsolvers

__all__ = ["VelocityController", "checked_number", "real_numbers"]

Array = NDArray[np.float64]
MISSED = 1e-3
"""Relative difference between reference and delivered motion above which the task counts as relaxed."""
ROUNDED = 1e-6
"""Tolerance of a zero bound, for rounding."""
STILL = 1e-6
"""[m/s] Slower motions count as none."""

# Bound once: each attribute look-up in the hot path costs a hundredth of the tick.
_OK, _NAN, _new, _read_only, _JUDGED = Status.OK, math.nan, tuple.__new__, np.frombuffer, GIVEN["judged"]
# A table, since making an IntFlag costs half a microsecond; keys are the numbers of a verdict.
_BOUNDS, _SOLVERS = (
    {float(i): Relaxed(i) for i in range(8)},
    {float(i): name for i, name in enumerate(VELOCITY_SOLVERS)} | {-1.0: ""},
)


class VelocityController(OneThread, ABC):
    """Controller whose command is a joint velocity held until the next tick.

    A subclass defines its QP. The QP's first parameter is q (n,), its first variables are the joint velocities (n,).
    The QP's memory begins with the result of `remember`: the last velocity and the position after it (2 n,). The
    subclass's `step` writes the inputs into `_views`, or through `_write`, and calls `_tick`. The command is
    `memory[command_slice]`, by default the last velocity; `memory[wheels]` are wheel speeds.

    The controller computes with commanded joint positions; measurements only supervise them, see `FrontEnd`.
    """

    chain: SerialChain = setting()
    dt: float = setting()
    tolerance: float = setting()
    recovery_speed: float = setting()
    max_age: float = setting()

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
    ) -> None:
        if not isinstance(chain, SerialChain):
            raise ConfigurationError("chain", chain, "a SerialChain")
        self.chain = chain
        self.dt = checked_number("dt", dt, above=0.0, below=1.0)
        self.tolerance = tolerance
        self.recovery_speed = checked_number("recovery_speed", recovery_speed, above=0.0, below=1.0)
        self.max_age = Watchdog(dt=dt, max_age=max_age).max_age
        self.led = FrontEnd(chain, dt=self.dt, max_age=self.max_age, base=self.base) if self.watched else None
        """Commanded positions of the joints."""
        parts = dict(vars(self))
        self._code = [each for kind in type(self).__mro__ for each in vars(kind).values()]  # classes may change

        def made() -> dict[str, Any]:
            self.functions = self._functions()
            return {name: each for name, each in vars(self).items() if name not in parts}

        vars(self).update(remembered(form_of_parts(type(self), parts, list(map(id, self._code))), made))
        self._solvers = solvers = FallbackChain(
            self.stated, solver=solver, backup=backup, tolerance=tolerance, compile=compile, tick=self.functions.tick
        )
        self._inside = solver == FUSED and not solvers.is_recorded()
        """Whether the QP is solved inside the tick's function; for a recorder, the QP is solved on its own."""
        self._function, n = solvers.function, chain.n
        (parameters, everything, given), (after, verdict, told) = self._function.inputs, self._function.outputs
        own = everything[self.stated.state_size :]
        seldom: Compile = False if solver == FUSED else compile
        inputs = dict(enumerate((parameters, everything, given, after[: self.stated.state_size], verdict)))
        self._finish = BufferedFunction(self.functions.finish, compile=seldom, inputs=inputs)
        inputs = {1: solvers.memory, 2: own, 3: given}
        self._judge = BufferedFunction(self.functions.judge, compile=seldom, inputs=inputs)
        self._begin_anew = BufferedFunction(self.beginning())
        ends = np.cumsum([symbol.numel() for symbol in self.stated.parameters])
        first, *others = np.split(parameters, ends[:-1])
        self._q = first
        self._inputs = tuple(part.reshape(shape) for part, shape in zip(others, self.shapes, strict=True))
        self._views: tuple[memoryview[Any], ...] = tuple(part.data for part in (first, *others))
        self._names = tuple(symbol[0].name().rsplit("_", 1)[0] for symbol in self.stated.parameters)
        # Memory views: twice as fast as numpy's indexing.
        views = (cast("memoryview[float]", each.data) for each in (everything, after, given, told))
        self._keep, self._answer, self._given, self._told = views
        self._verdict, self._head = solvers.verdict, self._told[: REPORT["unusual"] + 1]
        self._own = {name: own[place] for name, place in self.judged.places.items()}
        self._last = solvers.memory[:n]
        self._command_view = solvers.memory[slice(n) if self.command_slice is None else self.command_slice]
        self._velocity: memoryview[Any] = self._command_view.data
        self._wheels = None if self.wheels is None else solvers.memory[self.wheels].data
        self._set_enable(enable=True, stamp=None)
        self.reset()

    # ------------------------------------------------------------------------------------------- for subclasses
    shapes: ClassVar[tuple[tuple[int, ...], ...]] = ()
    """Shapes of the statement's parameters after q, as in `step`."""
    twist_rows: Sequence[str] = ("x", "y", "z", "rx", "ry", "rz")
    """Names of the components of a twist."""
    requirement: ClassVar[str] = ""
    """Text for unmet requirements of the statement."""
    command_slice: slice | None = None
    """Slice of the memory that holds the command (n,); None for the last velocity."""
    wheels: slice | None = None
    """Slice of the memory that holds wheel speeds; None without wheels."""
    motion: slice | None = None
    """Slice of the memory, after velocity and position, that is zero at rest; None for everything after them."""
    names_what_blocks: ClassVar[bool] = False
    """Whether the report ends with the reason why a command delivers nothing, and the joint that blocks it."""
    base: ClassVar[int] = 0
    """Number of leading joints that are the position of a mobile base, see `FrontEnd`."""
    watched: ClassVar[bool] = True
    """Whether there is a `FrontEnd`; False for joints that are exactly at their commanded positions."""

    @property
    def judged(self) -> Record:
        """See `judged_memory`."""
        return judged_memory(self.chain.n, self.led.size if self.led else 0)

    functions: VelocityTick
    """Functions of a tick, built once for all controllers with equal settings."""

    def _functions(self) -> VelocityTick:
        stated, n = self.stated, self.chain.n
        judge = judged_state(
            n, int(stated.memory.numel()), dt=self.dt, max_age=self.max_age, led=self.led,
            sent=self.command_slice or slice(n), motion=self.motion or slice(2 * n, None),
        )  # fmt: skip
        return velocity_tick(
            stated, judge, self.judged, stop=self.stopping(), faulty=self.faulty(), law=self.fallback_law(),
            hurried=self.hurried, tolerance=self.tolerance, named=self.names_what_blocks,
        )  # fmt: skip

    @abstractmethod
    def statement(self) -> Statement:
        """QP of one tick."""

    @property
    def farthest(self) -> float:
        """Distance [m] from the base above which a pose is an error: ten times the arm's reach."""
        return farthest(self.chain)

    @cached_property
    def stated(self) -> Statement:
        """QP of one tick, built once; it gives no answer for impossible inputs."""
        wrong = implausible(self.chain, (stated := self.statement()).parameters, stated.parameters, self.twist_rows)
        return replace(stated, requires=[*stated.requires, ca.sum1(wrong) == 0])

    def bounds(self, q: ca.SX, memory: ca.SX) -> VelocityBounds:
        """Intervals of the joint velocities."""
        return velocity_bounds(
            self.chain, q, memory[: self.chain.n], dt=self.dt, recovery_speed=self.recovery_speed,
            approach=APPROACH if self.watched else math.inf,
        )  # fmt: skip

    def report(self, last: ca.SX, velocity: ca.SX, delivered: ca.SX, commanded: ca.SX, outside: ca.SX) -> ca.SX:
        """Flags of `Relaxed` as a number, and `delivered_fraction` of the reference motion.

        `delivered` and `commanded` are twists with equal weights; `outside` means that a joint is beyond its limit.
        """
        hurried = self.hurried(last, velocity)
        size = ca.sumsqr(commanded)
        missed = ca.sumsqr(delivered - commanded) > MISSED**2 * size + STILL**2
        relaxed = int(Relaxed.POSITION) * outside + int(Relaxed.ACCELERATION) * hurried + int(Relaxed.TASK) * missed
        return ca.vertcat(relaxed, delivered_fraction(delivered, commanded, missed, least=STILL))

    @cached_property
    def hurried(self) -> ca.Function:
        """Function: last velocity (n,), velocity (n,) -> whether the change exceeds an acceleration limit."""
        last, velocity = ca.SX.sym("last", self.chain.n), ca.SX.sym("velocity", self.chain.n)
        faster = ca.sum1(ca.fabs(velocity - last) > max_change(self.chain, self.dt) * (1 + 1e-9) + 1e-12) > 0
        return ca.Function("hurried", [last, velocity], [faster])

    def remember(self, q: ca.SX, velocity: ca.SX) -> ca.SX:
        """Velocity, and position after the tick."""
        return ca.vertcat(velocity, q + velocity * self.dt)

    def memory_after(self, q: ca.SX, last: ca.SX, velocity: ca.SX) -> ca.SX:
        """Memory after a tick at q (n,) with the fallback command `velocity` (n,), which follows `last` (n,)."""
        return self.remember(q, velocity)

    @abstractmethod
    def braking(self) -> ca.Function:
        """Function: q, memory -> memory after the fallback command, and its report."""

    def fallback_law(self) -> ca.Function | None:
        """Function for a tick in which every solver fails, or None: parameters, memory -> report, memory, violation."""
        return None

    def beginning(self) -> ca.Function:
        """Function: current velocity (n,) -> initial state, whether the joints may be that fast."""
        velocity = ca.SX.sym("velocity", self.chain.n)
        lower, upper = np.maximum(self.chain.lower, -MAX_MAGNITUDE), np.minimum(self.chain.upper, MAX_MAGNITUDE)
        n, memory, nothing = self.chain.n, int(self.stated.memory.numel()), ca.SX.zeros
        start = ca.vertcat(velocity, nothing(self.stated.state_size - memory - n))
        remembered = ca.vertcat(velocity, (lower + upper) / 2, nothing(memory - 2 * n))
        known = ca.vertcat(start, remembered, nothing_known(self.judged))
        possible = all_true(ca.fabs(velocity) <= ca.DM(self.chain.velocity))
        return ca.Function("begin", [velocity], [ca.densify(known), possible])

    def stopping(self) -> ca.Function:
        """Function: parameters, state -> state after the fallback command, [relaxed bounds, whether it moves], q (n,).

        An invalid position is replaced by the position in memory. The warm start is discarded.
        """
        stated, n, brake = self.stated, self.chain.n, self.braking()
        p, state = ca.MX.sym("p", stated.parameter_size), ca.MX.sym("state", stated.state_size)
        memory = state[stated.state_size - stated.memory.numel() :]
        q = ca.if_else(ca.fabs(p[:n]) <= MAX_MAGNITUDE, p[:n], memory[n : 2 * n])
        given = [q, memory]
        if brake.n_in() > len(given):
            around = p[p.numel() - brake.size1_in(2) :]
            valid = ca.sum1(ca.fabs(around) <= MAX_MAGNITUDE) == around.numel()
            given.append(ca.if_else(valid, around, 0))
        kept, report = brake.call(given)
        after = ca.vertcat(kept, memory[kept.numel() :])  # a subclass clears the rest of its memory
        start = ca.vertcat(kept[:n], ca.MX.zeros(state.numel() - memory.numel() - n))
        moves = ca.sum1(after[slice(n) if self.command_slice is None else self.command_slice] != 0) > 0
        said = ca.vertcat(report[0], moves)
        return ca.Function("stopping", [p, state], [ca.vertcat(start, after), said, q])

    def faulty(self) -> ca.Function:
        """Function: parameters, whether they are valid -> why no answer is certified.

        The output holds the number of the reason, and the indices of the input and its element; -1 for none.
        """
        p, valid = ca.SX.sym("p", self.stated.parameter_size), ca.SX.sym("valid")
        where = [(i, k) for i, each in enumerate(self.stated.parameters) for k in range(each.numel())]
        reason = ca.if_else(ca.norm_2(p) <= MAX_MAGNITUDE, reason_number(self.requirement), NUMBER["INPUT_TOO_LARGE"])
        found = ca.vertcat(ca.if_else(valid, NUMBER["NOT_CERTIFIED"], reason), -1, -1)
        parts = ca.vertsplit(p, [0, *np.cumsum([each.numel() for each in self.stated.parameters]).tolist()])
        wrong = implausible(self.chain, self.stated.parameters, parts, self.twist_rows)
        for i, name in enumerate(("POSE_TOO_FAR", "INPUT_TOO_LARGE")):
            found = ca.if_else(wrong[i], ca.DM([NUMBER[name], -1, -1]), found)
        for at, (i, k) in reversed(list(enumerate(where))):
            found = ca.if_else(ca.fabs(p[at]) <= MAX_MAGNITUDE, found, ca.DM([NUMBER["INPUT_INVALID"], i, k]))
        return ca.Function("faulty", [p, valid], [found])

    # -------------------------------------------------------------------------------------------------- the user's
    def reset(self, velocity: ArrayLike | None = None) -> None:
        """Reset the state and the solvers; `velocity` (n,) is the joints' current velocity, by default rest."""
        n = self.chain.n
        speed = np.zeros(n) if velocity is None else per_joint("velocity", velocity, n, finite=True)
        if not self._began(speed):
            raise ConfigurationError("velocity", velocity, "joint speeds within their limits")

    def _began(self, *given: ArrayLike) -> bool:
        self._refuse_others()
        state = self._begin_anew.of(*given)
        if not self._begin_anew.outputs[1][0]:
            return False
        self._claim()
        self._solvers.forget()
        self._solvers.everything[:] = state
        self._give_away()
        return True

    def instance(self, q: ArrayLike, *inputs: ArrayLike) -> Instance:
        """QP that `step` would solve now, as numbers, for inspection."""
        return self.stated.instance(q, *inputs, memory=self._solvers.memory.copy())

    def to_qpsolvers(self, q: ArrayLike, *inputs: ArrayLike) -> qpsolvers.Problem:
        """QP that `step` would solve now, as a `qpsolvers.Problem`."""
        from rehab_opt.optim.backends import to_qpsolvers  # noqa: PLC0415  (solvers load when used)

        return to_qpsolvers(self.instance(q, *inputs))

    # ---------------------------------------------------------------------------------------------------- one tick
    def _set_enable(self, enable: object, stamp: float | None) -> None:
        given = self._given
        given[0], given[1] = (stamp, NUMBER_OF_SECONDS) if type(stamp) is float else stamp_and_kind(stamp)
        given[2] = is_true(enable)
        self._usual = enable is True and stamp is None

    def _tick(self, enable: object, stamp: float | None) -> Command:
        if enable is not True or stamp is not None or not self._usual:
            self._set_enable(enable, stamp)
        if not self._inside:
            return self._otherwise(LEFT_TO_OTHERS)
        self._told[0] = self._verdict[0] = _NAN  # see `FallbackChain`: a failure inside leaves the outputs unchanged
        self._function.evaluate()
        left, residual, who, relaxed, scale, unusual = self._head.tolist()
        if left:  # NaN, too
            return self._otherwise(left)
        self._keep[:] = self._answer
        if unusual:
            return self._as_told(self._told)
        value = _read_only(self._velocity.tobytes())  # a copy
        wheels = None if self._wheels is None else _read_only(self._wheels.tobytes())
        return _new(Command, (value, _OK, _SOLVERS[who], residual, -1, "", _BOUNDS[relaxed], scale, wheels))

    def _judged(self) -> str:
        """Check the state once in a tick; return the reason why it is invalid, or an empty text."""
        self._judge.inputs[0][:] = self._q
        self._judge.evaluate()
        self._q[:], self._solvers.memory[:], self._judge.inputs[2][:] = self._judge.outputs
        self._given[_JUDGED] = 1.0
        own = self._own
        return self._words(own["reason"][0], -1, own["element"][0], own["details"].tolist())

    def _otherwise(self, left: float) -> Command:
        """Run the tick with other solvers, or return the fallback command."""
        solver, solvers = "", self._solvers
        if left != NOTHING_TO_SOLVE and not self._judged():
            solver = solvers.solve_with_fallback() if self._inside else solvers()
        command = self._finished()
        self._given[_JUDGED] = 0.0
        if not solver:
            return command
        if solver == solvers.backup != solvers.solver:
            words = f"{solvers.solver} gave no certified answer"
            command = command._replace(status=Status.BACKUP, reason=words)
        return command._replace(solver=solver, iterations=solvers.iterations)

    def _finished(self) -> Command:
        self._finish.evaluate()
        after, told, _ = self._finish.outputs
        self._solvers.everything[:] = after
        return self._as_told(told.data)

    def _safe(self, reason: str) -> Command:
        """Fallback command at a checked state, or without measurements."""
        judged, self._given[_JUDGED], self._own["reason"][:] = self._given[_JUDGED], 1.0, bool(reason)
        command = self._finished()
        self._given[_JUDGED], self._own["reason"][:] = judged, 0.0
        return command._replace(reason=reason) if reason else command

    def _as_told(self, told: memoryview[Any]) -> Command:
        _, residual, who, relaxed, scale, _, status, reason, where, element, *details, note = told.tolist()
        name, words = _SOLVERS[who], self._words(reason, where, element, details)
        if who == len(FUSED_SOLVERS):
            words = f"{words}: {name}"
        words = "; ".join(filter(None, (words, self._noted(int(note)))))
        value = _read_only((np.frombuffer(self._velocity) + 0.0).tobytes())  # no negative zeros
        wheels = None if self._wheels is None else _read_only((np.frombuffer(self._wheels) + 0.0).tobytes())
        return Command(value, NUMBERED[int(status)], name, residual, -1, words, _BOUNDS[relaxed], scale, wheels)

    def _noted(self, notes: int) -> str:
        return ""

    def _words(self, reason: float, where: float, element: float, details: Sequence[float]) -> str:
        if reason == NUMBER["NOT_FOLLOWED"]:
            return f"{self.chain.names[int(element)]} does not follow: {details[0]:.2g} rad or m off its command"
        if reason == NUMBER["INPUT_INVALID"]:
            values = (self._q, *self._inputs)[int(where)]
            place = ", ".join(map(str, np.unravel_index(int(element), values.shape)))
            return f"{self._names[int(where)]}[{place}] is {values.flat[int(element)]}, not a valid number"
        if reason == NUMBER["JOINT_BLOCKS"]:
            return f"{self.chain.names[int(element)]} at its limit blocks the motion"
        return reason_text(reason, details)

    def _write(self, values: tuple[ArrayLike, ...]) -> None:
        """Copy a value that is not a float array, or raise an error about it."""
        for target, value, name in zip((self._q, *self._inputs), values, self._names, strict=True):
            target[...] = real_numbers(name, value, target.shape)


def real_numbers(argument: str, value: ArrayLike, shape: tuple[int, ...]) -> Array:
    """`value` as an array of the given shape; an integer too large for a float becomes infinite."""
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
