"""What `PoseTracker` does with inputs that are none, with stamps that are not fresh, and without the dead-man switch.

Judged: such a tick is answered by a safe command with a reason. All joints slow by the same fraction, as fast as the
one that rests last can, but for one that has to stop before its limit. None turns round, and then all stand; the hand
is no faster than its bounds, or than it was. The tick after next of sound inputs is followed again. Joints that have
not gone on through a gap in the stamps are taken to be at rest then: that is flagged. A robot that moves as commanded
follows.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tests.judge.numbering import Runs, judging
from tests.judge.pose_tracker_runs import Run, followed, speeds
from tests.judge.sensor_faults import expected
from tests.judge.ur5_numbers import hand_twist
from tests.judge.verdict import Verdict

GUARANTEES = ("G01", "G05")
LEAST = {"status braking": 3000, "status holding": 10_000, "reason not enabled": 1000, "reason stamp repeated": 500,
         "reason q[#] is #, not a valid number": 1000, "reason pose is not a rigid transform": 500,
         "reason twist[#] is #, not a valid number": 500, "reason pose[#, #] is #, not a valid number": 500,
         "reason stamp is not finite": 500, "reason stamp is missing": 500, "fault gap": 20,
         "reason stamp went backwards by # s": 500, "resumed": 2000,
         "joints wait for the one that rests last": 500, "taken to be at rest after a gap": 20}  # fmt: skip
CI_TICKS = 16_000
Array = NDArray[np.float64]


def judge(verdict: Verdict, one: Run) -> None:
    """Every faulty tick, and those after."""
    dt = one.settings.dt
    answers = verdict.answers(one.commands, dt)
    value, last = speeds(one)
    wrong = expected(one.faults)
    safe = np.isin(answers.status, ("braking", "holding"))
    verdict.holds("what cannot be used is not followed", safe | ~wrong)
    verdict.holds("a safe command has its reason, a plain one none", (answers.reason != "") == (answers.status != "ok"))
    verdict.holds("a safe command is not certified", np.isinf(answers.residual) == safe)
    verdict.within("residual of what is certified", np.where(safe, 0.0, answers.residual), 1e-8)
    verdict.holds("holding is standing still, braking is not", (answers.status == "holding") == (safe & ~value.any(1)))
    verdict.holds("nothing of the task is delivered by a safe command", (answers.scale == 0.0) | ~safe)
    whole = np.sign(last) * np.maximum(np.abs(last) - one.settings.acceleration * dt, 0.0)
    needed = (np.abs(last) / (one.settings.acceleration * dt)).max(axis=1)
    alike = np.abs(last) * np.maximum(1 - 1 / np.maximum(needed, 1), 0)[:, None]
    excess = np.where(safe[:, None], np.abs(value) - alike, 0.0)
    verdict.within("braking: speed above what braking of all joints alike leaves [rad/s]", excess, 1e-9)
    fast = hand_over(one, value) / np.maximum(hand_over(one, last), 1.0)
    # A joint that has just the room to stop before its limit waits for no other.
    given, q = one.settings, one.q[: len(value)]
    room = np.where(last > 0, given.upper - q, q - given.lower)
    stops = (last**2 / (2 * given.acceleration) + np.abs(last) * dt >= room) & (last != 0)
    free = safe & ~stops.any(axis=1)
    verdict.within("braking: the hand over its bounds, or over what it was", np.where(free, fast, 0.0), 1 + 1e-3)
    verdict.during("joints wait for the one that rests last", safe & (np.abs(value) > np.abs(whole) + 1e-9).any(1), dt)
    verdict.holds("no joint turns round while braking", (value * last >= 0) | ~safe[:, None])
    change = np.abs(value - last) / np.minimum(one.settings.acceleration * dt, 2 * one.settings.velocity)
    if not one.pushed.any():
        rests = (answers.relaxed & 2 != 0) & np.char.startswith(answers.reason, "gap")
        verdict.within("change of speed, faults and resumptions included", change * ~rests[:, None], 1 + 1e-9)
        verdict.during("taken to be at rest after a gap", rests, dt)
    lost = np.char.find(answers.reason, "does not follow") >= 0
    verdict.holds("a robot that moves as commanded follows", ~lost)
    calm = ~wrong & np.r_[True, ~wrong[:-1]] & np.r_[True, True, ~wrong[:-2]] & ~lost
    verdict.holds("sound inputs are followed again", ~safe | ~calm, str(set(answers.reason[safe & calm])))
    verdict.during("resumed", ~safe & np.r_[False, safe[:-1]], dt)
    for kind in np.unique(one.faults.kind):
        if kind:
            verdict.during(f"fault {kind}", one.faults.kind == kind, dt)


def hand_over(one: Run, value: Array) -> Array:
    """(N,) hand speeds over their bounds of joint speeds (N, 6): of places at both ends of the tick, of turns now."""
    begin, end = (hand_twist(one.q[:-1] + part * one.settings.dt * value, value) for part in (0.0, 1.0))
    linear = np.maximum(*(np.linalg.norm(each[:, :3], axis=1) for each in (begin, end))) / one.settings.linear_speed
    return np.asarray(np.maximum(linear, np.linalg.norm(begin[:, 3:], axis=1) / one.settings.angular_speed))


run = judging(
    __name__,
    LEAST,
    Runs(followed(judge, faults=0.2), 2 / 3),
    Runs(followed(judge, faults=0.2, pushes=0.2), 1 / 3, 1_000_000),
)
