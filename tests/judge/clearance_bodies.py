"""The distance that an arm's links keep from bodies that stand and that move, and from each other.

`PoseTracker` on a UR5 with capsules on its links, led through bodies that are put on its way. Judged by the judge's own
distances: bodies that stand still are not come nearer to than the margin, braking and faulty ticks included, and who is
nearer gets no nearer; the arm's own motion adds nothing to that of a body that comes; one body alone is kept clear of
while joint speeds allow; who could go straight along what is asked, slowly and within every barrier, does not stand.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rehab_opt import Box, Capsule, Clearance, KeepOut, LinkCapsule, MovingCapsule, PoseTracker, ur5
from tests.judge.chair_robot import segments_apart
from tests.judge.numbering import Runs, judging
from tests.judge.references import good_posture, minimum_jerk, reaches
from tests.judge.sensor_faults import Schedule, schedule, spoilt
from tests.judge.ur5_numbers import LIMIT, frames, hand_twist, jacobian, tool, turn_between
from tests.judge.verdict import Verdict

GUARANTEES = ("G08",)
LEAST = {"at the margin of a capsule": 20_000, "at the margin of a box": 10_000, "at the margin of a plane": 3000,
         "at the margin of a body that moves": 10_000, "at the margin of a link": 1000, "gives way to one body": 1000,
         "braking near a body": 1000, "nothing near, all of the task": 20_000, "may go on": 150_000}  # fmt: skip
CI_TICKS = 1200
SHARE = 0.2
Array = NDArray[np.float64]
FAULTS = ("pose", "twist", "all", "disabled")
TICKS, REST = 300, 100
NEAR, SLACK, EDGE, STEP = 2e-3, 1e-8, 5e-6, 1e-6
"""[m] from the margin what counts as at it; what rounding takes; who is so near it may be inside or not; [rad]."""
SLOTS = 8
GAIN, SINGULAR = 20.0, 0.03
"""[1/s] of the tracker; smallest singular value of the Jacobian below which the direction may be left."""
STANDS, SLOW, WHILE, SLOWEST = 5e-3, 0.02, 10, 1.0
"""[rad/s] of all joints for `WHILE` ticks, of a joint that goes slowly; [1/s], less than any barrier's rate here: no
joint takes longer than 0.6 s to its speed."""
LINKS = ("upper_arm", "forearm", "hand")
PAIR = 0, 2
"""Upper arm and hand: links that are no neighbours."""


class Scene(NamedTuple):
    """An arm and what is around it; segments are (2, 3) [m]."""

    links: list[tuple[int, Array, float]]
    margin: float
    self_margin: float
    linked: bool
    capsules: list[tuple[Array, float]]
    boxes: list[tuple[Array, Array, Array]]
    """Centre, half sizes, axes by columns."""
    planes: list[tuple[Array, float]]
    moving: list[tuple[Array, float, Array, Array, float]]
    """Segment in the middle, radius, swing of its start and of its end (3,), [rad/s]."""


# ------------------------------------------------------------------------------------------------------- distances
def ends_of(link: tuple[int, Array, float], q: Array) -> Array:
    """(N, 2, 3) [m] of a link's segment at q (N, 6)."""
    frame, ends, _ = link
    poses = frames(q)[:, frame]
    return np.asarray(np.einsum("nij,ej->nei", poses[:, :3, :3], ends) + poses[:, None, :3, 3])


def between(one: Array, other: Array) -> Array:
    """(N,) [m] of segments (N, 2, 3)."""
    return segments_apart(one[:, 0], one[:, 1], other[:, 0], other[:, 1])


def box_apart(segments: Array, box: tuple[Array, Array, Array]) -> Array:
    """(N,) [m] of segments (N, 2, 3) from a box, 0 where they cut it: convex along the segment, searched by thirds."""
    centre, half, axes = box
    begin, end = ((segments - centre) @ axes).transpose(1, 2, 0)[:, :, None]
    way, room = end - begin, half[:, None, None]
    low, high = np.zeros(len(segments)), np.ones(len(segments))

    def away(*t: Array) -> Array:
        beyond = np.maximum(np.abs(begin + np.stack(t) * way) - room, 0.0)
        return np.asarray(np.sqrt((beyond * beyond).sum(axis=0)))

    for _ in range(60):
        third = (high - low) / 3
        one, other = low + third, high - third
        left = np.less_equal(*away(one, other))
        low, high = np.where(left, low, one), np.where(left, other, high)
    return np.asarray(away(low, high, np.zeros_like(low), np.ones_like(low)).min(axis=0))


def segments_of(scene: Scene, q: Array) -> list[Array]:
    """(N, 2, 3) [m] of each link."""
    return [ends_of(link, q) for link in scene.links]


def standing(scene: Scene, ends: list[Array]) -> dict[str, Array]:
    """(N, pairs) [m] less the margin, of each kind of body that stands still; `ends` (N, 2, 3) of each link."""
    radii, margin, count = [link[2] for link in scene.links], scene.margin, ends[0].shape
    found: dict[str, list[Array]] = {"capsule": [], "box": [], "plane": [], "link": []}
    for one, radius in zip(ends, radii, strict=True):
        for body, other in scene.capsules:
            found["capsule"].append(between(one, np.broadcast_to(body, count)) - radius - other - margin)
        found["box"] += [box_apart(one, box) - radius - margin for box in scene.boxes]
        found["plane"] += [(one @ normal).min(axis=1) - offset - radius - margin for normal, offset in scene.planes]
    if scene.linked:
        one, other = PAIR
        found["link"].append(between(ends[one], ends[other]) - radii[one] - radii[other] - scene.self_margin)
    return {kind: np.column_stack(each) for kind, each in found.items() if each}


def coming(scene: Scene, ends: list[Array], places: list[Array]) -> Array:
    """(N, pairs) [m] less the margin, from bodies that move, whose segments (N, 2, 3) are given, as the links' are."""
    found = [
        between(segments, place) - link[2] - body[1] - scene.margin
        for link, segments in zip(scene.links, ends, strict=True)
        for body, place in zip(scene.moving, places, strict=True)
    ]
    return np.column_stack(found) if found else np.empty((len(ends[0]), 0))


def where(scene: Scene, times: Array) -> list[Array]:
    """Segments (N, 2, 3) [m] of the moving bodies at these times."""
    return [
        middle + np.stack([start, end]) * np.sin(rate * times[:, None, None])
        for middle, _, start, end, rate in scene.moving
    ]


# ----------------------------------------------------------------------------------------------------------- scenes
def alone(number: int) -> bool:
    """Whether one body that moves slowly is all there is in this run."""
    return number % 4 == 3


def folds(number: int) -> bool:
    """Whether hand and upper arm keep clear of each other in this run, where the arm folds up."""
    return number % 4 == 1


def draw(rng: np.random.Generator, number: int, joints: Array) -> Scene:
    """Bodies near places that the links would come by, clear of the arm at the start; few begin within the margin."""
    radii = rng.uniform(0.03, 0.06, 3)
    side, tip = rng.uniform(-0.03, 0.03, (2, 3)), rng.uniform([-0.1, -0.1, 0.0], [0.1, 0.1, 0.15])
    links = [
        (2, np.array([[0.425, 0.0, 0.136], [0.0, 0.0, 0.136]]) + side[0], radii[0]),
        (3, np.array([[0.392, 0.0, 0.016], [0.05, 0.0, 0.016]]) + side[1], radii[1]),
        (6, np.array([np.zeros(3), tip if rng.random() < 0.8 else np.zeros(3)]), radii[2]),
    ]
    scene = Scene(links, float(rng.choice([0.0, 0.02])), 0.01, folds(number), [], [], [], [])
    kinds = ((0, 3), (1, 2), (0,), (3,))[number % 4]
    return put_around(rng, scene, kinds, segments_of(scene, joints), alone=alone(number))


def put_around(
    rng: np.random.Generator, scene: Scene, kinds: tuple[int, ...], ends: list[Array], *, alone: bool
) -> Scene:
    """The scene and up to two bodies of each kind beside the ways of its links (N, 2, 3), clear of their begin."""
    begins = [each[:1] for each in ends]
    for _ in range(40):
        if alone and scene.moving:
            break
        passed = ends[int(rng.integers(len(ends)))][int(rng.integers(len(ends[0])))]
        place = passed[0] + rng.random() * (passed[1] - passed[0]) + 0.05 * rng.standard_normal(3)
        half = rng.uniform(0.0, 0.2) * rng.standard_normal(3) if rng.random() < 0.8 else np.zeros(3)
        segment, radius = np.array([place - half, place + half]), float(rng.uniform(0.0, 0.06))
        turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
        turn *= np.sign(np.linalg.det(turn))
        normal = rng.standard_normal(3)
        normal /= np.linalg.norm(normal)
        kind, swing = int(rng.choice(kinds)), rng.uniform(0.0, 0.25) * rng.standard_normal((2, 3))
        if alone:  # towards the link, and through it if that would stay
            away = rng.uniform(0.15, 0.4) * normal
            segment, swing = segment + away, 0.2 * swing - 1.5 * away
        fast = (0.15 if alone else 1.0) / max(float(np.linalg.norm(swing, axis=1).max()), 0.05)
        more = (
            scene._replace(capsules=[*scene.capsules, (segment, radius)]),
            scene._replace(boxes=[*scene.boxes, (place, rng.uniform(0.02, 0.2, 3), turn)]),
            scene._replace(planes=[*scene.planes, (normal, float(normal @ place))]),
            scene._replace(moving=[*scene.moving, (segment, radius, *swing, rng.uniform(0.2, 1.0) * fast)]),
        )[kind]
        clear = [each.min() for each in standing(more, begins).values()]
        clear += coming(more, begins, where(more, np.zeros(1))).ravel().tolist()
        least = -0.02 if rng.random() < 0.05 and kind in (0, 2) else 0.01
        counts = len(more.capsules), len(more.boxes), len(more.planes), len(more.moving)
        if min(clear, default=1.0) > least and max(counts) <= 2:
            scene = more
    return scene


def tracker(rng: np.random.Generator, scene: Scene, dt: float, max_contacts: int) -> PoseTracker:
    """A tracker told of them."""
    capsules = [LinkCapsule(name, frame, *map(tuple, ends.tolist()), radius)  # type: ignore[arg-type]
                for name, (frame, ends, radius) in zip(LINKS, scene.links, strict=True)]  # fmt: skip
    arm = ur5(velocity=rng.uniform(1.0, 3.0), acceleration=rng.uniform(5.0, 30.0), capsules=tuple(capsules))
    return PoseTracker(arm, gain=GAIN, dt=dt, limits=[clearance_of(scene, max_contacts)], compile=False)


def clearance_of(scene: Scene, max_contacts: int) -> Clearance:
    """What a controller is told of the scene."""
    return Clearance(
        margin=scene.margin, self_margin=scene.self_margin,
        pairs=[(LINKS[PAIR[0]], LINKS[PAIR[1]])] if scene.linked else (),
        planes=[KeepOut.through(normal * offset, normal) for normal, offset in scene.planes],
        capsules=[Capsule(f"bar {i}", *map(tuple, ends.tolist()), radius)  # type: ignore[arg-type]
                  for i, (ends, radius) in enumerate(scene.capsules)],
        boxes=[Box(f"box {i}", tuple(c.tolist()), tuple((2 * half).tolist()), tuple(map(tuple, axes.tolist())))  # type: ignore[arg-type]
               for i, (c, half, axes) in enumerate(scene.boxes)],
        moving=len(scene.moving), max_contacts=max_contacts,
    )  # fmt: skip


def one_run(verdict: Verdict, number: int, rng: np.random.Generator) -> None:
    """One arm, one room."""
    start, dt = good_posture(rng, 0.3), float(rng.choice([0.005, 0.01, 0.02]))
    joints = reaches(rng, start, TICKS - REST, dt * 2, size=1.2)
    joints = np.concatenate([joints, np.repeat(joints[-1:], REST, axis=0)])
    if number % 8 == 7:
        joints[:] = start
    if folds(number):
        joints[:, 2] += minimum_jerk(TICKS) * (np.copysign(2.9, start[2]) - joints[:, 2])
    scene = draw(rng, number, joints)
    max_contacts = int(rng.choice([2, SLOTS]))
    control = tracker(rng, scene, dt, max_contacts)
    poses, twists = tool(joints), hand_twist(joints, np.gradient(joints, dt, axis=0))
    faulty = number % 3 == 1
    wrong: Schedule = schedule(rng, TICKS, dt, FAULTS, every=0.3 if faulty else np.inf)
    q, commands = np.empty((TICKS + 1, 6)), []
    q[0], times = start, dt * np.arange(TICKS + 1)
    places = where(scene, times)
    speeds = [np.diff(place, axis=0) / dt for place in places]  # so that they are where they were told to go
    radii = [body[1] for body in scene.moving]
    for k in range(TICKS):
        given = q[k], poses[k], twists[k]
        if wrong.kind[k]:
            given = (q[k], *spoilt(wrong, k, *given)[1:])
        around = [
            MovingCapsule(*place[k], radius, *speed[k])
            for place, radius, speed in zip(places, radii, speeds, strict=True)
        ]
        command = control.step(*given, obstacles=around or None, enable=wrong.enable[k])
        commands.append(command)
        q[k + 1] = q[k] + dt * command.value
    verdict.begin(number, f"dt {dt:g}, {len(scene.capsules)} capsules, {len(scene.boxes)} boxes, "
                  f"{len(scene.planes)} planes, {len(scene.moving)} moving")  # fmt: skip
    ends, later = segments_of(scene, q), [place[1:] for place in places]
    still, moved = standing(scene, ends), coming(scene, ends, places)
    stays = coming(scene, [each[:-1] for each in ends], later)
    answers = verdict.answers(commands, dt)
    for kind, apart in still.items():
        verdict.within(
            f"nearer to a {kind} than the margin and before [m]", np.minimum(apart[:-1], 0) - apart[1:], SLACK
        )
    verdict.within("nearer to a moving body than it came itself [m]", np.minimum(stays, 0) - moved[1:], SLACK)
    every = np.column_stack([*still.values(), moved])
    inside, flagged = (every[:-1] < -SLACK).any(axis=1), answers.relaxed & 1 != 0
    edge = (np.abs(every[:-1]) < EDGE).any(axis=1)
    verdict.holds("a link within a margin is flagged, and nothing else is", (inside == flagged) | edge)
    acts = np.isin(answers.status, ("ok", "backup", "blocked"))
    if alone(number):
        near = acts & (moved[1:] < -SLACK).any(axis=1) & ~inside
        verdict.holds(
            "one body is kept clear of while joint speeds allow", ~near | ~could(scene, control, q, places, near)
        )
        verdict.during("gives way to one body", acts & (stays < 0).any(axis=1) & ~inside, dt)
    stands = acts & (np.abs(answers.value) < STANDS).all(axis=1)
    stands &= np.convolve(stands, np.ones(WHILE))[: len(stands)] >= WHILE
    unmoved = np.column_stack([*(apart[:-1] for apart in still.values()), stays])
    goes = may_go_on(scene, q, poses, twists, every, unmoved, later, dt)
    verdict.holds("who may go on does not stand", ~stands | ~goes)
    verdict.during("may go on", acts & goes, dt)
    for kind, apart in {**still, "body that moves": moved}.items():
        verdict.during(f"at the margin of a {kind}", (np.abs(apart[:-1]) < NEAR).any(axis=1), dt)
    verdict.during("braking near a body", ~acts & (np.abs(every[:-1]) < NEAR).any(axis=1), dt)
    verdict.during("nothing near, all of the task", (every[:-1] > 0.1).all(axis=1) & (answers.relaxed == 0) & acts, dt)


def could(
    scene: Scene, control: PoseTracker, q: Array, places: list[Array], which: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """(N,) of these ticks: whether joint speeds alone could have kept the nearest link at the margin, and half more."""
    found = np.zeros(len(which), dtype=bool)
    for k in np.flatnonzero(which):
        here, then = ([place[i : i + 1] for place in places] for i in (k, k + 1))
        ends = segments_of(scene, q[k : k + 1])
        nearby = [segments_of(scene, (q[k] + step)[None]) for step in STEP * np.eye(6)]
        reach = reach_of(q[k], control.chain.velocity * control.dt, -LIMIT, LIMIT)
        found[k] = could_keep(coming(scene, ends, here)[0], coming(scene, ends, then)[0],
                              np.concatenate([coming(scene, each, then) for each in nearby]), reach)  # fmt: skip
    return found


def may_go_on(
    scene: Scene, q: Array, poses: Array, twists: Array, every: Array, unmoved: Array, later: list[Array], dt: float
) -> NDArray[np.bool_]:
    """(N,) whether the arm could go on slowly along the asked twist within its joint limits and every barrier.

    `every` (N + 1, m) [m] are its distances less the margin, `unmoved` (N, m) those after each tick of an arm that
    stands, `later` where moving bodies are then. A body that is within the margin and leaves it in this tick may not
    be followed yet: the arm's own motion adds nothing.
    """
    here, moves = tool(q[:-1]), jacobian(q[:-1])
    turn = turn_between(poses[:, :3, :3], here[:, :3, :3])
    error = np.concatenate([poses[:, :3, 3] - here[:, :3, 3], turn], axis=1)
    asked = twists + (1 - np.exp(-GAIN * dt)) / dt * error
    regular = np.linalg.svd(moves, compute_uv=False)[:, -1] > SINGULAR
    way = np.zeros_like(asked)
    way[regular] = np.linalg.solve(moves[regular], asked[regular][..., None])[..., 0]
    fastest = np.abs(way).max(axis=1, keepdims=True)
    there = q[:-1] + dt * way * SLOW / np.maximum(fastest, SLOW)
    ends = segments_of(scene, there)
    then = np.column_stack([*standing(scene, ends).values(), coming(scene, ends, later)])
    nearer = (every[:-1] < 0) & (then < unmoved)
    kept = ((then >= (1 - SLOWEST * dt) * np.maximum(every[:-1], 0)) & ~nearer).all(axis=1)
    return np.asarray(regular & (fastest[:, 0] > SLOW) & kept & (np.abs(q[:-1]) < LIMIT - SLOW).all(axis=1))


def reach_of(q: Array, most: Array, lower: Array, upper: Array) -> Array:
    """(2, n) [rad, m] by which joints at q (n,) may turn back and on, by `most` (n,) and to their limits."""
    return np.stack([np.clip(q - lower, 0, most), np.clip(upper - q, 0, most)])


def could_keep(now: Array, later: Array, nearby: Array, reach: Array) -> bool:
    """Whether joints that turn by `reach` (2, n) could have kept the nearest of these distances less the margin (m,).

    `later` is what a body's motion makes of `now`, `nearby` (n, m) the same with each joint turned by `STEP`.
    """
    i = int(np.argmin(later))
    slopes = (nearby[:, i] - later[i]) / STEP
    gains = float((np.abs(slopes) * np.where(slopes > 0, reach[1], reach[0])).sum())
    return bool(now[i] >= 0 and later[i] + gains / 1.5 > 0 and float(np.sort(later)[1]) > 0.05)


run = judging(__name__, LEAST, Runs(one_run))
