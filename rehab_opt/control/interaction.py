"""Response of a robot hand to a measured force: admittance, a slower reference, and a stop.

The admittance is passive: its step is implicit, and projections onto convex sets bound speed and displacement. With E =
(M x'^2 + K x^2) / 2, every tick satisfies

    F . dx >= E_after - E_before + B |x'|^2 dt

A real hand is delayed and limited by bounds. Therefore an energy tank T, which holds `reserve` at first, sums up the
work of the measured forces. Each tick adds F . dy - dE + 0.02 W dt to T, up to `reserve`, with the hand's motion dy
relative to its reference. The 0.02 W compensate noise. As T falls, the damping B reserve / T grows. So if the measured
positions are right, the hand delivers at most reserve + 0.02 W t within a time t from rest, plus the energy under way
when the tank runs empty.
"""

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
"""[m] Displacements up to this count as zero once no force is measured."""
SLACK = 5e-3
"""[m] Anti-windup: the displacement is ahead of the hand by at most this length plus the motion in two ticks."""
STIFFER = 1e-4
"""Fraction of the reserve below which the damping no longer grows; the hand then hardly moves."""
REGAIN = 0.5
"""[s] Time in which a reference that stopped for a push regains its speed."""
ALLOWED = 0.02
"""[W] Power that refills the tank, to compensate noise of forces and positions."""
LEAP = 1.0
"""[m/s] If the hand seems to leave its reference faster than this, the reference has jumped."""
SEEN = 1e3
"""[m] Largest distance of a hand from its reference."""
FELT = Record(moved=3, velocity=3, away=3, pace=1, tank=1, stopped=1, force=3, active=1)
"""State of an admittance: displacement [m] and its velocity [m/s]; hand minus reference [m]; fraction of the reference
speed; energy in the tank [J]; time of the stop [s]; last force [N]; whether forces are measured or the last response
still goes on.
"""
FINE, INVALID, AT_LIMIT = range(3)
"""Verdicts: no stop, stop for an invalid force, stop for a large force."""


@dataclass(frozen=True, kw_only=True)
class Interaction:
    """Admittance of a robot hand, M x'' + B x' + K x = F; large forces slow its reference down and stop the arm.

    The hand's QP follows the reference pose plus the displacement x, with the reference twist plus the velocity x'. If
    bounds keep the hand from following x, the missing displacement beyond `SLACK` is removed from x. The reference
    slows down from the force `slow_from` on and stands still at `limit`. At `stop_at`, or without a valid force, the
    arm decelerates to rest. The arm continues after the force has stayed below `release` x `stop_at` for `hold`
    seconds.

    The default of `stop_at`, 140 N, is quoted from ISO/TS 15066 for a hand of healthy adults. A reference out of reach
    pulls the hand with K times its distance from the hand. A sensor's bias moves the hand by bias / K. Sensor faults
    are not detected: below `stop_at` the hand yields to any force.
    """

    slow_from: float = 8.0
    """[N] Force from which the reference slows down."""
    limit: float = 30.0
    """[N] Force at which the reference stands still."""
    stop_at: float = 140.0
    """[N] Force at which the arm decelerates to rest."""
    release: float = 0.7
    """Fraction of `stop_at` below which the force must stay before the arm continues."""
    hold: float = 0.3
    """[s] Time for which the force must stay below that fraction."""
    stiffness: float = 580.0
    """[N/m] K"""
    damping: float = 180.0
    """[N s/m] B"""
    mass: float = 4.0
    """[kg] M"""
    max_offset: float = 0.05
    """[m] Largest displacement of the reference."""
    speed: float = 0.15
    """[m/s] Largest speed of the displacement."""
    reserve: float = 0.5
    """[J] Energy of a full tank."""

    def __post_init__(self) -> None:
        for name in ("limit", "stop_at", "hold", "stiffness", "damping", "mass", "max_offset", "speed", "reserve"):
            checked_number(name, getattr(self, name), above=0.0)
        checked_number("release", self.release, above=0.0, below=1.0)
        checked_number("slow_from", self.slow_from, above=-1e-12, below=self.limit)
        if not self.limit <= self.stop_at:
            raise ConfigurationError("stop_at", self.stop_at, f"newtons from the limit, {self.limit:g}, on")

    def felt_function(self, dt: float) -> ca.Function:
        """Function: force [N] (3,), whether it is measured, `FELT`, hand minus last reference [m] (3,) -> `FELT`,
        verdict.

        The new state holds after a tick of dt [s]; the verdict is `FINE`, `INVALID` or `AT_LIMIT`. NaN stands for an
        unknown hand position.
        """
        force, measured, seen = ca.SX.sym("force", 3), ca.SX.sym("measured"), ca.SX.sym("seen", 3)
        old = FELT.symbols("state")
        size = ca.norm_2(force)
        again = ca.logic_or(size >= self.stop_at, ca.logic_and(old.stopped > 0, size >= self.release * self.stop_at))
        left = ca.if_else(old.stopped > 1.5 * dt, old.stopped - dt, 0)  # half a tick of slack for rounding
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
        # An invalid force counts as a force of unknown size.
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
        """Displacement (3,) [m] and velocity (3,) [m/s] after a tick without bounds."""
        damping = self.damping / clipped(tank / self.reserve, STIFFER, 1)
        resistance = self.mass + dt * damping + dt**2 * self.stiffness
        unconstrained = (self.mass * v + dt * (force - self.stiffness * x)) / resistance
        unconstrained = unconstrained * ca.fmin(1, self.speed / ca.fmax(ca.norm_2(unconstrained), 1e-12))
        moved = x + dt * unconstrained
        moved = moved * ca.fmin(1, self.max_offset / ca.fmax(ca.norm_2(moved), 1e-12))
        return moved, (moved - x) / dt

    def _delivered(self, moved: ca.SX, velocity: ca.SX, away: ca.SX, dt: float) -> tuple[ca.SX, ca.SX]:
        """Displacement and velocity, less the part that the hand did not carry out; `away` is hand minus reference."""
        refused = moved - away
        missing = ca.norm_2(refused)
        way = refused / ca.fmax(missing, 1e-12)
        along = ca.fmax(ca.dot(moved, way), 0)
        excess = clipped(missing - (SLACK + 2 * self.speed * dt), 0, along)
        outward = ca.if_else(excess > 0, ca.fmax(ca.dot(velocity, way), 0), 0)
        return moved - excess * way, velocity - outward * way

    @property
    def start(self) -> Array:
        """State (`FELT`) of a hand at rest on its reference, without a force."""
        return FELT.numbers(**{**dict.fromkeys(FELT.places, 0.0), "pace": 1.0, "tank": self.reserve})

    def too_large(self, felt: Array) -> str:
        """Text that says why the arm stopped, with the force from the `FELT` record `felt`."""
        size = math.hypot(*felt[FELT.places["force"]].tolist())
        if size >= self.stop_at:
            return f"interaction force of {size:.1f} N, at most {self.stop_at:g} N"
        return (
            f"interaction force of {size:.1f} N after one of {self.stop_at:g} N: the arm moves on after {self.hold:g} s"
            f" below {self.release * self.stop_at:g} N"
        )
