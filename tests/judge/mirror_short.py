"""A stretch that the arm cannot do: the hand goes along its edge, nothing is left out, and it is there again after it.

Judged on references that go out of reach for some seconds and come back: what the hand is said to stay short of grows
only to its true distance, when the hand stands or the clock has, since the hand was cut short last, stood for a second
longer than it went on; the clock passes all of the reference, without a jump; the hand is where the reference came back
to in the end, in time.
"""

from __future__ import annotations

import numpy as np

from tests.judge.mirror_runs import Settings, draw, tracker
from tests.judge.numbering import Runs, judging
from tests.judge.references import good_posture, minimum_jerk
from tests.judge.ur5_numbers import hand_twist, manipulability, tool
from tests.judge.verdict import Verdict

GUARANTEES = ("G19",)
LEAST = {"cut": 200, "waited": 5000, "short": 50_000, "judged at the end": 10_000, "planned to the end": 50_000}
CI_TICKS = 6000
SHARE = 0.1
STANDS = 0.005, 0.05
"""[m/s, rad/s] A hand up to these stands."""
WAITED = 1.0
"""[s] longer than it went on, after which the clock goes on, whatever the hand does."""
HELD = 8.0
"""[s] for which the last pose is held, and then for as long again as the hand is late."""


def one_run(verdict: Verdict, number: int, rng: np.random.Generator) -> None:
    """Out of reach, some seconds there, and back to a good posture: held by joint limits or, if wide, by the floor."""
    start = good_posture(rng, 0.6)
    given = draw(rng, start, planes=False)
    dt, wide = float(rng.choice([0.01, 0.02])), float(rng.choice([0.4, 0.7, 1.5]))
    given = given._replace(
        dt=dt, floor=0.1, linear_speed=float(rng.choice([0.25, 0.5])), angular_speed=1.5, lower=start - wide,
        upper=start + wide, velocity=np.full(6, 2.0), acceleration=np.full(6, 15.0),
    )  # fmt: skip
    control = tracker(given)
    first, end = tool(start[None])[0], tool(start[None] + 0.15 * rng.uniform(-1, 1, (1, 6)))[0]
    out = first[:3, 3] * rng.uniform(1.7, 2.2)
    part = minimum_jerk(round(2.0 / dt))[:, None]
    way = [first[:3, 3] + part * (out - first[:3, 3]), np.repeat(out[None], round(rng.uniform(0.5, 2.0) / dt), axis=0)]
    way += [out + part * (end[:3, 3] - out), np.repeat(end[None, :3, 3], round(HELD / dt), axis=0)]
    places = np.concatenate(way)
    poses = np.repeat(first[None], len(places), axis=0)
    poses[:, :3, 3] = places
    twists = np.zeros((len(places), 6))
    twists[1:, :3] = np.diff(places, axis=0) / dt
    verdict.begin(number, f"dt {dt:g}")
    q, told, commands = np.empty((len(places) + 1, 6)), np.empty((len(places), 4)), []
    q[0], shown = start, np.empty((len(places), 4, 4))
    for k, (pose, twist) in enumerate(zip(poses, twists, strict=True)):
        commands.append(control.step(q[k], pose, twist))
        q[k + 1] = q[k] + dt * commands[-1].value
        shown[k] = control.reference
        told[k] = control.counts["cut"], control.counts["waited"], *control.short
    answers = verdict.answers(commands, dt)
    last = np.vstack([np.zeros(6), answers.value[:-1]])
    moving = hand_twist(q[:-1], last)
    still = (np.linalg.norm(moving[:, :3], axis=1) <= STANDS[0]) & (np.linalg.norm(moving[:, 3:], axis=1) <= STANDS[1])
    waits = np.diff(told[:, 1], prepend=0) > 0
    cuts = np.diff(told[:, 0], prepend=0) > 0
    long = np.zeros(len(waits))
    for k in range(len(waits)):
        so_far = long[k - 1] if k and not cuts[k - 1] else 0.0
        long[k] = max(so_far + (dt if waits[k] else -dt), 0.0)
    grown = np.diff(told[:, 2], prepend=0.0) > 1e-3
    verdict.holds(
        "what it stays short of grows only for a hand that stands or was waited for",
        ~grown | still | (long > WAITED - dt),
    )
    here = tool(q[:-1])
    before = np.concatenate([first[None], shown[:-1]])  # the reference that was read when the tick began
    apart = np.linalg.norm(here[:, :3, 3] - before[:, :3, 3], axis=1)
    verdict.within("what it stays short of beyond the true distance [m]", told[:, 2] - apart, 1e-6)
    whole = np.char.find(answers.reason, "bridging") >= 0
    step = np.linalg.norm(np.diff(shown[:, :3, 3], axis=0, prepend=shown[:1, :3, 3]), axis=1)
    verdict.within("the reference jumps [m/s]", np.where(whole, 0.0, step / dt), 1.5 * given.linear_speed)
    good = manipulability(q).min() > given.floor + 0.02 and (answers.status[-50:] == "ok").all()
    if good:
        rests = q[-1]
        for _ in range(round(control.lag / dt)):  # what rests is passed in less time than it took
            rests = rests + dt * control.step(rests, poses[-1], np.zeros(6)).value
        apart = float(np.linalg.norm(tool(rests[None])[0, :3, 3] - end[:3, 3]))
        verdict.within("hand away from where the reference came back to [m]", apart, 1e-3)
        verdict.within("late after as long again at rest [s]", control.lag, 0.02)
    verdict.during("cut", cuts, dt)
    verdict.during("waited", waits, dt)
    verdict.during("short", told[:, 2] > 0.05, dt)
    verdict.during("judged at the end", np.full(len(places), good), dt)
    followed(verdict, given, poses, twists, start)


def followed(verdict: Verdict, given: Settings, poses: np.ndarray, twists: np.ndarray, start: np.ndarray) -> None:
    """The same as a plan: it passes all of the recording, and ends at rest."""
    dt = given.dt
    path = tracker(given).plan(poses, twists, start)
    verdict.ticks += len(path.times)
    verdict.holds("a plan comes to the recording's end", path.complete)
    own = np.diff(path.clock)
    verdict.within("a plan's clock jumps [s]", own, 1.5 * dt)
    verdict.within("a plan ends in motion [rad/s]", np.abs(path.velocities[-1]), 1e-4)
    verdict.during("planned to the end", np.full(len(path.times), path.complete), dt)


run = judging(__name__, LEAST, Runs(one_run))
