"""Positions with bounded velocity, acceleration and jerk, axis by axis, for axes without coupling constraints."""

from __future__ import annotations

import math
from threading import get_ident

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.control.axis_motion import axis_bounds, stopping_distance
from rehab_opt.control.command import Command, Relaxed, Status
from rehab_opt.control.profiles import CERTIFIED, Profiles
from rehab_opt.control.thread_owner import OneThread
from rehab_opt.control.watchdog import Watchdog
from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.chain import per_joint
from rehab_opt.kinematics.real_array import is_real, is_true, real_array

__all__ = ["Smoother"]

Array = NDArray[np.float64]

RETURN_SPEED = 0.1
"""Return speed of an axis outside its position bounds, as a fraction of its velocity bound."""
HORIZON = 3600.0
"""[s] Longest duration to a target at full speed; a longer one is a fault."""
NOT_RENEWED = "moving target was not renewed in time"
HEADROOM = 0.99
"""Largest target velocity, as a fraction of the velocity bound; the rest is a reserve for catching up."""
NUMBERS = {float, int}
AT_REST = "target is about to leave the bounds: approached as if at rest"


class Smoother(OneThread):
    """Follow targets with every axis inside its position, velocity, acceleration and jerk bounds.

    Each axis moves as fast as its own bounds allow, unless `straight`. A target outside the position bounds is clipped.
    If the smoother is disabled, the target invalid or its stamp stale, all axes stop as fast as the bounds allow. A
    position bound is relaxed, and flagged, only if `reset` sets an axis too fast to stop before it.

    Parameters
    ----------
    velocity, acceleration, jerk : (n,) bounds of the axes [u/s, u/s^2, u/s^3 with u = rad or m], positive and finite; a
        scalar applies to all axes.
    dt : tick [s]. max_age : of the targets, see `Watchdog`.
    lower, upper : (n,) position bounds [u]; None or infinite for none; equal ones lock the axis.
    axes : n, needed if every bound is a scalar; default 1.
    recovery_speed : return speed of an axis that was reset outside its bounds, as a fraction of `velocity`.
    straight : whether axes that start at rest move on the straight line to the target, as fast as the slowest allows.
    """

    def __init__(
        self,
        *,
        velocity: ArrayLike,
        acceleration: ArrayLike,
        jerk: ArrayLike,
        dt: float = 0.001,
        lower: ArrayLike | None = None,
        upper: ArrayLike | None = None,
        axes: int | None = None,
        recovery_speed: float = RETURN_SPEED,
        max_age: float | None = None,
        straight: bool = False,
    ) -> None:
        if not (is_real(recovery_speed) and 0.0 < recovery_speed <= 1.0):
            raise ConfigurationError("recovery_speed", recovery_speed, "a fraction of velocity, above 0 and at most 1")
        if not isinstance(straight, bool):
            raise ConfigurationError("straight", straight, "True or False")
        bounds = axis_bounds(
            lower=lower, upper=upper, velocity=velocity, acceleration=acceleration, jerk=jerk, axes=axes
        )
        self._watchdog = Watchdog(dt=dt, max_age=max_age)
        self._profiles = Profiles(bounds, dt=float(dt), recovery_speed=float(recovery_speed), straight=straight)
        self._bounds = bounds
        self._n = len(bounds.velocity)
        self._dt, self._ready = float(dt), False
        self._request: tuple[object, object] | None = None
        self._note = ""
        self._moving = self._returning = False
        self._old: tuple[object, object] | None = None

    @property
    def n(self) -> int:
        """Number of axes."""
        return self._n

    @property
    def dt(self) -> float:
        """Tick [s]."""
        return self._dt

    @property
    def position(self) -> Array:
        """(n,) last position [u], a copy."""
        return np.array(self._started().p)

    @property
    def velocity(self) -> Array:
        """(n,) velocity [u/s] at the last position, a copy."""
        return np.array(self._started().v)

    @property
    def acceleration(self) -> Array:
        """(n,) acceleration [u/s^2] at the last position, a copy."""
        return np.array(self._started().a)

    @property
    def arrived(self) -> bool:
        """Whether the last plan has ended: at the target, or at rest after a fault."""
        return self._started().arrived

    def reset(self, position: ArrayLike, velocity: ArrayLike | None = None) -> None:
        """Start at `position` (n,) [u] with `velocity` (n,) [u/s], by default at rest, and zero acceleration.

        Invalid numbers, a wrong size, or a velocity above its bound raise `ConfigurationError`.
        """
        p = per_joint("position", position, self._n, finite=True)
        v = per_joint("velocity", 0.0 if velocity is None else velocity, self._n, finite=True)
        if np.any(np.abs(v) > self._bounds.velocity):
            raise ConfigurationError("velocity", velocity, f"speeds of at most {self._bounds.velocity}")
        self._claim()
        if not self._profiles.start(p.tolist(), v.tolist()):
            raise ConfigurationError("position, velocity", (position, velocity), "a state that can be brought to rest")
        self._watchdog.reset()
        self._forget()
        self._old = None
        self._ready = True
        self._give_away()

    def step(
        self,
        target: ArrayLike,
        target_velocity: ArrayLike | None = None,
        *,
        enable: object = True,
        stamp: float | None = None,
    ) -> Command:
        """Position one tick later, on the way to the target; `ConfigurationError` before the first `reset`.

        Parameters
        ----------
        target : (n,) [u].
        target_velocity : (n,) [u/s] of a moving target, which is then followed without `lag`. A target that is not
            updated moves on for `max_age`.
        enable : dead man's switch; anything but True brings the axes to rest.
        stamp : [s, any origin] time of the target. After the first stamp, a missing stamp brings the axes to rest.

        Returns
        -------
        Command : `value` is the position (n,) [u], `residual` the largest relative excess of its finite differences
            over the bounds; infinite while braking or holding.
        """
        if self._owner != get_ident():
            self._claim()
        profiles = self._started()
        reason = self._watchdog.check(stamp)
        if not is_true(enable):
            reason = "disabled"
        if not reason:
            reason = self._aim(target, target_velocity)
        if reason:
            self._forget()
            if not profiles.stopping:
                profiles.stop()
        outside = profiles.outside
        residual = profiles.advance()
        outside = outside or profiles.outside
        value = np.array(profiles.p)
        value.flags.writeable = False
        relaxed = Relaxed.POSITION if outside else Relaxed.NOTHING
        if not residual <= CERTIFIED:
            self._forget()
            reason = reason or f"certificate failed: {residual:.3g} over the bounds"
        if reason:
            status = Status.BRAKING if any(profiles.v) else Status.HOLDING
            return Command(value, status, "", math.inf, -1, reason, relaxed | Relaxed.TASK, 0.0)
        if outside:
            return Command(value, Status.OK, "ruckig", residual, -1, "led back into the bounds", relaxed, 1.0)
        if self._note:
            return Command(value, Status.OK, "ruckig", residual, -1, self._note, Relaxed.TASK, 1.0)
        return Command(value, Status.OK, "ruckig", residual, -1, "", Relaxed.NOTHING, 1.0)

    def lag(self, speed: ArrayLike) -> Array:
        """Time lag (n,) [s] of the output behind a target at constant `speed` (n,) [u/s]; zero with `target_velocity`.

        Every tick plans to rest at the target, so the output lags by its stopping distance.
        """
        speeds = np.minimum(np.abs(per_joint("speed", speed, self._n)), self._bounds.velocity)
        limits = zip(speeds.tolist(), self._bounds.acceleration, self._bounds.jerk, strict=True)
        return np.array([stopping_distance(v, a, j) / v if v else 0.0 for v, a, j in limits])

    # ---------------------------------------------------------------------------------------------- the target
    def _aim(self, target: ArrayLike, target_velocity: ArrayLike | None) -> str:
        """Plan to a new target; return the reason if it cannot be followed, or an empty text."""
        profiles = self._profiles
        request = _copied(target), _copied(target_velocity)
        if request == self._request and not (profiles.stopping or self._returning):
            if not (self._moving and self._has_grown_old()):
                return ""
            self._old = request
        if request == self._old:
            return NOT_RENEWED
        goal = _finite_numbers(target, self._n)
        speed = [0.0] * self._n if target_velocity is None else _finite_numbers(target_velocity, self._n)
        if goal is None or speed is None:
            return f"target{' velocity' if goal else ''} is not {self._n} finite numbers"
        if not all(abs(x - y) <= HORIZON * v for x, y, v in zip(goal, profiles.p, self._bounds.velocity, strict=True)):
            return f"target is more than {HORIZON:g} s away"
        note = _brought_within(profiles, goal, speed)
        if not profiles.move(goal, speed):
            note = note or AT_REST
            speed = [0.0] * self._n
            if not profiles.move(goal, speed):
                return "too fast to reach the target inside the bounds"
        self._request, self._note = request, note
        self._moving, self._returning = any(speed), profiles.outside
        return ""

    def _has_grown_old(self) -> bool:
        profiles = self._profiles
        return profiles.age > self._watchdog.max_age or (
            profiles.arrived and any(map(profiles.leads_out, range(self._n), profiles.p, profiles.v))
        )

    def _forget(self) -> None:
        self._request = None
        self._note = ""
        self._moving = self._returning = False

    def _started(self) -> Profiles:
        if not self._ready:
            raise ConfigurationError("position", None, "reset(position) before the first step")
        return self._profiles


def _brought_within(profiles: Profiles, goal: list[float], speed: list[float]) -> str:
    note = ""
    for i, (low, high, fastest, _, _) in enumerate(zip(*profiles.bounds, strict=True)):
        if not low <= goal[i] <= high:
            goal[i], speed[i] = min(max(goal[i], low), high), 0.0
            note = "target is outside the bounds: clipped"
        if not -fastest <= speed[i] <= fastest:
            note = note or "target is faster than the velocity bound"
        limit = HEADROOM * fastest
        speed[i] = min(max(speed[i], -limit), limit)
        if speed[i] and profiles.leads_out(i, goal[i], speed[i]):
            speed[i] = 0.0
            note = note or AT_REST
    return note


def _copied(value: ArrayLike | None) -> object:
    """Copy of a target, since the caller may overwrite its arrays."""
    if value is None:
        return None
    if isinstance(value, (list, tuple)) and NUMBERS.issuperset(map(type, value)):
        return list(value)
    try:
        return real_array(value).tolist()
    except (TypeError, ValueError, OverflowError):
        return object()  # equal to nothing


def _finite_numbers(value: ArrayLike, n: int) -> list[float] | None:
    try:
        array = real_array(value)
    except (TypeError, ValueError, OverflowError):
        return None
    if array.ndim == 0 and n == 1:
        array = array.reshape(1)
    if array.shape != (n,):
        return None
    numbers: list[float] = array.tolist()
    return numbers if all(map(math.isfinite, numbers)) else None
