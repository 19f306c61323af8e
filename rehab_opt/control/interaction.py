"""Response of a led hand to a measured force: admittance, a slower reference, and a stop."""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.velocity_controller import checked_number
from rehab_opt.errors import ConfigurationError
from rehab_opt.optim.certificate import all_true, clipped
from rehab_opt.symbolic.record import Record

__all__ = ["AT_LIMIT", "FELT", "INVALID", "Interaction"]

Array = NDArray[np.float64]

GONE = 1e-6
"""[m] A displacement up to this is none, once no force is measured any more."""
SLACK = 5e-3
"""[m] A displacement leads the hand by at most this and two ticks' way: what the bounds refuse is not wound up."""
STIFFER = 1e-4
"""Fraction of the reserve from which a tank that empties makes the damping no larger: the hand hardly moves."""
REGAIN = 0.5
"""[s] in which a reference that stood for a push regains its pace."""
ALLOWED = 0.02
"""[W] that the tank regains: what noise of force times noise of positions takes from it."""
LEAP = 1.0
"""[m/s] A hand that leaves its reference faster than this does not: the reference leapt."""
SEEN = 1e3
"""[m] No hand is farther from its reference."""
FELT = Record(moved=3, velocity=3, away=3, pace=1, tank=1, stopped=1, force=3, active=1)
"""An admittance's state: displacement [m], its velocity [m/s], the hand off its reference [m], the fraction of its pace
that the reference keeps, [J] left in the tank, [s] of the stop, the last force [N], and whether forces are measured, or
the last of them is not over yet."""
FINE, INVALID, AT_LIMIT = range(3)
"""Why the arm must stop."""


@dataclass(frozen=True, kw_only=True)
class Interaction:
    """Admittance of a led hand, M x'' + B x' + K x = F, how its reference slows down, and when the arm stops.

    Displacement x and velocity x' are added to the pose and twist that the hand's QP follows, so that every bound of it
    holds: a push is given way to as far as the bounds allow. What they refuse beyond `SLACK` is taken out of x, and the
    hand returns from where it got to. The pace of the reference falls from `slow_from` on and is 0 at `limit`; it falls
    at once and regains slowly, and so follows the largest of noisy forces. At `stop_at` the arm decelerates to rest, as
    it does without a valid force; it goes on after `hold` seconds in a row below `release` x `stop_at`. A rigid stop
    at 30 N, instead of giving way beyond, is `Interaction(stop_at=30.0)`.

    Energy. The step is implicit (backward Euler); speed and displacement are bounded by projections onto convex sets
    that hold where the step began, and such contacts dissipate. With the stored energy E = (M x'^2 + K x^2) / 2,

        F . dx >= E_after - E_before + B |x'|^2 dt

    in every tick: where the hand is at x, it gives out no more than was put in. A real hand is late, and bounds hold it
    back. A tank T, full with `reserve` at first, therefore takes measured forces and positions: per tick
    T + F . dy - dE + 0.02 W dt, at most `reserve`, where dy is how far the hand went, from its reference, since F was
    measured. As T falls, the damping B reserve / T grows; with an empty tank the hand hardly answers forces, but
    returns, which fills it. From T >= 0 follows sum F . dy >= -reserve - 0.02 W t after rest, whatever the delay; what
    is on its way when the tank is empty is given out, too, and owed (T >= -reserve). 0.02 W are what noise of forces
    and positions takes. Nothing is claimed where the hand is not where it is measured (bending, play).

    The reference itself works against a person who resists F with at most F pace v: limit^2 / (4 (limit - slow_from))
    times its speed, 2.6 W at the defaults and 0.25 m/s, and nothing from `limit` on. Without the tank a delay D of the
    whole loop would leave the admittance passive up to about sqrt(B / (M D)) rad/s: 9 Hz for 15 ms.

    Defaults are choices: ISO/TS 15066 as quoted allows a hand 140 N, of healthy adults. A reference out of reach pulls
    with K times its distance: a push away from it is answered beyond that force. A sensor's bias moves the hand by
    bias / K. A sensor that lies is not found: a force that stands still, or leaps by 100 N from tick to tick, is given
    way to as any other below `stop_at`.
    """

    slow_from: float = 8.0
    """[N] from which the reference slows down."""
    limit: float = 30.0
    """[N] at which the reference stands still."""
    stop_at: float = 140.0
    """[N] at which the arm decelerates to rest."""
    release: float = 0.7
    """Fraction of `stop_at` below which the force must be, before the arm moves on."""
    hold: float = 0.3
    """[s] in a row for which it must."""
    stiffness: float = 580.0
    """[N/m] K"""
    damping: float = 180.0
    """[N s/m] B"""
    mass: float = 4.0
    """[kg] M"""
    max_offset: float = 0.05
    """[m] largest displacement of the reference."""
    speed: float = 0.15
    """[m/s] largest speed of the displacement."""
    reserve: float = 0.5
    """[J] of the tank, when full."""

    def __post_init__(self) -> None:
        for name in ("limit", "stop_at", "hold", "stiffness", "damping", "mass", "max_offset", "speed", "reserve"):
            checked_number(name, getattr(self, name), above=0.0)
        checked_number("release", self.release, above=0.0, below=1.0)
        checked_number("slow_from", self.slow_from, above=-1e-12, below=self.limit)
        if not self.limit <= self.stop_at:
            raise ConfigurationError("stop_at", self.stop_at, f"newtons from the limit, {self.limit:g}, on")

    def felt_function(self, dt: float) -> ca.Function:
        """Force [N] (3,), whether it is measured, state (`FELT`), hand off the reference [m] (3,) -> state, the reason.

        The state is that after a tick dt [s]; the reason why the arm must stop is `FINE`, `INVALID` or `AT_LIMIT`. The
        hand is where it is now, off the reference that the last tick followed; NaN where that is not known.
        """
        force, measured, seen = ca.SX.sym("force", 3), ca.SX.sym("measured"), ca.SX.sym("seen", 3)
        old = FELT.symbols("state")
        size = ca.norm_2(force)
        again = ca.logic_or(size >= self.stop_at, ca.logic_and(old.stopped > 0, size >= self.release * self.stop_at))
        left = ca.if_else(old.stopped > 1.5 * dt, old.stopped - dt, 0)  # by halves of a tick: rounding does not decide
        stopped = ca.if_else(again, self.hold, left)
        pace = ca.fmin(clipped((self.limit - size) / (self.limit - self.slow_from), 0, 1), old.pace + dt / REGAIN)

        known = ca.sumsqr(seen) < SEEN**2
        away = ca.if_else(known, seen, old.away)
        way = away - old.away
        leapt = ca.logic_or(ca.sumsqr(way) > (LEAP * dt) ** 2, ca.logic_not(known))

        moved, velocity = self._yielding(force, old.moved, old.velocity, old.tank, dt)
        moved, velocity = self._delivered(moved, velocity, away, dt)
        rest = ca.logic_or(stopped > 0, ca.logic_not(known))
        moved, velocity = ca.if_else(rest, old.moved, moved), ca.if_else(rest, 0, velocity)
        gained = ca.if_else(leapt, 0, ca.dot(old.force, way)) - self._energy(moved, velocity)
        gained = gained + self._energy(old.moved, old.velocity)
        tank = clipped(old.tank + gained + ALLOWED * dt, -self.reserve, self.reserve)
        active = ca.logic_or(ca.logic_or(measured, stopped > 0), ca.logic_or(pace < 1, ca.norm_2(moved) > GONE))
        after = FELT.of(
            moved=ca.if_else(active, moved, 0), velocity=ca.if_else(active, velocity, 0), away=away, pace=pace,
            tank=tank, stopped=stopped, force=force, active=active,
        )  # fmt: skip
        # Of a force that is no number nothing is known but that there is one.
        blind = FELT.changed(old, velocity=ca.SX.zeros(3), pace=ca.SX(0), active=ca.SX(1)).column
        valid = all_true(ca.fabs(force) < ca.inf)
        idle = ca.logic_not(ca.logic_or(measured, old.active))
        state = ca.if_else(idle, old.column, ca.if_else(valid, after, blind))
        reason = ca.if_else(idle, FINE, ca.if_else(valid, ca.if_else(stopped > 0, AT_LIMIT, FINE), INVALID))
        inputs = [force, measured, old.column, seen]
        return ca.Function("felt", inputs, [ca.densify(state), reason], {"cse": True})

    def _energy(self, x: ca.SX, v: ca.SX) -> ca.SX:
        return (self.mass * ca.sumsqr(v) + self.stiffness * ca.sumsqr(x)) / 2

    def _yielding(self, force: ca.SX, x: ca.SX, v: ca.SX, tank: ca.SX, dt: float) -> tuple[ca.SX, ca.SX]:
        """Displacement (3,) [m] and velocity (3,) [m/s] after a tick, where nothing refuses them."""
        damping = self.damping / clipped(tank / self.reserve, STIFFER, 1)
        resistance = self.mass + dt * damping + dt**2 * self.stiffness
        unconstrained = (self.mass * v + dt * (force - self.stiffness * x)) / resistance
        unconstrained = unconstrained * ca.fmin(1, self.speed / ca.fmax(ca.norm_2(unconstrained), 1e-12))
        moved = x + dt * unconstrained
        moved = moved * ca.fmin(1, self.max_offset / ca.fmax(ca.norm_2(moved), 1e-12))
        return moved, (moved - x) / dt

    def _delivered(self, moved: ca.SX, velocity: ca.SX, away: ca.SX, dt: float) -> tuple[ca.SX, ca.SX]:
        """The same without what the hand, which is `away` (3,) [m] off its reference, was refused of it.

        Taken out is the part of the displacement along what is missing of it, and never more: where the hand is late,
        or its reference out of reach, a push away from there is given way to as everywhere.
        """
        refused = moved - away
        missing = ca.norm_2(refused)
        way = refused / ca.fmax(missing, 1e-12)
        along = ca.fmax(ca.dot(moved, way), 0)
        excess = clipped(missing - (SLACK + 2 * self.speed * dt), 0, along)
        outward = ca.if_else(excess > 0, ca.fmax(ca.dot(velocity, way), 0), 0)
        return moved - excess * way, velocity - outward * way

    @property
    def start(self) -> Array:
        """`FELT` of a hand at rest on its reference, that no force was felt of."""
        return FELT.numbers(**{**dict.fromkeys(FELT.places, 0.0), "pace": 1.0, "tank": self.reserve})

    def too_large(self, felt: Array) -> str:
        """Why the arm stops for the force in a `FELT`."""
        size = math.hypot(*felt[FELT.places["force"]].tolist())
        if size >= self.stop_at:
            return f"interaction force of {size:.1f} N, at most {self.stop_at:g} N"
        return (
            f"interaction force of {size:.1f} N after one of {self.stop_at:g} N: the arm moves on after {self.hold:g} s"
            f" below {self.release * self.stop_at:g} N"
        )
