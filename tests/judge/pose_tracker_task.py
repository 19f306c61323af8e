"""What `PoseTracker` says about its task, and that it does it.

Judged by the flange's twist from the judge's own Jacobian, against the whole of it: twist plus what removes a share
1 - exp(-gain dt) of the pose error in a tick. `scale` and `Relaxed.TASK` must be what is true of them. What is asked
has less feedback where the joints could not stop at the target. Where nothing
yields for ten time constants the pose error is what the reference's own change within a tick leaves. Where
the hand could go straight along what is asked, it leaves that by a fiftieth in one tick of fifty at most (the price of
slowing down is finite); in the others it is never led faster than it may be by a hundredth.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tests.judge.numbering import Runs, judging
from tests.judge.pose_tracker_runs import Run, followed, speeds
from tests.judge.ur5_numbers import hand_twist, jacobian, tool, turn_between
from tests.judge.verdict import Verdict

GUARANTEES = ("G04",)
LEAST = {"solver closed form": 3e5, "solver active set": 5e4, "solver dual active set": 5e3,
         "task relaxed": 96_000, "task delivered": 36_000, "slowed to the hand speed": 2000,
         "straight possible, slowed by the joints": 80,
         "settled on the reference": 80, "nothing of the task delivered": 20_000}  # fmt: skip
CI_TICKS = 16_000
Array = NDArray[np.float64]
MISSED, STILL = 1e-3, 1e-6
SINGULAR = 0.03
"""Smallest singular value of the Jacobian below which the direction may be left."""


def judge(verdict: Verdict, one: Run) -> None:
    """Every tick's claim about the task."""
    given, dt = one.settings, one.settings.dt
    answers = verdict.answers(one.commands, dt)
    value, last = speeds(one)
    here = tool(one.q[:-1])
    error = np.concatenate(
        [one.poses[:, :3, 3] - here[:, :3, 3], turn_between(one.poses[:, :3, :3], here[:, :3, :3])], axis=1
    )
    weigh, rate = np.sqrt(given.weights), (1 - np.exp(-given.gain * dt)) / dt
    feedback, done = weigh * rate * error, hand_twist(one.q[:-1], value)
    whole, felt = weigh * one.twists + feedback, weigh * done
    asked = whole - (1 - braked(one, rate, feedback))[:, None] * feedback
    size, off = np.linalg.norm(whole, axis=1), np.linalg.norm(felt - whole, axis=1)
    slack = MISSED * size + STILL
    turned = np.abs(np.linalg.norm(error[:, 3:], axis=1)) < 3.1  # a half turn has two ways round
    ok = np.isin(answers.status, ("ok", "blocked", "backup")) & turned
    flagged = answers.relaxed & 4 != 0
    verdict.holds("a task that is missed is flagged", flagged | (off <= 1.001 * slack + 1e-9) | ~ok)
    verdict.holds("what is flagged is missed", ~flagged | (off >= 0.7 * slack) | ~ok)
    along = np.clip(np.einsum("ni,ni->n", felt, whole) / np.maximum(size, STILL) ** 2, 0, 1)
    told = np.where(along > MISSED, along, 0.0)  # less is nothing
    edge = np.abs(along - MISSED) < 1e-6
    true = np.where(flagged & (size > STILL), np.where(edge, answers.scale, told), 1.0)  # 1 where nothing is commanded
    # A joint that is put less than 1 mrad beyond its limit is taken to stand at it.
    exact = 1e-3 if one.pushed.any() else 1e-6
    verdict.within("error of the scale", np.where(ok, np.abs(answers.scale - true), 0.0) / exact, 1.0)
    verdict.within("scale", np.abs(answers.scale - 0.5), 0.5)

    # Where some speed of the arm, within every bound, goes straight along what is asked: so must the hand.
    fast = np.maximum(np.linalg.norm(done[:, :3], axis=1) / given.linear_speed,
                      np.linalg.norm(done[:, 3:], axis=1) / given.angular_speed)  # fmt: skip
    every = bool((given.weights == 1).all()) and given.posture is None
    if every:
        along = np.einsum("ni,ni->n", felt, asked) / np.maximum(np.linalg.norm(asked, axis=1), STILL) ** 2
        slowed = np.maximum(np.linalg.norm(asked[:, :3], axis=1) / given.linear_speed,
                            np.linalg.norm(asked[:, 3:], axis=1) / given.angular_speed)  # fmt: skip
        fraction, straight = along_asked(one, asked, slowed, last)
        straight &= ok & (np.linalg.norm(asked, axis=1) > 1e-3) & (not one.pushed.any())
        beside = felt - asked * along[:, None]
        across = np.linalg.norm(beside, axis=1) / np.maximum(np.linalg.norm(felt, axis=1), 1e-9)
        wide = np.maximum(np.linalg.norm(beside[:, :3], axis=1) / given.linear_speed,
                          np.linalg.norm(beside[:, 3:], axis=1) / given.angular_speed)  # fmt: skip
        bent = straight & ((across > 0.02) | (wide > 0.01))
        verdict.within("share of the ticks across what is asked where it could go straight", float(bent.mean()), 0.02)
        short = np.minimum(fraction, 1 / np.maximum(slowed, 1)) - along
        verdict.within("share of the ticks slower than the arm could", float((straight & (short > 0.02)).mean()), 0.02)
        verdict.within("hand speed over the largest asked", np.where(straight & ~bent, fast, 0.0), 1.01)
        verdict.during("straight possible, slowed by the joints", straight & (fraction < 0.99), dt)
    # A reference that was followed freely for ten time constants is where the hand is.
    quiet = np.cumsum(~flagged & ok)
    long = max(round(10 / (given.gain * dt)), 10)
    steady = np.zeros(len(value), dtype=bool)
    steady[long:] = quiet[long:] - quiet[:-long] == long
    bend = np.linalg.norm(np.diff(one.twists, axis=0), axis=1).max(initial=0.0) * dt
    curve = (np.abs(value).sum(axis=1).max() * dt) ** 2
    left = (bend + curve + slack.max() * dt) / (1 - np.exp(-given.gain * dt)) + 1e-9
    if every and one.kind != "sudden" and not one.pushed.any():
        verdict.within("pose error of what is followed freely [m, rad], over what a tick's curve leaves",
                       np.where(steady, np.linalg.norm(error, axis=1), 0.0) / left, 1.0)  # fmt: skip
        verdict.during("settled on the reference", steady, dt)
    verdict.during("task relaxed", flagged, dt)
    verdict.during("task delivered", ok & ~flagged & (size > STILL), dt)
    verdict.during("nothing of the task delivered", ok & (answers.scale == 0), dt)
    verdict.during("slowed to the hand speed", every & (np.abs(fast - 1) < 1e-3), dt)


def braked(one: Run, rate: float, feedback: Array) -> Array:
    """(N,) share of the feedback (N, 6), weighted, from which the joints can stop with 0.7 of their accelerations.

    By its damped joint velocities: at the rate of feedback they may take 1.4 of the time in which the error would fade.
    """
    given = one.settings
    moves = np.sqrt(given.weights)[:, None] * jacobian(one.q[:-1]) * (given.lower < given.upper)
    inverse = np.linalg.inv(moves @ moves.transpose(0, 2, 1) + 4e-4 * np.eye(6))
    once = np.einsum("nij,nj->ni", inverse, feedback)
    twice = np.einsum("nij,nj->ni", inverse, once)
    solved = once + 4e-4 * twice + 4e-4**2 * np.einsum("nij,nj->ni", inverse, twice)
    velocity = np.einsum("nji,nj->ni", moves, solved)
    r = np.maximum(rate * (np.abs(velocity) / given.acceleration).max(axis=1) / 0.7, 1)
    return np.asarray(np.sqrt(2 * r - 1) / r)


def along_asked(one: Run, asked: Array, slowed: Array, last: Array) -> tuple[Array, NDArray[np.bool_]]:
    """(N,) largest s with J q' = s asked within every bound, less a margin; and where it is some, more than the least.

    At the least the hand may be no faster than its limit: joints that cannot slow down in a tick may leave a straight
    way at higher speeds only. Where the motion that is asked, slowed to the hand speeds by `slowed` (N,), would bring a
    joint to its limit faster than it can stop there, the direction may be left.

    The bounds are those of continuous braking, which are a little narrower than those over ticks. A joint comes to its
    limit with 0.7 of its acceleration, and at last at 30/s.
    """
    given, dt, q = one.settings, one.settings.dt, one.q[:-1]
    moves = jacobian(q)
    regular = np.linalg.svd(moves, compute_uv=False)[:, -1] > SINGULAR
    way = np.zeros_like(q)
    way[regular] = np.linalg.solve(moves[regular], asked[regular][..., None])[..., 0]
    change = np.minimum(given.acceleration * dt, 2 * given.velocity)
    half = change / 2
    stops = []
    for room in (np.maximum(given.upper - q, 0), np.maximum(q - given.lower, 0)):
        hard = np.sqrt(2 * change / dt * room + half**2) - half
        gentle = 0.7 * change / dt
        near = gentle / 30.0**2
        gently = np.where(room <= near, 30.0 * room, np.sqrt(2 * gentle * np.maximum(room - near / 2, 0)))
        stops.append(np.minimum(hard, gently))
    up, down = (np.minimum(given.velocity, each) for each in stops)
    full = way / np.maximum(slowed, 1)[:, None]  # a joint that this would bring to its limit too fast goes slower alone
    kept = ((full <= stops[0]) & (-full <= stops[1])).all(axis=1)
    high, low = np.minimum(last + change, up), np.maximum(last - change, -down)
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.where(way != 0, low / way, -np.inf), np.where(way != 0, high / way, np.inf)
    still = (way == 0) & ((low > 0) | (high < 0))
    least, most = np.minimum(*ends).max(axis=1), np.minimum(np.maximum(*ends).min(axis=1), 1.0)
    slow_enough = least < 0.9 * np.minimum(most, 1 / np.maximum(slowed, 1))
    return most, regular & kept & ~still.any(axis=1) & (low <= high).all(axis=1) & slow_enough & (most > 0.2)


run = judging(
    __name__,
    LEAST,
    Runs(followed(judge), 3 / 4),
    Runs(followed(judge, pushes=1.0), 1 / 4, 1_000_000),
    finish=(Verdict.seldom_by_backup,),
)
