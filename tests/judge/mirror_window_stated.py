"""`MirrorWindow` states what its docstring says: cost and bounds, in numbers, with the judge's own UR5.

A tick is one drawn motion of K knots; each of its bounds must hold in the programme exactly where it truly holds.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from bench.solvers.mirror_window import MirrorWindow
from rehab_opt import ur5
from rehab_opt.control.hand_bounds import HandBounds
from tests.judge.numbering import numbered
from tests.judge.references import good_posture
from tests.judge.ur5_numbers import LARGEST, LIMIT, manipulability, tool
from tests.judge.verdict import Verdict

GUARANTEES = ("G25",)
BOUNDS = ("speed", "acceleration", "manipulability", "hand speed", "deviation")
LEAST = {f"{name} broken": 50_000.0 for name in BOUNDS} | {f"{name} satisfied": 50_000.0 for name in BOUNDS}
CI_TICKS = 2000
SHARE = 0.02
STEADYING = 1e-3


def run(ticks: int, seed: int, *, only: int | None = None) -> Verdict:
    """Two hundred motions of one arm a run."""
    verdict = Verdict("mirror_window_stated", seed, LEAST)
    for number, rng in numbered(verdict, ticks, only):
        one_run(verdict, number, rng)
    return verdict


def one_run(verdict: Verdict, number: int, rng: np.random.Generator) -> None:
    """One arm and its programme."""
    knots, h, turn = int(rng.integers(1, 4)), float(rng.choice([0.02, 0.05])), float(rng.choice([0.05, 0.1, 0.3]))
    velocity, acceleration = rng.uniform(0.8, 3.0, 6), rng.uniform(3.0, 30.0, 6)
    start = good_posture(rng, 0.4)
    lower, upper = np.maximum(-LIMIT, start - 0.5), np.minimum(LIMIT, start + 0.6)
    floor, linear, deviation = rng.uniform(0.3, 0.7), rng.uniform(0.2, 1.0), float(rng.choice([0.02, 0.05]))
    arm = ur5(lower=lower, upper=upper, velocity=velocity, acceleration=acceleration)
    bounds = HandBounds(arm, floor, LARGEST, linear, deviation, (), 20.0, h, 0.1)
    window = MirrorWindow(bounds, knots=knots, turn_length=turn)
    nlp = window.nlp
    rows = nlp.rows
    numbers = ca.Function(
        "numbers", [nlp.x, nlp.p], [nlp.minimise, rows.expression, rows.lower, rows.upper, nlp.report]
    )
    box = ca.Function("box", [nlp.p], [nlp.lower, nlp.upper])
    verdict.begin(number, f"{knots} knots, {h:g} s")
    state = {name: np.zeros((200, 2), dtype=bool) for name in BOUNDS}
    for k in range(200):
        here = start + 0.3 * rng.uniform(-1, 1, 6)
        before = here - h * velocity * rng.uniform(-1, 1, 6)
        wild = rng.choice([0.3, 0.8, 1.2])
        steps = [here - before + wild * acceleration * h**2 * rng.uniform(-1, 1, 6)]
        for _ in range(knots - 1):
            steps.append(steps[-1] + wild * acceleration * h**2 * rng.uniform(-1, 1, 6))
        q = here + np.cumsum(steps, axis=0)
        poses = tool(q + 0.03 * rng.standard_normal((knots, 6)))
        poses[:, :3, 3] += rng.choice([0.0, 0.02, 0.05]) * rng.standard_normal((knots, 3))
        cost, value, low, high, report = (
            each.full().ravel() for each in numbers(q.ravel(), window.parameters_of(here, before, poses))
        )
        every = np.vstack([before, here, q])
        hands, fractions = tool(every[1:]), manipulability(every[1:])
        error = hands[1:, :3, 3] - poses[:, :3, 3]
        change = np.diff(every, 2, axis=0)
        true = 0.5 * np.sum(error**2) + 0.25 * turn**2 * np.sum((hands[1:, :3, :3] - poses[:, :3, :3]) ** 2)
        verdict.within("error of the cost", abs(cost[0] - true - 0.5 * STEADYING * np.sum(change**2)), 1e-12)
        verdict.within("error of the manipulability told", np.abs(report - fractions[1:]), 1e-9)
        lengths = np.linalg.norm(np.diff(hands[:, :3, 3], axis=0), axis=1)
        away = max(deviation, float(np.linalg.norm(hands[0, :3, 3] - poses[0, :3, 3])))
        margins = [
            velocity * h - np.abs(np.diff(every[1:], axis=0)), acceleration * h**2 - np.abs(change),
            (fractions[1:] - min(floor, fractions[0]))[:, None], (linear * h - lengths)[:, None],
            (away - np.linalg.norm(error, axis=1))[:, None],
        ]  # fmt: skip
        held, at = (value >= low) & (value <= high), 0
        for knot in range(knots):
            for name, margin in zip(BOUNDS, margins, strict=True):
                size = margin.shape[1]
                mine, clear = margin[knot] >= 0, np.abs(margin[knot]) > 1e-12
                verdict.holds(f"{name} is stated as it is", (held[at : at + size] == mine) | ~clear)
                state[name][k] |= (not mine.all(), bool(mine.all()))
                at += size
        verdict.holds("no more rows than those", at == len(held))
    ends = [each.full().ravel() for each in box(window.parameters_of(here, before, poses))]
    verdict.within("error of the joint limits [rad]", np.abs(np.array(ends) - np.tile([lower, upper], knots)), 1e-12)
    verdict.within("a start away from where the arm stands", np.abs(window.standing(here) - np.tile(here, knots)), 0.0)
    verdict.ticks += 200
    for name, broken in state.items():
        verdict.during(f"{name} broken", broken[:, 0], h)
        verdict.during(f"{name} satisfied", broken[:, 1], h)
