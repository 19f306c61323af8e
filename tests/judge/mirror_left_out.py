"""A stretch that the arm cannot do: the clock waits, then leaves it out, and the hand is led to where it can go on.

Judged on references that go out of reach for some seconds and come back: by the flange's true speed when something is
left out and while it is led on, and by where the hand is in the end.
"""

from __future__ import annotations

import numpy as np

from tests.judge.mirror_runs import Settings, draw, tracker
from tests.judge.numbering import numbered
from tests.judge.references import good_posture, minimum_jerk
from tests.judge.ur5_numbers import hand_twist, manipulability, tool
from tests.judge.verdict import Promise, Verdict

PROMISES = (
    Promise("rehab_opt/control/mirror.py", "A stretch that the arm cannot do at all is left out: once the hand stands, "
            "it is led, at half the hand speeds, to where the reference is by then."),
    Promise("rehab_opt/control/mirror.py", "How many ticks yielded acceleration, were shortened, waited, braked, and "
            "how many stretches were left out."),
)  # fmt: skip
LEAST = {"left out": 200, "waited": 20_000, "led on": 5000, "judged at the end": 10_000,
         "planned to the end": 50_000}  # fmt: skip
CI_TICKS = 6000
SHARE = 0.1
STANDS = 0.005
"""[m/s] A hand up to this stands."""
LED = 0.75
"""Of the hand speed, at which the reference leads over a bridge: half, and a half more of it to catch up."""
HELD = 8.0
"""[s] for which the last pose is held."""


def run(ticks: int, seed: int, *, only: int | None = None) -> Verdict:
    """One way out and back a run."""
    verdict = Verdict("mirror_left_out", seed, LEAST)
    for number, rng in numbered(verdict, ticks, only):
        one_run(verdict, number, rng)
    return verdict


def one_run(verdict: Verdict, number: int, rng: np.random.Generator) -> None:
    """Out of reach, some seconds there, and back to a good posture."""
    start = good_posture(rng, 0.6)
    given = draw(rng, start, planes=False)
    dt = float(rng.choice([0.01, 0.02]))
    given = given._replace(
        dt=dt, floor=0.1, linear_speed=float(rng.choice([0.25, 0.5])), angular_speed=1.5, lower=start - 1.5,
        upper=start + 1.5, velocity=np.full(6, 2.0), acceleration=np.full(6, 15.0),
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
    q, counts, commands = np.empty((len(places) + 1, 6)), np.empty((len(places), 2), dtype=int), []
    q[0], shown = start, np.empty((len(places), 3))
    for k, (pose, twist) in enumerate(zip(poses, twists, strict=True)):
        commands.append(control.step(q[k], pose, twist))
        q[k + 1] = q[k] + dt * commands[-1].value
        shown[k] = control.reference[:3, 3]
        counts[k] = control.counts["left out"], control.counts["waited"]
    answers = verdict.answers(commands, dt)
    last = np.vstack([np.zeros(6), answers.value[:-1]])
    speed = np.linalg.norm(hand_twist(q[:-1], last)[:, :3], axis=1)
    left_out = np.diff(counts[:, 0], prepend=0) > 0
    verdict.within("hand speed where something is left out [m/s]", np.where(left_out, speed, 0.0), STANDS)
    led = np.char.find(answers.reason, "bridging") >= 0
    pace = np.linalg.norm(np.diff(shown, axis=0, prepend=shown[:1]), axis=1) / dt / given.linear_speed
    between = led & np.r_[False, led[:-1]] & np.r_[led[1:], False] & ~left_out & ~np.r_[False, left_out[:-1]]
    verdict.within("pace of a bridge, of the hand speed", np.where(between, pace, 0.0), LED + 1e-6)
    good = manipulability(q).min() > given.floor + 0.02 and (answers.status[-50:] == "ok").all()
    apart = float(np.linalg.norm(tool(q[-1:])[0, :3, 3] - end[:3, 3]))
    if good:
        verdict.within("hand away from where the reference came back to [m]", apart, 1e-3)
        verdict.within("late at the end [s]", control.lag, 0.02)
    followed(verdict, given, poses, twists, start)
    verdict.during("left out", left_out, dt)
    verdict.during("waited", np.diff(counts[:, 1], prepend=0) > 0, dt)
    verdict.during("led on", led, dt)
    verdict.during("judged at the end", np.full(len(places), good), dt)


def followed(verdict: Verdict, given: Settings, poses: np.ndarray, twists: np.ndarray, start: np.ndarray) -> None:
    """The same as a plan: what comes after the stretch is no part of it."""
    dt = given.dt
    more = round(2 * HELD / dt)  # what is left out doubles with each attempt, and so stays below twice the stretch
    poses = np.concatenate([poses, np.repeat(poses[-1:], more, axis=0)])
    twists = np.concatenate([twists, np.zeros((more, 6))])
    path = tracker(given).plan(poses, twists, start)
    verdict.ticks += len(path.times)
    held = len(poses) - round(3 * HELD / dt)
    seconds = dt * float(np.count_nonzero(path.clock > dt * (held + 1)))
    verdict.holds(
        "a plan does not skip to the end", not path.complete or seconds > HELD, f"{seconds:g} s of {3 * HELD:g}"
    )
    verdict.during("planned to the end", np.full(len(path.times), path.complete), dt)
