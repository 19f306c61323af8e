"""A motion tracker's samples made fit for a controller: resampled evenly, lost sight as NaN, noise filtered.

The whole recording at once (`conditioned`) and sample by sample (`Conditioner`) give the same numbers.
"""

from __future__ import annotations

import math
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
"""Samples that must agree before a stretch counts: fewer are a tracker's spike."""
LONGEST_GAP = 600.0
"""[s] A clock that goes on by more was set."""


class Conditioned(NamedTuple):
    """N even samples; those while sight was lost hold NaN, which a tracker answers by decelerating."""

    times: Array
    """(N,) [s] of the stamps' clock, dt apart, from the first usable sample on."""
    poses: Array
    """(N, 4, 4)"""
    twists: Array
    """(N, 6) [m/s, rad/s] linear first, base frame, over the tick before."""
    lost: NDArray[np.bool_]
    """(N,) True where there is no sample to go by."""
    dropped: int
    """Samples left out: not finite, stamps that do not advance, spikes."""
    gaps: int
    """Stretches without usable samples, jumps included."""


class Conditioner(OneThread):
    """Sample by sample.

    Samples are joined by straight lines, and turns by the nearest way, at even ticks; then each coordinate, and each
    of the quaternion's, passes a low-pass filter of two equal poles. Sight counts as lost between samples more than
    `max_gap` apart, and where a hand would have had to move faster than one can. After that the filter starts anew.
    Ticks that were lost are given then, but where stamps went on by more than 600 s, as of a clock that was set: times
    go on from there.
    An object belongs to one thread: see `OneThread`.

    Parameters
    ----------
    dt : [s] between even samples.
    cutoff_hz : [Hz] of each pole; infinite for no filter.
    max_gap : [s]
    max_speed, max_turn_rate : [m/s, rad/s] of a hand.
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
        """[s] by which the filter delays a steady motion: 2 (1 - a)/a ticks; live, a sample interval comes on top."""
        return 2.0 * (1.0 - self.gain) / self.gain * self.dt

    def reset(self) -> None:
        """Forget every sample."""
        self._claim()
        self.dropped, self.gaps = 0, 0
        self._origin = math.nan
        self._next = 0  # tick to be given next
        self._held: list[tuple[float, Array]] = []  # the beginning of a stretch that does not count yet
        self._counts = False
        self._last: tuple[float, Array] | None = None
        self._state: tuple[Array, Array, Array] | None = None  # filter's poles, and the last pose
        self._give_away()

    def push(self, stamp: float, position: ArrayLike, quaternion: ArrayLike) -> Conditioned:
        """Even samples (none, one or many) that one sample of the tracker completes.

        Parameters
        ----------
        stamp : [s]
        position, quaternion : (3,) [m], (4,) x, y, z, w.
        """
        if self._owner != get_ident():
            self._claim()
        sample = np.concatenate(
            [real_numbers("position", position, (3,)), real_numbers("quaternion", quaternion, (4,))]
        )
        stamp, _ = stamp_and_kind(stamp)
        if not _usable(np.array([stamp]), sample[None])[0] or (self._last is not None and stamp <= self._last[0]):
            self.dropped += 1
            return self._given([])
        sample[3:] = continuous_quaternions(sample[None, 3:], None if self._last is None else self._last[1][3:])[0]
        if self._last is not None and not self._joins(*self._last, stamp, sample):
            if not self._counts:
                self.dropped += len(self._held)
            self._held, self._counts = [], False
        self._last = stamp, sample
        if self._counts:
            return self._given(self._up_to(stamp, sample))
        self._held.append((stamp, sample))
        if len(self._held) < TOGETHER:
            return self._given([])
        return self._given(self._opened())

    def _joins(self, t0: float, a: Array, t1: float, b: Array) -> bool:
        return bool(_joined(np.array([t0, t1]), np.array([a, b]), self)[0])

    def _opened(self) -> list[tuple[int, Array | None, Array]]:
        """The first ticks of a stretch, after those that were lost before it."""
        self._counts = True
        start, first = self._held[0]
        out: list[tuple[int, Array | None, Array]] = []
        self.gaps += not math.isnan(self._origin)
        if not start - (self._origin + self._next * self.dt) <= LONGEST_GAP:
            self._origin, self._next = start, 0
        opening = _first_tick(start, self._origin, self.dt)
        out += [(k, None, np.zeros(6)) for k in range(self._next, opening)]
        self._next = max(opening, self._next)
        self._state, self._from = None, (start, first)
        for stamp, sample in self._held[1:]:
            out += self._up_to(stamp, sample)
        self._held = []
        return out

    def _up_to(self, stamp: float, sample: Array) -> list[tuple[int, Array | None, Array]]:
        out: list[tuple[int, Array | None, Array]] = []
        t0, a = self._from
        while (at := self._origin + self._next * self.dt) <= stamp:
            raw = a + (sample - a) * ((at - t0) / (stamp - t0))
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
        self._from = stamp, sample
        return out

    def _given(self, ticks: list[tuple[int, Array | None, Array]]) -> Conditioned:
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
    """A whole recording: stamps (N,) [s], positions (N, 3) [m], quaternions (N, 4); see `Conditioner`.

    Raises
    ------
    ConfigurationError : wrong shapes, no stretch of usable samples, or more than 600 s without.
    """
    from scipy.signal import lfilter  # noqa: PLC0415  (loaded when used)

    rule = Conditioner(dt, cutoff_hz=cutoff_hz, max_gap=max_gap, max_speed=max_speed, max_turn_rate=max_turn_rate)
    given = {"times": times, "positions": positions, "quaternions": quaternions}
    t, *given_poses = (checked_array(name, value, "numbers") for name, value in given.items())
    x = np.concatenate(given_poses, axis=1)
    if t.shape != (len(x),) or x.shape[1] != 7:
        raise ConfigurationError("times, positions, quaternions", (t.shape, x.shape), "(N,), (N, 3) and (N, 4)")
    keep = np.flatnonzero(_usable(t, x))
    newest = np.maximum.accumulate(t[keep]) if len(keep) else t[keep]
    keep = keep[np.concatenate([[True], t[keep][1:] > newest[:-1]])] if len(keep) else keep
    t, x = t[keep], x[keep]
    x[:, 3:] = continuous_quaternions(x[:, 3:])
    stretch = np.concatenate([[0], np.cumsum(~_joined(t, x, rule))]) if len(t) else np.zeros(0, dtype=int)
    sizes = np.bincount(stretch)
    parts = [np.flatnonzero(stretch == i) for i in np.flatnonzero(sizes >= TOGETHER)]
    if not parts:
        within = f"stamps [s] at most {rule.max_gap:g} apart and places [m] no faster than {rule.max_speed:g} m/s"
        expected = f"at least {TOGETHER} usable samples together, of {within}"
        raise ConfigurationError("times", f"{len(keep)} finite samples, none together", expected)
    longest = max((float(t[after[0]] - t[part[-1]]) for part, after in pairwise(parts)), default=0.0)
    if longest > LONGEST_GAP:
        expected = f"no more than {LONGEST_GAP:g} s without usable samples: seconds of one clock that nobody set"
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


def _joined(times: Array, samples: Array, rule: Conditioner) -> NDArray[np.bool_]:
    """Whether each sample goes on from the one before; quaternions of unit length, continuous."""
    seconds = np.diff(times)
    way = np.linalg.norm(np.diff(samples[:, :3], axis=0), axis=1)
    half = np.clip(np.abs(np.sum(samples[1:, 3:] * samples[:-1, 3:], axis=1)), 0.0, 1.0)
    turn = 2.0 * np.arccos(half)
    near = (way <= rule.max_speed * seconds + 1e-3) & (turn <= rule.max_turn_rate * seconds + 1e-2)
    return np.asarray(near & (seconds <= rule.max_gap))


def _first_tick(start: float, origin: float, dt: float) -> int:
    """The first tick not before `start`."""
    tick = math.ceil((start - origin) / dt - 1e-9)
    return tick + int(origin + tick * dt < start)


def _twists(states: Array, dt: float) -> Array:
    """(N, 6) of filtered positions and quaternions (N, 7), from the one before; the first is at rest."""
    twists = np.zeros((len(states), 6))
    twists[1:, :3] = np.diff(states[:, :3], axis=0) / dt
    q = states[:, 3:] / np.linalg.norm(states[:, 3:], axis=1, keepdims=True)
    a, b = q[:-1], q[1:]
    # The vector part of b a^-1: the axis times the sine of half the angle.
    vector = b[:, :3] * a[:, 3:] - a[:, :3] * b[:, 3:] + np.cross(a[:, :3], b[:, :3])
    sine = np.linalg.norm(vector, axis=1, keepdims=True)
    angle = 2.0 * np.arctan2(sine, np.abs(np.sum(a * b, axis=1, keepdims=True)))
    twists[1:, 3:] = np.where(sine > 1e-12, vector * angle / np.maximum(sine, 1e-300), 2.0 * vector) / dt
    return twists
