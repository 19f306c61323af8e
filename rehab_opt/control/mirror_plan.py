"""A whole mirrored motion at once: `MirrorTracker`'s guarantees, with the reference's future known."""

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
"""[rad/s or m/s] Joint speeds at which a motion has come to its end."""
PATIENCE = 10.0
"""[s] beyond the reference's own length, and as a multiple of that, after which a plan ends incomplete."""
SETTLING = 2.0
"""[s] at most in which the hand finds to the last pose; then it is brought to rest where it is."""
ENDING = 10.0
"""[s] at most in which a plan that ends incomplete comes to rest."""


class MirrorPath(NamedTuple):
    """M ticks of a planned motion."""

    times: Array
    """(M,) [s] dt apart; at the beginning of each tick, like the positions."""
    q: Array
    """(M, n) joint positions [rad, m]."""
    velocities: Array
    """(M, n) joint velocities held during the tick [rad/s, m/s]."""
    poses: Array
    """(M, 4, 4) of the tool."""
    references: Array
    """(M, 4, 4) the reference pose where the clock stands in the tick."""
    clock: Array
    """(M,) [s] of the reference's own time; over a jump it runs as the bridge takes."""
    short: Array
    """(M, 2) [m, rad] by which the arms stay short of the reference; see `MirrorTracker.short`."""
    person: Array
    """(M, 2) [m, rad] of that which are the person's arm's."""
    paces: Array
    """(M,) seconds by which `clock` goes on in a second, in the tick that brings it there: 1 is the recording's own
    pace; less where the bridge over a jump takes longer than the recording, 0 once the clock stands at its end."""
    manipulability: Array
    """(M,) w / w_max where the tick leads."""
    relaxed: list[Relaxed]
    """What had to give way in each tick."""
    complete: bool
    """Whether the reference's end was reached; where it was not, the motion ends early, and at rest too."""
    counts: Counter[str]
    """See `MirrorTracker.counts`; `lost` samples, too."""
    seconds: float
    """Computing time."""

    @property
    def deviations(self) -> Array:
        """(M,) [m] from the reference."""
        return np.asarray(np.linalg.norm(self.poses[:, :3, 3] - self.references[:, :3, 3], axis=1))

    @property
    def turns(self) -> Array:
        """(M,) [rad] from the reference's orientation."""
        return angles_between(self.poses[:, :3, :3], self.references[:, :3, :3])

    @property
    def delay(self) -> float:
        """[s] by which the motion ends later than the reference."""
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
        # Whoever plays a plan stops at its end: it must stand there, also where it ends before the reference does.
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
    """Which samples `step` would not refuse."""
    numbers = np.hstack([poses.reshape(-1, 16), twists])
    valid = np.flatnonzero(np.linalg.norm(numbers, axis=1) <= MAX_MAGNITUDE)
    if len(valid):
        valid = valid[mapped(rigid_function())(numbers[valid, :16])[:, 0] == 1]
    if not len(valid):
        raise ConfigurationError("poses", poses.shape, "a usable sample at least, that is a rigid transform")
    away = np.linalg.norm(poses[valid, :3, 3] - tracker.chain.base[:3, 3], axis=1)
    if away.min() > tracker.farthest:
        expected = f"places within {tracker.farthest:.3g} m of the base, ten times the arm's reach: are they in metres?"
        raise ConfigurationError("poses", f"{away.min():.6g} m away and more", expected)
    return np.asarray(valid[away <= tracker.farthest])
