"""`ArmIK` for a person's arm: in its limits, the handle upright, the hand in place, and true about all of it.

Judged with the arm of Table I (Rossa et al.) written down once more, by brute force: no random posture within limits
and tilt has its hand nearer to an unreachable target, and none of those near an answer holds the hand for less cost.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from scipy.optimize import minimize

from rehab_opt import ArmIK, human_arm
from tests.judge.numbering import Runs, judging
from tests.judge.ur5_numbers import frames
from tests.judge.verdict import Verdict

GUARANTEES = ("G10",)
LEAST = {"status ok": 141_000, "status unreachable": 28_000, "status holding": 2000, "range regular": 100_000,
         "range restricted": 66_000, "followed": 66_000}  # fmt: skip
CI_TICKS = 300
SHARE = 0.008
ROWS = ((0.130, 0, 0.0), (0.0, -1, 0.0), (0.0, -1, 0.0), (0.290, 0, 0.0), (0.300, 0, 0.0), (0.0, 1, 0.0),
        (0.0, -1, 0.0), (0.0, 0, 0.070))  # fmt: skip
"""Of Table I: a [m], quarter turns, d [m]."""
RANGES = {
    "regular": [(170, 195), (-20, 10), (50, 90), (20, 80), (0, 70), (-50, 60), (-45, -30), (10, 50)],
    "restricted": [(180, 180), (0, 5), (70, 90), (30, 70), (30, 60), (30, 60), (-30, -30), (40, 45)],
}
REST = np.deg2rad([180.0, 0.0, 90.0, 0.0, 0.0, 0.0, -90.0, 0.0])
TERMS: tuple[dict[str, float], ...] = (
    {"rest": 1.0}, {"rest": 0.5, "elbow": 2.0}, {"displacement": 1.0, "speed": 0.5}, {"speed": 2.0, "rest": 0.1},
)  # fmt: skip
ELBOW = 4
"""Joint 5 bends it."""
ITERATIONS = 18.0
"""Of the quadratic convergence that the SQP says it has."""
PLACE = 1e-6
"""[m] A hand nearer than this is in place."""


def hand(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(N, 3) [m] places and (N, 3) handle axes of a left arm at q (N, 8), in the shoulder's frame."""
    pose = hand_pose(q)
    return pose[:, :3, 3], pose[:, :3, 0]


def hand_pose(q: np.ndarray) -> np.ndarray:
    """(N, 4, 4) poses of the hand."""
    return frames(q, ROWS)[:, -1]


def one_run(verdict: Verdict, number: int, rng: np.random.Generator) -> None:
    """One arm, forty targets and a path."""
    name = ("regular", "restricted")[number % 2]
    lower, upper = np.deg2rad(np.array(RANGES[name], dtype=float)).T
    tilt = (math.radians(0.8), math.radians(2.0), math.radians(10.0), None)[int(rng.integers(4))]
    terms = TERMS[int(rng.integers(len(TERMS)))]
    arm = human_arm(range_of_motion=name)
    if nameless := bool(rng.random() < 0.3):
        arm = dataclasses.replace(arm, names=tuple("elbow" if i == ELBOW else f"joint {i}" for i in range(8)))
    rest = (lower + upper) / 2 if nameless else np.clip(REST, lower, upper)
    ik = ArmIK(arm, handle_tilt=tilt, posture_cost=terms, compile=False)
    verdict.begin(number, f"{name}, tilt {tilt}, {terms}")
    targets = hand(rng.uniform(lower, upper, (40, 8)))[0]
    targets[30:37] += rng.standard_normal((7, 3)) * rng.choice([0.05, 1.0, 100.0], (7, 1))
    targets[36] = rng.choice([-1e200, 1e200]), 0.1, -0.2
    targets[37], targets[38], targets[39, 1] = math.nan, 1e300, -math.inf
    first = rng.uniform(lower, upper)
    begins = [first if k % 4 == 3 else None for k in range(len(targets))]
    answers = [ik.solve(each, start) for each, start in zip(targets, begins, strict=True)]
    way = np.linspace(0, 1, 20)[:, None]
    path = targets[0] + way * (targets[1] - targets[0])
    path[7] = math.nan
    followed = ik.follow(path)
    q = np.concatenate([[each.q for each in answers], followed.q])
    goals = np.concatenate([targets, path])
    status = np.array([each.status.value for each in answers] + [each.value for each in followed.status])
    told = np.concatenate([[each.position_error for each in answers], followed.position_error])
    slope = np.concatenate([[each.handle_tilt for each in answers], followed.handle_tilt])
    reason = np.array([each.reason for each in answers] + followed.reason)
    verdict.ticks += len(q)

    verdict.holds("q is finite", np.isfinite(q))
    verdict.within("q outside its limits [rad]", np.maximum(lower - q, q - upper), 1e-12)
    places, handles = hand(q)
    numbers = np.isfinite(goals).all(axis=1)
    away = np.where(numbers[:, None], goals, 0.0) - places
    most = np.abs(away).max(axis=1)  # squares of 1e300 would be none
    true = np.where(numbers, most * np.linalg.norm(away / np.maximum(most, 1e-300)[:, None], axis=1), math.inf)
    verdict.holds("the position error is what it is", np.isclose(told, true, rtol=1e-9, atol=1e-9))
    lean = np.arctan2(np.hypot(handles[:, 0], handles[:, 1]), handles[:, 2])
    verdict.within("error of the tilt [rad]", np.abs(slope - lean), 1e-9)
    solved = np.isin(status, ("ok", "backup"))
    verdict.within("hand of a solved target away from it [m]", np.where(solved, true, 0.0), PLACE)
    if tilt is not None:
        verdict.within("tilt of a handle [rad]", np.where(status == "holding", 0.0, lean), tilt + 1e-7)
    verdict.holds("a plain answer has no reason, another one has", (reason == "") == (status == "ok"))
    steps = [each.iterations for each in answers if each.status.value == "ok"]
    verdict.within("iterations of a solved target, in the mean", np.mean(steps) if steps else 0.0, ITERATIONS)
    verdict.holds("no number is answered by holding", (status == "holding") == ~numbers)
    verdict.holds("whoever is in place is not called unreachable", (true > PLACE) | (status != "unreachable"))
    middles = [middle(terms, lower, upper, rest, start) for start in begins]
    costs = [0.5 * float(np.sum(w * (each.q - c) ** 2)) for each, (w, c) in zip(answers, middles, strict=True)]
    verdict.within("error of the posture cost", np.abs([each.cost for each in answers] - np.array(costs)), 1e-9)
    verdict.within(
        "error of a path's steps [rad]", np.abs(np.abs(np.diff(followed.q, axis=0)).max(1) - followed.steps), 1e-12
    )
    verdict.within("error of its largest [rad]", abs(followed.steps.max() - followed.max_step), 1e-12)
    verdict.within("error of the share reached", abs(np.mean(solved[40:]) - followed.reached), 1e-12)
    drawn = rng.uniform(lower, upper, (20_000, 8))
    where, upright = hand(drawn)
    fits = np.ones(len(drawn), dtype=bool) if tilt is None else upright[:, 2] >= math.cos(tilt)
    for k in np.flatnonzero((status == "unreachable") & numbers & (true < 1e3)).tolist():
        nearest = np.linalg.norm(where[fits] - goals[k], axis=1).min(initial=math.inf)
        verdict.within("unreachable: hand further away than a random posture's [m]", true[k] - nearest, 1e-6)
    for k in np.flatnonzero((status != "holding") & numbers & (true >= 1e6)).tolist():
        way = goals[k] / most[k] / np.linalg.norm(goals[k] / most[k])
        verdict.within("hand less far towards what is absurdly far than a random posture's [m]",
                       (where[fits] @ way).max(initial=-math.inf) - places[k] @ way, 1e-6)  # fmt: skip
    verdict.holds("what a posture of the arm reaches is reached", solved[:30] | (tilt is not None))
    for k in np.flatnonzero(status[:30] == "ok")[:5].tolist():
        weight, centre = middles[k]
        better = _cheaper(q[k], goals[k], lower, upper, weight, centre, tilt)
        verdict.within(
            "posture cost over one found nearby by another solver", (costs[k] - better) / (1e-6 + costs[k]), 1e-3
        )
    for each in ("ok", "backup", "unreachable", "holding"):
        verdict.during(f"status {each}", status == each, 1.0)
    verdict.during(f"range {name}", np.ones(len(q), dtype=bool), 1.0)
    verdict.during("followed", np.arange(len(q)) >= 40, 1.0)


def middle(
    terms: dict[str, float], lower: np.ndarray, upper: np.ndarray, rest: np.ndarray, start: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray]:
    """(T, 8) weights and centres of a posture cost's terms; what has nothing to refer to is left out."""
    scale = 1.0 / np.clip(upper - lower, 0.1, 2 * math.pi) ** 2
    found = []
    for name, weight in terms.items():
        if name == "elbow":
            found.append((np.eye(8)[ELBOW] * scale * weight, upper))
        elif name == "rest":
            found.append((scale * weight, rest))
        elif start is not None:
            found.append((scale * weight, start))
    weights, centres = zip(*(found or [(scale, rest)]), strict=True)
    return np.array(weights), np.array(centres)


def _cheaper(q: np.ndarray, goal: np.ndarray, lower: np.ndarray, upper: np.ndarray, weight: np.ndarray,
             rest: np.ndarray, tilt: float | None) -> float:  # fmt: skip
    """Least cost that scipy finds from an answer."""
    held = [{"type": "eq", "fun": lambda x: (hand(x[None])[0][0] - goal) * 10}]
    if tilt is not None:
        held.append({"type": "ineq", "fun": lambda x: hand(x[None])[1][0, 2] - math.cos(tilt)})
    found = minimize(
        lambda x: 0.5 * float(np.sum(weight * (x - rest) ** 2)), q, bounds=list(zip(lower, upper, strict=True)),
        constraints=held, method="SLSQP", options={"maxiter": 60, "ftol": 1e-12},
    )  # fmt: skip
    place, handle = hand(np.clip(found.x, lower, upper)[None])
    kept = np.linalg.norm(place[0] - goal) < PLACE and (tilt is None or handle[0, 2] >= math.cos(tilt) - 1e-9)
    return float(found.fun) if kept else math.inf


run = judging(__name__, LEAST, Runs(one_run), finish=(Verdict.seldom_by_backup,))
