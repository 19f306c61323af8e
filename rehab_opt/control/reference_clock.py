"""The time at which a reference is followed: it waits, slows down and catches up; the path itself is kept."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.between_poses import (
    angle_between,
    calm_way_function,
    distance_between,
    part_way_function,
)
from rehab_opt.control.foreseen import Foreseen
from rehab_opt.symbolic import BufferedFunction

__all__ = ["ReferenceClock"]

Array = NDArray[np.float64]

THINNED = 4096
"""Samples that wait at most; beyond, every second one is left out. What arrives at 200 Hz waits 20 s until then, and is
still sampled at 100 Hz afterwards: far above what a tracker's filter lets through. C has room for fewer."""
CURVED = 0.02
"""[rad] Turns between samples up to this are interpolated by entries, larger ones along the arc."""


class ReferenceClock:
    """Poses that arrive tick by tick, read at a time of one's own.

    Poses are joined by straight lines and even turns. A clock is *current* while it stands at the newest sample.

    Parameters
    ----------
    dt : [s] between samples as they arrive.
    linear_speed, angular_speed : [m/s, rad/s] at which a jump between samples is bridged.
    """

    def __init__(self, dt: float, *, linear_speed: float, angular_speed: float) -> None:
        self.dt = dt
        self._part_way = BufferedFunction(part_way_function())
        self._calm_way = BufferedFunction(calm_way_function(linear_speed, angular_speed))
        self.most = THINNED
        """Samples that wait at most; may be set between two ticks."""
        self.reset()

    def reset(self) -> None:
        """Forget every sample."""
        self._poses: list[Array] = []
        self._twists: list[Array] = []
        self._seconds: list[float] = []  # since the sample before
        self._paces: list[float] = []  # the most that what follows allows, where it is known
        self._stamps: list[float] = []  # of the reference's own time
        self._at = 0
        self._fraction = 0.0
        self.lag = 0.0
        """[s] that the clock needs to the newest sample, bridges included."""
        self.lost = 0.0
        """[s] of the reference since the newest sample that were not taken."""
        self.passed = 0
        """Samples that the clock has passed."""
        self.thinned = False
        """Whether the last sample made every second one go that waits."""
        self._looked_at: tuple[int, Array | None, bool] = (-1, None, False)

    @property
    def empty(self) -> bool:
        """Whether there is no sample yet."""
        return not self._poses

    @property
    def current(self) -> bool:
        """Whether the newest sample is the one that is read."""
        return self._at >= len(self._poses) - 1

    @property
    def waiting(self) -> int:
        """Samples that are still to come."""
        return len(self._poses) - 1 - self._at

    @property
    def bridging(self) -> bool:
        """Whether the clock is between samples that a jump lies between."""
        return self._at < len(self._poses) - 1 and self._seconds[self._at + 1] > 1.5 * self.dt

    @property
    def stamp(self) -> float:
        """[s] of the reference's own time, from the first sample on, where the clock stands; in a bridge, between."""
        at = self._at
        if self._fraction == 0.0:
            return self._stamps[at]
        return self._stamps[at] + self._fraction * (self._stamps[at + 1] - self._stamps[at])

    @property
    def behind(self) -> float:
        """[s] by which what is read is older than what arrives now, taken or not; and no less than `lag`."""
        return 0.0 if self.empty else max(self.lag, self._stamps[-1] + self.lost - self.stamp)

    @property
    def fraction(self) -> float:
        """Share of the way to the next sample that the clock has gone."""
        return self._fraction

    @property
    def newest(self) -> Array:
        """(4, 4) the last pose that arrived."""
        return self._poses[-1]

    def start(self, pose: Array, twist: Array, *, stamp: float = 0.0) -> None:
        """Stand at one sample, and forget the others."""
        self.reset()
        self._stamps = [stamp]
        self._poses, self._twists, self._seconds, self._paces = [pose.copy()], [twist.copy()], [0.0], [math.inf]

    def push(
        self,
        pose: Array,
        twist: Array,
        *,
        seconds: float | None = None,
        bridge: bool = False,
        thinning: bool = True,
    ) -> None:
        """A new sample, one tick (or `seconds`) after the newest; with `bridge`, as late as a calm way to it takes.

        What was lost between them is left out: its time counts in `behind` until the clock has passed it.
        `thinning` bounds the samples that wait.
        """
        seconds = self.dt if seconds is None else seconds
        stamp, self.lost = self._stamps[-1] + self.lost + seconds, 0.0
        if bridge:
            calm, between = self._bridge(self._poses[-1], pose, seconds)
            if calm > seconds:
                self._twists[-1] = between  # all the way, and steadily: the tracker's own bounds round the corners
                self._append(pose, between, calm, stamp)
                seconds = 0.0
        self._append(pose, twist, seconds, stamp)
        self.thinned = thinning and len(self._poses) - self._at > self.most
        if self.thinned:
            self._thin()

    def extend(self, poses: Array, twists: Array, seconds: Array) -> None:
        """Many samples (N, 4, 4), (N, 6) at once, so many seconds (N,) after each other; none of them bridged."""
        self._stamps.extend((self._stamps[-1] + np.cumsum(seconds)).tolist())
        self._poses.extend(poses.copy())
        self._twists.extend(twists.copy())
        self._seconds.extend(seconds.tolist())
        self._paces.extend([math.inf] * len(poses))
        self.lag += float(seconds.sum())

    def go_on(self, samples: int, fraction: float, seconds: float) -> None:
        """Stand so many samples further, and at this share of the way to the next one."""
        self._at, self.passed, self._fraction = self._at + samples, self.passed + samples, fraction
        self.lag = 0.0 if self.current else self.lag - seconds

    def foreseen(self, *, linear_speed: float, angular_speed: float) -> Foreseen:
        """The samples from the one at hand on, to be laid out in time, at most at these speeds [m/s, rad/s]."""
        poses, twists, seconds, paces = (
            np.array(column[self._at :]) for column in (self._poses, self._twists, self._seconds, self._paces)
        )
        return Foreseen(poses, twists, seconds, paces, linear_speed=linear_speed, angular_speed=angular_speed)

    def advance(self, seconds: float) -> None:
        """Go on by this much reference time, at most to the newest sample."""
        last = len(self._poses) - 1
        while self._at < last:
            length = self._seconds[self._at + 1]
            left = length * (1.0 - self._fraction)
            if seconds < left:
                self._fraction += seconds / length
                self.lag -= seconds
                break
            seconds -= left
            self.lag -= left
            self._at, self.passed, self._fraction = self._at + 1, self.passed + 1, 0.0
        if self._at >= last:
            self._fraction, self.lag = 0.0, 0.0
        if self._at > 256:
            self._forget(self._at)

    def read(self, ahead: float = 0.0) -> tuple[Array, Array]:
        """Pose (4, 4) and twist (6,), `ahead` seconds of reference time from now; the clock stays where it is."""
        at, fraction = self._at, self._fraction
        last = len(self._poses) - 1
        while ahead > 0.0 and at < last:
            length = self._seconds[at + 1]
            left = length * (1.0 - fraction)
            if ahead < left:
                fraction += ahead / length
                break
            ahead -= left
            at, fraction = at + 1, 0.0
        if at >= last or fraction == 0.0:
            return self._poses[at], self._twists[at]
        a, b = self._poses[at], self._poses[at + 1]
        twist = self._twists[at] + fraction * (self._twists[at + 1] - self._twists[at])
        pose = a + fraction * (b - a)
        # Between neighbouring samples entries suffice: what they miss of a rotation is an eighth of the angle's square.
        if self._seconds[at + 1] > 1.5 * self.dt or self._is_curved(at):
            pose[:3, :3] = self._part_way.of(a.ravel()[:12], b.ravel()[:12], fraction).reshape(3, 3)
        return pose, twist

    def _is_curved(self, at: int) -> bool:
        if at != self._looked_at[0] or self._poses[at] is not self._looked_at[1]:
            turn = float(np.abs(self._poses[at][:3, :3] - self._poses[at + 1][:3, :3]).max())
            self._looked_at = at, self._poses[at], turn > CURVED
        return self._looked_at[2]

    def is_still(self, linear_speed: float, angular_speed: float) -> bool:
        """Whether the poses on both sides of the clock are no further apart than these speeds [m/s, rad/s] lead."""
        if self.current:
            return True
        a, b, seconds = self._poses[self._at], self._poses[self._at + 1], self._seconds[self._at + 1]
        return distance_between(a, b) <= linear_speed * seconds and angle_between(a, b) <= angular_speed * seconds

    @property
    def pace(self) -> float:
        """The most that what follows allows, where `slow_ahead` has looked at it."""
        return self._paces[self._at]

    def slow_ahead(self, *, linear_speed: float, angular_speed: float, quickening: float) -> None:
        """Look at all samples: the pace at which none is faster than these speeds [m/s, rad/s], slowed down in time.

        The pace falls by at most 1 in `quickening` seconds.
        """
        motion = np.array(self._twists)
        fastest = np.maximum(
            np.linalg.norm(motion[:, :3], axis=1) / linear_speed, np.linalg.norm(motion[:, 3:], axis=1) / angular_speed
        )
        paces = (1.0 / np.maximum(fastest, 1e-9)).tolist()
        for i in range(len(paces) - 2, -1, -1):
            # d(pace^2)/d(reference time) = 2 d(pace)/dt
            paces[i] = min(paces[i], math.sqrt(paces[i + 1] ** 2 + 2.0 * self._seconds[i + 1] / quickening))
        self._paces = paces

    def _bridge(self, a: Array, b: Array, least: float) -> tuple[float, Array]:
        """Seconds (at least so many) and twist (6,) of the calm way from one pose to another."""
        calm = float(self._calm_way.of(a.ravel()[:12], b.ravel()[:12], least)[0])
        return calm, self._calm_way.outputs[1].copy()

    def _append(self, pose: Array, twist: Array, seconds: float, stamp: float) -> None:
        self._stamps.append(stamp)
        self._poses.append(pose.copy())
        self._twists.append(twist.copy())
        self._seconds.append(seconds)
        self._paces.append(math.inf)
        self.lag += seconds

    def _forget(self, before: int) -> None:
        if before > self._at:
            self._fraction = 0.0
        for column in (self._poses, self._twists, self._seconds, self._paces, self._stamps):
            del column[:before]
        self._at = max(self._at - before, 0)

    def _thin(self) -> None:
        """Leave out every second sample that waits; their time is kept."""
        first = self._at + 2
        for i in range(first, len(self._poses) - 1):
            if (i - first) % 2 == 0:
                self._seconds[i + 1] += self._seconds[i]
        gone = slice(first, len(self._poses) - 1, 2)
        for column in (self._poses, self._twists, self._seconds, self._paces, self._stamps):
            del column[gone]
