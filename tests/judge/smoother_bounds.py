"""Position, velocity, acceleration and jerk of `Smoother`, whatever is asked of it.

Judged by finite differences of the positions alone, from the state of `reset` on: mean values over a tick cannot exceed
what holds at every instant. What rounding of a position leaves in its third difference is allowed for. After a fault
the axes come to rest and stay there.
"""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np

from rehab_opt import Smoother
from tests.judge.numbering import Runs, judging, run_length
from tests.judge.references import reaches, sudden, tremor
from tests.judge.sensor_faults import STAMPS, expected, schedule
from tests.judge.verdict import Verdict

GUARANTEES = ("G01", "G03")
LEAST = {"at the velocity bound": 5000, "at the acceleration bound": 5000, "at the jerk bound": 10_000,
         "at a position bound": 4000, "outside a position bound": 53, "status braking": 1000, "status holding": 2000,
         "long after a fault": 5000, "reason disabled": 1000,
         "targets at a bound": 20_000}  # fmt: skip
CI_TICKS = 40_000
FAULTS = ("target", "disabled", *STAMPS)
KINDS = ("steps", "person", "sudden", "steady", "held")
CLIPPED = 0.4
"""Fraction of the axes whose targets, told without a speed, are clipped to the bounds by the caller."""
OUTSIDE = "target is outside the bounds: clipped"
EPSILON = float(np.finfo(float).eps)


def targets(
    rng: np.random.Generator, kind: str, start: np.ndarray, ticks: int, dt: float, speed: np.ndarray
) -> tuple[np.ndarray, np.ndarray | None]:
    """(ticks, n) targets, and their speeds where they are told."""
    axes = len(start)
    if kind == "held":
        return np.repeat((start + rng.uniform(-1, 1, axes))[None], ticks, axis=0), None
    if kind == "steps":
        places = start + rng.uniform(-1, 1, (ticks, axes))
        holds = np.cumsum(rng.random(ticks) < dt / rng.choice([0.05, 0.5, 2.0]))
        return places[holds], None
    if kind == "steady":
        pace = rng.choice([0.8, 0.8, 0.98]) * rng.uniform(-1, 1, axes) * speed
        return start + pace * dt * np.arange(1, ticks + 1)[:, None], np.repeat(pace[None], ticks, axis=0)
    path = reaches(rng, start, ticks, dt, size=0.5) + tremor(rng, ticks, dt, size=2e-3, axes=axes)
    if kind == "sudden":
        path, rate = sudden(rng, path, dt)
        return path, rate if rng.random() < 0.5 else None
    return path, np.gradient(path, dt, axis=0) if rng.random() < 0.5 else None


def one_run(verdict: Verdict, number: int, rng: np.random.Generator, *, faults: float) -> None:
    """One smoother; what moves on steadily does so long enough to be caught up with, often with no bound ahead."""
    kind = KINDS[number % len(KINDS)]
    steady = kind == "steady"
    axes, dt = int(rng.integers(1, 7)), float(rng.choice([1e-3, 2e-3, 1e-2, 2e-2]))
    velocity, acceleration = rng.uniform(0.2, 3.0, axes), rng.uniform(1.0, 20.0, axes)
    dt = max(dt, 0.01) if steady else dt
    jerk = acceleration * rng.uniform(2.0, 200.0, axes)
    start, bounded, recovery_speed = (
        rng.choice([0.3, 3.0, 3.0, 5000.0]) * rng.uniform(-1, 1, axes),
        rng.random() < (0.2 if steady else 0.6),
        float(rng.choice([0.1, 0.3])),
    )
    lower, upper = (start - rng.uniform(0.05, 1, axes), start + rng.uniform(0.05, 1, axes)) if bounded else (
        np.full(axes, -math.inf), np.full(axes, math.inf))  # fmt: skip
    outside = bounded and rng.random() < 0.3
    begin = start + 1.5 * rng.uniform(-1, 1, axes) if outside else start
    smoother = Smoother(velocity=velocity, acceleration=acceleration, jerk=jerk, dt=dt, lower=lower, upper=upper,
                        recovery_speed=recovery_speed)  # fmt: skip
    ticks = max(run_length(rng, number, dt, seconds=20.0), 1000 if steady else 0)
    verdict.begin(number, f"{kind}, {axes} axes, dt {dt:g}")
    goals, rates = targets(rng, kind, start, ticks, dt, velocity)
    if rates is None:  # of some axes the caller clips them, so that they are at a bound and not outside
        clipped = np.random.default_rng([verdict.seed, number, 1]).random(axes) < CLIPPED
        goals[:, clipped] = np.clip(goals, lower, upper)[:, clipped]
    wrong = schedule(rng, ticks, dt, FAULTS, every=faults, longest=3.0)
    kinds, stamped = wrong.kind.tolist(), math.isfinite(faults)
    smoother.reset(begin)
    commands, told = [], np.empty((ticks, axes))
    for k in range(ticks):
        goal = goals[k]
        if kinds[k] == "target":
            goal = goal.copy()
            goal[wrong.index[k] % axes] = wrong.number[k]
        options: dict[str, Any] = {"enable": wrong.enable[k], "stamp": wrong.stamp[k]} if stamped else {}
        commands.append(smoother.step(goal, None if rates is None else rates[k], **options))
        told[k] = smoother.velocity
    answers = verdict.answers(commands, dt)
    x = np.vstack([begin, begin, begin, begin, answers.value])
    size = 16 * EPSILON * np.maximum(np.abs(x).max(), 1.0)
    changes = [np.diff(x, order, axis=0) / dt**order for order in (1, 2, 3)]
    fractions = []
    for name, order, bound in (("velocity", 1, velocity), ("acceleration", 2, acceleration), ("jerk", 3, jerk)):
        fractions.append(np.abs(changes[order - 1][-ticks:]) / bound)
        slack = size * 2**order / dt**order / bound
        verdict.within(f"{name} over its bound", fractions[-1], 1 + 1e-6 + slack)
    verdict.holds("the command is finite", np.isfinite(answers.value))
    q, ahead = x[3:-1], x[4:]
    beyond = np.maximum(ahead - np.maximum(upper, q), np.minimum(lower, q) - ahead)
    verdict.within("never further outside a position bound", beyond, 1e-9)
    out = (q > upper + 1e-9) | (q < lower - 1e-9)
    back = np.where(out, np.abs(changes[0][-ticks:]) / (recovery_speed * velocity), 0.0)
    verdict.within("speed of the way back", back, 1 + 1e-6 + 2 * size / dt / (recovery_speed * velocity))
    verdict.holds("an axis outside is flagged", (answers.relaxed & 1 != 0) | ~out.any(axis=1))

    safe, bad = np.isin(answers.status, ("braking", "holding")), expected(wrong)
    verdict.holds("what cannot be used is not followed", safe | ~bad)
    refused = np.char.startswith(answers.reason, "target is more than # s away")  # none of these is
    verdict.holds("a target is too far only if it is so", ~refused | (wrong.kind == "target"))
    outside_bounds = ((goals < lower) | (goals > upper)).any(axis=1)
    verdict.holds("a target is outside the bounds only if it is so", (answers.reason != OUTSIDE) | outside_bounds)
    verdict.during("targets at a bound", ((goals == lower) | (goals == upper)).any(axis=1) & ~outside_bounds, dt)
    verdict.holds("a safe command has a reason", (answers.reason != "") | ~safe)
    still = (np.abs(ahead - q) <= size).all(axis=1)  # a last bit may be rounded otherwise
    holding = answers.status == "holding"
    verdict.holds("holding is being at rest", ~told.any(axis=1) | ~holding)
    verdict.holds("what holds stands still", still | ~(holding & np.r_[False, holding[:-1]]))
    # Each axis: the acceleration it has goes, and its speed, by the two ramps of jerk that this takes.
    stopping = _run_of(safe)
    begun = np.maximum(np.arange(ticks) - stopping, 0)
    speed, change = np.abs(changes[0][-ticks:])[begun], np.abs(changes[1][-ticks:])[begun]
    rest = ((speed + change**2 / (2 * jerk)) / acceleration + 2 * acceleration / jerk + change / jerk).max(axis=1)
    after = (stopping > 0) & (stopping * dt > rest + 4 * dt) & ~out[begun].any(axis=1)
    verdict.holds("long after a fault the axes stand", still | ~after | out.any(axis=1))

    for name, fraction in zip(("velocity", "acceleration", "jerk"), fractions, strict=True):
        verdict.during(f"at the {name} bound", (fraction > 1 - 1e-3).any(axis=1), dt)
    verdict.during("at a position bound", (np.minimum(ahead - lower, upper - ahead) < 1e-9).any(axis=1), dt)
    verdict.during("long after a fault", after, dt)
    verdict.during("outside a position bound", out.any(axis=1), dt)
    verdict.during(f"target {kind}", np.ones(ticks, dtype=bool), dt)


def _run_of(mask: np.ndarray) -> np.ndarray:
    """(N,) how many ticks in a row up to this one."""
    at = np.arange(1, len(mask) + 1)
    return np.asarray(at - np.maximum.accumulate(np.where(mask, 0, at)))


run = judging(
    __name__,
    LEAST,
    Runs(partial(one_run, faults=math.inf), 1 / 2),
    Runs(partial(one_run, faults=0.5), 1 / 2, 1_000_000),
)
