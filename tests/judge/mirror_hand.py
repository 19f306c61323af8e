"""The hand that `MirrorTracker` leads: never faster than it may be, and its reference waits for it.

Judged: the flange's true velocity at five instants of every tick, while the joints keep theirs; and that the reference
stands while the hand is farther from it than `max_deviation`.
"""

from __future__ import annotations

import numpy as np

from tests.judge.mirror_floor import joint_bounds
from tests.judge.mirror_runs import Run, followed
from tests.judge.numbering import Runs, judging
from tests.judge.ur5_numbers import hand_twist, tool
from tests.judge.verdict import Verdict

GUARANTEES = ("G17",)
LEAST = {"solver closed form": 1e5, "solver active set": 2e3,
         "at the largest hand speed": 250, "near the largest deviation": 250, "status braking": 100,
         "ticks of 20 ms at the largest hand speed": 50}  # fmt: skip
CI_TICKS = 4000
SHARE = 0.3
SPEED = 1.02
INSTANTS = (0.0, 0.25, 0.5, 0.75, 1.0)


def judge(verdict: Verdict, one: Run) -> None:
    """Speed and place of the hand in every tick."""
    given, dt = one.settings, one.settings.dt
    value, _ = joint_bounds(verdict, one)
    linear = np.stack([hand_twist(one.q[:-1] + part * dt * value, value)[:, :3] for part in INSTANTS])
    fast = np.linalg.norm(linear, axis=2).max(axis=0) / given.linear_speed
    verdict.within("hand speed over the largest, at every instant", fast, SPEED)
    places = tool(one.q)[:, :3, 3]
    chord = np.linalg.norm(np.diff(places, axis=0), axis=1) / dt / given.linear_speed
    verdict.within("hand speed over the largest, from place to place", chord, SPEED)
    apart = np.linalg.norm(places[1:] - one.references[:, :3, 3], axis=1)
    known = ~np.isnan(apart)  # no reference yet
    short = one.clock[:, 3]
    beyond = apart - short
    far = known[:-1] & known[1:] & (beyond[:-1] > given.max_deviation + 1e-9)
    moved = np.linalg.norm(np.diff(one.references[:, :3, 3], axis=0), axis=1)
    verdict.within("a reference that does not wait for its hand [m]", np.where(far, moved, 0.0), 1e-9)
    verdict.during("further than the largest deviation", np.r_[False, far], dt)
    quick = fast > 0.99
    verdict.during("at the largest hand speed", quick, dt)
    verdict.during("ticks of 20 ms at the largest hand speed", quick & (dt > 0.015), dt)
    verdict.during("near the largest deviation", beyond > 0.8 * given.max_deviation, dt)


run = judging(
    __name__,
    LEAST,
    Runs(followed(judge, pushed=True), 2 / 3),
    Runs(followed(judge, faults=0.5), 1 / 3, 1_000_000),
    finish=(
        Verdict.seldom_by_backup,
        Verdict.seldom_beyond_the_dual_method,
    ),
)
