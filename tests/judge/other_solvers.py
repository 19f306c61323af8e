"""The same commands and answers whichever solver is asked for: certified, and by the one that was named.

Judged on twins in the same states, one with the default solver: `PoseTracker` and `BoundedForce` tick by tick,
`ArmIK` target by target.
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np
import qpsolvers

from rehab_opt import ArmIK, BoundedForce, PoseTracker, human_arm, ur5
from tests.judge.arm_ik_answers import RANGES, hand
from tests.judge.numbering import Runs, judging
from tests.judge.references import good_posture, reference
from tests.judge.ur5_numbers import LIMIT
from tests.judge.verdict import Verdict

GUARANTEES = ("G06",)
KNOWN = "known to qpsolvers"
"""A solver that qpsolvers knows and nobody else: DAQP under another name."""
SOLVERS = tuple(name for name in ("proxqp", "osqp", "daqp", "quadprog") if name in qpsolvers.available_solvers)
SOLVERS = (*SOLVERS, *([KNOWN] if "daqp" in SOLVERS else []))
PROGRAMMES = ("ipopt", "fatrop", "sqpmethod")
LEAST = {f"named {name}": 30_000.0 for name in SOLVERS} | {f"named {name}": 200.0 for name in PROGRAMMES}
CI_TICKS = 4000
SHARE = 0.1
ANSWERED = {"proxqp": 0.98, "osqp": 0.3, "daqp": 0.95, "quadprog": 0.9, KNOWN: 0.9}
"""Share of ticks in which the solver that was named must be the one that answered."""
ALIKE = 2e-2
"""A residual of 1e-8 where the cost is as flat as near a singular posture: 1.8e-9 was seen to make 0.7 %."""
CERTIFIED = ("ok", "backup", "blocked")
MISSING = 0.02
UNNAMED = {"ipopt": 0.5, "fatrop": 1.0, "sqpmethod": 0.5}
"""Share of postures that may be the backup's."""
TARGETS = 4
BLIND = 50
"""Of so many ticks, one is told joint positions that are no numbers."""


if "daqp" in SOLVERS and KNOWN not in qpsolvers.available_solvers:
    daqp = qpsolvers.solvers.solve_function["daqp"]
    qpsolvers.solvers.solve_function[KNOWN] = partial(daqp, primal_tol=1e-11, dual_tol=1e-11)
    qpsolvers.available_solvers.append(KNOWN)


def one_run(verdict: Verdict, number: int, rng: np.random.Generator) -> None:
    """An arm, a force, a few postures of a person's arm."""
    solver = SOLVERS[number % len(SOLVERS)]
    verdict.begin(number, solver)
    trackers(verdict, rng, solver)
    forces(verdict, rng, solver)
    postures(verdict, rng, PROGRAMMES[number % len(PROGRAMMES)])


def compare(verdict: Verdict, claim: str, solver: str, mine: list, usual: list, dt: float) -> None:  # type: ignore[type-arg]
    """Two lists of commands of the same states."""
    answers = verdict.answers(mine, dt)
    plain = answers.status == "ok"
    apart = np.abs(answers.value - np.array([each.value for each in usual])).max(axis=1)
    size = 1.0 + np.abs(answers.value).max(axis=1)
    certified = np.isin(answers.status, CERTIFIED)
    sound = np.array([each.status.value in CERTIFIED for each in usual])
    verdict.within(f"{claim} away from the default solver's", np.where(certified & sound, apart / size, 0.0), ALIKE)
    verdict.within(f"{claim}: ticks without an answer, where the default has one", np.mean(sound & ~certified), MISSING)
    verdict.holds(f"{claim}: a plain answer is by the solver that was named", (answers.solver == solver) | ~plain)
    verdict.within(f"{claim}: residual", np.where(certified, answers.residual, 0.0), 1e-8)
    named = float(np.mean(answers.solver[sound] == solver)) if sound.any() else 1.0
    verdict.within(f"{claim}: ticks not answered by {solver}", 1.0 - named, 1.0 - ANSWERED[solver])
    verdict.during(f"named {solver}", answers.solver == solver, dt)


def trackers(verdict: Verdict, rng: np.random.Generator, solver: str) -> None:
    """Two trackers at one arm, which does what the default one says."""
    start, dt = good_posture(rng, 0.2), 0.01
    lower, upper = np.maximum(-LIMIT, start - 0.4), np.minimum(LIMIT, start + 0.4)
    arm = ur5(lower=lower, upper=upper, velocity=np.full(6, 1.0), acceleration=np.full(6, 10.0))
    twins = [PoseTracker(arm, dt=dt, solver=each, compile=False) for each in (solver, "qrqp")]
    poses, twists = reference(rng, ("sines", "person", "held")[int(rng.integers(3))], start, 200, dt)
    q, found = start, ([], [])
    none = np.arange(200) % BLIND == BLIND - 1
    for k, (pose, twist) in enumerate(zip(poses, twists, strict=True)):
        for commands, each in zip(found, twins, strict=True):
            commands.append(each.step(q * np.nan if none[k] else q, pose, twist))
        q = q + dt * found[1][-1].value
    safe = np.array([each.status.value in ("braking", "holding") for each in found[0]])
    verdict.holds("joint velocities: no numbers are answered by the safe command", safe | ~none)
    compare(verdict, "joint velocities", solver, *found, dt)


def forces(verdict: Verdict, rng: np.random.Generator, solver: str) -> None:
    """Two forces on one hand, which goes its own way."""
    dt = 0.005
    stiffness, budget = rng.uniform(200.0, 1500.0), float(rng.choice([0.3, 20.0]))
    options = {"dt": dt, "energy_budget": budget, "compile": False}
    twins = [
        BoundedForce(lambda x, y, _vx, _vy: (-stiffness * x, -stiffness * y), solver=each, **options)  # type: ignore[arg-type]
        for each in (solver, "qrqp")
    ]
    phase, found = rng.uniform(0, 6, 2), ([], [])
    for k in range(200):
        x = 0.05 * np.sin(2.0 * dt * k * np.array([2.0, 3.0]) + phase)
        v = 0.1 * np.array([2.0, 3.0]) * np.cos(2.0 * dt * k * np.array([2.0, 3.0]) + phase)
        for commands, each in zip(found, twins, strict=True):
            commands.append(each.step(x, v))
    compare(verdict, "force", solver, *found, dt)


def postures(verdict: Verdict, rng: np.random.Generator, solver: str) -> None:
    """The same person with two solvers: nobody's posture costs more."""
    lower, upper = np.deg2rad(np.array(RANGES["regular"], dtype=float)).T
    arm, tilt = human_arm(range_of_motion="regular"), math.radians(10.0)
    twins = [ArmIK(arm, handle_tilt=tilt, solver=each, compile=False) for each in (solver, "sqp")]
    targets = hand(rng.uniform(lower, upper, (TARGETS, 8)))[0]
    answers = [[each.solve(target) for target in targets] for each in twins]
    solved = [np.array([each.status.value in ("ok", "backup") for each in one]) for one in answers]
    verdict.holds("a posture wherever the default has one", solved[0] | ~solved[1])
    cost = np.array([[each.cost for each in one] for one in answers])
    worse = np.where(solved[0] & solved[1], cost[0] - cost[1], 0.0)
    verdict.within("posture cost over the default solver's", worse / (1e-3 + np.abs(cost[1])), 1e-3)
    named = np.array([each.solver == solver for each in answers[0]])
    verdict.within(f"postures not by {solver}", float(np.mean(solved[1] & ~named)), UNNAMED[solver])
    verdict.during(f"named {solver}", named, 1.0)


run = judging(__name__, LEAST, Runs(one_run))
