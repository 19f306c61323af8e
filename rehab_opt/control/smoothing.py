"""Positions with bounded velocity, acceleration and jerk, axis by axis: what goes out to free axes.

Free are the joint trajectories of a plan, targets, reference clocks. Where constraints couple axes, smoothing after the
controller would break them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.control.command import Bound, Command, Status
from rehab_opt.control.profiles import CERTIFIED, AxisBounds, Profiles, stopping_distance
from rehab_opt.control.watchdog import Watchdog
from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.chain import per_joint

__all__ = ["SmoothPath", "Smoother", "measured_lag", "smooth_path"]

Array = NDArray[np.float64]

RETURN_SPEED = 0.1
"""Share of the velocity bound at which an axis outside its position bounds is led back."""
HORIZON = 3600.0
"""[s] A target further away than this at full speed is a fault, not a target; Ruckig itself ends at 7.6e3 s."""
HEADROOM = 0.99
"""Largest share of the velocity bound that a target's own velocity counts for: the rest is for catching up with it."""
AT_REST = "target is about to leave the bounds: approached as if at rest"
NOT_RENEWED = "moving target was not renewed in time"


class Smoother:
    """Follows targets with every axis inside its position, velocity, acceleration and jerk bounds.

    Each axis moves as fast as its own bounds allow. A target outside the position bounds is clipped to them. A
    disabled smoother, a target that is not a plausible number and a stale stamp bring all axes to rest as fast as
    the bounds allow and hold them there; from wherever that is, the motion goes on without a jump.

    Parameters
    ----------
    velocity, acceleration, jerk : (n,) bounds of the axes [u/s, u/s^2, u/s^3 with u = rad or m], positive and finite;
        a scalar stands for all.
    dt : tick [s].
    lower, upper : (n,) position bounds [u]; None or infinite for none; equal ones lock the axis.
    axes : n, needed where every bound is a scalar; default 1.
    return_speed : share of `velocity` at which an axis that was reset outside its bounds comes back.
    max_age : of the targets, see `Watchdog`.

    Raises
    ------
    ConfigurationError : a bound that is not usable or of the wrong size.
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
        return_speed: float = RETURN_SPEED,
        max_age: float | None = None,
    ) -> None:
        if not (isinstance(return_speed, (int, float, np.integer, np.floating)) and 0.0 < return_speed <= 1.0):
            raise ConfigurationError("return_speed", return_speed, "a share of the velocity, above 0 and at most 1")
        bounds = _axis_bounds(
            lower=lower, upper=upper, velocity=velocity, acceleration=acceleration, jerk=jerk, axes=axes
        )
        self._watchdog = Watchdog(dt=dt, max_age=max_age)
        self._profiles = Profiles(bounds, dt=float(dt), return_speed=float(return_speed))
        self._bounds = bounds
        self._n = len(bounds.velocity)
        self._dt = float(dt)
        self._ready = False
        self._asked: tuple[object, object] | None = None
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
        """Whether the last plan has come to its end: at the target, or at rest after a fault."""
        return self._started().arrived

    def reset(self, position: ArrayLike, velocity: ArrayLike | None = None) -> None:
        """Start from here, without acceleration.

        Parameters
        ----------
        position : (n,) [u]. An axis outside its bounds is led back at `return_speed`.
        velocity : (n,) [u/s], default at rest.

        Raises
        ------
        ConfigurationError : not finite, of the wrong size, or faster than the velocity bound.
        """
        p = per_joint("position", position, self._n, finite=True)
        v = per_joint("velocity", 0.0 if velocity is None else velocity, self._n, finite=True)
        if np.any(np.abs(v) > self._bounds.velocity):
            raise ConfigurationError("velocity", velocity, f"speeds of at most {self._bounds.velocity}")
        if not self._profiles.start(p.tolist(), v.tolist()):
            raise ConfigurationError("position, velocity", (position, velocity), "a state Ruckig can stop from")
        self._watchdog.reset()
        self._forget()
        self._old = None
        self._ready = True

    def step(
        self,
        target: ArrayLike,
        target_velocity: ArrayLike | None = None,
        *,
        enable: object = True,
        stamp: float | None = None,
    ) -> Command:
        """Position one tick on, on the way to the target.

        Parameters
        ----------
        target : (n,) [u].
        target_velocity : (n,) [u/s] of a moving target, which is then followed without `lag`. One that is not renewed
            moves on for `max_age`, then the axes come to rest.
        enable : the dead-man input; anything but true brings the axes to rest.
        stamp : time of the target [s, any origin].

        Returns
        -------
        Command : `value` is the position (n,) [u]. `residual` is the largest excess of its finite differences over the
            velocity, acceleration and jerk bounds, as a share of them and less what rounding explains, and of the
            position over its bounds [u]; infinite while braking or holding.

        Raises
        ------
        ConfigurationError : there was no `reset` yet; never because of a number.
        """
        profiles = self._started()
        reason = self._watchdog.check(stamp)
        if not _is_true(enable):
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
        yielded = Bound.POSITION if outside else Bound.NOTHING
        if not residual <= CERTIFIED:
            self._forget()
            reason = reason or f"certificate failed: {residual:.3g} over the bounds"
        if reason:
            status = Status.BRAKING if any(profiles.v) else Status.HOLDING
            return Command(value, status, "", math.inf, -1, reason, yielded | Bound.TASK, 0.0)
        if outside:
            return Command(value, Status.OK, "ruckig", residual, -1, "led back into the bounds", yielded, 1.0)
        if self._note:
            return Command(value, Status.OK, "ruckig", residual, -1, self._note, Bound.TASK, 1.0)
        return Command(value, Status.OK, "ruckig", residual, -1, "", Bound.NOTHING, 1.0)

    def lag(self, speed: ArrayLike) -> Array:
        """(n,) time [s] by which the output trails a target moving steadily at `speed` (n,) [u/s].

        Every tick plans to rest at the target, so the output keeps the distance it needs to stop: (v/a + a/j)/2
        seconds, or sqrt(v/j) where v < a^2/j. With `target_velocity` there is none.
        """
        speeds = np.minimum(np.abs(per_joint("speed", speed, self._n)), self._bounds.velocity)
        limits = zip(speeds.tolist(), self._bounds.acceleration, self._bounds.jerk, strict=True)
        return np.array([stopping_distance(v, a, j) / v if v else 0.0 for v, a, j in limits])

    # ---------------------------------------------------------------------------------------------- the target
    def _aim(self, target: ArrayLike, target_velocity: ArrayLike | None) -> str:
        """Plan to the target where it is a new one; why it cannot be followed, or nothing."""
        profiles = self._profiles
        asked = _copied(target), _copied(target_velocity)
        if asked == self._asked and not (profiles.stopping or self._returning):
            if not (self._moving and self._has_grown_old()):
                return ""
            self._old = asked
        if asked == self._old:
            return NOT_RENEWED
        goal = _finite(target, self._n)
        speed = [0.0] * self._n if target_velocity is None else _finite(target_velocity, self._n)
        if goal is None or speed is None:
            return f"target{' velocity' if goal else ''} is not {self._n} finite numbers"
        if not all(abs(x - y) <= HORIZON * v for x, y, v in zip(goal, profiles.p, self._bounds.velocity, strict=True)):
            return f"target is more than {HORIZON:g} s away"
        note = self._within(goal, speed)
        if not profiles.move(goal, speed):
            note = note or AT_REST
            speed = [0.0] * self._n
            if not profiles.move(goal, speed):
                return "too fast to reach the target inside the bounds"
        self._asked, self._note = asked, note
        self._moving, self._returning = any(speed), profiles.outside
        return ""

    def _has_grown_old(self) -> bool:
        """Whether a moving target must not be taken to move on any longer."""
        profiles = self._profiles
        return profiles.age > self._watchdog.max_age or (
            profiles.arrived and any(map(profiles.leads_out, range(self._n), profiles.p, profiles.v))
        )

    def _within(self, goal: list[float], speed: list[float]) -> str:
        """Bring goal and speed inside the bounds; what had to be changed."""
        note = ""
        for i, (low, high, fastest, _, _) in enumerate(zip(*self._bounds, strict=True)):
            if not low <= goal[i] <= high:
                goal[i], speed[i] = min(max(goal[i], low), high), 0.0
                note = "target is outside the bounds: clipped"
            if not -fastest <= speed[i] <= fastest:
                note = note or "target is faster than the velocity bound"
            limit = HEADROOM * fastest
            speed[i] = min(max(speed[i], -limit), limit)
            if speed[i] and self._profiles.leads_out(i, goal[i], speed[i]):
                speed[i] = 0.0
                note = note or AT_REST
        return note

    def _forget(self) -> None:
        """Plan anew at the next tick."""
        self._asked = None
        self._note = ""
        self._moving = self._returning = False

    def _started(self) -> Profiles:
        if not self._ready:
            raise ConfigurationError("position", None, "reset(position) before the first step")
        return self._profiles


class SmoothPath(NamedTuple):
    """A path made followable: positions within the bounds at every tick."""

    times: Array
    """(M,) [s] ticks from the first time of the path, until the last point is reached."""
    positions: Array
    """(M, n) [u]."""
    lag: float
    """[s] by which the positions trail the path, see `measured_lag`."""
    deviation: Array
    """(n,) [u] largest distance from where the path was at the same time."""
    residual: float
    """Largest certificate residual of all ticks; infinite if the axes had to brake."""
    compensation: str
    """"velocity", "preview" or "none": what was done about the lag."""


def smooth_path(
    times: ArrayLike,
    points: ArrayLike,
    *,
    velocity: ArrayLike,
    acceleration: ArrayLike,
    jerk: ArrayLike,
    lower: ArrayLike | None = None,
    upper: ArrayLike | None = None,
    dt: float = 0.001,
    compensate: bool = True,
) -> SmoothPath:
    """A recorded or planned path as `Smoother` follows it, from rest to rest.

    Between its points the path is interpolated by shape-preserving cubics, which leave no range the points keep.

    Parameters
    ----------
    times : (N,) [s], increasing.
    points : (N, n) [u], in the order of the axes.
    velocity, acceleration, jerk, lower, upper, dt : as for `Smoother`.
    compensate : also follow the path with its own velocity, and ahead of time by the lag, and keep what stays closest.
        The first is nearly exact on a path within the bounds and overshoots at its corners, where the second is better.

    Raises
    ------
    ConfigurationError : times not increasing, points of the wrong shape, a number that is not finite.
    """
    from scipy.interpolate import PchipInterpolator  # noqa: PLC0415  (loaded when used)

    t, x = _numbers("times", times), _numbers("points", points)
    if t.ndim != 1 or t.size < 2 or not np.all(np.diff(t) > 0.0) or not np.all(np.isfinite(t)):
        raise ConfigurationError("times", times, "at least two finite, increasing times (N,)")
    if x.ndim != 2 or len(x) != len(t) or not np.all(np.isfinite(x)):
        raise ConfigurationError("points", points, f"finite numbers of shape ({t.size}, n)")
    smoother = Smoother(
        velocity=velocity,
        acceleration=acceleration,
        jerk=jerk,
        lower=lower,
        upper=upper,
        dt=dt,
        axes=x.shape[1],
    )
    path = PchipInterpolator(t, x, axis=0)
    ticks = t[0] + dt * np.arange(1, math.ceil((t[-1] - t[0]) / dt - 1e-9) + 1)

    def at(when: Array) -> Array:
        return np.asarray(path(np.clip(when, t[0], t[-1])))

    def followed(targets: Array, speeds: Array | None, compensation: str) -> SmoothPath:
        positions, residual = _followed(smoother, x[0], targets, speeds, x[-1])
        when = t[0] + dt * np.arange(len(positions))
        wanted = at(when)
        lag = measured_lag(when, wanted, positions)
        return SmoothPath(when, positions, lag, np.abs(positions - wanted).max(axis=0), residual, compensation)

    tries = [followed(at(ticks), None, "none")]
    if compensate:
        speeds = np.where((ticks < t[-1])[:, None], path.derivative()(ticks), 0.0)
        tries.append(followed(at(ticks), speeds, "velocity"))
        tries.append(followed(at(ticks + tries[0].lag), None, "preview"))
    fastest = np.broadcast_to(np.asarray(velocity, dtype=np.float64), x.shape[1])
    return min(tries, key=lambda run: (run.residual > CERTIFIED, float(np.max(run.deviation / fastest))))


def measured_lag(times: ArrayLike, targets: ArrayLike, positions: ArrayLike) -> float:
    """Delay [s] after which the targets match the positions best: least squares, each axis counted by its own range.

    Parameters
    ----------
    times : (N,) [s], increasing.
    targets, positions : (N, n) [u].

    Returns
    -------
    Between plus and minus a quarter of the whole time; negative where the positions lead; 0 where nothing moves.
    """
    from scipy.optimize import minimize_scalar  # noqa: PLC0415  (loaded when used)

    t = np.asarray(times, dtype=np.float64)
    wanted, got = np.asarray(targets, dtype=np.float64), np.asarray(positions, dtype=np.float64)
    span = np.ptp(wanted, axis=0)
    moving = span > 0.0
    if not moving.any():
        return 0.0
    wanted, got = wanted[:, moving] / span[moving], got[:, moving] / span[moving]

    def mismatch(lag: float) -> float:
        late = [np.interp(t - lag, t, column) for column in wanted.T]
        return float(np.mean((np.array(late).T - got) ** 2))

    reach = 0.25 * float(t[-1] - t[0])
    coarse = np.linspace(-reach, reach, 101)
    best = float(coarse[int(np.argmin([mismatch(lag) for lag in coarse]))])
    step = float(coarse[1] - coarse[0])
    return float(minimize_scalar(mismatch, bounds=(best - step, best + step), method="bounded").x)


def _followed(
    smoother: Smoother, start: Array, targets: Array, speeds: Array | None, end: Array
) -> tuple[Array, float]:
    """Positions (M, n) from the start at rest along the targets to rest at the end, and their largest residual."""
    smoother.reset(start)
    commands = [
        smoother.step(target, None if speeds is None else speed)
        for target, speed in zip(targets, targets if speeds is None else speeds, strict=True)
    ]
    commands.append(smoother.step(end))
    while not smoother.arrived:
        commands.append(smoother.step(end))
    return np.array([start, *(command.value for command in commands)]), max(command.residual for command in commands)


def _axis_bounds(
    *,
    lower: ArrayLike | None,
    upper: ArrayLike | None,
    velocity: ArrayLike,
    acceleration: ArrayLike,
    jerk: ArrayLike,
    axes: int | None = None,
) -> AxisBounds:
    given = {
        "lower": -math.inf if lower is None else lower,
        "upper": math.inf if upper is None else upper,
        "velocity": velocity,
        "acceleration": acceleration,
        "jerk": jerk,
    }
    n = axes if axes is not None else max(_numbers(name, value).size for name, value in given.items())
    if not (isinstance(n, (int, np.integer)) and n >= 1):
        raise ConfigurationError("axes", axes, "a whole number of axes, at least one")
    bounds = AxisBounds(**{name: per_joint(name, value, n).tolist() for name, value in given.items()})
    for name in ("velocity", "acceleration", "jerk"):
        if not all(0.0 < number < math.inf for number in getattr(bounds, name)):
            raise ConfigurationError(name, given[name], "positive finite numbers")
    for low, high in zip(bounds.lower, bounds.upper, strict=True):
        if not (low <= high and low < math.inf and high > -math.inf):
            raise ConfigurationError("lower, upper", (low, high), "lower <= upper, neither NaN")
    return bounds


def _numbers(argument: str, value: ArrayLike) -> Array:
    """`value` as an array of its own."""
    try:
        return np.array(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as problem:
        raise ConfigurationError(argument, value, "numbers") from problem


def _is_true(signal: object) -> bool:
    """A dead-man input is given by true and by nothing else: NaN, text and None are not."""
    return signal is True or (isinstance(signal, (bool, np.bool_, int, float)) and bool(signal == 1))


def _copied(value: ArrayLike | None) -> object:
    """What was asked, to be compared with the next: the caller may overwrite its array."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    return list(value) if isinstance(value, (list, tuple)) else value


def _finite(value: ArrayLike, n: int) -> list[float] | None:
    """`value` as n finite numbers, or None."""
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        return None
    if array.ndim == 0 and n == 1:
        array = array.reshape(1)
    if array.shape != (n,):
        return None
    numbers: list[float] = array.tolist()
    return numbers if all(map(math.isfinite, numbers)) else None
