"""Force on a hand: the desired force, bounded so that it is safe for a person."""

from __future__ import annotations

import math
from array import array
from collections.abc import Sequence
from threading import get_ident
from typing import TYPE_CHECKING, Any, TypedDict, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.control.assistance_statement import assistance_statement
from rehab_opt.control.command import NUMBERED, Command, Relaxed, Status
from rehab_opt.control.energy_tank import LAGS, SLOTS, TAIL, tank_record
from rehab_opt.control.force_tick import MODEL, VIEW, affordable, anew, force_tick, give, watched_record
from rehab_opt.control.gate import DesiredForce
from rehab_opt.control.hand import HAND
from rehab_opt.control.reasons import reason_text
from rehab_opt.control.thread_owner import OneThread, setting
from rehab_opt.control.velocity_controller import checked_number
from rehab_opt.control.watchdog import NO_STAMP, STAMPS, Watchdog, stamp_and_kind
from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.real_array import is_true, real_array
from rehab_opt.optim.fallback_chain import FUSED, FallbackChain
from rehab_opt.optim.fused import FUSED_SOLVERS
from rehab_opt.optim.qp import Statement
from rehab_opt.optim.rows import Instance
from rehab_opt.symbolic import BufferedFunction, Compile

if TYPE_CHECKING:
    import qpsolvers

__all__ = ["BoundedForce", "ForceBounds"]

Array = NDArray[np.float64]

_FLOATS = np.dtype(np.float64)
_NAN, _new, _read_only = math.nan, tuple.__new__, np.frombuffer
_BOUNDS = tuple(Relaxed(i) for i in range(16))  # a table, since making an IntFlag costs half a microsecond
_REASON, _PLACE = VIEW["reason"], STAMPS.size + HAND["x"]
NOISE_PEAK = 6.0
"""Largest displacement by noise between two samples, in standard deviations of one coordinate."""


class ForceBounds(TypedDict, total=False):
    """Options that are passed to `BoundedForce`."""

    slew_limit: float
    growth_limit: float
    energy_budget: float
    speed_cap: float
    actuation_delay: float
    actuation_lag: float
    actuation_uncertainty: float
    position_noise: float | None
    velocity_lag: float
    trust_stillness: bool
    dt: float
    max_age: float | None
    solver: str
    backup: str | None
    tolerance: float
    compile: Compile


class BoundedForce(OneThread):
    """Force on a hand [N]: the desired force within bounds on size, change and energy.

    min  |F - F_desired|^2
    s.t. |F - F_last| <= slew_limit dt,
         |F| <= min(force_limit, largest recent force + growth_limit dt, force that the energy tank affords)

    The force limit always holds exactly. The slew limit holds except in a release that is flagged `Relaxed.SLEW`. Such
    a release occurs if the hand is faster than `speed_cap`, or if the energy is too small for a slower release. The
    delivered energy stays within the budget if the hand stays below the speed cap and ticks come within `max_age`. If
    the hand jumps faster than the speed cap, it can once draw more energy: at most the force limit times the length of
    the jump.

    The force falls to zero within the slew limit after a solver failure, an invalid sensor value, a stale stamp or a
    released `enable`. Two faults are not detected: a sensor error smaller than a possible motion in a tick, and a late
    tick without a stamp.

    Parameters
    ----------
    desired_force : function from position x, y [m] and velocity [m/s] to the desired force [N], which may be of any
        size or NaN.
    force_limit : [N] largest size of the force.
    slew_limit : [N/s] largest rate of change of the force vector, at nominal ticks. `rehab_opt.field.settling` gives
        the least value that damps oscillations.
    growth_limit : [N/s] largest growth of the force above its recent maximum. This maximum falls by force_limit / 2 per
        second.
    energy_budget : [J] net energy that may be delivered to the hand until `reset`; see `EnergyTank`.
    speed_cap : [m/s] hand speed above which the force is released.
    actuation_delay : [s] sum of the delays from a command to its force and from a position to `step`.
    actuation_lag : [s] time constant at which the acting force follows the command.
    actuation_uncertainty : [s] amount by which the true delay and the true lag may each be larger. The energy count
        considers all forces of the last delay + 5 lag.
    position_noise : [m] standard deviation of each coordinate; a position may jump by six standard deviations. By
        default the noise is learnt within 0.2 s, up to 1.2 mm. A noisy velocity makes the energy count wrong: pass a
        filtered one.
    velocity_lag : [s] lag of the estimated velocity, which is used if none is passed; half a tick is added.
    trust_stillness : accept exactly repeated positions. By default they count as a possibly frozen sensor, which
        reserves energy.
    dt : [s] nominal tick. solver, backup, tolerance, compile : see `FallbackChain`. max_age : [s] see `Watchdog`.
    """

    valid: bool
    """Whether the last tick's state and inputs were valid."""
    desired_force: tuple[float, float]
    """[N] desired force of the last tick, before any bound; zero for an invalid state."""

    force_limit: float = setting()
    slew_limit: float = setting()
    growth_limit: float = setting()
    speed_cap: float = setting()
    dt: float = setting()
    max_age: float = setting()
    energy_budget: float = setting()
    tolerance: float = setting()

    def __init__(
        self,
        desired_force: DesiredForce,
        *,
        force_limit: float = 30.0,
        slew_limit: float = 2500.0,
        growth_limit: float = 200.0,
        energy_budget: float = 20.0,
        speed_cap: float = 1.0,
        actuation_delay: float = 0.0,
        actuation_lag: float = 0.0,
        actuation_uncertainty: float = 0.003,
        position_noise: float | None = None,
        velocity_lag: float = 0.01,
        trust_stillness: bool = False,
        dt: float = 0.001,
        max_age: float | None = None,
        solver: str = FUSED,
        backup: str | None = None,
        tolerance: float = 1e-8,
        compile: Compile = None,
    ) -> None:
        if not callable(desired_force):
            raise ConfigurationError("desired_force", desired_force, "a function of place and velocity, a DesiredForce")
        if not isinstance(trust_stillness, bool):
            raise ConfigurationError("trust_stillness", trust_stillness, "True or False")
        self._desired = desired_force
        self.force_limit = checked_number("force_limit", force_limit, above=0.0, below=1e4)
        self.slew_limit = checked_number("slew_limit", slew_limit, above=0.0, below=1e6)
        self.growth_limit = checked_number("growth_limit", growth_limit, above=0.0, below=1e6)
        self.speed_cap = checked_number("speed_cap", speed_cap, above=0.0, below=10.0)
        self.dt = checked_number("dt", dt, above=0.0, below=1.0)
        self.max_age = Watchdog(dt=dt, max_age=max_age).max_age
        self.energy_budget = checked_number("energy_budget", energy_budget, above=0.0)
        self.tolerance = tolerance
        delay = checked_number("actuation_delay", actuation_delay, above=-1e-12, below=0.2)
        lag = checked_number("actuation_lag", actuation_lag, above=-1e-12, below=0.1)
        more = checked_number("actuation_uncertainty", actuation_uncertainty, above=-1e-12, below=0.1)
        self._late_by = {"delay": delay + self.dt, "lag": lag, "velocity_lag": velocity_lag}
        window = delay + more + TAIL * (lag + more)
        self.slots = SLOTS if window > 0.0 else 1
        """Number of time slots for forces that have been commanded and may still act."""
        self.stated = self.statement()
        self._inside = solver == FUSED and not FallbackChain.is_recorded()
        """Whether the QP is solved inside the tick; a recorder needs it outside."""
        self._solvers = FallbackChain(
            self.stated,
            solver=solver,
            backup=backup,
            tolerance=tolerance,
            compile=False if self._inside else compile,
        )
        self.model = MODEL.numbers(
            dt=self.dt,
            max_age=self.max_age,
            force_limit=self.force_limit,
            slew_limit=self.slew_limit,
            growth_limit=self.growth_limit,
            speed_cap=self.speed_cap,
            velocity_lag=checked_number("velocity_lag", velocity_lag, above=0.0, below=1.0),
            trust_stillness=trust_stillness,
            budget=self.energy_budget,
            window=window,
            tail=LAGS if lag + more > 0.0 else 0.0,
            jitter=NOISE_PEAK
            * checked_number(
                "position_noise", 0.0 if position_noise is None else position_noise, above=-1e-12, below=0.1
            ),
            learns=position_noise is None,
            tolerance=tolerance,
        )
        tick, force = force_tick(self.slots), np.zeros(2)
        self._judge = judge = BufferedFunction(tick.judge, compile=compile, inputs={2: force})
        _, watched, _, sample = judge.inputs
        watched_next, view = judge.outputs
        self._conclude = BufferedFunction(tick.conclude, compile=compile, inputs={1: force, 2: view})
        desired, (solved,) = self._conclude.inputs[3], self._conclude.outputs
        self._precompute = BufferedFunction(tick.precompute, inputs={1: view, 2: desired})
        self._finish = BufferedFunction(tick.finish, inputs={1: force, 2: view, 3: desired})
        rest = [BufferedFunction(part(self.slots)) for part in (affordable, give, anew)]
        self._affordable, self._give, self._anew = rest
        for function in (judge, self._conclude, self._precompute, self._finish, *rest):
            function.inputs[0][:] = self.model
        at = watched_record(self.slots)["tank"]
        self._level, self._pending = (at + tank_record(self.slots)[name] for name in ("level", "pending"))
        self._watched, self._force = watched, force
        # Memory views: twice as fast as numpy's indexing.
        self._now, self._next, self._sample, self._view = map(_view, (watched, watched_next, sample, view))
        self._held, self._desired_view, self._solved = map(_view, (force, desired, solved))
        self.reset()

    def statement(self) -> Statement:
        """The QP of one tick."""
        return assistance_statement()

    def reset(self, *, energy: bool = True, force: ArrayLike = (0.0, 0.0)) -> None:
        """Reset the state while `force` (2,) [N] acts on the hand; `energy` says whether to refill the tank.

        A force above its limit raises `ConfigurationError`. A force that the energy does not allow is released.
        """
        acting = _pair("force", force)
        if not math.hypot(*acting) <= self.force_limit:
            raise ConfigurationError("force", force, f"at most {self.force_limit:g} N")
        self._claim()
        self._watched[:] = (
            self.nothing_seen(acting) if energy else self._anew.of(self.model, self._watched, (*self._force, *acting))
        )
        self.desired_force, self.valid = (0.0, 0.0), False
        self._force[:] = acting
        self._solvers.forget()
        self._give_away()

    def nothing_seen(self, force: tuple[float, float] = (0.0, 0.0)) -> Array:
        """`watched_record` before the first sample: the tank is full, and `force` [N] acts."""
        impulse = np.zeros(self.slots)
        impulse[0] = math.hypot(*force) * self.model[MODEL["window"]]
        told: dict[str, ArrayLike] = {"level": self.energy_budget, "x": force[0], "y": force[1], "impulse": impulse}
        told |= dict.fromkeys(("lately", "swing"), math.hypot(*force))
        full: dict[str, ArrayLike] = dict.fromkeys(tank_record(self.slots).places, 0.0)
        return watched_record(self.slots).numbers(
            stamps=STAMPS.numbers(last=_NAN, lag=0, stamped=0, ahead=0),
            hand=HAND.numbers(x=_NAN, v=0, estimated=0, halfway=0, scatter=0, stamp=_NAN),
            tank=tank_record(self.slots).numbers(**full | told),
            felt=math.hypot(*force),
        )

    @property
    def energy_left(self) -> float:
        """Lower bound of the energy [J] that may still be delivered."""
        return self._now[self._level] - self._now[self._pending]

    @property
    def place(self) -> tuple[float, float]:
        """[m] Hand position in the last `valid` tick; NaN before the first."""
        return self._now[_PLACE], self._now[_PLACE + 1]

    def give_energy(self, fraction: float) -> float:
        """Take a `fraction` >= 0 of the tank's free energy for another tank and return that energy [J]."""
        if self._owner != get_ident():
            self._refuse_others()
        part = checked_number("fraction", fraction, above=-1e-12)
        self._watched[:] = self._give.of(self.model, self._watched, self._force, part)
        return float(self._give.outputs[1][0])

    def instance(self, x: ArrayLike, v: ArrayLike = (0.0, 0.0)) -> Instance:
        """QP for a hand at x (2,) [m] with velocity v (2,) [m/s], given the last force and the current energy."""
        point, velocity = np.asarray(x, dtype=np.float64), np.asarray(v, dtype=np.float64)
        ceiling, left, grown = self._affordable.of(self.model, self._watched, self._force)
        view = VIEW.numbers(
            x=point, v=velocity, reason=0, details=0, at_once=0, ceiling=ceiling, left=left, repeats=0, grown=grown
        )
        desired = *self._desired(*point.tolist(), *velocity.tolist()), 0.0
        parameters, _ = force_tick(self.slots).precompute(self.model, view, desired)
        return self.stated.instance(np.array(parameters), memory=self._force)

    def to_qpsolvers(self, x: ArrayLike, v: ArrayLike = (0.0, 0.0)) -> qpsolvers.Problem:
        """`instance` as a `qpsolvers.Problem`."""
        from rehab_opt.optim.backends import to_qpsolvers  # noqa: PLC0415  (solvers load when used)

        return to_qpsolvers(self.instance(x, v))

    def step(
        self, x: ArrayLike, v: ArrayLike | None = None, *, enable: object = True, stamp: float | None = None
    ) -> Command:
        """Compute the force (2,) [N] to hold until the next tick.

        If the state is invalid, the force is released and the command gives the reason. Arguments of a wrong shape
        raise `ConfigurationError`.

        Parameters
        ----------
        x : (2,) [m] current hand position.
        v : (2,) [m/s] hand velocity; estimated from the positions by default.
        enable : dead man's switch; anything but True releases the force.
        stamp : [s] time of the position; the watchdog checks it.
        """
        if self._owner != get_ident():
            self._claim()
        sample = self._sample
        place, velocity = _pair("x", x), None if v is None else _pair("v", v)
        sample[0], sample[1] = place
        if velocity is not None:
            sample[2], sample[3] = velocity
        sample[4] = velocity is not None
        sample[5], sample[6] = (_NAN, NO_STAMP) if stamp is None else stamp_and_kind(stamp)
        sample[7] = is_true(enable)
        self._judge.evaluate()
        self._now[:] = self._next
        view = self._view
        self.valid = not view[_REASON]
        if self.valid:
            x_wanted, y_wanted = self._desired(view[0], view[1], view[2], view[3])
            try:
                self._desired_view[0], self._desired_view[1] = x_wanted, y_wanted
            except (OverflowError, ValueError):  # an integer too large for a float
                self._desired_view[0] = _NAN
        if self._inside:  # the usual case: one compiled call
            self._conclude.evaluate()
            if self._solved[0] == 0.0:
                return self._command(self._solved, FUSED_SOLVERS)
        return self._by_other_solvers()

    def _by_other_solvers(self) -> Command:
        solvers, precompute, finish, solver = self._solvers, self._precompute, self._finish, ""
        solvers.verdict[:] = array("d", [_NAN] * len(solvers.verdict))
        precompute.evaluate()
        if precompute.outputs[1][0]:
            solvers.parameters[:], solvers.memory[:] = precompute.outputs[0], self._force
            solver = solvers.solve_with_fallback() if self._inside else solvers()
        if not solver:
            solvers.warm_start(0.0)
        finish.inputs[4][:] = *solvers.answer[-2:], solvers.verdict[0], solvers.verdict[2]
        finish.evaluate()
        command = self._command(_view(finish.outputs[0]), (solver,) * len(FUSED_SOLVERS))
        if solver == solvers.backup != solvers.solver and command.status is Status.OK:
            return command._replace(status=Status.BACKUP, reason=f"{solvers.solver} gave no certified answer")
        return command

    def _command(self, solved: memoryview[float], names: Sequence[str]) -> Command:
        """Command from the values of a `SOLVED` record; its force becomes the last force of the next tick."""
        _, x, y, status, residual, solver, relaxed, scale, reason, *rest = solved.tolist()
        self._held[0], self._held[1], self.desired_force = x, y, (rest[3], rest[4])
        value = _read_only(self._held.tobytes())  # a copy
        name = names[int(solver)] if solver >= 0.0 else ""
        words = reason_text(reason, rest) if reason else ""
        return _new(
            Command, (value, NUMBERED[int(status)], name, residual, -1, words, _BOUNDS[int(relaxed)], scale, None)
        )


def _view(numbers: Array) -> memoryview[float]:
    return cast("memoryview[float]", numbers.data)


def _pair(argument: str, value: Any) -> tuple[float, float]:
    if type(value) is np.ndarray and value.dtype is _FLOATS and value.shape == (2,):
        first, second = value.tolist()
        return first, second
    if type(value) is tuple and len(value) == 2 and type(value[0]) is type(value[1]) is float:
        return value
    try:
        pair = real_array(value)
    except OverflowError:
        return math.inf, math.inf
    except (TypeError, ValueError) as problem:
        raise ConfigurationError(argument, value, "two real numbers") from problem
    if pair.shape != (2,):
        raise ConfigurationError(argument, value, "two real numbers")
    first, second = pair.tolist()
    return first, second
