"""Position, velocity, acceleration and jerk of `Smoother`, whatever is asked of it.

Judged by finite differences of the positions alone, from the state of `reset` on: mean values over a tick cannot exceed
what holds at every instant. What rounding of a position leaves in its third difference is allowed for. After a fault
the axes come to rest and stay there; a target that is held or moves steadily is met no later than by coming to rest
relative to it and going the way from there. Lists and tuples of numbers are followed as arrays are.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Any

import numpy as np

from rehab_opt import Smoother
from tests.judge.numbering import numbered, run_length
from tests.judge.references import reaches, sudden, tremor
from tests.judge.sensor_faults import STAMPS, expected, schedule
from tests.judge.verdict import Verdict

GUARANTEES = ("G01", "G03")
LEAST = {"at the velocity bound": 5000, "at the acceleration bound": 5000, "at the jerk bound": 10_000,
         "at a position bound": 4000, "outside a position bound": 53, "status braking": 1000, "status holding": 2000,
         "on a target that is held": 20_000, "on a target that moves": 20_000,
         "long after a fault": 5000, "reason disabled": 1000, "targets in lists and tuples": 60_000,
         "targets at a bound": 20_000}  # fmt: skip
CI_TICKS = 40_000
FAULTS = ("target", "disabled", *STAMPS)
KINDS = ("steps", "person", "sudden", "steady", "held")
FORMED = 60
"""Ticks at the beginning of each run that are done in other forms, too."""
FORMS: tuple[Callable[[np.ndarray], Any], ...] = (
    np.ndarray.tolist, tuple, list, lambda row: tuple(row.tolist()), lambda row: [*map(round, row.tolist())],
    np.ndarray.tolist,
)  # fmt: skip
INTEGERS, REFILLED = 4, 5
CLIPPED = 0.4
"""Fraction of the axes whose targets, told without a speed, are clipped to the bounds by the caller."""
OUTSIDE = "target is outside the bounds: clipped"
FARTHER = re.compile(r"target is more than (\S+) s away")
EPSILON = float(np.finfo(float).eps)


def run(ticks: int, seed: int, *, only: int | None = None) -> Verdict:
    """Half without faults, half with."""
    verdict = Verdict("smoother_bounds", seed, LEAST)
    for number, rng in numbered(verdict, ticks // 2, only):
        one_run(verdict, number, rng, faults=math.inf)
    for number, rng in numbered(verdict, ticks // 2, only, first=1_000_000):
        one_run(verdict, number, rng, faults=0.5)
    return verdict


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
    """One smoother; what moves on steadily does so long enough to be caught up with, and often with no bound ahead."""
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
    if kind == "held":  # in half of the runs farther away as soon as an axis comes to its full speed
        again = np.random.default_rng([verdict.seed, number, 2])
        i, farther = int(again.integers(axes)), again.uniform(0.0, 4.0) * float(again.random() < 0.5)
        ramp = velocity[i] / acceleration[i] + again.random() * acceleration[i] / jerk[i]
        goals[int(ramp / dt) :] += farther * (goals[0] - start)
    if rates is None:  # of some axes the caller clips them, so that they are at a bound and not outside
        clipped = np.random.default_rng([verdict.seed, number, 1]).random(axes) < CLIPPED
        goals[:, clipped] = np.clip(goals, lower, upper)[:, clipped]
    farthest(verdict, Smoother(velocity=velocity, acceleration=acceleration, jerk=jerk, dt=dt), velocity)
    wrong = schedule(rng, ticks, dt, FAULTS, every=faults, longest=3.0)
    kinds, stamped = wrong.kind.tolist(), math.isfinite(faults)
    as_given(verdict, smoother, begin, goals, rates)
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

    if rates is None or steady:
        pace = np.zeros(axes) if rates is None else rates[0]
        inside = ((goals >= lower) & (goals <= upper)).all(axis=1)
        goal = np.clip(goals, lower, upper)
        same = inside if steady else np.r_[False, (np.diff(goals, axis=0) == 0).all(axis=1)]
        since = _run_of(same & ~safe & ~out.any(axis=1))
        first = np.minimum(np.arange(ticks) - since + 1, ticks - 1)
        stood = np.maximum.reduce([np.abs(x[3 + first] - x[i + first]) for i in range(3)]) <= size
        # Of an axis that moves, the mean speed of its last tick is known, and no acceleration but by its bound.
        change = np.where(stood, 0.0, acceleration)
        speed = np.abs(changes[0][2 + first] - pace) + change * dt / 2
        way = np.abs(goal[first] - pace * dt - x[3 + first])
        seconds = meeting_seconds(way, speed, change, pace, velocity, acceleration, jerk).max(axis=1)
        late = since * dt > seconds + 5 * dt
        if steady:
            stop = velocity**2 / acceleration + 2 * velocity * acceleration / jerk
            late &= (np.minimum(upper - goals, goals - lower) > 2 * stop + 4 * dt * velocity).all(axis=1)
        met = np.abs(ahead - goal) <= (1e-6 if steady else 1e-9 * (1 + np.abs(goals)))
        how = "moves steadily is followed without lag" if steady else "is held is reached"
        verdict.holds(f"a target that {how}", met.all(axis=1) | ~late)
        verdict.during(f"on a target that {'moves' if steady else 'is held'}", late, dt)
    for name, fraction in zip(("velocity", "acceleration", "jerk"), fractions, strict=True):
        verdict.during(f"at the {name} bound", (fraction > 1 - 1e-3).any(axis=1), dt)
    verdict.during("at a position bound", (np.minimum(ahead - lower, upper - ahead) < 1e-9).any(axis=1), dt)
    verdict.during("long after a fault", after, dt)
    verdict.during("outside a position bound", out.any(axis=1), dt)
    verdict.during(f"target {kind}", np.ones(ticks, dtype=bool), dt)


def farthest(verdict: Verdict, smoother: Smoother, velocity: np.ndarray) -> None:
    """From rest at zero: targets that are further away than is said are refused, and one that is no further is not."""
    told = []
    for fraction in (1e9, 1.0, 1.0 + 1e-9):
        smoother.reset(np.zeros(len(velocity)))
        seconds = float(told[0][1]) if told and told[0] else 1.0
        told.append(FARTHER.match(smoother.step(fraction * (seconds * velocity)).reason))
    verdict.holds("a target is further away than is said if it is refused for that", [bool(each) for each in told]
                  == [True, False, True], str(told))  # fmt: skip


def as_given(
    verdict: Verdict, smoother: Smoother, begin: np.ndarray, goals: np.ndarray, rates: np.ndarray | None
) -> None:
    """Targets in lists and tuples, of floats, integers and numpy's numbers, give what they give in new arrays.

    One list is filled anew each tick, as callers do; each target comes twice, as a target that is held does.
    """
    goals = np.repeat(goals[: FORMED // 2], 2, axis=0)
    rates = None if rates is None else np.repeat(rates[: FORMED // 2], 2, axis=0)
    forms = np.arange(len(goals)) // 6 % len(FORMS)
    goals[forms == INTEGERS] = np.round(goals[forms == INTEGERS]) + 0.0  # no integer is -0.0
    own: list[float] = [0.0] * goals.shape[1]

    def formed(row: np.ndarray, form: int) -> Any:
        if form == REFILLED:
            own[:] = row.tolist()
            return own
        return FORMS[form](row)

    found = []
    for plain in (True, False):
        smoother.reset(begin if plain else begin.tolist())
        told = []
        for k, form in enumerate(forms.tolist()):
            speed = None if rates is None else rates[k].copy() if plain else FORMS[form % INTEGERS](rates[k])
            told.append(smoother.step(goals[k].copy() if plain else formed(goals[k], form), speed))
        found.append(told)
    alike = [
        one.value.tobytes() == other.value.tobytes() and one[1:] == other[1:] for one, other in zip(*found, strict=True)
    ]
    verdict.holds("lists and tuples are followed as arrays are", alike)
    verdict.during("targets in lists and tuples", np.ones(len(alike), dtype=bool), smoother.dt)


def meeting_seconds(
    way: np.ndarray,
    speed: np.ndarray,
    change: np.ndarray,
    pace: np.ndarray,
    velocity: np.ndarray,
    acceleration: np.ndarray,
    jerk: np.ndarray,
) -> np.ndarray:
    """[s] in which an axis can meet a target that moves on at `pace`, whichever way both go.

    Seen from the target: its acceleration goes, then its speed, and from rest it goes back the `way` that it was off
    and what it came further, at the speed that its bound leaves above the pace. `speed` is relative to the target.
    """
    most = np.minimum(speed + change**2 / (2 * jerk), velocity + np.abs(pace))

    def ramp(speed: np.ndarray) -> np.ndarray:
        """[s] from rest to a speed: the bound of acceleration is come to or is not."""
        touched = speed * jerk >= acceleration**2
        return np.asarray(np.where(touched, speed / acceleration + acceleration / jerk, 2 * np.sqrt(speed / jerk)))

    way = way + most * (change / jerk + ramp(most) / 2)
    fastest = velocity - np.abs(pace)
    gentle, rising = 4 * np.cbrt(way / (2 * jerk)), acceleration / jerk
    short = np.where(way < 2 * acceleration * rising**2, gentle, rising + np.sqrt(rising**2 + 4 * way / acceleration))
    back = np.where(way < fastest * ramp(fastest), short, way / fastest + ramp(fastest))
    return np.asarray(change / jerk + ramp(most) + back)


def _run_of(mask: np.ndarray) -> np.ndarray:
    """(N,) how many ticks in a row up to this one."""
    at = np.arange(1, len(mask) + 1)
    return np.asarray(at - np.maximum.accumulate(np.where(mask, 0, at)))
