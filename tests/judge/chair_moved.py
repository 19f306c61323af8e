"""The chair under a stick as people move it, among obstacles that come and go: bounds, rest, and the law where held.

A run is many parts: held, slow sines, bursts of least jerk with pauses and tremor, ramps, sudden stops and reversals,
too much, nothing, the dead-man released, numbers that are none; rows, frame and obstacles change between parts. Some
obstacles come too late to brake for, some around the chair; only these excuse an acceleration beyond its bound.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from rehab_opt.control.obstacles import Disc, HalfPlane
from tests.judge.chair_claims import judge_ticks
from tests.judge.chair_held import judge_law
from tests.judge.chair_robot import CORNERS, FRONT, REAR, SIDE, Array, Obstacles
from tests.judge.chair_runs import (
    OTHER_SETS,
    SETS,
    Part,
    Run,
    command,
    held,
    motion,
    other_resolver,
    posture,
    record,
    resolver,
)  # fmt: skip
from tests.judge.numbering import Runs, judging
from tests.judge.verdict import Verdict

GUARANTEES = ("G01", "G02", "G04", "G13")
LEAST = {
    "a joint at its limit": 2e4,
    "a joint outside its limits": 20,
    "a keep-out near": 2e3,
    "a speed at its limit": 500,
    "chassis speed at its limit": 100,
    "a wheel at its limit": 20,
    "an obstacle near": 500,
    "within an obstacle": 50,
    "an obstacle came too late": 100,
    "an acceleration at its bound": 1e4,
    "beyond the acceleration, too late": 10,
    "the dead-man released, moving": 300,
    "numbers that are none, moving": 50,
    "status braking": 300,
    "status holding": 300,
    "command zero, moving": 300,
    "the hand slowed": 1e4,
    "the hand as asked": 5e4,
    "at rest after the command": 1e3,
    "rows switched while moving": 100,
    "relaxed position": 50,
    "relaxed acceleration": 10,
    "relaxed task": 1e4,
    "wheels rolled along arcs": 5e4,
    "law judged": 5e3,
}
CI_TICKS = 26_000
PLACES = 3
TICKS = (0.001, 0.002, 0.005, 0.01, 0.01, 0.02)
OTHERS = 4
"""One run in this many is of a random robot at a random tick."""
NOT_TRUE = (False, 0, None, math.nan, 2, "on", np.False_)
"""What is given for a dead-man that is not held."""
KINDS = ("held", "sine", "person", "ramp", "reverse", "much", "zero", "released", "hostile")
OFTEN = np.array([3, 3, 4, 1, 2, 2, 2, 1.5, 1.5]) / 20


def one_run(verdict: Verdict, number: int, rng: np.random.Generator) -> None:
    """One robot, about eight parts; more of a robot that was built for this run."""
    if number % OTHERS == OTHERS - 1:
        every = (*SETS, *OTHER_SETS)
        sets = tuple(every[i] for i in rng.permutation(len(every))[:2])
        dt = float(rng.choice(TICKS))
        chair, made = other_resolver(rng, dt, PLACES, sets)
    else:
        sets, dt = SETS, 0.01
        chair, made = resolver(("differential", "mecanum")[number % 2], sets, dt, PLACES)
    q = posture(chair, rng)
    obstacles = room(rng, q) if rng.random() < 0.5 else ()
    outside = number % 10 == 4
    if outside:
        joint = rng.integers(4)
        q[3 + joint] = rng.choice([chair.lower[joint] - 0.05, chair.upper[joint] + 0.05])
    u = motion(chair, q, rng, dt, obstacles) if rng.random() < 0.3 and not outside else np.zeros(7)
    arcs = number % 3 == 1
    parts, spent, seconds = [], 0.0, (6000 if number % OTHERS == OTHERS - 1 else 2500) * dt
    while spent < seconds:
        part = one_part(rng, sets, dt, obstacles if not parts else None)
        if not (arcs and part.fault):  # without q a controller goes by its own path, which is that of no wheels
            parts.append(part)
            spent += len(part.twist) * dt
    recorded = record(made, Run(chair, dt, u, parts, arcs), q)
    verdict.begin(number, f"{chair.drive} dt {dt:g}, {len(parts)} parts")
    _, moved = judge_ticks(recorded, verdict)
    if arcs:
        verdict.during("wheels rolled along arcs", np.ones(len(moved), dtype=bool), dt)
    judge_rest(recorded, verdict, moved)
    if not outside:
        judge_held(recorded, verdict)


def one_part(rng: np.random.Generator, sets: tuple[tuple[str, ...], ...], dt: float, first: Obstacles | None) -> Part:
    """A stretch of one kind; with the obstacles at the begin of a run, or at times with others."""
    obstacles: Obstacles | Callable[[Array], Obstacles] | None = first
    rows = sets[rng.integers(len(sets))]
    frame = "world" if rng.random() < 0.3 else "chassis"
    if obstacles is None and rng.random() < 0.2:
        seed = int(rng.integers(2**31))
        obstacles = (lambda at: room(np.random.default_rng(seed), at)) if rng.random() < 0.7 else ()
    kind = str(rng.choice(KINDS, p=OFTEN))
    seconds = float(rng.uniform(0.3, 3.0) if rng.random() < 0.6 else rng.uniform(3.0, 10.0))
    n = max(2, min(round(seconds / dt), 3000))
    time = np.arange(n) * dt
    twist = command(rng, rows)
    enable = NOT_TRUE[rng.integers(len(NOT_TRUE))] if kind == "released" else True
    if kind == "sine":
        asked = np.sin(2 * math.pi * time / rng.uniform(3, 20) + rng.uniform(0, 6))[:, None] * 1.5 * twist
    elif kind == "person":
        asked = person(rng, rows, time)
    elif kind == "ramp":
        asked = (time / time[-1])[:, None] * 2 * twist
    elif kind == "reverse":
        asked = np.where(time < time[-1] / 2, 1.0, -1.0)[:, None] * twist
    elif kind == "much":
        asked = held(twist * rng.choice([5.0, 20.0, 1e4]), seconds, dt)[:n]
    elif kind == "zero":
        asked = np.zeros((n, len(rows)))
    elif kind == "hostile":
        return hostile(rng, rows, frame, twist, obstacles)
    else:
        asked = np.tile(twist, (n, 1))
    return Part(rows, frame, asked, enable=enable, obstacles=obstacles)


def person(rng: np.random.Generator, rows: tuple[str, ...], time: Array) -> Array:
    """(n, k) bursts with the speed of least jerk, pauses between them, and a tremor of 4 to 11 Hz on the bursts."""
    asked = np.zeros((len(time), len(rows)))
    begin = float(rng.uniform(0, 0.3))
    while begin < time[-1]:
        long = float(rng.uniform(0.4, 2.0))
        s = np.clip((time - begin) / long, 0, 1)
        bell = 16 * s**2 * (1 - s) ** 2
        shake = 1 + 0.05 * np.sin(2 * math.pi * rng.uniform(4, 11) * time + rng.uniform(0, 6))
        asked += (bell * shake)[:, None] * command(rng, rows, 0.05, 0.4)
        begin += long * rng.uniform(0.5, 1.0) + (rng.uniform(0, 1.0) if rng.random() < 0.5 else 0.0)
    return asked


def hostile(
    rng: np.random.Generator,
    rows: tuple[str, ...],
    frame: str,
    twist: Array,
    obstacles: Obstacles | Callable[[Array], Obstacles] | None,
) -> Part:
    """A few ticks with a number that is none, in the twist or in q."""
    n, bad = int(rng.integers(1, 30)), float(rng.choice([math.nan, math.inf, -math.inf, 1e300, -1e7]))
    asked, q = np.tile(twist, (n, 1)), np.zeros((n, 7))
    which = rng.integers(2)
    (asked, q)[which][:, rng.integers((asked, q)[which].shape[1])] = bad
    return Part(rows, frame, asked, obstacles=obstacles, hostile=q if which else None, fault=True)


def room(rng: np.random.Generator, q: Array) -> Obstacles:
    """One to three walls and posts around the chair: away from it, beside its outline, on it, or under the chair."""
    found: list[Disc | HalfPlane] = []
    c, s = math.cos(q[2]), math.sin(q[2])
    outline = q[:2] + CORNERS @ [[c, s], [-s, c]]
    for _ in range(int(rng.integers(1, PLACES + 1))):
        angle, kind = rng.uniform(0, 2 * math.pi), rng.random()
        normal = np.array([math.cos(angle), math.sin(angle)])
        radius = float(rng.choice([0.0, 0.02, 0.1, 0.4]))
        gap = rng.uniform(0.001, 0.1) if kind < 0.4 else rng.uniform(-0.6, 1.9) if kind < 0.8 else 0.0
        if rng.random() < 0.5 and kind < 0.8:
            size = rng.uniform(0.5, 2.0)  # a normal may have any length
            offset = size * (np.max(outline @ normal) + gap)
            found.append(HalfPlane((float(size * normal[0]), float(size * normal[1])), float(offset)))
            continue
        x, y = CORNERS[0] * rng.uniform(-1, 1, 2)
        x, y = (rng.choice([FRONT, REAR]), y) if rng.random() < 0.5 else (x, math.copysign(SIDE, y))
        ahead = (math.copysign(1.0, x), 0.0) if x in (FRONT, REAR) else (0.0, math.copysign(1.0, y))
        away = gap + radius if kind < 0.8 else 0.0
        x, y = x + away * ahead[0], y + away * ahead[1]
        found.append(Disc((float(q[0] + c * x - s * y), float(q[1] + s * x + c * y)), radius))
    return found


def judge_rest(run: Run, verdict: Verdict, u: Array) -> None:
    """Nothing asked, or the dead-man released: exactly at rest T + 1 s later, at the latest."""
    settled = round((run.chair.braking_time + 1.0) / run.dt)
    quiet, since = np.zeros(len(u), dtype=bool), 0
    previous = None
    for part, ticks in zip(run.parts, run.slices, strict=True):
        still = part.enable is not True or (not part.fault and part.target is None and not part.twist.any())
        since = since + ticks.stop - ticks.start if still else 0
        begin = ticks.stop - max(since - settled, 0)
        if still:
            quiet[max(begin, ticks.start) : ticks.stop] = True
        switched = previous is not None and previous != part.rows and bool(np.any(u[ticks.start - 1]))
        verdict.during("rows switched while moving", np.array([switched]), run.dt)
        previous = part.rows
    verdict.holds("without a command there is no motion", ~quiet | ~np.any(u, axis=1))
    verdict.during("at rest after the command", quiet, run.dt)


def judge_held(run: Run, verdict: Verdict) -> None:
    """The law in parts with one command, where no obstacle came too late before or in them."""
    obstacles: Obstacles = ()
    u = run.chair.chassis(run.q[:-1], np.array([each.value for each in run.commands]))
    valid = -1
    for part, ticks in zip(run.parts, run.slices, strict=True):
        if part.obstacles is not None:
            obstacles = tuple(part.obstacles)
            before = u[ticks.start - 1] if ticks.start else run.start
            if not run.chair.brakes_in_time(run.q[ticks.start], before, obstacles, run.dt):
                valid = ticks.stop  # so much of the run is of another state than the law speaks of
        at = run.q[ticks.start]
        inside = np.min(run.chair.obstacle_gaps(at, obstacles)) <= 0 or np.min(run.chair.arm_gaps(at)) <= 0
        if part.fault or part.enable is not True or ticks.start < valid or inside:
            continue
        if np.all(part.twist == part.twist[0]) and 1e-3 < np.linalg.norm(part.twist[0]) < 0.5:
            judge_law(run, verdict, part, ticks, obstacles)


run = judging(__name__, LEAST, Runs(one_run))
