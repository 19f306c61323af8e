"""Whole-arm clearance judged by coal: `python -m bench.clearance`; needs `pip install coal`.

Distances of 10^5 random pairs of each kind, the least distances in closed loop among bodies that move, and what an arm
still does where its way is free.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from decimal import Decimal, localcontext
from itertools import product
from typing import NamedTuple

import coal
import eigenpy
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from scipy.optimize import linprog
from scipy.spatial.transform import Rotation

from bench.machine import machine
from bench.verdict import Reported, Verdict, all_met
from rehab_opt import Box, Clearance, MovingCapsule, PoseTracker, SerialChain
from rehab_opt.control.clearance_pairs import KINDS
from rehab_opt.kinematics.room import moving_numbers
from tests.control.clearance_world import MARGIN, Swinging, link_ends, robot, room

__all__ = ["main"]

Array = NDArray[np.float64]

ROBOTS = ("ur5", "panda", "six", "seven")
SPEED = 0.1
"""[m/s] of any point of a body that moves, at most."""
Z = np.array([0.0, 0.0, 1.0])
NEAR = 0.03
"""[m] Nearer than this beyond the margin, coal is asked."""
AGREED = 1e-12
"""[m] Where coal's distance of two capsules is further than this from ours, arithmetic of 50 digits judges both."""
NEARLY = 0.002
"""[m] Distances beyond the margin above which the judge of whole runs does not look."""
EPISODE = 4.0
"""[s]"""
ENOUGH = 0.05
"""[m] beyond the margin: the way is free where no part of the arm comes nearer without obstacles."""
MOVE = 1.0
"""[s] of a move whose work is measured."""
ARM_LENGTH = 0.3
"""[m] A turn of the tool counts as this way of it a rad."""


class Judge:
    """Distances by coal, of bodies made once."""

    def __init__(self, chain: SerialChain, given: Clearance) -> None:
        self.chain, self.given = chain, given

    @staticmethod
    def placed(a: Array, b: Array) -> tuple[coal.Transform3s, float]:
        """Pose of a capsule along coal's z axis, and its length [m]."""
        way = b - a
        length = float(np.linalg.norm(way))
        if length < 1e-14:
            return coal.Transform3s(np.eye(3), a), length
        turn = eigenpy.Quaternion.FromTwoVectors(Z, way if way[2] > 0 else -way)  # exact: never by more than a quarter
        return coal.Transform3s(turn.matrix(), (a + b) / 2), length

    @classmethod
    def capsules(cls, a: Array, b: Array, c: Array, d: Array, radii: tuple[float, float]) -> float:
        """[m] of two capsules."""
        (one, length), (other, another) = cls.placed(a, b), cls.placed(c, d)
        shapes = coal.Capsule(radii[0], length), coal.Capsule(radii[1], another)
        return float(coal.distance(shapes[0], one, shapes[1], other, coal.DistanceRequest(), coal.DistanceResult()))

    @classmethod
    def box(cls, a: Array, b: Array, radius: float, box: Box) -> float:
        """[m] of a capsule and a box, negative where they overlap."""
        one, length = cls.placed(a, b)
        other = coal.Transform3s(np.array(box.turn), np.array(box.centre))
        shapes = coal.Capsule(radius, length), coal.Box(*box.size)
        return float(coal.distance(shapes[0], one, shapes[1], other, coal.DistanceRequest(), coal.DistanceResult()))

    @classmethod
    def plane(cls, a: Array, b: Array, radius: float, normal: Array, offset: float) -> float:
        """[m] of a capsule above a half-space."""
        one, length = cls.placed(a, b)
        still = coal.Transform3s.Identity()
        half = coal.Halfspace(np.array(normal), offset)
        return float(
            coal.distance(coal.Capsule(radius, length), one, half, still, coal.DistanceRequest(), coal.DistanceResult())
        )

    def distances(
        self, ends: Array, moving: Sequence[MovingCapsule], *, within: float, links: Sequence[tuple[int, int]]
    ) -> list[tuple[str, float]]:
        """Body by body, less the margin, of links (L, 2, 3); none further than `within` by balls."""
        found = []
        middles, sizes = ends.mean(axis=1), np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / 2
        radii = [each.radius for each in self.chain.capsules]
        bodies = [(np.array(m.start), np.array(m.end), m.radius, f"moving {i}") for i, m in enumerate(moving)]
        bodies += [(np.array(c.start), np.array(c.end), c.radius, c.name) for c in self.given.capsules]
        for i in sorted({i for i, _ in links}):
            for a, b, radius, name in bodies:
                far = np.linalg.norm(middles[i] - (a + b) / 2) - sizes[i] - np.linalg.norm(b - a) / 2
                if far - radii[i] - radius - MARGIN < within:
                    found.append((name, self.capsules(*ends[i], a, b, (radii[i], radius)) - MARGIN))
            for box in self.given.boxes:
                far = np.linalg.norm(middles[i] - box.centre) - sizes[i] - np.linalg.norm(box.size) / 2
                if far - radii[i] - MARGIN < within:
                    found.append((box.name, self.box(*ends[i], radii[i], box) - MARGIN))
            found += [
                ("plane", self.plane(*ends[i], radii[i], np.array(plane.normal), plane.offset) - MARGIN)
                for plane in self.given.planes
                if middles[i] @ plane.normal - plane.offset - sizes[i] - radii[i] - MARGIN < within
            ]
        for i, j in links:
            if j < 0:
                continue
            far = np.linalg.norm(middles[i] - middles[j]) - sizes[i] - sizes[j]
            if far - radii[i] - radii[j] < within:
                found.append(("link", self.capsules(*ends[i], *ends[j], (radii[i], radii[j]))))
        return found

    def least(self, q: Array, bodies: Array, links: Sequence[tuple[int, int]], *, within: float = NEARLY) -> Array:
        """(N,) least distance beyond the margins at postures (N, n) among moving bodies (N, k, 7), at most `within`.

        By coal wherever distances in numpy, of boxes those of balls about them, are below `within`.
        """
        ends, found = link_ends(self.chain, q), np.full(len(q), within)
        radii = [each.radius for each in self.chain.capsules]
        still = [
            (np.broadcast_to(c.start, (len(q), 3)), np.broadcast_to(c.end, (len(q), 3)), c.radius)
            for c in self.given.capsules
        ]
        moving = [(body[:, :3], body[:, 3:6], float(body[0, 6])) for body in bodies.transpose(1, 0, 2)]
        for i in sorted({i for i, _ in links}):
            a, b = ends[:, i, 0], ends[:, i, 1]
            for c, d, radius in [*still, *moving]:
                for k in np.flatnonzero(segments(a, b, c, d) - radii[i] - radius - MARGIN < within):
                    found[k] = min(found[k], self.capsules(a[k], b[k], c[k], d[k], (radii[i], radius)) - MARGIN)
            for box in self.given.boxes:
                centre = np.broadcast_to(box.centre, a.shape)
                ball = segments(a, b, centre, centre) - np.linalg.norm(box.size) / 2
                for k in np.flatnonzero(ball - radii[i] - MARGIN < within):
                    found[k] = min(found[k], self.box(a[k], b[k], radii[i], box) - MARGIN)
            for plane in self.given.planes:
                heights = np.minimum(a @ plane.normal, b @ plane.normal) - plane.offset - radii[i] - MARGIN
                for k in np.flatnonzero(heights < within):
                    found[k] = min(
                        found[k], self.plane(a[k], b[k], radii[i], np.array(plane.normal), plane.offset) - MARGIN
                    )
        for i, j in links:
            if j < 0:
                continue
            apart = segments(ends[:, i, 0], ends[:, i, 1], ends[:, j, 0], ends[:, j, 1]) - radii[i] - radii[j]
            for k in np.flatnonzero(apart < within):
                found[k] = min(found[k], self.capsules(*ends[k, i], *ends[k, j], (radii[i], radii[j])))
        return found


def segments(a: Array, b: Array, c: Array, d: Array) -> Array:
    """(N,) [m] of segments, by going to and fro between nearest points: from above, and exact where that has ended."""
    u, v = b - a, d - c
    uu, vv, uv = (
        np.maximum(np.sum(x * y, axis=1), 1e-18) if x is y else np.sum(x * y, axis=1)
        for x, y in ((u, u), (v, v), (u, v))
    )
    gap = a - c
    least = np.full(len(a), np.inf)
    starts = [
        np.clip(
            (uv * np.sum(v * gap, axis=1) - vv * np.sum(u * gap, axis=1)) / np.maximum(uu * vv - uv * uv, 1e-18), 0, 1
        )
    ]
    for start in (*starts, np.zeros(len(a)), np.ones(len(a))):
        s = start
        for _ in range(3):
            t = np.clip(np.sum(v * (gap + s[:, None] * u), axis=1) / vv, 0, 1)
            least = np.minimum(least, np.linalg.norm(gap + s[:, None] * u - t[:, None] * v, axis=1))
            s = np.clip(-np.sum(u * (gap - t[:, None] * v), axis=1) / uu, 0, 1)
    return least


def exact_segments(a: Array, b: Array, c: Array, d: Array) -> float:
    """[m] of two segments that are no points, in arithmetic of 50 digits."""
    with localcontext(prec=50):
        a, b, c, d = (np.array([Decimal(float(x)) for x in each]) for each in (a, b, c, d))
        u, v, gap = b - a, d - c, a - c
        uu, vv, uv, gu, gv = u @ u, v @ v, u @ v, gap @ u, gap @ v
        ends = [Decimal(0), Decimal(1)]
        places = [(s, min(max((gv + s * uv) / vv, ends[0]), ends[1])) for s in ends]
        places += [(min(max((t * uv - gu) / uu, ends[0]), ends[1]), t) for t in ends]
        if sine := uu * vv - uv * uv:
            s = (uv * gv - vv * gu) / sine
            t = (uv * s + gv) / vv
            places += [(s, t)] if 0 <= s <= 1 and 0 <= t <= 1 else []
        gaps = [gap + s * u - t * v for s, t in places]
        return float(min(each @ each for each in gaps).sqrt())


def distances(count: int, seed: int) -> list[Verdict | Reported]:
    """Our distances beside coal's, of random pairs, half of which overlap or are nearly parallel."""
    rng = np.random.default_rng(seed)
    a, c = rng.uniform(-0.4, 0.4, (2, count, 3))
    b = a + rng.uniform(-0.4, 0.4, (count, 3))
    d = c + rng.uniform(-0.4, 0.4, (count, 3))
    beside, nearly = slice(0, count, 4), slice(1, count, 8)
    d[beside] = c[beside] + (b - a)[beside] * rng.uniform(-1, 1, (len(d[beside]), 1))
    d[nearly] = c[nearly] + (b - a)[nearly] * rng.uniform(-1, 1, (len(d[nearly]), 1))
    d[nearly] += rng.normal(size=d[nearly].shape) * 10.0 ** rng.uniform(-12, -2, (len(d[nearly]), 1))
    still, radii = np.zeros((count, 6)), np.full((count, 1), 0.15)
    ours = np.array(KINDS[0].distance.map(count)(np.hstack([a, b, c, d, still, radii]).T)).ravel()
    coals = np.array([Judge.capsules(*each, (0.1, 0.05)) for each in zip(a, b, c, d, strict=True)])
    judged, apart = coals.copy(), np.flatnonzero(~(np.abs(ours - coals) <= AGREED))
    judged[apart] = [exact_segments(*each) - 0.15 for each in zip(a[apart], b[apart], c[apart], d[apart], strict=True)]
    sizes, turns = rng.uniform(0.1, 0.8, (count, 3)), Rotation.random(count, rng=rng).as_matrix()
    columns = np.hstack([a, b, turns.transpose(0, 2, 1).reshape(count, 9), c, sizes / 2, np.full((count, 1), 0.05)])
    of_boxes = np.array(KINDS[1].distance.map(count)(columns.T)).ravel()
    boxes = [
        Box("box", tuple(x), tuple(size), tuple(map(tuple, turn)))
        for x, size, turn in zip(c, sizes, turns, strict=True)
    ]
    theirs = np.array([Judge.box(*each[:2], 0.05, each[2]) for each in zip(a, b, boxes, strict=True)])
    worst = float(np.abs(of_boxes - theirs).max())
    signs = int(np.sum((ours < 0) != (coals < 0)) + np.sum((of_boxes < 0) != (theirs < 0)))
    return [
        Verdict(
            f"capsules, {count} states, {np.mean(ours < 0):.0%} overlap: from coal, {len(apart)} from 50 digits",
            np.abs(ours - judged).max(),
            "<=",
            1e-9,
            "m",
        ),
        Reported("of these coal is off by, m", np.abs(coals - judged).max()),
        Verdict(f"boxes, {count} states, {np.mean(of_boxes < 0):.0%} overlap: from coal", worst, "<=", 1e-6, "m"),
        Verdict("states whose sign differs", signs, "<=", 0),
    ]


class Run(NamedTuple):
    """What came of many episodes."""

    ticks: int
    below: int
    least: float
    held: int
    """Ticks in which a body stood still since the arm had nowhere to go."""
    near: int
    """Ticks in which something was within a millimetre of the margin."""
    reversals: int
    """Of those, in which a joint's velocity went to, fro and to by a tenth of its acceleration bound or more."""
    uncertified: int


def _guarded(tracker: PoseTracker) -> list[tuple[int, int]]:
    """Pairs of links that are kept apart, and links that are kept from bodies (-1)."""
    pairs = tracker.limits.clearance
    assert pairs is not None
    return [*pairs.linked, *((i, -1) for i in pairs.free)]


def closed_loop(
    kind: str, ticks: int, seed: int, dt: float, *, max_contacts: int = Clearance.max_contacts, compile: object = "wait"
) -> Run:
    """A robot sent from random pose to random pose, among bodies that stand still and two that move."""
    rng = np.random.default_rng(seed)
    chain = robot(kind, rng)
    given = replace(room(chain, rng, moving=2), max_contacts=max_contacts)
    tracker = PoseTracker(chain, dt=dt, limits=[given], compile=compile)  # type: ignore[arg-type]
    judge, links = Judge(chain, given), _guarded(tracker)
    total = Run(0, 0, np.inf, 0, 0, 0, 0)
    low, high = 0.7 * np.maximum(chain.lower, -3), 0.7 * np.minimum(chain.upper, 3)
    while total.ticks < ticks:
        swinging = Swinging.drawn(rng, 2, SPEED)
        clock, going = np.zeros(2), np.ones(2)
        q = _clear_start(rng, chain, judge, swinging, links)
        if q is None:
            continue
        tracker.reset()
        postures, velocities, bodies, held, uncertified = [], [], [], 0, 0
        for k in range(round(EPISODE / dt)):
            if k % round(1.0 / dt) == 0:
                goal = chain.pose(rng.uniform(low, high))
            if k % 10 == 0:
                going = _may_go(chain, judge, q, swinging, clock, links)
            told = moving_numbers(swinging.at(clock, going), 2)
            command = tracker.step(q, goal, np.zeros(6), obstacles=told)
            q = q + dt * command.value
            postures.append(q)
            velocities.append(command.value)
            bodies.append(np.hstack([told[:, :6] + dt * told[:, 6:12], told[:, 12:13]]))
            uncertified += not command.status.certified
            held += int(not going.all())
            clock = clock + dt * going
        least = judge.least(np.array(postures), np.array(bodies), links)
        changes = np.diff(velocities, axis=0)
        fast = np.abs(changes) > 0.1 * chain.acceleration * dt
        turned = (changes[1:] * changes[:-1] < 0) & fast[1:] & fast[:-1]
        shaking = np.any(turned[1:] & turned[:-1], axis=1) & (least[3:] < 1e-3)
        total = Run(
            total.ticks + len(least), total.below + int(np.sum(least < -1e-9)), min(total.least, float(least.min())),
            total.held + held, total.near + int(np.sum(least < 1e-3)), total.reversals + int(shaking.sum()),
            total.uncertified + uncertified,
        )  # fmt: skip
        if least.min() < -1e-9 or shaking.any():
            print(
                f"  {kind} {seed}: least {least.min():.1e} at tick {np.argmin(least)}, {shaking.sum()} shaking",
                flush=True,
            )
    return total


class Work(NamedTuple):
    """What was done of moves whose way is free."""

    tried: int
    free: int
    without: float
    """[m] by which the tool came nearer to its goals without obstacles."""
    among: float
    """[m] the same among them."""
    least: float
    """Least share of one move."""


def work_done(kind: str, moves: int, seed: int, dt: float, *, compile: object = "wait") -> Work:
    """Moves of random postures, without a `Clearance` and with one; those count that are free without it."""
    rng = np.random.default_rng(seed)
    chain = robot(kind, rng)
    given = room(chain, rng, moving=2)
    free, among = (PoseTracker(chain, dt=dt, limits=limits, compile=compile) for limits in ([], [given]))  # type: ignore[arg-type]
    judge, links, count = Judge(chain, given), _guarded(among), round(MOVE / dt)
    found = Work(0, 0, 0.0, 0.0, np.inf)
    low, high = 0.7 * np.maximum(chain.lower, -3), 0.7 * np.minimum(chain.upper, 3)
    while found.tried < moves:
        swinging = Swinging.drawn(rng, 2, SPEED)
        start = _clear_start(rng, chain, judge, swinging, links)
        if start is None:
            continue
        goal = chain.pose(np.clip(start + rng.uniform(-0.6, 0.6, chain.n), low, high))
        told = [moving_numbers(swinging.at(np.full(2, k * dt), np.ones(2)), 2) for k in range(count + 1)]
        free.reset()
        q, postures = start, [start]
        for _ in range(count):
            q = q + dt * free.step(q, goal, np.zeros(6)).value
            postures.append(q)
        bodies = np.array([np.hstack([each[:, :6], each[:, 12:13]]) for each in told])
        ways = judge.least(np.array(postures), bodies, links, within=ENOUGH)
        done = _come_nearer(chain, start, q, goal)
        found = found._replace(tried=found.tried + 1)
        if ways.min() < ENOUGH or done < ENOUGH:  # what moves nothing has no share
            continue
        among.reset()
        q = start
        for k in range(count):
            q = q + dt * among.step(q, goal, np.zeros(6), obstacles=told[k]).value
        still = _come_nearer(chain, start, q, goal)
        found = Work(
            found.tried, found.free + 1, found.without + done, found.among + still, min(found.least, still / done)
        )
    return found


def _come_nearer(chain: SerialChain, start: Array, q: Array, goal: Array) -> float:
    """[m] by which the tool is nearer to its goal at q than at the start, turns counted by `ARM_LENGTH`."""
    away = []
    for pose in (chain.pose(start), chain.pose(q)):
        turn = Rotation.from_matrix(goal[:3, :3] @ pose[:3, :3].T).magnitude()
        away.append(float(np.linalg.norm(goal[:3, 3] - pose[:3, 3]) + ARM_LENGTH * turn))
    return away[0] - away[1]


def _clear_start(rng, chain, judge, swinging, links):  # type: ignore[no-untyped-def]
    bodies = swinging.at(np.zeros(2), np.ones(2))
    for _ in range(300):
        q = rng.uniform(0.7 * np.maximum(chain.lower, -3), 0.7 * np.minimum(chain.upper, 3))
        found = judge.distances(link_ends(chain, q[None])[0], bodies, within=0.02, links=links)
        if all(d > (0.001 if name == "link" else 0.01) for name, d in found):
            return q
    return None


def _may_go(chain, judge, q, swinging, clock, links):  # type: ignore[no-untyped-def]  # noqa: PLR0917
    """Which bodies may move on: none that is near where no joint velocity keeps all distances, by coal and an LP."""
    bodies = swinging.at(clock, np.ones(2))
    ends = link_ends(chain, q[None])[0]
    here = judge.distances(ends, bodies, within=NEAR, links=links)
    coming = {name for name, d in here if name.startswith("moving") and d < NEAR}
    if not coming:
        return np.ones(2)
    steps = 1e-6 * np.eye(chain.n)
    around = [judge.distances(e, bodies, within=NEAR, links=links) for e in link_ends(chain, q + steps)]
    later = [
        m._replace(start=m.start + 1e-6 * np.asarray(m.start_velocity), end=m.end + 1e-6 * np.asarray(m.end_velocity))
        for m in bodies
    ]
    ahead = judge.distances(ends, later, within=NEAR, links=links)
    if len({tuple(n for n, _ in each) for each in (here, ahead, *around)}) > 1:
        return np.zeros(2)
    d = np.array([x for _, x in here])
    slopes = (np.array([[x for _, x in each] for each in around]).T - d[:, None]) / 1e-6
    change = (np.array([x for _, x in ahead]) - d) / 1e-6
    keep = d < NEAR
    room_up, room_down = (np.minimum(each, 1.0) for each in (5 * (chain.upper - q), 5 * (q - chain.lower)))
    box = list(
        zip(
            -0.3 * chain.velocity * np.maximum(room_down, 0), 0.3 * chain.velocity * np.maximum(room_up, 0), strict=True
        )
    )
    answer = linprog(
        np.zeros(chain.n), A_ub=-slopes[keep], b_ub=change[keep] + 2.0 * np.maximum(d[keep] - 1e-3, 0), bounds=box
    )
    if answer.status == 0:
        return np.ones(2)
    return np.array([0.0 if f"moving {i}" in coming else 1.0 for i in range(2)])


def main() -> None:
    """Print every part's verdicts."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0] if __doc__ else "")
    parser.add_argument("--parts", nargs="*", default=["distances", "loop", "work"])
    parser.add_argument("--states", type=int, default=100_000)
    parser.add_argument("--ticks", type=int, default=1_000_000)
    parser.add_argument("--moves", type=int, default=1000)
    parser.add_argument("--worlds", type=int, default=3, help="of each robot")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--dt", type=float, default=0.001)
    parser.add_argument(
        "--max-contacts", type=int, default=Clearance.max_contacts, help="rows of a tick, in the closed loop"
    )
    parser.add_argument("--no-compile", action="store_true")
    given = parser.parse_args()
    console, code = Console(width=150), False if given.no_compile else "wait"
    verdicts: list[Verdict | Reported] = []
    if "distances" in given.parts:
        verdicts += distances(given.states, given.seed)
    if "loop" in given.parts:
        each = given.ticks // (len(ROBOTS) * given.worlds)
        runs = []
        for kind, k in product(ROBOTS, range(given.worlds)):
            began = time.perf_counter()
            runs.append(
                closed_loop(kind, each, given.seed + 100 * k, given.dt, max_contacts=given.max_contacts, compile=code)
            )
            print(kind, k, runs[-1], f"{time.perf_counter() - began:.0f} s", flush=True)
        ticks, below, near = (sum(getattr(run, name) for run in runs) for name in ("ticks", "below", "near"))
        least, held, reversals = (
            min(run.least for run in runs),
            sum(run.held for run in runs),
            sum(run.reversals for run in runs),
        )
        verdicts += [
            Verdict(f"{ticks} ticks among bodies of at most {SPEED} m/s: below the margin by coal", below, "<=", 0),
            Reported("least distance beyond the margin, m", least),
            Reported("ticks within 1 mm of the margin", near),
            Reported("ticks in which bodies stood still since the arm had nowhere to go", held),
            Verdict("ticks at contact in which a joint went to and fro", reversals, "<=", 0),
        ]
    if "work" in given.parts:
        each = given.moves // (len(ROBOTS) * given.worlds)
        works = [
            work_done(kind, each, given.seed + 100 * k, given.dt, compile=code)
            for kind, k in product(ROBOTS, range(given.worlds))
        ]
        count, without, among = (sum(getattr(work, name) for work in works) for name in ("free", "without", "among"))
        fraction = among / without if without else np.nan
        verdicts += [
            Verdict(f"{count} moves whose way is free: work done of that without bodies", fraction, ">=", 0.9),
            Reported("the same of the worst of them", min(work.least for work in works)),
        ]
    console.print(machine())
    asked = [each for each in verdicts if isinstance(each, Verdict)]
    for each in verdicts:
        console.print(str(each), highlight=False, soft_wrap=True)
    sys.exit(0 if all_met(asked) else 1)


if __name__ == "__main__":
    main()
