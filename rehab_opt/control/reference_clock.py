"""Clock that reads a reference: it waits, slows down and catches up; the path of the reference is unchanged."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.between_poses import angle_of, calm_way, distance_of, part_way
from rehab_opt.control.preview import Preview, turned_each, turns_between
from rehab_opt.optim.certificate import all_true
from rehab_opt.symbolic import BufferedFunction
from rehab_opt.symbolic.record import Record, Values

__all__ = ["CLOCK", "JUMP", "KEPT", "SAMPLE", "SPIN", "ClockStatement", "ReferenceClock"]

Array = NDArray[np.float64]

THINNED, KEPT = 4096, 2
"""Largest number of waiting samples in Python; with more, every second one is left out, except the first `KEPT`."""
CURVED = 0.02
"""[rad] Rotations between samples up to this are interpolated entry by entry, larger ones along the arc."""
LONGEST = 1.5
"""[ticks] Two samples that are further apart are joined by a bridge."""
JUMP, SPIN = 5.0, 30.0
"""[m/s, rad/s] Speeds that no hand reaches: faster samples mean a jump of the motion tracker, which is bridged."""
ROTATION = [4 * i + j for i in range(3) for j in range(3)]
"""Indices of the rotation's entries in a pose."""
WINDOW = 12
"""Default number of samples that a tick considers."""

SAMPLE = Record(pose=12, twist=6, seconds=1, stamp=1)
"""First three rows of the pose [m], twist [m/s, rad/s], time since the sample before [s], stamp in the reference's own
time [s].
"""
CLOCK = Record(ahead=1, fraction=1, lag=1, lost=1, newest=1)
"""Number of samples after the current one (-1 without any); fraction of the step to the next one; [s] time from the
clock to the newest sample, bridges included; [s] time of the reference that was skipped since; the newest sample's
stamp [s].
"""


class ClockStatement:
    """Functions of a clock, for Python and C.

    They read the `window` samples from the current one on. Samples arrive `dt` [s] apart.
    """

    def __init__(self, dt: float, *, window: int = WINDOW) -> None:
        self.dt, self.window = dt, window

    def between(self, a: Values, b: Values, share: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Pose (12,) and twist (6,) at a fraction of the step from sample `a` to sample `b`."""
        pose = a.pose + share * (b.pose - a.pose)
        turn = ca.mmax(ca.fabs(a.pose[ROTATION] - b.pose[ROTATION]))
        curved = ca.logic_or(b.seconds > LONGEST * self.dt, turn > CURVED)
        pose[ROTATION] = ca.if_else(curved, part_way(a.pose, b.pose, share), pose[ROTATION])
        twist = a.twist + share * (b.twist - a.twist)
        return ca.if_else(share == 0, a.pose, pose), ca.if_else(share == 0, a.twist, twist)

    def read_function(self) -> ca.Function:
        """Function: samples (20, window), `CLOCK`, [s] ahead of the clock -> pose (16,) and twist."""
        lengths, clock, ahead = ca.SX.sym("seconds", self.window), CLOCK.symbols("clock"), ca.SX.sym("ahead")
        passed, fraction, left, going = ca.SX(0), clock.fraction, ahead, ahead > 0
        for i in range(self.window - 2):  # generated code would read beyond the array
            length = lengths[i + 1]
            to_next = length * (1 - fraction)
            looked = all_true(going, clock.ahead > i, left > 0)
            ends = left < to_next
            fraction = ca.if_else(looked, ca.if_else(ends, fraction + left / length, 0), fraction)
            going = ca.logic_and(looked, ca.logic_not(ends))
            left, passed = ca.if_else(going, left - to_next, left), passed + going
        share = ca.if_else(passed >= clock.ahead, 0, fraction)
        find = ca.Function("find", [lengths, clock.column, ahead], [passed, share], {"cse": True})
        a, b, part = SAMPLE.symbols("a"), SAMPLE.symbols("b"), ca.SX.sym("share")
        outputs = [ca.densify(each) for each in self.between(a, b, part)]
        between = ca.Function("between", [a.column, b.column, part], outputs, {"cse": True})
        samples = ca.MX.sym("samples", SAMPLE.size, self.window)
        given = [ca.MX.sym("clock", CLOCK.size), ca.MX.sym("ahead")]
        at, way = find(samples[SAMPLE["seconds"], :].T, *given)
        pose, twist = between.call([samples[:, at], samples[:, at + 1], way])
        return ca.Function("read", [samples, *given], [ca.vertcat(pose, ca.DM([0, 0, 0, 1])), twist])

    def advanced(self, lengths: ca.SX, clock: Values, seconds: ca.SX, goes: ca.SX) -> tuple[ca.SX, Values]:
        """Two results: the number of samples passed in `seconds` of reference time, and the new clock.

        `lengths` (window,) [s] are the times between samples. The clock advances only if `goes` is true, and no further
        than the newest sample.
        """
        passed, fraction, lag, going = ca.SX(0), clock.fraction, clock.lag, goes
        for i in range(self.window - 1):
            length = lengths[i + 1]
            left = length * (1 - fraction)
            looked = ca.logic_and(going, clock.ahead > i)
            ends = seconds < left
            lag = ca.if_else(looked, lag - ca.if_else(ends, seconds, left), lag)
            fraction = ca.if_else(looked, ca.if_else(ends, fraction + seconds / length, 0), fraction)
            going = ca.logic_and(looked, ca.logic_not(ends))
            seconds, passed = ca.if_else(going, seconds - left, seconds), passed + going
        ahead = clock.ahead - passed
        newest = ca.logic_and(goes, ahead <= 0)
        after = CLOCK.changed(
            clock, ahead=ahead, fraction=ca.if_else(newest, 0, fraction), lag=ca.if_else(newest, 0, lag)
        )
        return passed, after

    @staticmethod
    def behind_function() -> ca.Function:
        """Function: current sample and the next (40,), `CLOCK` -> `ReferenceClock.behind`."""
        samples, clock = ca.SX.sym("samples", SAMPLE.size, 2), CLOCK.symbols("clock")
        here, there = ca.horzsplit(samples[SAMPLE["stamp"], :])
        stamp = ca.if_else(clock.fraction == 0, here, here + clock.fraction * (there - here))
        behind = ca.if_else(clock.ahead < 0, 0, ca.fmax(clock.lag, clock.newest + clock.lost - stamp))
        return ca.Function("behind", [ca.vec(samples), clock.column], [behind])

    @staticmethod
    def started_function() -> ca.Function:
        """Function: pose (16,), twist, stamp -> the only sample, `CLOCK`."""
        pose, twist, stamp, zero = ca.SX.sym("pose", 16), ca.SX.sym("twist", 6), ca.SX.sym("stamp"), ca.SX(0)
        sample = SAMPLE.of(pose=pose[:12], twist=twist, seconds=zero, stamp=stamp)
        clock = CLOCK.of(ahead=zero, fraction=zero, lag=zero, lost=zero, newest=stamp)
        return ca.Function("started", [pose, twist, stamp], [sample, clock])

    @staticmethod
    def taken_function(linear_speed: float, angular_speed: float) -> ca.Function:
        """Function: newest sample, pose, twist, `CLOCK`, [seconds, bridge] -> three samples (60,), `CLOCK`.

        After a jump, or with `bridge`: the newest sample, the end of a calm motion to the new pose, the new sample.
        Otherwise: the newest sample, the new sample, zeros.
        """
        newest, pose, twist = SAMPLE.symbols("newest"), ca.SX.sym("pose", 16), ca.SX.sym("twist", 6)
        clock, (seconds, bridge) = CLOCK.symbols("clock"), ca.vertsplit(told := ca.SX.sym("told", 2))
        entries = pose[:12]
        stamp = newest.stamp + clock.lost + seconds
        jumps = ca.logic_or(
            distance_of(entries, newest.pose) > JUMP * seconds + 1e-3,
            angle_of(entries, newest.pose) > SPIN * seconds + 1e-2,
        )
        calm, between = calm_way(newest.pose, entries, seconds, linear_speed=linear_speed, angular_speed=angular_speed)
        both = ca.logic_and(ca.logic_or(bridge, jumps), calm > seconds)
        # At constant speed: the tracker's own bounds round the corners.
        before = SAMPLE.of(
            pose=newest.pose, twist=ca.if_else(both, between, newest.twist), seconds=newest.seconds, stamp=newest.stamp
        )
        way = SAMPLE.of(pose=entries, twist=between, seconds=calm, stamp=stamp)
        own = SAMPLE.of(pose=entries, twist=twist, seconds=ca.if_else(both, 0, seconds), stamp=stamp)
        samples = ca.vertcat(before, ca.if_else(both, way, own), ca.if_else(both, own, 0))
        lag = clock.lag + ca.if_else(both, calm, seconds)
        after = CLOCK.changed(clock, ahead=clock.ahead + 1 + both, lag=lag, lost=ca.SX(0), newest=stamp)
        inputs = [newest.column, pose, twist, clock.column, told]
        return ca.Function("taken", inputs, [samples, after.column], {"cse": True})


class ReferenceClock:
    """Poses that arrive every `dt` [s] and are read at another pace, joined by straight lines and uniform rotations.

    A clock is *current* if it is at the newest sample.

    linear_speed, angular_speed : [m/s, rad/s] speeds of the bridges over jumps.
    """

    def __init__(self, dt: float, *, linear_speed: float, angular_speed: float, window: int = WINDOW) -> None:
        self.dt, self._window = dt, window
        stated = ClockStatement(dt, window=window)
        self._reading, self._behind, self._started = (
            BufferedFunction(each()) for each in (stated.read_function, stated.behind_function, stated.started_function)
        )
        self._taken = BufferedFunction(stated.taken_function(linear_speed, angular_speed))
        self.most = THINNED
        """Largest number of waiting samples; may be set between two ticks."""
        self.reset()

    def reset(self) -> None:
        """Remove all samples."""
        self._table: Array = np.zeros((4 * self._window, SAMPLE.size))
        self._end = self._at = 0
        self._paces: list[float] = []  # largest pace that later samples allow, if known
        self.fraction = 0.0
        """Fraction of the way to the next sample that the clock has passed."""
        self.lag = 0.0
        """[s] Time that the clock needs to the newest sample, bridges included."""
        self.lost = 0.0
        """[s] Skipped time of the reference since the newest sample."""
        self.passed = 0
        """Number of samples that the clock has passed."""
        self.thinned = False
        """Whether every second waiting sample was left out with the last one."""

    @property
    def empty(self) -> bool:
        """Whether there is no sample yet."""
        return not self._end

    @property
    def current(self) -> bool:
        """Whether the clock is at the newest sample."""
        return self._at >= self._end - 1

    @property
    def waiting(self) -> int:
        """Number of samples after the clock."""
        return self._end - 1 - self._at

    @property
    def window(self) -> Array:
        """Samples (window, 20) from the current one on; rows after the newest are meaningless."""
        return self._table[self._at : self._at + self._window]

    @property
    def bridging(self) -> bool:
        """Whether the clock is on a bridge over a jump."""
        return not self.current and float(self._table[self._at + 1, SAMPLE["seconds"]]) > LONGEST * self.dt

    @property
    def now(self) -> tuple[float, ...]:
        """Values of `CLOCK`."""
        newest = float(self._table[self._end - 1, SAMPLE["stamp"]])
        return self._end - 1 - self._at, self.fraction, self.lag, self.lost, newest

    @property
    def stamp(self) -> float:
        """Time [s] of the reference that the clock reads, from the first sample on; interpolated on a bridge."""
        at, next_one = self._table[self._at : self._at + 2, SAMPLE["stamp"]].tolist()
        return float(at if self.fraction == 0.0 else at + self.fraction * (next_one - at))

    @property
    def behind(self) -> float:
        """Age [s] of the sample in use behind the newest sample; skipped time counts, and it is never below `lag`."""
        behind = self._behind
        behind.inputs[0][:], behind.inputs[1][:] = self._table[self._at : self._at + 2].reshape(-1), self.now
        behind.evaluate()
        return float(behind.outputs[0][0])

    def start(self, pose: Array, twist: Array, *, stamp: float = 0.0) -> None:
        """Start at one sample, and remove the others."""
        self.reset()
        self._append(self._started.of(pose.reshape(-1), twist, stamp)[None])

    def push(
        self,
        pose: Array,
        twist: Array,
        *,
        seconds: float | None = None,
        bridge: bool = False,
        thinning: bool = True,
    ) -> None:
        """Add a sample one tick (or `seconds`) after the newest; a jump, or `bridge`, adds a bridge before it.

        Samples that were skipped before count in `behind`. `thinning` limits the number of waiting samples.
        """
        self._enlarge(2)
        taken, newest = self._taken, self._end - 1
        inputs, (samples, after) = taken.inputs, taken.outputs
        inputs[0][:], inputs[1][:], inputs[2][:] = self._table[newest], pose.reshape(-1), twist
        inputs[3][:], inputs[4][:] = self.now, (self.dt if seconds is None else seconds, bridge)
        taken.evaluate()
        self._table[newest : newest + 3] = samples.reshape(3, -1)
        ahead, _, self.lag, self.lost, _ = after.tolist()
        self._end = self._at + int(ahead) + 1
        self.thinned = thinning and self._end - self._at > self.most
        if self.thinned:
            self._thin()

    def extend(self, poses: Array, twists: Array, seconds: Array) -> None:
        """Add N samples at once, `seconds` (N,) apart, without bridges: poses (N, 4, 4) and twists (N, 6)."""
        stamps = self._table[self._end - 1, SAMPLE["stamp"]] + np.cumsum(seconds)
        self._append(np.column_stack([poses.reshape(-1, 16)[:, :12], twists, seconds, stamps]))

    def stand(self, samples: int, fraction: float, lag: float) -> None:
        """Move the clock on by `samples` samples, and set its `fraction` of the next step and its `lag` [s]."""
        self._at, self.passed, self.fraction, self.lag = self._at + samples, self.passed + samples, fraction, lag
        if self._at > 256 and not self._paces:
            self._table[: self._end - self._at] = self._table[self._at : self._end].copy()
            self._end, self._at = self._end - self._at, 0

    def go_on(self, samples: int, fraction: float, seconds: float) -> None:
        """Move the clock on as `stand` does; the lag falls by `seconds` of reference time."""
        self.stand(samples, fraction, self.lag - seconds)
        self.lag = 0.0 if self.current else self.lag

    def preview(self, *, linear_speed: float, angular_speed: float) -> Preview:
        """Preview of the samples from the current one on, with these largest speeds [m/s, rad/s]."""
        samples = self._table[self._at : self._end]
        poses = np.tile(np.eye(4), (len(samples), 1, 1))
        poses[:, :3] = samples[:, :12].reshape(-1, 3, 4)
        seconds, paces = samples[:, SAMPLE["seconds"]].copy(), np.array(self._paces[self._at :])
        return Preview(
            poses, samples[:, 12:18].copy(), seconds, paces, linear_speed=linear_speed, angular_speed=angular_speed
        )

    def left(self, seconds: Array) -> tuple[Array, Array]:
        """Poses (M, 4, 4) and times (M,) [s] of the reference, each `seconds` (M,) before the newest sample."""
        samples = self._table[: self._end]
        after = np.append(np.cumsum(samples[:0:-1, SAMPLE["seconds"]])[::-1], 0.0)
        place = np.interp(-seconds, -after, np.arange(self._end))
        at = np.minimum(place.astype(int), max(self._end - 2, 0))
        share, here, there = place - at, samples[at], samples[np.minimum(at + 1, self._end - 1)]
        poses = np.tile(np.eye(4), (len(seconds), 1, 1))
        poses[:, :3] = here[:, :12].reshape(-1, 3, 4)
        then = there[:, :12].reshape(-1, 3, 4)
        poses[:, :3, 3] += share[:, None] * (then[:, :, 3] - poses[:, :3, 3])
        turns = turns_between(poses[:, :3, :3], then[:, :, :3])
        poses[:, :3, :3] = turned_each(poses[:, :3, :3], share[:, None] * turns)
        stamp = SAMPLE["stamp"]
        return poses, here[:, stamp] + share * (there[:, stamp] - here[:, stamp])

    def read(self, ahead: float = 0.0) -> tuple[Array, Array]:
        """Pose (4, 4) and twist (6,), `ahead` seconds of reference time after the clock."""
        found = self._reading.of(self.window.T, self.now, ahead).reshape(4, 4)
        return found, self._reading.outputs[1].copy()

    @property
    def pace(self) -> float:
        """Largest pace that later samples allow, if `slow_ahead` was called."""
        return self._paces[self._at] if self._paces else math.inf

    def slow_ahead(self, *, linear_speed: float, angular_speed: float, quickening: float) -> None:
        """Compute the largest pace at each sample that keeps the reference within these speeds.

        The pace falls by at most 1 in `quickening` seconds.
        """
        motion = self._table[: self._end, 12:18]
        fastest = np.maximum(
            np.linalg.norm(motion[:, :3], axis=1) / linear_speed, np.linalg.norm(motion[:, 3:], axis=1) / angular_speed
        )
        paces, seconds = (1.0 / np.maximum(fastest, 1e-9)).tolist(), self._table[:, SAMPLE["seconds"]].tolist()
        for i in range(len(paces) - 2, -1, -1):
            # d(pace^2)/d(reference time) = 2 d(pace)/dt
            paces[i] = min(paces[i], math.sqrt(paces[i + 1] ** 2 + 2.0 * seconds[i + 1] / quickening))
        self._paces = paces

    def _append(self, samples: Array) -> None:
        self._enlarge(len(samples))
        end = self._end + len(samples)
        self._table[self._end : end] = samples
        self._end = end
        for seconds in samples[:, SAMPLE["seconds"]].tolist():
            self.lag += seconds

    def _enlarge(self, more: int) -> None:
        end = self._end + more + self._window
        if end > len(self._table):
            self._table = np.concatenate([self._table, np.zeros((end, SAMPLE.size))])

    def _thin(self) -> None:
        """Remove every second waiting sample, and add its time to the next one."""
        seconds, first = self._table[:, SAMPLE["seconds"]], self._at + KEPT
        gone = np.arange(first, self._end - 1, 2)
        seconds[gone + 1] += seconds[gone]
        kept = np.delete(self._table[: self._end], gone, axis=0)
        self._end = len(kept)
        self._table[: self._end] = kept
