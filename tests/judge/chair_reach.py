"""The chair led to places: bounds in every tick, no place is left once it is reached, and none is run away from.

A target is reached, or the hand ends where no velocity within the true bounds leads it there at 5 % of 0.1 m/s.
On the way the hand is never further from its target than when that was set, by `AWAY`, and no faster along an axis than
`SPEED` and what makes up for a lag, which fades where all that is asked is done. A hand that gains speed lags by
half of what it gains in a tick, times the tick, and makes up for that alike.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.signal import lfilter

from tests.judge.chair_claims import judge_ticks
from tests.judge.chair_runs import Part, Run, motion, other_resolver, posture, record, resolver
from tests.judge.numbering import Runs, judging
from tests.judge.verdict import Answers, Verdict

GUARANTEES = ("G14",)
LEAST = {
    "status ok": 5e5,
    "a joint at its limit": 3e3,
    "target reached": 1e5,
    "target jumped on the way": 1e4,
    "the dead-man released, moving": 100,
    "at its speed, and not behind": 100,
    "asked of the linear programme": 8,
}
CI_TICKS = 8_000
SHARE = 1.0
SETS = (("x", "y", "z"),)
REACHED, SLOW = 3e-4, 2e-3
"""[m], [m/s] Nearer and slower than this, a hand is there; one that passes by is not."""
AWAY = 0.25
"""[m] A hand under way to another target goes on by v^2/2a + va/2j = 9.4 cm on each axis, lags by 3 cm; and 6 cm."""
FAR, PASSED = 0.3, 1e-2
"""[m] Of a place that is set at least so far away, by how much a hand passes it at most: see the chair's page."""
SPEED, LAGGING, FADES = 0.25, 0.12, 4.0
"""[m/s] along an axis, [m/s] more for a hand that lags, and the rate [1/s] at which that ends."""
ROUGH = 1.005
"""A hand's way within a tick is not the one of its middle."""
POSSIBLE, TRIED = 0.05, 0.1


def one_run(verdict: Verdict, number: int, rng: np.random.Generator) -> None:
    """Half a dozen targets, some of which jump before they are reached, some with the dead-man released between."""
    if number % 6 == 5:
        dt = float(rng.choice([0.005, 0.01, 0.02]))
        chair, made = other_resolver(rng, dt, 0, SETS)
    else:
        dt = 0.01
        chair, made = resolver(("differential", "mecanum")[number % 2], SETS, dt, 0)
    q = posture(chair, rng)
    u = motion(chair, q, rng, dt) if rng.random() < 0.3 else np.zeros(7)
    parts = []
    for _ in range(6):
        target = chair.hand(q) + rng.uniform(-1, 1, 3) * [0.8, 0.8, 0.4]
        target[2] = np.clip(target[2], 0.1, 1.4)
        seconds = rng.uniform(1, 3) if rng.random() < 0.3 else rng.uniform(12, 18)
        parts.append(Part(("x", "y", "z"), "world", np.zeros((round(seconds / dt), 3)), target=target))
        if rng.random() < 0.3:
            n = round(rng.uniform(0.1, 1.5) / dt)
            parts.append(Part(("x", "y", "z"), "world", np.zeros((n, 3)), enable=False, target=target))
    recorded = record(made, Run(chair, dt, u, parts, arcs=bool(rng.random() < 0.3)), q)
    verdict.begin(number, f"{chair.drive} dt {dt:g}")
    found, _ = judge_ticks(recorded, verdict)
    for part, ticks in zip(parts, recorded.slices, strict=True):
        if part.enable is True:
            judge_target(recorded, verdict, found, part, ticks)


def judge_target(run: Run, verdict: Verdict, found: Answers, part: Part, ticks: slice) -> None:
    """Whether the hand went there, and how."""
    chair, dt = run.chair, run.dt
    hand, target = chair.hand(run.q[ticks.start : ticks.stop + 1]), part.target
    assert target is not None
    apart = np.linalg.norm(hand - target, axis=1)
    braked = round((chair.braking_time + 1.0) / dt)
    if ticks.start:  # from rest or from another reach; a random motion at the begin may lead anywhere
        verdict.within("the hand does not run from its target", apart - apart[0], AWAY)
    if apart[0] > FAR:
        passed = (hand - target) @ (target - hand[0]) / apart[0]
        verdict.within("a hand passes its place [m]", passed, PASSED)
    velocity = np.diff(hand, axis=0) / dt
    speed, fastest = np.linalg.norm(velocity, axis=1), np.abs(velocity).max(axis=1)
    number = np.arange(len(speed))
    short = (found.status[ticks] != "ok") | (found.relaxed[ticks] != 0) | (number == 0)
    done = (number - np.maximum.accumulate(np.where(short, number, 0))) * dt
    gained = np.abs(np.diff(velocity, axis=0, prepend=velocity[:1])).max(axis=1) / 2
    keeps = math.exp(-FADES * dt)
    late = lfilter([1 - keeps], [1, -keeps], gained)
    capped = fastest - LAGGING * np.exp(-FADES * done) - late
    verdict.within("the hand's speed along an axis is capped [m/s]", capped[braked:], ROUGH * SPEED)
    verdict.during("at its speed, and not behind", (done > 1.0) & (fastest > 0.95 * SPEED), dt)
    there = (apart[1:] < REACHED) & (speed < SLOW)
    verdict.during("target reached", there, dt)
    if there.any():
        verdict.within("a place that is reached is kept", apart[1 + int(np.argmax(there)) :], 10 * REACHED)
    if not there[-1]:
        verdict.during("target jumped on the way", np.full(len(speed), len(speed) * dt < 4.0), dt)
    if len(there) * dt < 10.0 or there[-1]:
        return
    stopped = np.all(speed[-round(1.0 / dt) :] < 0.02 * TRIED)
    if not stopped:
        verdict.within("a hand under way comes nearer", [apart[-1] - apart[-round(3.0 / dt)]], 0.0)
    else:
        way = (target - hand[-1]) / apart[-1]
        possible = chair.fastest(run.q[ticks.stop], TRIED * way, part.rows, part.frame, dt=dt)
        verdict.within("a hand that stopped elsewhere can go no further", [possible], POSSIBLE)
        verdict.during("asked of the linear programme", np.array([True]), dt)


run = judging(__name__, LEAST, Runs(one_run))
