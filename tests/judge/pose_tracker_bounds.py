"""Joint bounds of `PoseTracker`, and the order in which they yield.

Judged: the command of every tick, against intervals written down once more. A joint that stands at its limit to 1e-9 is
not outside. Where nobody puts the joints elsewhere every state can still stop, so that acceleration never yields; else
it yields only where speed or position leave it no room, and after a pause of the stamps. With drives that bound jerk
neither it nor acceleration ever yields but there, a state that can stop never leaves the limits, and who lets go is at
rest as soon as a ramp down and its two ends take. A slider is at its limit as soon as the judge's shortest way takes.
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np
from numpy.typing import NDArray

from rehab_opt import DH, PoseTracker, SerialChain
from tests.judge.numbering import Runs, judging
from tests.judge.pose_tracker_runs import DTS, Run, followed, speeds
from tests.judge.verdict import Verdict

Array = NDArray[np.float64]
GUARANTEES = ("G02", "G03")
LEAST = {"status ok": 190_000, "relaxed position": 1000, "relaxed acceleration": 50, "relaxed task": 50_000,
         "at a joint limit": 5000, "at a joint speed": 5000, "at a joint acceleration": 18_000,
         "outside a joint limit": 2000, "solver dual active set": 100,
         "at a jerk": 20_000, "jerk bounded: at rest, braked": 3000, "jerk bounded: at a joint limit": 4000,
         "jerk bounded: at a joint speed": 1000, "jerk bounded: at an acceleration": 4000,
         "jerk bounded: all of the task": 2000, "jerk bounded: led against a limit": 5000}  # fmt: skip
CI_TICKS = 32_000
AT, NOISE = 1e-9, 1e-3
"""[rad] beyond a limit: of who stands there, and of what may be noise."""
PUSHED, JERKY, JERKY_PUSHED = 1_000_000, 2_000_000, 3_000_000
"""Numbers of the pushed runs begin here, of those with a bounded jerk, and of those with both."""
SLIDERS, HELD, LATE = 4_000_000, 60, 2
"""And of sliders led against their limit; ticks for which they are held there, and by which they may be late."""


def judge(verdict: Verdict, one: Run, *, calm: bool) -> None:
    """Every bound in every tick."""
    given, dt = one.settings, one.settings.dt
    answers = verdict.answers(one.commands, dt)
    value, last = speeds(one)
    q = one.q[:-1]
    verdict.holds("the command is finite", np.isfinite(value))
    verdict.within("joint speed", np.abs(value) / given.velocity, 1 + 1e-12)

    known = ~np.isin(one.faults.kind, ("q", "all"))  # else the tracker does not see where the joints are
    ahead = q + dt * value
    # A joint that is put beyond by less than noise may be is taken to stand at its limit.
    high, low = (given.upper, given.lower) if calm else (given.upper + NOISE, given.lower - NOISE)
    beyond = np.maximum(ahead - np.maximum(high, q), np.minimum(low, q) - ahead)
    verdict.within("never further outside a joint limit [rad]", np.where(known[:, None], beyond, 0.0), 1e-9)
    above, below = q > high + AT, q < low - AT
    back = np.where(above, -value, np.where(below, value, 0.0)) / (given.recovery_speed * given.velocity)
    verdict.within("speed of the way back", np.where(known[:, None], back, 0.0), 1 + 1e-9)

    change = np.abs(value - last)
    allowed = np.minimum(given.acceleration * dt, 2 * given.velocity)
    hurried = change > allowed * (1 + 2e-9) + 2e-12
    flagged = answers.relaxed & 2 != 0
    verdict.holds("acceleration that was relaxed is flagged", flagged | ~hurried.any(axis=1))
    verdict.holds("what is flagged was relaxed", ~flagged | (change > allowed).any(axis=1))
    outside = np.maximum(q - given.upper, given.lower - q)
    verdict.holds("a joint outside is flagged, and nothing else is",
                  flagged_if(answers.relaxed & 1 != 0, outside) | ~known)  # fmt: skip
    if calm:
        verdict.within("change of speed of a robot that can stop", change / allowed, 1 + 1e-9)
    # Where the bounds above acceleration leave no speed that it allows, theirs is the nearest to it.
    room_up, room_down = (given.upper - q) / dt, (q - given.lower) / dt
    back = given.recovery_speed * given.velocity
    hard_up = np.clip(room_up, 0.0, np.where(below, back, given.velocity))
    hard_down = -np.clip(room_down, 0.0, np.where(above, back, given.velocity))
    needed = (hard_up < last - allowed + 1e-9) | (hard_down > last + allowed - 1e-9)
    # After a gap joints that have not gone on are taken to be at rest.
    rests = np.char.startswith(answers.reason, "gap")[:, None]
    verdict.holds("acceleration yields only to speed and position", ~hurried | needed | rests | ~known[:, None])

    full = np.isfinite(given.acceleration)
    verdict.during("at a joint limit", (np.minimum(room_up, room_down) < 1e-6 / dt).any(axis=1), dt)
    verdict.during("at a joint speed", (np.abs(value) > given.velocity * (1 - 1e-6)).any(axis=1), dt)
    verdict.during("at a joint acceleration", ((change > allowed * (1 - 1e-6)) & full).any(axis=1), dt)
    verdict.during("outside a joint limit", (above | below).any(axis=1), dt)
    verdict.during(f"reference {one.kind}", np.ones(len(q), dtype=bool), dt)


def flagged_if(flagged: NDArray[np.bool_], beyond: Array) -> NDArray[np.bool_]:
    """(N,) whether that is so where joints (N, 6) are beyond their limits; by less than NOISE it may be said or not."""
    return np.where(flagged, (beyond > AT).any(axis=1), (beyond <= NOISE).all(axis=1))


def judge_jerk(verdict: Verdict, one: Run, *, calm: bool) -> None:
    """The same of drives that bound jerk, in every tick."""
    given, dt = one.settings, one.settings.dt
    answers = verdict.answers(one.commands, dt)
    value, last = speeds(one)
    change = (value - last) / dt
    jerk = np.diff(np.vstack([np.zeros(6), change]), axis=0) / dt / given.jerk
    verdict.holds("the command is finite", np.isfinite(value))
    verdict.within("jerk bounded: joint speed", np.abs(value) / given.velocity, 1 + 1e-12)
    # After a gap joints that have not gone on are taken to be at rest; `reset` forgets what the acceleration was.
    rests = np.char.startswith(answers.reason, "gap")
    begun = rests | np.append(False, one.pushed[:-1])
    gone_on = ~begun & ~np.append(False, begun[:-1])
    verdict.within("jerk bounded: acceleration", np.abs(change) * ~rests[:, None] / given.acceleration, 1 + 1e-9)
    verdict.within("jerk", np.abs(jerk) * gone_on[:, None], 1 + 1e-9)
    verdict.holds("jerk bounded: acceleration is not said to yield", (answers.relaxed & 2 == 0) | rests)
    q, known = one.q, ~np.isin(one.faults.kind, ("q", "all"))
    beyond = np.maximum(q - given.upper, given.lower - q)
    if calm:
        verdict.within("jerk bounded: outside a joint limit [rad]", beyond, AT)
    verdict.holds("jerk bounded: a joint outside is flagged, and nothing else is",
                  flagged_if(answers.relaxed & 1 != 0, beyond[:-1]) | ~known)  # fmt: skip
    safe = np.isin(answers.status, ("braking", "holding"))
    braking = np.arange(len(safe)) - np.maximum.accumulate(np.where(safe, -1, np.arange(len(safe))))
    fastest = np.maximum.accumulate(np.where(safe[:, None], 0.0, np.abs(value)))  # ever since the start: easily enough
    ramp = fastest / given.acceleration + 3 * given.acceleration / given.jerk
    late = braking[:, None] > ramp / dt + 5
    if calm:
        verdict.holds("jerk bounded: at rest in time", ~(late & (value != 0)).any(axis=1))
    verdict.during("jerk bounded: at rest, braked", safe & ~value.any(axis=1), dt)
    verdict.during("jerk bounded: at a joint limit", (np.abs(beyond[:-1]) < 0.05 * given.jerk * dt**3).any(axis=1), dt)
    verdict.during("jerk bounded: at a joint speed", (np.abs(value) > given.velocity * (1 - 1e-6)).any(axis=1), dt)
    verdict.during("jerk bounded: at an acceleration",
                   (np.abs(change) > given.acceleration * (1 - 1e-6)).any(axis=1), dt)  # fmt: skip
    verdict.during("at a jerk", (np.abs(jerk) > 1 - 1e-6).any(axis=1), dt)
    verdict.during("jerk bounded: all of the task", (answers.relaxed == 0) & (answers.scale == 1), dt)


def judge_arrival(verdict: Verdict, number: int, rng: np.random.Generator) -> None:
    """One slider, led beyond its limit from rest, as fast as its bounds allow: how soon and how near it comes to it."""
    dt, speed = float(rng.choice(DTS)), float(rng.uniform(0.1, 3.0))
    acceleration = speed / (dt * 10 ** rng.uniform(0.5, 2.0))
    jerk = acceleration / (dt * 10 ** rng.uniform(0.0, 1.5))
    room = speed * (speed / acceleration + acceleration / jerk) * rng.uniform(0.3, 2.0)
    side = float(rng.choice([-1.0, 1.0]))
    gain = 0.25 * jerk / max(acceleration, math.sqrt(jerk * speed))
    ends = sorted((side * room, -side * math.inf))
    chain = SerialChain((DH(a=0.0, alpha=0.0, prismatic=True),), lower=ends[0], upper=ends[1],
                        velocity=speed, acceleration=acceleration)  # fmt: skip
    control = PoseTracker(chain, gain=gain * (1 - 1e-9), linear_speed=2 * speed, task_weights=(0, 0, 1, 0, 0, 0),
                          jerk=jerk, dt=dt, compile=False)  # fmt: skip
    pose, due = np.eye(4), math.ceil(shortest(room, speed, acceleration, jerk) / dt) + LATE
    pose[2, 3] = side * (room + 3 * speed * (1 / gain + dt))
    q, left, commands = np.zeros(1), np.empty(due + HELD), []
    for k in range(len(left)):
        commands.append(control.step(q, pose, np.zeros(6)))
        q = q + dt * commands[-1].value
        left[k] = room - side * q[0]
    verdict.begin(number, f"slider, dt {dt:g}, {speed / acceleration / dt:.1f} ticks to the speed, "
                  f"{acceleration / jerk / dt:.1f} to the acceleration")  # fmt: skip
    verdict.answers(commands, dt)
    left /= jerk * dt**3
    verdict.within("slider: outside its limit", -left, AT)
    verdict.within("slider: nearest by when the shortest way ends, jerk dt^3 off", left[:due].min(), 1.0)
    verdict.within("slider: held at its limit, jerk dt^3 off in the mean", left[due:].mean(), 1.0)
    verdict.during("jerk bounded: led against a limit", np.arange(len(left)) >= due, dt)


def shortest(way: float, speed: float, acceleration: float, jerk: float) -> float:
    """[s] from rest to rest over a way within these bounds."""
    built = min(acceleration, math.sqrt(jerk * speed))
    ramp = speed / built + built / jerk
    if speed * ramp <= way:
        return ramp + way / speed
    if way * jerk**2 >= 2 * acceleration**3:
        return acceleration / jerk + math.sqrt((acceleration / jerk) ** 2 + 4 * way / acceleration)
    return float(4 * (way / (2 * jerk)) ** (1 / 3))


run = judging(
    __name__,
    LEAST,
    Runs(followed(partial(judge, calm=True)), 3 / 8),
    Runs(followed(partial(judge, calm=False), faults=1.0, pushes=0.2), 3 / 8, PUSHED),
    Runs(followed(partial(judge_jerk, calm=True), faults=1.0, jerk=True), 1 / 6, JERKY),
    Runs(followed(partial(judge_jerk, calm=False), faults=1.0, pushes=0.5, jerk=True), 1 / 12, JERKY_PUSHED),
    Runs(judge_arrival, 1 / 24, SLIDERS),
)
