"""The chair with limits of a user's own, clear of bodies that stand and that move.

Chairs with ARDIS and with arms from files, each limit drawn around where they start: an elbow above a tilted plane, a
hand in a box or a ball that stands in the room while the chair drives, out of a ball, or upright; walls and a heading
for the chair itself. Judged in each tick, also under a released stick, by the judge's own kinematics: no distance
falls below zero, nor further; no body comes nearer than it does by itself; all that is judged of any chair; and what is
said of it. In a quarter of the runs sticks lead an arm from a file, which has no limits besides, at keep-outs.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rehab_opt import Limit, MovingCapsule, RedundancyResolver, Relaxed
from tests.judge.chair_claims import judge_ticks
from tests.judge.chair_held import BRAKING, SIZE
from tests.judge.chair_moved import judge_rest, one_part
from tests.judge.chair_reach import judge_target
from tests.judge.chair_robot import STAND_OFF, Array, Chair, placed
from tests.judge.chair_runs import OTHER_SETS, SETS, Part, Run, held, motion, posture, record
from tests.judge.clearance_bodies import (
    EDGE,
    Scene,
    clearance_of,
    coming,
    put_around,
    standing,
    where,
)
from tests.judge.mounted_arms import Mounted, mounted
from tests.judge.numbering import Runs, judging
from tests.judge.verdict import Answers, Verdict

GUARANTEES = ("G07", "G08", "G12", "G13")
# A stick that leads at a limit stays there, or never comes: of 75 000 ticks 0 to 1000 are at one kind.
LEAST = {
    "status ok": 400_000, "status blocked": 10_000, "braking near a limit": 30, "law judged": 1000,
    "at a limit: in a box": 100, "at a limit: in a ball": 500, "at a limit: out of a ball": 1000,
    "at a limit: upright": 500, "at the margin of a capsule": 200, "at the margin of a box": 100,
    "at the margin of a plane": 50, "at the margin of a body that moves": 300,
    "reaching": 50_000, "a limit near, turned across the world": 10_000,
    "numbers that are none, moving": 100, "the dead-man released, moving": 500, "at rest after the command": 5000,
    "an arm from a file": 100_000, "a keep-out near an arm from a file": 10_000,
    "limits that are come to faster than all can brake": 50_000, "a velocity told that leads at a limit": 200,
}  # fmt: skip
CI_TICKS = 3000
SHARE = 0.3
KINDS = ("above a plane", "in a box", "in a ball", "out of a ball", "upright", "chair within walls", "chair's heading")
EPISODES, SECONDS, STICKS = 2, 5.0, 3
LEADS, KEPT_OUT = 0.3, 5e-3
"""[m] From a keep-out, from which on a stick leads there, and what counts as near."""
PLACES = 3
"""Of walls and posts."""
NEAR = 2e-3
"""[rad, m] of a limit or margin what counts as at it."""
FASTER = 0.1
"""[m/s, rad/s] By so much braking together may be faster than a barrier: ways bend."""
ROUNDING = 1e-9
"""[rad, m] What sums may miss a limit by."""
MAX_MAGNITUDE = 1e6
"""A number beyond it is no position."""
BESIDE, ROUND = 5e-3, 0.3
"""[m] of a standing body within which a link comes round its edges; of the command, across it, there."""
TRIED = 20
"""Velocities, one of which leads at a limit perhaps."""
AWAY, TIMES, PASSES = 0.05, 1.2, 0.1
"""[m] A body that moves is given way to from no further off, and the way that it comes nearer in that many times T;
[m] at which it passes, as it is told to go on, where its other end comes."""


class Wish(NamedTuple):
    """A user's limit: one distance or several."""

    kind: str
    elbow: int | None
    """Frame of the chain whose origin it is of, at a joint of the arm; None for the hand."""
    ways: Array
    """(k, 3) of planes' normals, a ball's middle, the axis that the hand points along; of the chair's place."""
    rooms: Array
    """(k,) [m or rad] of planes; a ball's radius; cosine."""
    rate: float | None
    unit: float
    """Of its distances, in m or rad."""

    def limit(self) -> Limit:
        """As a user states it."""

        def distances(chain: Any, q: ca.SX) -> ca.SX:
            frames = chain.frames_expression(q)
            pose = frames[-1]
            if self.kind.startswith("chair"):
                place = q[:3]
            else:
                place = pose[:3, 2] if self.kind == "upright" else frames[self.elbow or -1][:3, 3]
            if "ball" in self.kind:
                radius, middle = float(self.rooms[0]), ca.DM(self.ways[0])
                left = (radius**2 - ca.sumsqr(place - middle)) / (2 * radius)
                return self.unit * (left if self.kind == "in a ball" else -left)
            return self.unit * (ca.DM(self.ways) @ place + ca.DM(self.rooms))

        return Limit(distances, rate=self.rate)

    def numbers(self, chair: Chair, q: Array) -> Array:
        """(N, k) the distances at q (N, n) [m or rad]."""
        if self.kind.startswith("chair"):
            place = q[:, :3]
        elif self.kind == "upright":
            place = chair.orientation(q)[..., 2]
        else:
            place = chair.hand(q) if self.elbow is None else elbow(chair, q, self.elbow)
        if "ball" in self.kind:
            radius = float(self.rooms[0])
            left = (radius**2 - np.sum((place - self.ways[0]) ** 2, axis=-1, keepdims=True)) / (2 * radius)
            return np.asarray(left if self.kind == "in a ball" else -left)
        return np.asarray(place @ self.ways.T + self.rooms)


def elbow(chair: Chair, q: Array, frame: int) -> Array:
    """(..., 3) [m] of the joint at that frame of the chain in the world."""
    return chair.elbow(q, frame) if isinstance(chair, Mounted) else placed(chair.joints(q)[1], q)


def wish(rng: np.random.Generator, chair: Chair, q: Array, tightest: float, *, beside: bool) -> Wish:
    """A limit some way off the posture q (n,), or a ball `beside` the hand; a ball of that radius at least [m]."""
    kind = "out of a ball" if beside else str(rng.choice(KINDS))
    slower, faster = rng.uniform(0.5, 1.0), rng.uniform(2.0, 8.0)  # than all joints can brake together
    rate = rng.choice([None, None, None, slower, faster])
    rate = None if rate is None else float(rate / longest(chair))
    unit, frame = float(rng.choice([1.0, 1.0, 0.1, 1000.0])), None
    if kind == "above a plane" or ("ball" in kind and not beside and rng.random() < 0.5):
        frame = 5 if not isinstance(chair, Mounted) else 3 + int(rng.integers(1, chair.n))
    point = (chair.hand(q[None]) if frame is None else elbow(chair, q[None], frame))[0]
    room = float(rng.choice([0.02] if beside else [0.02, 0.05, 0.15, 0.4])) * rng.uniform(0.5, 1.0)
    room = -0.02 if rng.random() < 0.05 and not beside else room  # beyond it already
    way = rng.standard_normal(3)
    way /= np.linalg.norm(way)
    if kind == "in a box":
        axes = np.linalg.qr(rng.standard_normal((3, 3)))[0] if rng.random() < 0.5 else np.eye(3)
        ways = np.vstack([axes.T, -axes.T])
        return Wish(kind, frame, ways, rng.uniform(0.02, 0.5, 6) - ways @ point, rate, unit)
    if kind == "above a plane":
        return Wish(kind, frame, way[None], np.array([room - way @ point]), rate, unit)
    if "ball" in kind:
        radius = rng.uniform(tightest, 6 * tightest)
        out = radius - min(room, 0.9 * radius) if kind == "in a ball" else radius + room
        return Wish(kind, frame, (point + out * way)[None], np.array([radius]), rate, unit)
    if kind == "upright":
        axis = chair.orientation(q[None])[0, :, 2]
        way = axis + 0.5 * way
        way /= np.linalg.norm(way)
        return Wish(kind, frame, way[None], np.array([0.3 * room - way @ axis]), rate, unit)
    if kind == "chair's heading":
        ways = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
        return Wish(kind, frame, ways, rng.uniform(0.05, 0.5, 2) - ways @ q[:3], rate, unit)
    angles = rng.uniform(0, 2 * math.pi) + np.array([0.0, 2.0, 4.2])
    ways = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(3)])
    return Wish(kind, frame, ways, rng.uniform(0.03, 0.4, 3) - ways @ q[:3], rate, unit)


class Case(NamedTuple):
    """A chair, what it has to keep, and its controller."""

    chair: Chair
    made: Any
    dt: float
    sets: tuple[tuple[str, ...], ...]
    wishes: list[Wish]
    scene: Scene | None
    places: int
    """Of walls and posts."""
    alone: bool
    few: bool
    """Whether a clearance has fewer slots than by default."""
    bare: bool = False
    """Whether keep-outs are all that it has to keep."""


def alone(number: int) -> bool:
    """Whether one body that moves slowly is all there is in this run."""
    return number % 8 == 5


def beside_a_ball(number: int) -> bool:
    """Whether a ball beside the hand, that each stick leads at, is all there is in this run."""
    return number % 8 == 6


def sharp(number: int) -> bool:
    """Whether balls are small, and a velocity that is told may lead beyond a limit: then accelerations yield to it."""
    return number % 5 in {2, 3}


def comes_near(case: Case, q: Array, u: Array) -> bool:
    """Whether braking from q (n,) and u (n,) leads to a limit, or beyond."""
    way = case.chair.braked(q, u, case.dt)
    return min((each.numbers(case.chair, way).min() for each in case.wishes), default=1.0) < NEAR


def one_slow_body(case: Case) -> bool:
    """Whether that is so in the case that was drawn."""
    return case.alone and case.scene is not None and bool(case.scene.moving)


def draw(rng: np.random.Generator, number: int) -> tuple[Case, Array]:
    """A chair and where it starts: own limits, bodies, or both."""
    drive, dt = ("fixed", "differential", "mecanum")[number % 3], float(rng.choice([0.005, 0.01, 0.01, 0.02]))
    sets = (SETS[0], (SETS + OTHER_SETS)[int(rng.integers(1, len(SETS + OTHER_SETS)))])
    if rng.random() < 0.6:
        chair = Chair(drive)
        q = posture(chair, rng)
    else:
        chair, joints = mounted(rng, drive, sets)
        q = np.concatenate([rng.uniform(-0.3, 0.3, 2), rng.uniform(-3, 3, 1), joints])
    scene = None
    ball = beside_a_ball(number)
    count = 0 if number % 4 == 3 or alone(number) else 1 if ball else int(rng.integers(1, 4))
    wishes = [wish(rng, chair, q, 0.02 if sharp(number) else 0.1, beside=ball) for _ in range(count)]
    if not wishes or (rng.random() < 0.4 and not ball):
        scene = around(rng, number, chair, q, dt)
    rng.random()  # drawn for nothing, so that runs that were broken once keep their numbers
    places = PLACES if rng.random() < 0.25 and not alone(number) else 0
    limits: list[Any] = [each.limit() for each in wishes]
    max_contacts = 8
    if scene is not None:
        place, max_contacts = int(rng.integers(len(limits) + 1)), int(rng.choice([2, max_contacts]))
        limits.insert(place, clearance_of(scene, max_contacts))
    made = RedundancyResolver(
        chair.robot(), drive=drive, row_sets=sets, dt=dt, max_obstacles=places, limits=limits, compile=False,  # type: ignore[arg-type]
    )  # fmt: skip
    return Case(chair, made, dt, sets, wishes, scene, places, alone(number), max_contacts < 8), q


def around(rng: np.random.Generator, number: int, chair: Chair, q: Array, dt: float) -> Scene:
    """Bodies about the ways of the links, in the world."""
    links = [(0, np.zeros((2, 3)), radius) for *_, radius in chair.bodies(q)]
    kinds = (3,) if alone(number) else ((0, 3), (1, 2), (0, 1))[int(rng.integers(3))]
    scene = Scene(links, float(rng.choice([0.0, 0.02, 0.05])), 0.0, False, [], [], [], [])
    speed = rng.uniform(-1, 1, (8, len(q))) * np.isin(np.arange(len(q)), chair.moving) * chair.velocity
    ways = np.vstack([q, q + rng.uniform(0.2, 0.8, (8, 1)) * speed])
    return put_around(rng, scene, kinds, segments(chair, ways), alone=alone(number))


def segments(chair: Chair, q: Array) -> list[Array]:
    """(N, 2, 3) [m] of each link in the world at q (N, n)."""
    return [np.stack([placed(one, q), placed(other, q)], axis=1) for one, other, _ in chair.bodies(q)]


def aimed(rng: np.random.Generator, case: Case, q: Array, rows: tuple[str, ...], frame: str) -> Array:
    """(k,) a direction of these rows that leads at a limit or a body, of a `bare` arm at a keep-out."""
    chair = case.chair
    u = rng.standard_normal((24, len(q))) * np.isin(np.arange(len(q)), chair.moving) * chair.velocity
    there = np.vstack([q, q + 1e-3 * chair.world(np.broadcast_to(q, u.shape), u)])
    found = [each.numbers(chair, there) for each in case.wishes]
    if case.bare:
        gaps = chair.arm_gaps(there)
        found = [gaps[:, gaps[0] < max(LEADS, gaps[0].min() + EDGE)]]
    if case.scene is not None:
        ends = segments(chair, there)
        found += [*standing(case.scene, ends).values()]
        if case.scene.moving:
            found.append(coming(case.scene, ends, where(case.scene, np.zeros(len(there)))))
    if found:
        chosen = found[int(rng.integers(len(found)))]
        u = u[[int(np.argmin(chosen[1:, int(rng.integers(chosen.shape[1]))]))]]
    direction = chair.task(q, rows, frame) @ u[0]
    size = np.linalg.norm(direction)
    direction = direction / size if size > 1e-6 else rng.standard_normal(len(rows))
    direction = direction + 0.1 * rng.standard_normal(len(rows))
    return np.asarray(direction / np.linalg.norm(direction))


def parts_of(rng: np.random.Generator, case: Case, q: Array) -> list[Part]:
    """A stick that leads at something, then others, or places to reach."""
    dt, spent, parts = case.dt, 0, list[Part]()
    slow = one_slow_body(case)
    reaching = not slow and rng.random() < 0.25
    while spent < SECONDS / dt:
        part = one_part(rng, case.sets, dt, () if not parts else None)
        if not case.places:
            part = part._replace(obstacles=None)
        n = min(len(part.twist), round(2.5 / dt))
        part = part._replace(twist=part.twist[:n], hostile=None if part.hostile is None else part.hostile[:n])
        if part.hostile is not None:
            hostile = np.zeros((n, len(q)))
            hostile[:, int(rng.integers(len(q)))] = part.hostile.sum(axis=1)
            part = part._replace(hostile=hostile)
        elif not part.fault and (slow or not parts or rng.random() < 0.5):
            way = aimed(rng, case, q, part.rows, part.frame)
            swings = np.sin(np.arange(n) * dt * rng.uniform(0.5, 2.5))[:, None] if parts and rng.random() < 0.5 else 1.0
            size = rng.uniform(0.05, 0.3) * (0.2 if slow else 1.0)
            part = part._replace(twist=size * swings * np.tile(way, (n, 1)), enable=True)
        if reaching and not part.fault:
            target = case.chair.hand(q) + rng.uniform(0.1, 0.6) * aimed(rng, case, q, SETS[0], "world")
            part = part._replace(target=target, rows=SETS[0], frame="world", twist=np.zeros((n, 3)))
        if part.enable is True and not part.fault and rng.random() < 0.3:  # let go on the way, by one hand or the other
            n = int(rng.integers(round(0.2 / dt), n + round(0.2 / dt) + 1))
            part = part._replace(twist=part.twist[:n])
            rest = np.zeros((round((case.chair.braking_time + 1.2) / dt), len(part.rows)))
            other = rng.choice([True, False])
            parts += [part, part._replace(twist=rest if other else rest + part.twist[-1], enable=bool(other),
                                          target=None, obstacles=None)]  # fmt: skip
        else:
            parts.append(part)
        spent = sum(len(each.twist) for each in parts)
    return parts


def one_run(verdict: Verdict, number: int, rng: np.random.Generator) -> None:
    """One chair."""
    case, start = draw(rng, number)
    for _ in range(EPISODES):
        episode(verdict, number, rng, case, start)


def beside_keep_outs(verdict: Verdict, number: int, rng: np.random.Generator) -> None:
    """An arm from a file, which has nothing else to keep, under sticks that lead its links at bodies of the chair's."""
    drive, dt = ("fixed", "fixed", "differential", "mecanum")[number % 4], float(rng.choice([0.01, 0.01, 0.02]))
    rows = (SETS[0], SETS[0], SETS[1], SETS[2])[int(rng.integers(4))]
    chair, start = mounted(rng, drive, [SETS[0], rows])
    made = RedundancyResolver(chair.robot(), drive=drive, row_sets=[rows], dt=dt, max_obstacles=0, compile=False)  # type: ignore[arg-type]
    case = Case(chair, made, dt, (rows,), [], None, 0, False, False, bare=True)
    for _ in range(STICKS):
        again = chair.free_posture(rng)
        q = np.concatenate([rng.uniform(-0.3, 0.3, 3), start if again is None else again])
        twist = rng.uniform(0.1, 0.25) * aimed(rng, case, q, rows, "chassis")
        part = Part(rows, "chassis", held(twist, SECONDS, dt))
        run = record(made, Run(chair, dt, np.zeros(len(q)), [part], arcs=False), q)
        verdict.begin(number, f"{chair.n} joints, {drive} {rows} dt {dt:g}, {len(chair.capsules)} capsules")
        near = chair.arm_gaps(run.q[:-1]).min(axis=1)
        found, _ = judge_ticks(run, verdict, excused=near < STAND_OFF)
        none = np.zeros(len(near), dtype=bool)
        judge_part(verdict, case, run, part, slice(0, len(near)), found, none, none)
        verdict.during("a keep-out near an arm from a file", near < KEPT_OUT, dt)


def episode(verdict: Verdict, number: int, rng: np.random.Generator, case: Case, q: Array) -> None:
    """Sticks, from the posture q (n,) on."""
    chair, dt = case.chair, case.dt
    parts = parts_of(rng, case, q)
    begun = motion(chair, q, rng, dt) if rng.random() < 0.3 else np.zeros(len(q))
    if case.scene is not None or (comes_near(case, q, begun) and not sharp(number)):
        begun = np.zeros(len(q))
    elif sharp(number):
        some = (motion(chair, q, rng, dt) for _ in range(TRIED))
        begun = next((u for u in some if comes_near(case, q, u)), begun)
    ticks = sum(len(part.twist) for part in parts)
    places, there = moving_bodies(rng, case, ticks)
    told = None
    if case.scene is not None and case.scene.moving:
        speeds, radii = [np.diff(place, axis=0) / dt for place in places], [body[1] for body in case.scene.moving]
        told = [
            [MovingCapsule(*places[i][k], radii[i], *speeds[i][k]) for i in np.flatnonzero(there[k])]
            for k in range(ticks)
        ]
    run = record(case.made, Run(chair, dt, begun, parts, arcs=False, moving=told), q)
    kinds, scene = ", ".join(each.kind for each in case.wishes), case.scene
    counts = [] if scene is None else [len(each) for each in (scene.capsules, scene.boxes, scene.moving)]
    told_of = f"capsules, boxes, moving {counts}"
    verdict.begin(number, f"{type(chair).__name__} {chair.drive} dt {dt:g}, {kinds}, {told_of}")
    judge(verdict, case, run, places, there)


def moving_bodies(rng: np.random.Generator, case: Case, ticks: int) -> tuple[list[Array], NDArray[np.bool_]]:
    """Segments (ticks + 1, 2, 3) of what moves, and whether each is there (ticks, m): they come and go."""
    if case.scene is None:
        return [], np.ones((ticks, 0), dtype=bool)
    places = where(case.scene, case.dt * np.arange(ticks + 1))
    there = np.ones((ticks, len(places)), dtype=bool)
    for column in there.T:
        if rng.random() < 0.3:
            begin = int(rng.integers(ticks))
            column[begin : begin + int(rng.integers(ticks))] = False
    return places, there


# ----------------------------------------------------------------------------------------------------------- judging
def judge(verdict: Verdict, case: Case, run: Run, places: list[Array], there: NDArray[np.bool_]) -> None:
    """All claims of one run."""
    chair, dt, q, ends = case.chair, case.dt, run.q[:-1], run.ends
    n = len(q)
    inside, edge, near, beyond = (np.zeros(n, dtype=bool) for _ in range(4))
    slowest, falls = longest(chair), np.full(n, -math.inf)
    readable = np.concatenate([np.ones(len(part.twist), dtype=bool) if part.hostile is None else
                               (np.abs(part.hostile) < MAX_MAGNITUDE).all(axis=1) for part in run.parts])  # fmt: skip
    known = np.logical_or.accumulate(readable)  # where the robot is, since a first sample that could be read
    for each in case.wishes:
        now, then = each.numbers(chair, q), each.numbers(chair, ends)
        verdict.within(f"{each.kind}: below zero, or further [m or rad]", (np.minimum(now, 0) - then)[known], ROUNDING)
        rate = 1 / slowest if each.rate is None else each.rate
        falls = np.maximum(falls, ((now - then) / dt - rate * np.maximum(now, 0)).max(axis=1))
        least = now.min(axis=1)
        beyond |= least < ROUNDING
        inside, edge, near = inside | (least < 0), edge | (np.abs(least) < EDGE), near | (np.abs(least) < NEAR)
        verdict.during(f"at a limit: {each.kind}", np.abs(least) < NEAR, dt)
    apart = moved = stays = np.full((n, 1), math.inf)
    beside, deep = np.zeros(n, dtype=bool), np.zeros(n, dtype=bool)
    if case.scene is not None:
        here, later = segments(chair, q), segments(chair, ends)
        for kind, gaps in standing(case.scene, here).items():
            then = standing(case.scene, later)[kind]
            verdict.within(f"nearer to a {kind} than the margin and before [m]", np.minimum(gaps, 0) - then, 1e-8)
            falls = np.maximum(falls, ((gaps - then) / dt - np.maximum(gaps, 0) / slowest).max(axis=1))
            beyond |= (gaps < ROUNDING).any(axis=1)
            beside |= (gaps < BESIDE).any(axis=1)
            inside, edge = inside | (gaps < 0).any(axis=1), edge | (np.abs(gaps) < EDGE).any(axis=1)
            deep |= (gaps < -EDGE).any(axis=1)
            near |= (np.abs(gaps) < NEAR).any(axis=1)
            verdict.during(f"at the margin of a {kind}", (np.abs(gaps) < NEAR).any(axis=1), dt)
        if case.scene.moving:
            gone = np.where(np.tile(there, len(case.scene.links)), 0.0, math.inf)
            before, after = [place[:-1] for place in places], [place[1:] for place in places]
            apart, stays, moved = (coming(case.scene, *each) + gone for each in
                                   ((here, before), (here, after), (later, after)))  # fmt: skip
            verdict.within("nearer to a moving body than it came itself [m]", np.minimum(stays, 0) - moved, 1e-8)
            inside, edge = inside | (apart < 0).any(axis=1), edge | (np.abs(apart) < EDGE).any(axis=1)
            verdict.during("at the margin of a body that moves", (np.abs(apart) < NEAR).any(axis=1), dt)
    gives_way = giving_way(case, q, places, apart, stays, there)
    hasty = np.full(n, any(each.rate is not None and each.rate > 1 / slowest for each in case.wishes))
    verdict.during("limits that are come to faster than all can brake", hasty, dt)
    told = np.arange(n) < round((slowest + 1.0) / dt) * run.start.any()  # that velocity knew of no barrier
    hurries = told & comes_near(case, q[0], run.start)
    excused = gives_way | beyond | hurries | (beside & case.few) | ~known
    found, u = judge_ticks(run, verdict, excused=excused, led=hurries)
    hurried = found.relaxed & Relaxed.ACCELERATION.value != 0  # where that may be is judged with the accelerations
    met = np.where(gives_way | inside | told | hurried, -math.inf, falls)
    verdict.during("a velocity told that leads at a limit", hurries & near, dt)
    verdict.within("come to faster than its barrier [m/s or rad/s]", met, FASTER)
    arm = q[:, 3:]
    rooms = np.minimum(chair.arm_gaps(q).min(axis=1), np.minimum(arm - chair.lower, chair.upper - arm).min(axis=1))
    inside, edge = inside | (rooms < 0), edge | (np.abs(rooms) < EDGE)
    if not case.places:
        flagged = found.relaxed & Relaxed.POSITION.value != 0
        # Before the first position that it can read, a controller knows no posture to speak of.
        unknown = ~np.logical_or.accumulate(np.isin(found.status, ("ok", "backup", "blocked")))
        verdict.holds("beyond a limit or within a margin is flagged, and nothing else is",
                      (inside == flagged) | edge | unknown)  # fmt: skip
    judge_rest(run, verdict, u)
    safe = ~np.isin(found.status, ("ok", "backup", "blocked"))
    verdict.during("braking near a limit", safe & near & u.any(axis=1), dt)
    turns = np.abs(np.sin(q[:, 2])) > 0.7
    verdict.during("a limit near, turned across the world", near & turns, dt)
    verdict.during("an arm from a file", np.full(n, isinstance(chair, Mounted)), dt)
    for part, span in zip(run.parts, run.slices, strict=True):
        # Who begins within a body is led out of it, against the stick if need be: the law begins clear of bodies.
        unjudged = gives_way | since(deep, round((slowest + 1.0) / dt))
        judge_part(verdict, case, run, part, span, found, unjudged, since(beside, round(slowest / dt)))


def longest(chair: Chair) -> float:
    """[s] T of all joints, a base that stands among them."""
    return float(np.max(chair.velocity / chair.acceleration))


def giving_way(
    case: Case, q: Array, places: list[Array], apart: Array, stays: Array, there: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """(n,) whether a body comes, or came within T + 1 s, so near and fast that accelerations may yield to it.

    By how fast what is nearest comes now, and by where the body, going on as it is told to, is within about T: its
    other end may come faster.
    """
    slowest, dt = longest(case.chair), case.dt
    with np.errstate(invalid="ignore"):
        comes = np.nan_to_num(np.maximum(apart - stays, 0.0)) / dt
    yields = (stays < AWAY + TIMES * slowest * comes).any(axis=1)
    if case.scene is not None and places:
        here, gone = segments(case.chair, q), np.where(np.tile(there, len(case.scene.links)), 0.0, math.inf)
        for part in np.linspace(0.2, 1.0, 5):
            ahead = [place[:-1] + part * TIMES * slowest / dt * np.diff(place, axis=0) for place in places]
            yields = yields | ((coming(case.scene, here, ahead) + gone < PASSES) & (comes > 0)).any(axis=1)
    return since(np.asarray(yields), round((slowest + 1.0) / dt))


def since(happened: NDArray[np.bool_], ticks: int) -> NDArray[np.bool_]:
    """(n,) whether it happens, or did within so many ticks."""
    return np.convolve(happened, np.ones(ticks + 1))[: len(happened)] > 0.5


def judge_part(
    verdict: Verdict, case: Case, run: Run, part: Part, span: slice, found: Answers, excused: NDArray[np.bool_],
    beside: NDArray[np.bool_],
) -> None:  # fmt: skip
    """The law of one stick, or of a place to reach."""
    chair, dt = case.chair, case.dt
    q, ends = run.q[:-1][span], run.ends[span]
    near = excused[span]
    if part.fault or part.enable is not True:
        return
    if part.target is not None:
        verdict.during("reaching", np.ones(len(q), dtype=bool), dt)
        if case.scene is None or not case.scene.moving:
            judge_target(run, verdict, found, part, span)
        return
    size = float(np.linalg.norm(part.twist[0]))
    late = math.ceil((chair.braking_time + 1.0) / dt)
    if not np.all(part.twist == part.twist[0]) or size < 1e-3 or size > 0.5 or len(q) <= late or near.any() or case.few:
        return
    hand = chair.hand_velocity(q, ends, dt, part.rows, part.frame)[late:] / size
    way = part.twist[0] / size
    along, chord = hand @ way, max(1.0, dt / 0.01)
    across = np.linalg.norm(hand - along[:, None] * way, axis=1)
    verdict.within("law: the hand is no faster than the command", along, 1 + SIZE * chord)
    verdict.within("law: against the command", -along, BRAKING)
    round_ = beside[span][late:]
    verdict.within("law: across the command", np.where(round_, 0.0, across), BRAKING)
    verdict.within("law: across the command, beside a body that stands", np.where(round_, across, 0.0), ROUND)
    verdict.during("law judged beside a body that stands", round_, dt)
    verdict.during("law judged", np.ones(len(along), dtype=bool), dt)


run = judging(__name__, LEAST, Runs(one_run, 3 / 4), Runs(beside_keep_outs, 1 / 4, 1_000_000))
