"""The chair beside walls and posts: it goes into none, turning or not, and sticks held there obey the law.

Each run is one held command for some seconds with one to three obstacles a few centimetres from the outline: walls
along its sides or across, posts before its faces and corners. Now and then one comes while the chair moves, and in
some runs others come again and again, most of them too late; there, too, the QP has an answer, braking at least.
"""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np

from rehab_opt import ConfigurationError, RedundancyResolver
from rehab_opt.control.obstacles import Disc, HalfPlane
from tests.judge.chair_claims import judge_ticks
from tests.judge.chair_held import judge_law
from tests.judge.chair_moved import PLACES, room
from tests.judge.chair_robot import CORNERS, Array, Obstacles
from tests.judge.chair_runs import SETS, Part, Run, command, held, posture, record, resolver
from tests.judge.numbering import Runs, judging
from tests.judge.verdict import Verdict

GUARANTEES = ("G13",)
LEAST = {
    "an obstacle near": 1e5,
    "turning beside an obstacle": 2e4,
    "a wall near": 5e4,
    "a post near": 2e4,
    "law judged": 1e5,
    "an obstacle came too late": 10,
    "obstacles come again and again": 1e5,
}
CI_TICKS = 14_000
SHARE = 1.0
DT = 0.01
NUMBERLESS: Any = (math.nan, math.inf, -math.inf, 1.7e308, -1.7e308, None, True, "1", 1j, (1.0, 2.0))
"""No places in metres, nor numbers that a wall's normal can be made of where both are that."""
CROWDED, COME = 5, 40
"""One run in so many is of so many times other obstacles."""


def one_run(verdict: Verdict, number: int, rng: np.random.Generator) -> None:
    """One command beside what stands there from the begin, or comes after a while."""
    if number % CROWDED == 3:
        crowded(verdict, number, rng)
        return
    rows = SETS[number % 5 % 2]  # most often x, y, z, which turns a chair
    chair, made = resolver(("differential", "mecanum")[number % 2], SETS, DT, PLACES)
    q = posture(chair, rng, ready=0.5)
    twist = command(rng, rows, 0.05, 0.3)
    frame = "world" if rng.random() < 0.3 else "chassis"
    late = rng.random() < 0.2
    obstacles = beside(rng, q)
    parts = [Part(rows, frame, held(twist, rng.uniform(3.0, 8.0), DT), obstacles=obstacles)]
    if late:
        seed = int(rng.integers(2**31))
        there = parts[0]._replace(obstacles=lambda at: beside(np.random.default_rng(seed), at))
        parts = [Part(rows, frame, held(twist, rng.uniform(0.5, 2.0), DT), obstacles=()), there]
    verdict.begin(number, f"{chair.drive} {rows} {frame} {np.round(twist, 4)}")
    if number == 0:
        refused(verdict, made)
    recorded = record(made, Run(chair, DT, np.zeros(7), parts, arcs=bool(rng.random() < 0.3)), q)
    _, u = judge_ticks(recorded, verdict)
    part, ticks = recorded.parts[-1], recorded.slices[-1]
    around = part.obstacles
    assert isinstance(around, tuple)
    near = chair.obstacle_gaps(recorded.q[ticks], around)[:, 1:] < 0.01
    walls = np.array([isinstance(each, HalfPlane) for each in around])
    verdict.during("a wall near", np.any(near & walls, axis=1), DT)
    verdict.during("a post near", np.any(near & ~walls, axis=1), DT)
    verdict.during("turning beside an obstacle", np.any(near, axis=1) & (np.abs(u[ticks][:, 2]) > 0.02), DT)
    before = u[ticks.start - 1] if ticks.start else np.zeros(7)
    if chair.brakes_in_time(recorded.q[ticks.start], before, around, DT):
        judge_law(recorded, verdict, part, ticks, around)


def crowded(verdict: Verdict, number: int, rng: np.random.Generator) -> None:
    """Others each tenth of a second or so, and another command, for a chair that is under way."""
    chair, made = resolver(("differential", "mecanum")[number // CROWDED % 2], SETS, DT, PLACES)
    q, rows = posture(chair, rng, ready=0.5), SETS[rng.integers(len(SETS))]
    parts = [Part(rows, "chassis", held(command(rng, rows, 0.1, 0.5), rng.uniform(0.5, 1.5), DT), obstacles=())]
    for rooms in rng.spawn(COME):
        twist = held(command(rng, rows, 0.1, 0.5), rng.uniform(0.05, 0.25), DT)
        parts.append(Part(rows, "chassis", twist, obstacles=partial(room, rooms)))
    recorded = record(made, Run(chair, DT, np.zeros(7), parts, arcs=False), q)
    verdict.begin(number, f"{chair.drive} {rows}, obstacles come again and again")
    found, _ = judge_ticks(recorded, verdict)
    verdict.during("obstacles come again and again", np.ones(len(found.solver), dtype=bool), DT)
    verdict.holds("the QP has an answer in every tick", found.solver != "braking together")


def refused(verdict: Verdict, made: RedundancyResolver) -> None:
    """What is no obstacle is refused, named, and changes nothing."""
    known, told = made.obstacles, []
    wrong: list[Any] = [HalfPlane((0.0, 0.0), 1.0), Disc((1.0, 1.0), -0.1), (1.0, 2.0, 3.0)]
    for none in NUMBERLESS:
        wrong += [
            HalfPlane((none, none), 1.0),
            HalfPlane((1.0, 0.0), none),
            Disc((1.0, none), 0.1),
            Disc((1.0, 1.0), none),
        ]
    for each in wrong:
        try:
            made.obstacles = [each]
            told.append("")
        except ConfigurationError as problem:
            told.append(str(problem))
    verdict.holds("what is no obstacle is refused by name", [each.startswith("obstacles[0]") for each in told])
    verdict.holds("what is refused changes nothing", made.obstacles is known)


def beside(rng: np.random.Generator, q: Array) -> Obstacles:
    """One to three, 2 mm to 10 cm from the outline at q."""
    found: list[HalfPlane | Disc] = []
    for _ in range(int(rng.integers(1, PLACES + 1))):
        gap = 10 ** rng.uniform(-2.7, -1.0)
        face = float(rng.integers(4)) * math.pi / 2
        angle = face + (rng.normal(0.0, 0.03) if rng.random() < 0.6 else rng.uniform(-0.8, 0.8))
        heading = q[2] + angle
        normal = np.array([math.cos(heading), math.sin(heading)])
        if rng.random() < 0.6:
            c, s = math.cos(q[2]), math.sin(q[2])
            reach = float(np.max((q[:2] + CORNERS @ [[c, s], [-s, c]]) @ normal))
            found.append(HalfPlane((float(normal[0]), float(normal[1])), reach + gap))
            continue
        radius = float(rng.choice([0.0, 0.02, 0.1, 0.3]))
        edge = CORNERS[0] * rng.uniform(-1.05, 1.05, 2)
        side = round(face / (math.pi / 2)) % 2
        sign = 1.0 if face < 0.75 * math.pi else -1.0
        outer = np.array([0.55 if sign > 0 else -0.45, sign * 0.33])
        edge[side] = outer[side] + sign * (gap + radius)
        c, s = math.cos(q[2]), math.sin(q[2])
        found.append(Disc((float(q[0] + c * edge[0] - s * edge[1]), float(q[1] + s * edge[0] + c * edge[1])), radius))
    return tuple(found)


run = judging(__name__, LEAST, Runs(one_run))
