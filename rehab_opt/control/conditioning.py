"""Prepare a motion tracker's samples for a controller: resample evenly, set NaN while sight is lost, filter noise.

`conditioned` takes a whole recording, `Conditioner` takes its samples one by one; both give the same result.
"""

from __future__ import annotations

import math
import operator
from itertools import pairwise
from threading import get_ident
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.control.thread_owner import OneThread
from rehab_opt.control.velocity_controller import checked_number, real_numbers
from rehab_opt.control.watchdog import stamp_and_kind
from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.real_array import checked_array, is_real
from rehab_opt.kinematics.vr import continuous_quaternions, poses_of

__all__ = ["Conditioned", "Conditioner", "conditioned"]

Array = NDArray[np.float64]

TOGETHER = 3
"""Least number of consistent samples in a stretch; fewer count as a spike."""
LONGEST_GAP = 600.0
"""[s] Largest gap between stamps; a longer one means that the clock was changed."""


class Conditioned(NamedTuple):
    """N evenly spaced samples; NaN while sight is lost."""

    times: Array
    """(N,) [s] times by the stamps' clock, dt apart, from the first valid sample on."""
    poses: Array
    """(N, 4, 4)"""
    twists: Array
    """(N, 6) [m/s, rad/s] linear first, base frame, mean over the previous tick."""
    lost: NDArray[np.bool_]
    dropped: int
    """Number of samples left out: samples that are not finite, samples whose stamps do not advance, and spikes."""
    gaps: int
    """Number of stretches without valid samples, including jumps."""


class _Sample(NamedTuple):
    stamp: float
    pose: Array
    """(7,) position and unit quaternion."""
    number: int = 0
    """Index in the recording."""


_Tick = tuple[int, Array | None, Array]
"""Index of the tick; pose (7,), or None if sight is lost; twist (6,)."""


class _Stretches:
    def __init__(self, rule: Conditioner) -> None:
        self.rule, self.dropped = rule, 0
        self.last: _Sample | None = None
        """Last accepted sample."""
        self.held: list[_Sample] = []
        """Samples of a stretch that is not accepted yet."""

    @property
    def newest(self) -> _Sample | None:
        return self.held[-1] if self.held else self.last

    def take(self, sample: _Sample) -> list[_Sample]:
        """Samples accepted now: none, this sample, or this sample and the beginning of its stretch."""
        newest = self.newest
        goes_on = newest is not None and self._goes_on(newest, sample)
        if newest is not None and sample.stamp <= newest.stamp:
            back = self.held and sample.stamp < self.held[0].stamp
            if not back or (self.last is not None and sample.stamp <= self.last.stamp):
                self.dropped += 1
                return []
            goes_on = False  # the held samples had stamps from the future
        if goes_on and not self.held:
            self.last = sample
            return [sample]
        if not goes_on:
            self.dropped += len(self.held)
            self.held = []
        self.held.append(sample)
        if len(self.held) < TOGETHER:
            return []
        begun, self.held, self.last = self.held, [], sample
        return begun

    def _goes_on(self, before: _Sample, after: _Sample) -> bool:
        seconds, a, b = after.stamp - before.stamp, before.pose.tolist(), after.pose.tolist()
        half = min(abs(sum(map(operator.mul, a[3:], b[3:]))), 1.0)
        way, turn = math.dist(a[:3], b[:3]), 2.0 * math.acos(half)
        near = way <= self.rule.max_speed * seconds + 1e-3 and turn <= self.rule.max_turn_rate * seconds + 1e-2
        return near and seconds <= self.rule.max_gap


class Conditioner(OneThread):
    """Condition a tracker's samples one by one.

    Positions and rotations are interpolated linearly at even ticks. Then each coordinate, also of the quaternion,
    passes a low-pass filter of two equal poles. Between two samples, sight counts as lost if they are more than
    `max_gap` apart, or if the hand would exceed `max_speed` or `max_turn_rate`. The filter then restarts. If the stamps
    jump by more than 600 s, the output times continue from the new stamp.

    Parameters
    ----------
    dt : [s] time between output samples.
    cutoff_hz : [Hz] cutoff frequency of each pole; infinite for no filter.
    max_gap : [s] largest time between samples that is interpolated.
    max_speed, max_turn_rate : [m/s, rad/s] largest possible speeds of a hand.
    """

    def __init__(
        self,
        dt: float,
        *,
        cutoff_hz: float = 8.0,
        max_gap: float = 0.1,
        max_speed: float = 5.0,
        max_turn_rate: float = 30.0,
    ) -> None:
        self.dt = checked_number("dt", dt, above=0.0, below=1.0)
        if not (is_real(cutoff_hz) and cutoff_hz > 0.0):
            raise ConfigurationError("cutoff_hz", cutoff_hz, "a positive frequency")
        self.gain = -math.expm1(-2.0 * math.pi * float(cutoff_hz) * self.dt)
        self.max_gap = checked_number("max_gap", max_gap, above=0.0)
        self.max_speed = checked_number("max_speed", max_speed, above=0.0)
        self.max_turn_rate = checked_number("max_turn_rate", max_turn_rate, above=0.0)
        self.reset()

    @property
    def lag(self) -> float:
        """[s] Lag of the filter in steady motion: 2 (1 - a)/a ticks, with the filter's gain a."""
        return 2.0 * (1.0 - self.gain) / self.gain * self.dt

    def reset(self) -> None:
        """Forget every sample."""
        self._claim()
        self.gaps, self._stretches = 0, _Stretches(self)
        self._origin = math.nan
        self._next = 0  # next tick to return
        self._state: tuple[Array, Array, Array] | None = None  # the filter's two poles, and the last pose
        self._give_away()

    @property
    def dropped(self) -> int:
        """Number of samples left out so far, see `Conditioned`."""
        return self._stretches.dropped

    def push(self, stamp: float, position: ArrayLike, quaternion: ArrayLike) -> Conditioned:
        """Add one sample: stamp [s], position (3,) [m], quaternion (x, y, z, w).

        Return the output samples that the new sample completes: none, one or several.
        """
        if self._owner != get_ident():
            self._claim()
        pose = np.concatenate([real_numbers("position", position, (3,)), real_numbers("quaternion", quaternion, (4,))])
        stamp, _ = stamp_and_kind(stamp)
        stretches = self._stretches
        if not _usable(np.array([stamp]), pose[None])[0]:
            stretches.dropped += 1
            return self._given([])
        newest = stretches.newest
        pose[3:] = continuous_quaternions(pose[None, 3:], None if newest is None else newest.pose[3:])[0]
        counts, out = stretches.take(_Sample(stamp, pose)), list[_Tick]()
        if len(counts) >= TOGETHER:
            out, counts = self._opened(counts[0]), counts[1:]
        for sample in counts:
            out += self._up_to(sample)
        return self._given(out)

    def _opened(self, first: _Sample) -> list[_Tick]:
        self.gaps += not math.isnan(self._origin)
        if not first.stamp - (self._origin + self._next * self.dt) <= LONGEST_GAP:
            self._origin, self._next = first.stamp, 0
        opening = _first_tick(first.stamp, self._origin, self.dt)
        out: list[_Tick] = [(k, None, np.zeros(6)) for k in range(self._next, opening)]
        self._next = max(opening, self._next)
        self._state, self._from = None, first
        return out

    def _up_to(self, sample: _Sample) -> list[_Tick]:
        out: list[_Tick] = []
        t0, a, _ = self._from
        while (at := self._origin + self._next * self.dt) <= sample.stamp:
            raw = a + (sample.pose - a) * ((at - t0) / (sample.stamp - t0))
            if self._state is None:
                one = two = raw
                twist = np.zeros(6)
            else:
                one, two, before = self._state
                one = one + self.gain * (raw - one)
                two = two + self.gain * (one - two)
                twist = _twists(np.array([before, two]), self.dt)[1]
            self._state = one, two, two
            out.append((self._next, two, twist))
            self._next += 1
        self._from = sample
        return out

    def _given(self, ticks: list[_Tick]) -> Conditioned:
        numbers = np.array([math.nan * np.ones(7) if state is None else state for _, state, _ in ticks]).reshape(-1, 7)
        times = self._origin + self.dt * np.array([k for k, _, _ in ticks], dtype=np.float64)
        lost = np.isnan(numbers[:, 0])
        twists = np.array([twist for _, _, twist in ticks]).reshape(-1, 6)
        return Conditioned(times, poses_of(numbers[:, :3], numbers[:, 3:]), twists, lost, self.dropped, self.gaps)


def conditioned(
    times: ArrayLike,
    positions: ArrayLike,
    quaternions: ArrayLike,
    *,
    dt: float,
    cutoff_hz: float = 8.0,
    max_gap: float = 0.1,
    max_speed: float = 5.0,
    max_turn_rate: float = 30.0,
) -> Conditioned:
    """Condition a recording: stamps (N,) [s], positions (N, 3) [m], quaternions (N, 4); see `Conditioner`.

    Raises `ConfigurationError` for wrong shapes, no valid stretch, or a gap of more than 600 s.
    """
    from scipy.signal import lfilter  # noqa: PLC0415  (loaded when used)

    rule = Conditioner(dt, cutoff_hz=cutoff_hz, max_gap=max_gap, max_speed=max_speed, max_turn_rate=max_turn_rate)
    given = {"times": times, "positions": positions, "quaternions": quaternions}
    t, *given_poses = (checked_array(name, value, "numbers") for name, value in given.items())
    x = np.concatenate(given_poses, axis=1)
    if t.shape != (len(x),) or x.shape[1] != 7:
        raise ConfigurationError("times, positions, quaternions", (t.shape, x.shape), "(N,), (N, 3) and (N, 4)")
    usable = np.flatnonzero(_usable(t, x))
    x[usable, 3:] = continuous_quaternions(x[usable, 3:])
    stretches, parts = _Stretches(rule), list[list[int]]()
    for i in usable.tolist():
        counts = stretches.take(_Sample(float(t[i]), x[i], i))
        if len(counts) >= TOGETHER:
            parts.append([])
        if counts:
            parts[-1] += [each.number for each in counts]
    for part in parts:
        x[part, 3:] = continuous_quaternions(x[part, 3:])  # anew, since samples between are left out
    if not parts:
        within = f"stamps [s] at most {rule.max_gap:g} apart and places [m] no faster than {rule.max_speed:g} m/s"
        expected = f"at least {TOGETHER} valid samples together, of {within}"
        raise ConfigurationError("times", f"{len(usable)} finite samples, none together", expected)
    longest = max((float(t[after[0]] - t[part[-1]]) for part, after in pairwise(parts)), default=0.0)
    if longest > LONGEST_GAP:
        expected = f"no more than {LONGEST_GAP:g} s without valid samples, in seconds of one clock"
        raise ConfigurationError("times", f"a gap of {longest:.3g} s", expected)
    origin, ends = t[parts[0][0]], []
    for part in parts:
        first = _first_tick(t[part[0]], origin, dt)
        last = math.floor((t[part[-1]] - origin) / dt + 1e-9)
        last -= int(origin + last * dt > t[part[-1]])
        ends.append((first, last))
    total = ends[-1][1] + 1
    states, twists = np.full((total, 7), math.nan), np.zeros((total, 6))
    for part, (first, last) in zip(parts, ends, strict=True):
        if last < first:
            continue
        at = origin + dt * np.arange(first, last + 1)
        raw = np.stack([np.interp(at, t[part], x[part, i]) for i in range(7)], axis=1)
        smooth = raw
        for _ in range(2):
            start = (1.0 - rule.gain) * smooth[:1]
            smooth = lfilter([rule.gain], [1.0, rule.gain - 1.0], smooth, axis=0, zi=start)[0]
        states[first : last + 1] = smooth
        twists[first : last + 1] = _twists(smooth, dt)
    lost = np.isnan(states[:, 0])
    dropped = len(np.array(times)) - int(sum(map(len, parts)))
    poses = poses_of(states[:, :3], states[:, 3:])
    return Conditioned(origin + dt * np.arange(total), poses, twists, lost, dropped, len(parts) - 1)


def _usable(times: Array, samples: Array) -> NDArray[np.bool_]:
    length = np.sum(samples[:, 3:] ** 2, axis=1)
    finite = np.isfinite(times) & np.all(np.abs(samples) <= 1e6, axis=1)
    return np.asarray(finite & (length > 1e-6))


def _first_tick(start: float, origin: float, dt: float) -> int:
    tick = math.ceil((start - origin) / dt - 1e-9)
    return tick + int(origin + tick * dt < start)


def _twists(states: Array, dt: float) -> Array:
    """Mean twists (N, 6) over the previous tick, from filtered positions and quaternions (N, 7); the first is zero."""
    twists = np.zeros((len(states), 6))
    twists[1:, :3] = np.diff(states[:, :3], axis=0) / dt
    q = states[:, 3:] / np.linalg.norm(states[:, 3:], axis=1, keepdims=True)
    a, b = q[:-1], q[1:]
    # Vector part of b a^-1: axis times sine of half the angle.
    vector = b[:, :3] * a[:, 3:] - a[:, :3] * b[:, 3:] + np.cross(a[:, :3], b[:, :3])
    sine = np.linalg.norm(vector, axis=1, keepdims=True)
    angle = 2.0 * np.arctan2(sine, np.abs(np.sum(a * b, axis=1, keepdims=True)))
    twists[1:, 3:] = np.where(sine > 1e-12, vector * angle / np.maximum(sine, 1e-300), 2.0 * vector) / dt
    return twists
