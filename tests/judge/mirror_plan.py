"""`MirrorTracker.plan`: every bound of the tick, on the true motion; the reference late, not cut; an end at rest.

Judged with the judge's own UR5. Where nothing is left out or bridged, the reference shown is the recording at the
clock's own time; a recording that is easy from its first pose on is followed without delay.
"""

from __future__ import annotations

import math

import numpy as np

from tests.judge.mirror_runs import draw, tracker
from tests.judge.numbering import Runs, judging
from tests.judge.references import KINDS, good_posture, minimum_jerk, reference
from tests.judge.ur5_numbers import hand_twist, manipulability, tool
from tests.judge.verdict import Verdict

GUARANTEES = ("G17", "G19")
LEAST = {"at the largest hand speed": 250, "slowed": 20_000, "lost sight": 1000, "reference read": 100_000,
         "easy": 50_000, "complete": 100_000}  # fmt: skip
CI_TICKS = 6000
SHARE = 0.2
INSTANTS = (0.0, 0.25, 0.5, 0.75, 1.0)
TURNED = np.array([[1, 0, 0], [0, math.cos(0.8), -math.sin(0.8)], [0, math.sin(0.8), math.cos(0.8)]])
LATE = 0.05
"""[s] of delay that is allowed to an easy recording: the start from rest."""


def one_run(verdict: Verdict, number: int, rng: np.random.Generator) -> None:
    """One recording."""
    start, easy, jumps = good_posture(rng, 0.5), number % 3 == 0, False
    given = draw(rng, start, planes=False)
    dt = float(rng.choice([0.005, 0.01]))
    given = given._replace(dt=dt)
    ticks = round(rng.uniform(1.0, 3.0) / dt)
    kind = "easy" if easy else KINDS[number % len(KINDS)]
    if easy:
        given = given._replace(floor=0.1, linear_speed=0.5, angular_speed=3.0)
        joints = start + 0.1 * minimum_jerk(ticks)[:, None] * rng.uniform(-1, 1, 6)
        joints = np.clip(joints, given.lower, given.upper)
        poses, twists = tool(joints), hand_twist(joints, np.gradient(joints, dt, axis=0))
        if jumps := number % 2 == 1:  # the hand turns at once
            poses[ticks // 2 :, :3, :3] = poses[ticks // 2 :, :3, :3] @ TURNED
    else:
        poses, twists = reference(rng, kind, start, ticks, dt)
    lost = np.zeros(ticks, dtype=bool)
    if not easy and rng.random() < 0.5:
        first = int(rng.integers(1, ticks - 1))
        lost[first : first + int(rng.integers(1, 40))] = True
        lost[-1] = False
    poses[lost] = math.nan
    verdict.begin(number, f"{kind}, dt {dt:g}")
    control = tracker(given)
    path = control.plan(poses, twists, start)
    count = len(path.times)
    verdict.ticks += count
    q, v = path.q, path.velocities
    ahead = np.vstack([q[1:], q[-1:] + dt * v[-1:]])
    last = np.vstack([np.zeros(6), v[:-1]])
    verdict.within("times that are not those of the ticks [s]", np.abs(path.times - dt * np.arange(count)), 1e-9)
    verdict.within("the way is that of the velocities [rad]", np.abs(q + dt * v - ahead), 1e-12)
    verdict.within("begins away from where the arm is [rad]", np.abs(q[0] - start), 0.0)
    verdict.within("joint speed", np.abs(v) / given.velocity, 1 + 1e-12)
    beyond = np.maximum(ahead - np.maximum(given.upper, q), np.minimum(given.lower, q) - ahead)
    verdict.within("never further outside a joint limit [rad]", beyond, 1e-9)
    change = np.abs(v - last)
    allowed = np.minimum(given.acceleration * dt, 2 * given.velocity)
    flagged = np.array([each.value & 2 != 0 for each in path.relaxed])
    verdict.holds(
        "acceleration that was relaxed is flagged", flagged | ~(change > allowed * (1 + 2e-9) + 2e-12).any(axis=1)
    )
    verdict.holds("acceleration that was relaxed is counted", int(flagged.sum()) == path.counts.get("acceleration", 0))
    w = manipulability(np.vstack([q, ahead[-1:]]))
    verdict.within("manipulability below the floor", np.minimum(w[:-1], given.floor) - w[1:], 1e-9)
    verdict.within("error of the manipulability that is told", np.abs(path.manipulability - w[1:]), 1e-9)
    twists = np.stack([hand_twist(q + part * dt * v, v) for part in INSTANTS])
    fast, turning = (np.linalg.norm(twists[:, :, part], axis=2).max(axis=0) for part in (slice(3), slice(3, 6)))
    fast = fast / given.linear_speed
    verdict.within("hand speed over the largest, at every instant", fast, 1.02)
    verdict.within("turn of the hand over the largest, at every instant", turning / given.angular_speed, 1.02)
    true = tool(q)
    verdict.within("poses away from the tool's", np.abs(path.poses - true), 1e-9)
    apart = np.linalg.norm(true[:, :3, 3] - path.references[:, :3, 3], axis=1)
    verdict.within("error of the deviation that is told [m]", np.abs(path.deviations - apart), 1e-9)
    verdict.within("joint speeds at the end [rad/s]", np.abs(v[-1]), 1e-4)
    verdict.holds("paces are between nothing and the recording's own", (path.paces >= 0) & (path.paces <= 1 + 1e-9))
    step = np.diff(path.clock, prepend=dt * (np.flatnonzero(~lost)[0] - 1))  # a tick before the first usable sample
    verdict.within("the clock's step away from its pace [s]", np.abs(step - dt * path.paces), 1e-9)
    verdict.within("error of the delay that is told [s]", abs(path.delay - (path.times[-1] - path.clock[-1])), 1e-12)
    if path.complete:
        end = poses[np.flatnonzero(~lost)[-1]]
        verdict.within("the end is another pose", np.abs(path.references[-1] - end), 1e-9)
        verdict.within("clock at the end [s]", abs(path.clock[-1] - dt * np.flatnonzero(~lost)[-1]), 1e-9)
    untouched = not lost.any() and not jumps and kind != "sudden"
    if untouched:
        read = path.clock >= 0.0  # before is the bridge from the hand to the first pose
        verdict.within("reference away from the recording at the clock's time [m]",
                       np.where(read, np.linalg.norm(at(path.clock, poses[:, :3, 3], dt)
                                                     - path.references[:, :3, 3], axis=1), 0.0), 1e-7)  # fmt: skip
        verdict.within("clock runs back [s]", -step, 1e-12)
        verdict.during("reference read", read, dt)
    if jumps:
        turning = np.diff(path.references, axis=0)[:, :3, :3]
        rate = np.linalg.norm(turning, axis=(1, 2)) / math.sqrt(2) / dt
        verdict.within("turn of a reference that jumps over the hand's largest", rate / given.angular_speed, 1.0)
    elif easy:
        verdict.holds("an easy recording is followed to its end", path.complete)
        verdict.within("delay of an easy recording [s]", path.delay, LATE)
        verdict.within("deviation from an easy recording [m]", apart, 1e-3)
        verdict.during("easy", np.ones(count, dtype=bool), dt)
    verdict.during("at the largest hand speed", fast > 0.95, dt)
    verdict.during("slowed", path.paces < 0.99, dt)
    verdict.during("lost sight", np.full(count, lost.any()), dt)
    verdict.during("complete", np.full(count, path.complete), dt)


def at(times: np.ndarray, places: np.ndarray, dt: float) -> np.ndarray:
    """(M, 3) places of a recording at these times, between its samples along straight lines."""
    ticks = dt * np.arange(len(places))
    return np.stack([np.interp(times, ticks, column) for column in places.T], axis=1)


run = judging(__name__, LEAST, Runs(one_run))
