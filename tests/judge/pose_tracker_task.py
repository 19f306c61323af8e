"""What `PoseTracker` says about its task, and that it does it.

Judged by the flange's twist from the judge's own Jacobian, against the whole of it: twist plus what removes a share
1 - exp(-gain dt) of the pose error in a tick. `scale` and `Relaxed.TASK` must be what is true of them. Where nothing
yields for ten time constants the pose error is what the reference's own change within a tick leaves. The hand is no
faster than 1.02 of its limits.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tests.judge.numbering import Runs, judging
from tests.judge.pose_tracker_runs import Run, followed, speeds
from tests.judge.ur5_numbers import hand_twist, tool, turn_between
from tests.judge.verdict import Verdict

GUARANTEES = ("G04",)
LEAST = {"solver closed form": 3e5, "solver active set": 5e4, "solver dual active set": 5e3,
         "task relaxed": 96_000, "task delivered": 36_000, "slowed to the hand speed": 2000,
         "settled on the reference": 80, "nothing of the task delivered": 20_000}  # fmt: skip
CI_TICKS = 16_000
Array = NDArray[np.float64]
MISSED, STILL = 1e-3, 1e-6


def judge(verdict: Verdict, one: Run) -> None:
    """Every tick's claim about the task."""
    given, dt = one.settings, one.settings.dt
    answers = verdict.answers(one.commands, dt)
    value, _ = speeds(one)
    here = tool(one.q[:-1])
    error = np.concatenate(
        [one.poses[:, :3, 3] - here[:, :3, 3], turn_between(one.poses[:, :3, :3], here[:, :3, :3])], axis=1
    )
    weigh, rate = np.sqrt(given.weights), (1 - np.exp(-given.gain * dt)) / dt
    feedback, done = weigh * rate * error, hand_twist(one.q[:-1], value)
    whole, felt = weigh * one.twists + feedback, weigh * done
    size, off = np.linalg.norm(whole, axis=1), np.linalg.norm(felt - whole, axis=1)
    slack = MISSED * size + STILL
    turned = np.abs(np.linalg.norm(error[:, 3:], axis=1)) < 3.1  # a half turn has two ways round
    ok = np.isin(answers.status, ("ok", "blocked", "backup")) & turned
    flagged = answers.relaxed & 4 != 0
    led = not one.pushed.any()  # where joints are led; after a push they come to what is measured slowly
    verdict.holds("a task that is missed is flagged", flagged | (off <= 1.001 * slack + 1e-9) | ~ok | (not led))
    verdict.holds("what is flagged is missed", ~flagged | (off >= 0.7 * slack) | ~ok)
    along = np.clip(np.einsum("ni,ni->n", felt, whole) / np.maximum(size, STILL) ** 2, 0, 1)
    told = np.where(along > MISSED, along, 0.0)  # less is nothing
    edge = np.abs(along - MISSED) < 1e-6
    true = np.where(flagged & (size > STILL), np.where(edge, answers.scale, told), 1.0)  # 1 where nothing is commanded
    verdict.within("error of the scale", np.where(ok & led, np.abs(answers.scale - true), 0.0) / 1e-6, 1.0)
    verdict.within("scale", np.abs(answers.scale - 0.5), 0.5)

    every = bool((given.weights == 1).all()) and given.posture is None
    fast = np.maximum(np.linalg.norm(done[:, :3], axis=1) / given.linear_speed,
                      np.linalg.norm(done[:, 3:], axis=1) / given.angular_speed)  # fmt: skip
    verdict.within("hand speed over its limits", np.where(led, fast, 0.0), 1.02)
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


run = judging(
    __name__,
    LEAST,
    Runs(followed(judge), 3 / 4),
    Runs(followed(judge, pushes=1.0), 1 / 4, 1_000_000),
    finish=(Verdict.seldom_by_backup,),
)
