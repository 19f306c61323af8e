"""The hand that `MirrorTracker` leads: never faster than it may be, never further from its reference.

Judged: the flange's true velocity at five instants of every tick, while the joints keep theirs; and its distance from
the pose that the clock stands at, after every tick. The clock never runs away from the hand, so that a distance above
`max_deviation` (as at the start) only shrinks. 1e-6 of the speed is rounding.

The hand speed is known from a tick's beginning on: where no other bound is near, neither where a tick ends nor where
braking from there ends, no step is found too fast.
"""

from __future__ import annotations

import numpy as np

from tests.judge.mirror_floor import joint_bounds
from tests.judge.mirror_runs import Run, runs
from tests.judge.ur5_numbers import hand_twist, manipulability, tool
from tests.judge.verdict import Answers, Verdict

GUARANTEES = ("G17",)
LEAST = {"solver closed form": 1e5, "solver active set": 2e3,
         "at the largest hand speed": 250, "near the largest deviation": 250, "status braking": 100,
         "ticks of 20 ms at the largest hand speed": 50,
         "at the largest hand speed, nothing else near": 100}  # fmt: skip
CI_TICKS = 4000
SHARE = 0.3
FAR, AWAY = 0.9, 0.05
"""Share of a bound below which it is not near; [1, rad] w / w_max above the floor, and a joint before its limit."""
INSTANTS = (0.0, 0.25, 0.5, 0.75, 1.0)


def run(ticks: int, seed: int, *, only: int | None = None) -> Verdict:
    """References up to 1 m/s and beyond, with faults in a third."""
    verdict = Verdict("mirror_hand", seed, LEAST)
    for each in runs(verdict, 2 * ticks // 3, only, pushed=True):
        judge(verdict, each)
    for each in runs(verdict, ticks // 3, only, faults=0.5, first=1_000_000):
        judge(verdict, each)
    verdict.seldom_by_backup()
    verdict.seldom_beyond_the_dual_method()
    return verdict


def judge(verdict: Verdict, one: Run) -> None:
    """Speed and place of the hand in every tick."""
    given, dt = one.settings, one.settings.dt
    value, _ = joint_bounds(verdict, one)
    linear = np.stack([hand_twist(one.q[:-1] + part * dt * value, value)[:, :3] for part in INSTANTS])
    fast = np.linalg.norm(linear, axis=2).max(axis=0) / given.linear_speed
    verdict.within("hand speed over the largest, at every instant", fast, 1 + 1e-6)
    places = tool(one.q)[:, :3, 3]
    chord = np.linalg.norm(np.diff(places, axis=0), axis=1) / dt / given.linear_speed
    verdict.within("hand speed over the largest, from place to place", chord, 1 + 1e-6)
    apart = np.linalg.norm(places[1:] - one.references[:, :3, 3], axis=1)
    known = ~np.isnan(apart)  # no reference yet
    short = one.clock[:, 3]
    beyond = apart - short
    before = np.maximum(np.r_[0.0, beyond[:-1]], given.max_deviation)
    excess = np.where(known & np.r_[False, known[:-1]], beyond - before, 0.0)
    verdict.within("hand further from its reference than allowed [m]", excess, 1e-9)
    quick = fast > 0.99
    answers = Answers.of(one.commands)
    change = np.abs(np.diff(value, axis=0, prepend=np.zeros((1, 6)))).max(axis=1)
    alone = (np.abs(value) < FAR * given.velocity).all(axis=1) & (change < FAR * given.acceleration.min() * dt)
    # What the hand is kept near to lies short of a reference that is cut, by as much.
    alone &= (manipulability(one.q[:-1]) > given.floor + AWAY) & (apart + short < FAR * given.max_deviation)
    alone &= (np.minimum(given.upper - one.q, one.q - given.lower).min(axis=1) > AWAY)[:-1]
    slowing = np.max(np.abs(value) / given.acceleration, axis=1)  # [s] all joints alike
    rest = one.q[1:] + value * slowing[:, None] / 2
    away = np.linalg.norm(tool(rest)[:, :3, 3] - one.references[:, :3, 3], axis=1)
    alone &= away + short < FAR * given.max_deviation
    alone &= np.minimum(given.upper - rest, rest - given.lower).min(axis=1) > AWAY
    alone &= manipulability(rest) > given.floor + AWAY
    late = np.char.find(answers.reason, "step shortened") >= 0
    verdict.holds("no step is shortened where nothing but the hand speed is near", ~late | ~alone)
    verdict.during("at the largest hand speed, nothing else near", quick & alone, dt)
    verdict.during("at the largest hand speed", quick, dt)
    verdict.during("ticks of 20 ms at the largest hand speed", quick & (dt > 0.015), dt)
    verdict.during("near the largest deviation", beyond > 0.8 * given.max_deviation, dt)
