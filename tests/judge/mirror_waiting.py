"""The clock of `MirrorTracker`: late, not cut; and what pushes and faults do to it.

Judged against the reference that the test made: where nothing was bridged since, and no tick was answered by a safe
command (its pose is not taken), the pose that the clock stands at is the one of `lag` seconds ago. At the end the last
pose is held: a hand that came near it is no longer late. A person who pushes is not hurried; at the limit the clock
stands. At the stop and until the push is over, without numbers and without the dead-man switch the arm brakes, and the
clock waits; everywhere else it does not brake, however much it is pushed.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tests.judge.mirror_floor import joint_bounds
from tests.judge.mirror_runs import Run, followed
from tests.judge.numbering import Runs, judging
from tests.judge.sensor_faults import expected
from tests.judge.ur5_numbers import tool
from tests.judge.verdict import Verdict

Array = NDArray[np.float64]

GUARANTEES = ("G01", "G19")
LEAST = {"late": 32_000, "waiting": 2000, "caught up": 3000, "pushed": 20_000, "pushed to the limit": 2000,
         "stopped": 1500, "status braking": 500, "status holding": 2000,
         "fault disabled": 100}  # fmt: skip
CI_TICKS = 4000
SHARE = 0.2


def stops(forces: Array, stop_at: float, dt: float) -> NDArray[np.bool_]:
    """(N,) whether a push (N,) [N] keeps the arm at rest: from the stop on, until 0.3 s were below 0.7 of it."""
    found, below = np.zeros(len(forces), dtype=bool), math.inf
    for k, size in enumerate(forces.tolist()):
        if size >= stop_at or (size >= 0.7 * stop_at and k and found[k - 1]):
            below = 0.0
        else:
            below += dt
        found[k] = below < 0.3 - dt / 2
    return found


def judge(verdict: Verdict, one: Run) -> None:
    """The clock, tick by tick."""
    given, dt = one.settings, one.settings.dt
    value, last = joint_bounds(verdict, one)
    reasons = np.array([command.reason for command in one.commands])
    status = np.array([command.status.value for command in one.commands])
    scale = np.array([command.scale for command in one.commands])
    pace, lag, *_ = one.clock.T
    safe = np.isin(status, ("braking", "holding"))
    wrong, strong = expected(one.faults), one.forces >= given.force_limit
    stopped = stops(one.forces, given.stop_at, dt)
    verdict.holds("what cannot be used is not followed", safe | ~wrong)
    verdict.holds("the arm stops for a push that is too strong, until it is over", safe | ~stopped)
    # Each joint slows by its whole acceleration, or, where a bound is in the way of that, all of them alike.
    ticks = np.maximum((np.abs(last) / (given.acceleration * dt)).max(axis=1, keepdims=True), 1)
    alike = np.abs(last) * (1 - 1 / ticks)
    verdict.within("braking: speed above what braking of all joints alike leaves [rad/s]",
                   np.where(safe[:, None], np.abs(value) - alike, 0.0), 1e-12)  # fmt: skip
    verdict.holds("holding is standing still, braking is not", (status == "holding") == (safe & ~value.any(axis=1)))
    verdict.holds("a safe command has a reason", (reasons != "") | ~safe)
    calm = ~wrong & np.r_[True, ~wrong[:-1]] & np.r_[True, True, ~wrong[:-2]] & ~stopped
    verdict.holds("sound inputs are followed again", ~safe | ~calm, str(set(reasons[safe & calm])))
    stood = np.r_[False, np.abs(np.diff(one.references.reshape(-1, 16), axis=0)).max(axis=1) == 0]
    known = np.isfinite(one.references[:, 0, 3])
    verdict.holds("the clock waits for a safe command", stood | ~safe | ~np.r_[False, known[:-1]])

    verdict.within("scale", np.abs(scale - 0.5), 0.5)
    verdict.within("scale over the time scaling", np.where(safe, 0.0, scale - np.minimum(pace, 1)), 1e-12)
    verdict.within("lag below zero [s]", np.where(known, -lag, 0.0), 1e-9)
    felt = np.where(np.isnan(one.forces), 0.0, one.forces)
    fraction = np.clip((given.force_limit - felt) / (given.force_limit - given.slow_from), 0, 1)
    verdict.within("pace while pushed", np.where((fraction < 1) & ~safe, pace - fraction, 0.0), 1e-9)

    bridged = np.flatnonzero((np.char.find(reasons, "bridging") >= 0) | safe)
    since = int(bridged[-1]) + 2 if len(bridged) else 2
    k = np.arange(len(value))
    if (one.faults.kind == "").all() and one.kind != "sudden":
        at = np.clip(k - lag / dt, 0, len(k) - 1)
        low = np.minimum(at.astype(int), len(k) - 2)
        track = one.poses[:, :3, 3]
        place = track[low] + (at - low)[:, None] * (track[low + 1] - track[low])
        off = np.linalg.norm(one.references[:, :3, 3] - place, axis=1)
        bends = np.linalg.norm(np.diff(track, 2, axis=0), axis=1).max(initial=0.0) + 1e-9
        whole = (k >= since) & (k - lag / dt >= since) & known
        verdict.within("reference away from the pose of `lag` ago, over what a tick's curve leaves",
                       np.where(whole, off / bends, 0.0), 1.0)  # fmt: skip
        verdict.during("the pose of `lag` ago was compared", whole, dt)
    hand = tool(one.q[1:])
    apart = np.linalg.norm(hand[:, :3, 3] - one.poses[:, :3, 3], axis=1)
    near = (apart < 0.3 * given.max_deviation) & ~safe & (np.isnan(one.forces) | (one.forces < given.slow_from))
    quiet = np.cumsum(near)
    held = round(4.0 / dt)
    if len(k) > held + 1 and (np.abs(np.diff(one.poses[-held:].reshape(held, 16), axis=0)) < 1e-12).all():
        settled = quiet[-1] - quiet[-held - 1] == held
        final = np.linalg.norm(one.references[-1, :3, 3] - one.poses[-1, :3, 3])
        verdict.within("lag after 4 s near a pose that is held [s]", lag[-1] if settled else 0.0, 1.5 * dt)
        verdict.within("the clock's end away from the pose that is held [m]", final if settled else 0.0, 1e-9)
        verdict.during("caught up", np.full(held, settled), dt)
    verdict.during("late", lag > 0.05, dt)
    verdict.during("waiting", (pace < 0.02) & ~safe, dt)
    verdict.during("pushed", felt > given.slow_from, dt)
    verdict.during("pushed to the limit", strong, dt)
    verdict.during("stopped", stopped, dt)
    for kind in np.unique(one.faults.kind):
        if kind:
            verdict.during(f"fault {kind}", one.faults.kind == kind, dt)


run = judging(
    __name__,
    LEAST,
    Runs(followed(judge, below=0.0), 1 / 4),
    Runs(followed(judge, below=0.0, pushed=True), 1 / 4, 1_000_000),
    Runs(followed(judge, below=0.0, faults=0.3), 1 / 4, 2_000_000),
    Runs(followed(judge, below=0.0, held=12.0), 1 / 4, 4_000_000),
    finish=(Verdict.seldom_beyond_the_dual_method,),
)
