"""Plan a whole mirrored motion in advance, with `MirrorTracker`'s guarantees."""

from __future__ import annotations

import math
import time
from collections import Counter
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.control.between_poses import rigid_function
from rehab_opt.control.command import Relaxed
from rehab_opt.control.mirror_retiming import retimed
from rehab_opt.control.preview import angles_between
from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.real_array import real_array
from rehab_opt.optim.rows import MAX_MAGNITUDE
from rehab_opt.symbolic.buffered import mapped

if TYPE_CHECKING:
    from rehab_opt.control.mirror import MirrorTracker

__all__ = ["MirrorPath", "plan"]

Array = NDArray[np.float64]

STANDING = 1e-4
"""[rad/s or m/s] Joint speeds below which a motion has ended."""
PATIENCE = 10.0
"""[s] A plan ends incomplete after this time plus this multiple of the reference's duration."""
SETTLING = 2.0
"""[s] Longest time for the approach to the last pose; then the hand stops."""
ENDING = 10.0
"""[s] Longest time for the stop of an incomplete plan."""


class MirrorPath(NamedTuple):
    """M ticks of a planned motion."""

    times: Array
    """(M,) [s] start of each tick, dt apart; positions hold at the same time."""
    q: Array
    """(M, n) joint positions [rad, m]."""
    velocities: Array
    """(M, n) joint velocities held during the tick [rad/s, m/s]."""
    poses: Array
    """(M, 4, 4) poses of the tool."""
    references: Array
    """(M, 4, 4) reference pose at the clock in each tick."""
    clock: Array
    """(M,) [s] time of the reference that the clock reads; interpolated on a bridge."""
    short: Array
    """(M, 2) [m, rad] smallest deviation within reach; see `MirrorTracker.short`."""
    person: Array
    """(M, 2) [m, rad] portion of `short` due to the person's arm; see `MirrorTracker.beyond_person`."""
    paces: Array
    """(M,) advance of `clock` per second in the tick before; 1 is the recording's own pace."""
    manipulability: Array
    """(M,) w / w_max at the end of the tick."""
    relaxed: list[Relaxed]
    """Bounds relaxed in each tick."""
    complete: bool
    """Whether the motion reaches the end of the reference; otherwise it comes to rest before."""
    counts: Counter[str]
    """Counts as in `MirrorTracker.counts`, and the number of `lost` samples."""
    seconds: float
    """[s] Computing time."""

    @property
    def deviations(self) -> Array:
        """(M,) [m] distance from the reference."""
        return np.asarray(np.linalg.norm(self.poses[:, :3, 3] - self.references[:, :3, 3], axis=1))

    @property
    def turns(self) -> Array:
        """(M,) [rad] rotation from the reference's orientation."""
        return angles_between(self.poses[:, :3, :3], self.references[:, :3, :3])

    @property
    def delay(self) -> float:
        """Delay [s] of the motion's end relative to the reference's end."""
        return float(self.times[-1] - self.clock[-1]) if len(self.times) else 0.0


def plan(tracker: MirrorTracker, poses: ArrayLike, twists: ArrayLike, q: ArrayLike) -> MirrorPath:
    """Follow a whole recording from posture q; see `MirrorTracker.plan`."""
    try:
        reference, motion, joints = real_array(poses), real_array(twists), np.array(real_array(q))
    except (TypeError, ValueError, OverflowError) as problem:
        raise ConfigurationError("poses, twists, q", (poses, twists, q), "real numbers") from problem
    if reference.ndim != 3 or reference.shape[1:] != (4, 4) or motion.shape != (len(reference), 6):
        raise ConfigurationError("poses, twists", (reference.shape, motion.shape), "(N, 4, 4) and (N, 6)")
    if joints.shape != (tracker.chain.n,) or not np.all(np.isfinite(joints)):
        raise ConfigurationError("q", q, f"{tracker.chain.n} finite numbers")
    begun = time.perf_counter()
    valid = _usable(tracker, reference, motion)
    tracker.reset()
    dt = tracker.dt
    tracker.preview(joints, reference[valid], motion[valid], np.asarray(dt * valid, dtype=np.float64))
    most = math.ceil((PATIENCE + PATIENCE * tracker.clock.lag) / dt)
    path, speeds, clock, left, short, person, shown, w, relaxed = [], [], [], [], [], [], [], [], []
    complete, reference_clock, follow = False, tracker.clock, tracker.follow
    ending, arrived, before = False, 0, reference_clock.stamp
    for tick in range(most + math.ceil(ENDING / dt)):
        # A player stops at the plan's end, so the plan must end at rest, also if it ends before the reference.
        ending = ending or tick >= most or arrived * dt > SETTLING
        command = tracker.brake(joints) if ending else follow(joints)
        value = command.value
        path.append(joints)
        speeds.append(value)
        shown.append(tracker.followed)
        clock.append(reference_clock.stamp)
        left.append(reference_clock.lag)
        short.append(tracker.short)
        person.append(tracker.beyond_person)
        w.append(tracker.manipulability)
        relaxed.append(command.relaxed)
        joints = joints + value * dt
        arrived += reference_clock.current
        if (ending or reference_clock.current) and float(np.abs(value).max()) < STANDING:
            complete = reference_clock.current
            break
    found, counts = tracker.tools(path), Counter(tracker.counts)
    if len(valid) < len(reference):
        counts["lost"] = len(reference) - len(valid)
    planned = MirrorPath(
        np.asarray(dt * np.arange(len(path)), dtype=np.float64), np.array(path), np.array(speeds), found,
        np.array(shown), np.array(clock), np.array(short), np.array(person),
        np.diff(clock, prepend=before) / dt, np.array(w), relaxed, complete, counts, 0.0,
    )  # fmt: skip
    return retimed(tracker, planned, np.array(left))._replace(seconds=time.perf_counter() - begun)


def _usable(tracker: MirrorTracker, poses: Array, twists: Array) -> NDArray[np.intp]:
    numbers = np.hstack([poses.reshape(-1, 16), twists])
    valid = np.flatnonzero(np.linalg.norm(numbers, axis=1) <= MAX_MAGNITUDE)
    if len(valid):
        valid = valid[mapped(rigid_function())(numbers[valid, :16])[:, 0] == 1]
    if not len(valid):
        raise ConfigurationError("poses", poses.shape, "at least one valid sample, a rigid transform")
    away = np.linalg.norm(poses[valid, :3, 3] - tracker.chain.base[:3, 3], axis=1)
    if away.min() > tracker.farthest:
        expected = f"places within {tracker.farthest:.3g} m of the base, ten times the arm's reach: are they in metres?"
        raise ConfigurationError("poses", f"{away.min():.6g} m away and more", expected)
    return np.asarray(valid[away <= tracker.farthest])
