"""A wanted force on a hand, as much of it as the bounds on a person's side allow."""

from __future__ import annotations

import math
from threading import get_ident
from typing import TYPE_CHECKING, TypedDict, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.control.assistance_statement import EXACT, TINY, assistance_statement
from rehab_opt.control.command import Bound, Command, Status
from rehab_opt.control.energy_tank import EnergyTank
from rehab_opt.control.gate import WantedForce
from rehab_opt.control.hand import Hand
from rehab_opt.control.thread_owner import OneThread
from rehab_opt.control.velocity_controller import checked_number
from rehab_opt.control.watchdog import Watchdog
from rehab_opt.errors import ConfigurationError
from rehab_opt.optim.fused import FUSED_SOLVERS
from rehab_opt.optim.ladder import FUSED, Ladder
from rehab_opt.optim.qp import Statement
from rehab_opt.optim.rows import Instance
from rehab_opt.symbolic import Compile

if TYPE_CHECKING:
    import qpsolvers

__all__ = ["BoundedForce", "ForceBounds"]

Array = NDArray[np.float64]

MUCH = 1e3
"""[J] More than any tick could take: what is beyond it need not be said to the QP."""
MISSED = 1e-6
"""Share of the wanted force by which the commanded one must differ for the task to count as yielding."""

_OK, _NOTHING, _TASK, _NAN, _INF = Status.OK, Bound.NOTHING, Bound.TASK, math.nan, math.inf
_hypot, _new, _read_only = math.hypot, tuple.__new__, np.frombuffer


class ForceBounds(TypedDict, total=False):
    """The options of `BoundedForce` that whoever builds on it hands through."""

    slew_limit: float
    energy_budget: float
    speed_cap: float
    velocity_lag: float
    trust_stillness: bool
    dt: float
    max_age: float | None
    solver: str
    backup: str | None
    tolerance: float
    compile: Compile


class BoundedForce(OneThread):
    """Force on a hand [N]: the wanted one as far as bounds on its size, its change and its energy allow.

    min  |F - F_wanted|^2
    s.t. |F| <= force_limit, |F - F_last| <= slew_limit dt, F.v dt <= energy left in the tank

    The force bound holds exactly and always. The slew bound holds but for a flagged release (`Bound.SLEW`): the force
    is zero at once when the hand moves faster than `speed_cap`, or the energy left no longer affords a release within
    the slew bound. The energy delivered stays within the budget as long as the hand stays below the speed cap and
    ticks come within `max_age`; a faster hand can draw the force limit times its jump more, once, before the release.
    A missing answer, a sensor value that is no number, a stale stamp, an open dead-man switch: the force falls to zero
    within the slew bound. Nothing is pulled or pushed in a state that is not known.

    What it does not see: a sensor that lies by less than a hand can move in a tick; how late a tick comes, where no
    stamps are given; a jump after a rest so exact that the sensor may have been frozen, which counts as the motion of
    all that time (its energy does not go beyond the budget either).

    An object belongs to one thread: see `OneThread`.

    Parameters
    ----------
    wanted : x, y [m], velocity [m/s] -> the force that is wanted [N], before any bound; may be no number.
    force_limit : [N] largest size of the force.
    slew_limit : [N/s] largest change, as the length of a vector, per nominal tick.
    energy_budget : [J] what may be delivered to the hand until `reset`, net of what the hand puts in; see `EnergyTank`.
    speed_cap : [m/s] hand speed from which on the force is let go.
    velocity_lag : [s] time constant of the velocity that is estimated where none is given; it lags by this and half a
        tick.
    trust_stillness : believe positions that repeat themselves exactly. A frozen sensor looks the same, so by default
        energy is set aside meanwhile, and the force falls where there is none left: a hand that is seen to move by a
        count of the encoder now and then never notices.
    dt : [s] nominal tick. solver, backup, tolerance, compile : see `Ladder`. max_age : [s] see `Watchdog`.

    Raises
    ------
    ConfigurationError : an argument that cannot be used.
    """

    usable: bool
    """Whether the last tick's state and inputs could be acted on."""
    wanted: tuple[float, float]
    """[N] what was wanted in the last tick, before any bound; zero where the state was not usable."""

    def __init__(
        self,
        wanted: WantedForce,
        *,
        force_limit: float = 30.0,
        slew_limit: float = 200.0,
        energy_budget: float = 20.0,
        speed_cap: float = 1.0,
        velocity_lag: float = 0.01,
        trust_stillness: bool = False,
        dt: float = 0.001,
        max_age: float | None = None,
        solver: str = FUSED,
        backup: str | None = None,
        tolerance: float = 1e-8,
        compile: Compile = None,
    ) -> None:
        if not callable(wanted):
            raise ConfigurationError("wanted", wanted, "a function of place and velocity, a WantedForce")
        self._wanted = wanted
        self.force_limit = checked_number("force_limit", force_limit, above=0.0, below=1e4)
        self.slew_limit = checked_number("slew_limit", slew_limit, above=0.0, below=1e6)
        self.speed_cap = checked_number("speed_cap", speed_cap, above=0.0, below=10.0)
        self.dt = checked_number("dt", dt, above=0.0, below=1.0)
        watchdog = Watchdog(dt=dt, max_age=max_age)
        self._step = self.slew_limit * self.dt
        self._tank = EnergyTank(
            budget=checked_number("energy_budget", energy_budget, above=0.0),
            slew=self.slew_limit * math.sqrt(0.5),  # in any direction: see `assistance_statement`
            speed_cap=self.speed_cap,
            late=max(self.dt, min(watchdog.max_age, 1.0)),
        )
        self._hand = Hand(
            self._tank,
            watchdog,
            dt=self.dt,
            speed_cap=self.speed_cap,
            velocity_lag=checked_number("velocity_lag", velocity_lag, above=0.0),
            trust_stillness=bool(trust_stillness),
        )
        self.stated = self.statement()
        self._ladder = ladder = Ladder(self.stated, solver=solver, backup=backup, tolerance=tolerance, compile=compile)
        self._fused, self.tolerance = solver == FUSED, tolerance
        self._function, self._verdict, self._keep, self._answer = (
            ladder.function,
            ladder.verdict,
            ladder.keep,
            ladder.answer,
        )
        self._inputs = cast("memoryview[float]", ladder.parameters.data)
        self._force = cast("memoryview[float]", ladder.memory.data)
        self.reset()

    def statement(self) -> Statement:
        """The QP of one tick."""
        return assistance_statement(force_limit=self.force_limit, step=self._step, dt=self.dt)

    # -------------------------------------------------------------------------------------------------- the user's
    def reset(self, *, energy: bool = True) -> None:
        """Forget the past: no force is applied now, and, but for energy=False, the tank is full."""
        self._claim()
        if energy:
            self._tank.reset()
        self._hand.reset()
        self.wanted, self.usable = (0.0, 0.0), False
        self._ladder.memory[:] = 0.0
        self._ladder.forget()
        self._give_away()

    @property
    def energy_left(self) -> float:
        """[J] what may certainly still be delivered."""
        return self._tank.left

    def give_energy(self, share: float) -> float:
        """[J] taken from the tank for another one, a share of what is certainly left; see `Bilateral`."""
        if self._owner != get_ident():
            self._refuse_others()
        return self._tank.give(share)

    def take_energy(self, joules: float) -> None:
        """What another tank has given [J]; beyond the budget it is lost."""
        if self._owner != get_ident():
            self._refuse_others()
        self._tank.take(joules)

    def instance(self, x: ArrayLike, v: ArrayLike = (0.0, 0.0)) -> Instance:
        """The QP for a hand at x (2,) moving at v (2,), with the last force and the energy of now, for inspection."""
        return self.stated.instance(*self._parameters(x, v), memory=self._ladder.memory)

    def to_qpsolvers(self, x: ArrayLike, v: ArrayLike = (0.0, 0.0)) -> qpsolvers.Problem:
        """The same as a `qpsolvers.Problem`."""
        from rehab_opt.optim.backends import to_qpsolvers  # noqa: PLC0415  (solvers load when used)

        return to_qpsolvers(self.instance(x, v))

    def _parameters(self, x: ArrayLike, v: ArrayLike) -> tuple[ArrayLike, ...]:
        point, velocity = np.asarray(x, dtype=np.float64), np.asarray(v, dtype=np.float64)
        ceiling = min(self.force_limit, self._tank.ceiling)
        wanted = np.array(self._wanted(*point.tolist(), *velocity.tolist()))
        fitting = min(1.0, ceiling / max(float(np.hypot(*wanted)), TINY))
        return wanted * fitting, velocity, ceiling, min(max(0.0, self._tank.left), MUCH)

    def step(
        self, x: ArrayLike, v: ArrayLike | None = None, *, enable: object = True, stamp: float | None = None
    ) -> Command:
        """Force (2,) [N] to hold until the next tick.

        Never raises on numbers: what is not usable gives a release, and its reason.

        Parameters
        ----------
        x : (2,) [m] where the hand is now.
        v : (2,) [m/s] how it moves; estimated from the positions where it is not given.
        enable : the dead-man input; anything but true releases.
        stamp : time of the position [s]; checked by the watchdog when given.

        Raises
        ------
        ConfigurationError : an argument of the wrong shape. SharingError : a second thread, see `OneThread`.
        """
        if self._owner != get_ident():
            self._claim()
        hand, tank, force = self._hand, self._tank, self._force
        reason, at_once = hand.read(x, v, stamp, force)
        if enable is not True and not (isinstance(enable, np.bool_ | int | float) and enable == 1):
            reason = reason if at_once else "not enabled"
        ceiling = tank.ceiling
        if ceiling > self.force_limit:
            ceiling = self.force_limit
        elif _hypot(force[0], force[1]) - self._step > ceiling and not at_once:
            reason, at_once = "energy left does not afford a slower release", True
        self.usable = not reason
        if reason:
            return self._release(reason, at_once=at_once)
        asked_x, asked_y = self.wanted = self._wanted(hand.x, hand.y, hand.vx, hand.vy)
        size = _hypot(asked_x, asked_y)
        if not size < _INF:
            return self._release("the field gives no number here", at_once=False)
        fitting = 1.0 if size <= ceiling else ceiling / size * EXACT
        inputs, left = self._inputs, tank.left
        inputs[0] = asked_x * fitting
        inputs[1] = asked_y * fitting
        inputs[2] = hand.vx
        inputs[3] = hand.vy
        inputs[4] = ceiling
        inputs[5] = 0.0 if left < 0.0 else (left if left < MUCH else MUCH)
        if self._fused:  # the usual way, without the layers of Python
            verdict = self._verdict
            verdict[0] = _NAN  # see `Ladder`
            self._function.evaluate()
            residual, _, who, holds = verdict.tolist()
            if 0.0 <= residual <= self.tolerance and holds:
                self._keep[:] = self._answer
                return self._command(FUSED_SOLVERS[int(who)], residual, (asked_x, asked_y, size))
        solver = self._climbed(force[0], force[1])
        if not solver:
            residual = self._ladder.residual[0]
            return self._release(f"no solver gave a certified answer (residual {residual:.1e})", at_once=False)
        return self._command(solver, float(self._ladder.residual[0]), (asked_x, asked_y, size))

    # ---------------------------------------------------------------------------------------------------- one tick
    def _climbed(self, last_x: float, last_y: float) -> str:
        """Name of the solver whose answer is certified and, shrunk, within all bounds; else ""."""
        ladder = self._ladder
        solver = ladder.climb() if self._fused else ladder()
        if solver and ladder.report[0]:
            return solver
        self._force[0], self._force[1] = last_x, last_y
        return ""

    def _command(self, solver: str, residual: float, asked: tuple[float, float, float]) -> Command:
        """A certified force, beside the one that was asked for: its components and size."""
        (x, y), (asked_x, asked_y, size) = self._force, asked
        yielded, scale = _NOTHING, 1.0
        if _hypot(x - asked_x, y - asked_y) > MISSED * size + TINY:
            along = (x * asked_x + y * asked_y) / (size * size) if size > TINY else 0.0
            yielded, scale = _TASK, (min(along, 1.0) if along > 0.0 else 0.0)
        ladder, status, reason = self._ladder, _OK, ""
        if solver == ladder.backup != ladder.solver:
            status, reason = Status.BACKUP, f"{ladder.solver} gave no certified answer"
        value = _read_only(ladder.memory.tobytes())  # a copy
        return _new(Command, (value, status, solver, residual, -1, reason, yielded, scale, None))

    def _release(self, reason: str, *, at_once: bool) -> Command:
        """The last rung: no force, as fast as the slew bound allows, or at once."""
        self.wanted = (0.0, 0.0)
        x, y = self._force[0], self._force[1]
        size, step = _hypot(x, y), self._step * EXACT
        keep = 0.0 if at_once or size <= self._step else 1.0 - step / size
        value = np.array((x * keep, y * keep)) if keep else np.zeros(2)
        value.setflags(write=False)
        self._ladder.memory[:] = value
        self._ladder.warm_start(0.0)
        yielded = Bound.TASK | Bound.SLEW if at_once and size > self._step else Bound.TASK
        status = Status.RELEASING if keep else Status.RELEASED
        return Command(value, status, "", _INF, -1, reason, yielded, 0.0)
