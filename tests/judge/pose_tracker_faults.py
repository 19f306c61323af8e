"""What `PoseTracker` does with inputs that are none, with stamps that are not fresh, and without the dead-man switch.

Judged: such a tick is answered by a safe command with a reason; every joint slows by its whole acceleration, never
turns round, and then stands; and the tick after next of sound inputs is followed again. Only joints that somebody
pushes are found not to follow, and the arm rests then.
"""

from __future__ import annotations

import numpy as np

from tests.judge.pose_tracker_runs import Run, runs, speeds
from tests.judge.sensor_faults import expected
from tests.judge.verdict import Promise, Verdict

PROMISES = (
    Promise("docs/capabilities/certificates.md", "Letting go of `enable`, a stale or repeated `stamp`, a sensor value "
            "that is no number, a target that is no rigid pose: the joints decelerate within the bounds and hold, "
            "and resume without a jump."),
    Promise("rehab_opt/control/pose_tracker.py", "Never raises on numbers: what is not usable gives the safe command, "
            "decelerating within the limits, and its reason."),
    Promise("rehab_opt/control/pose_tracker.py", "the dead-man input; anything but true decelerates to rest."),
    Promise("rehab_opt/control/watchdog.py", "largest age of a state, and largest gap between two [s]"),
    Promise("rehab_opt/control/command.py", "Why this is not a plain OK, or what holds help back; empty otherwise."),
)  # fmt: skip
LEAST = {"status braking": 3000, "status holding": 10_000, "reason not enabled": 1000, "reason stamp repeated": 500,
         "reason q[#] is #, not a usable number": 1000, "reason pose is not a rigid transform": 500,
         "reason twist[#] is #, not a usable number": 500, "reason pose[#, #] is #, not a usable number": 500,
         "reason stamp is not finite": 500, "reason stamp is missing": 500, "fault gap": 20,
         "reason stamp went backwards by # s": 500, "resumed": 2000}  # fmt: skip
CI_TICKS = 16_000


def run(ticks: int, seed: int, *, only: int | None = None) -> Verdict:
    """A fault each 0.2 s; a third with pushes."""
    verdict = Verdict("pose_tracker_faults", seed, LEAST)
    for each in runs(verdict, 2 * ticks // 3, only, faults=0.2):
        judge(verdict, each)
    for each in runs(verdict, ticks // 3, only, faults=0.2, pushes=0.2, first=1_000_000):
        judge(verdict, each)
    return verdict


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
    slower = np.maximum(np.abs(last) - one.settings.acceleration * dt, 0.0)
    excess = np.where(safe[:, None], np.abs(value) - slower, 0.0)
    verdict.within("braking: speed above what the whole deceleration leaves [rad/s]", excess, 1e-12)
    verdict.holds("no joint turns round while braking", (value * last >= 0) | ~safe[:, None])
    change = np.abs(value - last) / np.minimum(one.settings.acceleration * dt, 2 * one.settings.velocity)
    if not one.pushed.any():
        verdict.within("change of speed, faults and resumptions included", change, 1 + 1e-9)
    lost = np.char.find(answers.reason, "does not follow") >= 0
    verdict.holds("a robot that nobody pushes follows", ~lost | np.logical_or.accumulate(one.pushed))
    calm = ~wrong & np.r_[True, ~wrong[:-1]] & np.r_[True, True, ~wrong[:-2]] & ~lost
    verdict.holds("sound inputs are followed again", ~safe | ~calm, str(set(answers.reason[safe & calm])))
    verdict.during("resumed", ~safe & np.r_[False, safe[:-1]], dt)
    for kind in np.unique(one.faults.kind):
        if kind:
            verdict.during(f"fault {kind}", one.faults.kind == kind, dt)
