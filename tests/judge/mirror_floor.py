"""The manipulability floor of `MirrorTracker`, and its joint bounds.

Judged: w by the UR5's closed form, at the end of every tick, on the way through singular postures and from below the
floor; to 1e-9 of the largest. Started below it, an arm with its whole range of motion is above the floor after 20 s,
also where elbow and wrist, stretched at the end of their range, can bend one way only.
"""

from __future__ import annotations

import numpy as np

from rehab_opt import MirrorTracker, ur5
from tests.judge.mirror_runs import Run, followed
from tests.judge.numbering import Runs, judging
from tests.judge.ur5_numbers import LARGEST, manipulability
from tests.judge.verdict import Verdict

GUARANTEES = ("G02", "G16")
LEAST = {"at the floor": 250, "below the floor": 250, "back above the floor": 40, "above the floor": 103_000,
         "20 s after a start below the floor": 40,
         "relaxed acceleration": 40,
         "status braking": 100}  # fmt: skip
CI_TICKS = 4000
SHARE = 0.2
RECOVERED = 20.0


def largest_found(verdict: Verdict) -> None:
    """W_max of a UR5 that nobody was told."""
    found = MirrorTracker(ur5(), compile=False).max_manipulability
    verdict.within("w_max that is found, by that of the closed form", abs(found / LARGEST - 1), 1e-9)


def joint_bounds(verdict: Verdict, one: Run) -> tuple[np.ndarray, np.ndarray]:
    """Bounds of the joints in every tick; the values sent, and those before."""
    given, dt = one.settings, one.settings.dt
    answers = verdict.answers(one.commands, dt)
    value = answers.value
    last = np.vstack([one.begun, value[:-1]])
    q, ahead = one.q[:-1], one.q[1:]
    verdict.holds("the command is finite", np.isfinite(value))
    verdict.within("joint speed", np.abs(value) / given.velocity, 1 + 1e-12)
    beyond = np.maximum(ahead - np.maximum(given.upper, q), np.minimum(given.lower, q) - ahead)
    verdict.within("never further outside a joint limit [rad]", beyond, 1e-9)
    change = np.abs(value - last)
    allowed = np.minimum(given.acceleration * dt, 2 * given.velocity)
    hurried = (change > allowed * (1 + 2e-9) + 2e-12).any(axis=1)
    flagged = answers.relaxed & 2 != 0
    verdict.holds("acceleration that was relaxed is flagged", flagged | ~hurried)
    verdict.holds("acceleration that is flagged was relaxed", ~flagged | (change > allowed).any(axis=1))
    verdict.holds("acceleration that was relaxed is counted", int(flagged.sum()) == one.counts.get("acceleration", 0))
    return value, last


def judge(verdict: Verdict, one: Run) -> None:
    """The floor in every tick."""
    given, dt = one.settings, one.settings.dt
    joint_bounds(verdict, one)
    w = manipulability(one.q)
    verdict.within(
        "manipulability below the floor, or below what it was", np.minimum(w[:-1], given.floor) - w[1:], 1e-9
    )
    verdict.within("error of the manipulability that is told", np.abs(one.clock[:, 2] - w[1:]), 1e-9)
    under = w < given.floor - 1e-9
    bends = one.q[:, [2, 4]]
    crossed = (bends[0] * bends < 0).any(axis=1) & (np.abs(bends[0]) < 3.0).all()
    if not under[0] and not given.narrow:
        verdict.holds("the arm keeps its branch", ~crossed)
    sound = (one.faults.kind == "").all() and not given.narrow
    if sound and len(w) * dt > RECOVERED and under[0]:
        verdict.holds("above the floor after 20 s", ~under[round(RECOVERED / dt) :])
        verdict.during("20 s after a start below the floor", np.arange(len(w) - 1) * dt > RECOVERED, dt)
    verdict.during("below the floor", under[1:], dt)
    verdict.during("above the floor", ~under[1:], dt)
    verdict.during("at the floor", np.abs(w[1:] - given.floor) < 1e-3, dt)
    verdict.during("back above the floor", under[:-1] & ~under[1:], dt)
    verdict.during(f"reference {one.kind}", np.ones(len(w) - 1, dtype=bool), dt)


run = judging(
    __name__,
    LEAST,
    Runs(followed(judge, below=0.3), 1 / 4),
    Runs(followed(judge, below=0.0, begun=0.8), 1 / 4, 3_000_000),
    Runs(followed(judge, faults=0.5, below=0.3), 1 / 4, 1_000_000),
    Runs(followed(judge, below=1.0, least=RECOVERED + 1.0), 1 / 4, 2_000_000),
    finish=(
        Verdict.seldom_beyond_the_dual_method,
        largest_found,
    ),
)
