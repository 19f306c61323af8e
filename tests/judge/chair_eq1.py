"""Far from every bound the answer is Honzik's Eq. (1), with inertia and posture cost written down once more.

Eq. (1): u = W^-1 J'(J W^-1 J')^-1 (r + v J g) - v g, W the inertia, g the gradient of the posture cost, v = |r|; of a
differential drive without the left speed, Eq. (5). The kinetic energy is that of the bodies named in `ardis`, and the
gradient is by finite differences. Judged are ticks far from every bound that the closed form answered: others look
ahead to where the robot could stop, and a least count sees to it that these are many. r is what the hand does: whether
it is what was asked, others judge. The Jacobian may be that of the tick's begin or of its middle, by this command or
the last one; `TOLERANCE` is for an instant in between.
"""

from __future__ import annotations

import numpy as np

from tests.judge.chair_claims import judge_ticks
from tests.judge.chair_robot import ROWS, Array, Chair, turned
from tests.judge.chair_runs import SETS, Part, Run, command, held, posture, record, resolver
from tests.judge.numbering import Runs, judging
from tests.judge.verdict import Verdict

GUARANTEES = ("G11",)
LEAST = {"far from every bound": 3e4}
CI_TICKS = 6_000
SHARE = 0.5
DT = 0.01
TOLERANCE = 2e-3
"""Of the largest speed of u."""
ROTORS = np.array([0.0, 0.0, 0.0, 0.15, 0.15, 0.10, 0.02])


def one_run(verdict: Verdict, number: int, rng: np.random.Generator) -> None:
    """A few commands in a row."""
    rows = SETS[number % 3]
    chair, made = resolver(("differential", "mecanum")[number // 3 % 2], (rows,), DT, 0)
    q = posture(chair, rng, ready=0.5)
    frame = "world" if rng.random() < 0.3 else "chassis"
    parts = [Part(rows, frame, held(command(rng, rows, 0.03, 0.1), rng.uniform(0.4, 1.0), DT)) for _ in range(4)]
    recorded = record(made, Run(chair, DT, np.zeros(7), parts, arcs=False), q)
    verdict.begin(number, f"{chair.drive} {rows} {frame}")
    found, u = judge_ticks(recorded, verdict)
    before = np.vstack([np.zeros(7), u[:-1]])
    q = recorded.q[:-1]
    room = np.minimum(chair.upper - q[:, 3:], q[:, 3:] - chair.lower)
    far = (
        np.all(room > 0.3, axis=1)
        & (np.min(chair.arm_gaps(q), axis=1) > 0.1)
        & np.all(np.abs(u) < 0.5 * chair.velocity, axis=1)
        & np.all(np.abs(u - before) < 0.3 * chair.acceleration * DT, axis=1)
        & (np.max(np.abs(u), axis=1) > 0.01)
        & (found.solver == "closed form")
    )
    for part, ticks in zip(parts, recorded.slices, strict=True):
        for k in np.flatnonzero(far[ticks])[20::7] + ticks.start:
            value = recorded.commands[k].value
            ways = np.zeros(7), DT / 2 * value, DT / 2 * recorded.commands[k - 1].value
            expected = [law(chair, q[k], u[k], instant(chair, q[k], way, part.rows, part.frame)) for way in ways]
            off = np.min(np.max(np.abs(u[k] - expected), axis=1)) / np.max(np.abs(u[k]))
            verdict.within("far from every bound the answer is Eq. (1)", [off], TOLERANCE, f"tick {k}")
    verdict.during("far from every bound", far, DT)


def instant(chair: Chair, q: Array, way: Array, rows: tuple[str, ...], frame: str) -> Array:
    """(k, 7) Jacobian at q + way by u at q, in the frame at q: that of a velocity held in the world."""
    task = chair.task(q + way, ROWS, "world")
    c, s = np.cos(way[2]), np.sin(way[2])
    task[:, :2] = task[:, :2] @ [[c, s], [-s, c]]
    if frame == "chassis":
        for part in (slice(0, 3), slice(3, 6)):
            task[part] = turned(task[part].T, -q[2]).T
    return task[[ROWS.index(row) for row in rows]]


def law(chair: Chair, q: Array, u: Array, task: Array) -> Array:
    """(7,) Eq. (1) for the hand's velocity that u (7,) makes."""
    moving = chair.moving
    r = task @ u
    w, j, g = inertia(chair, q)[np.ix_(moving, moving)], task[:, moving], gradient(chair, q)[moving]
    v = np.linalg.norm(r)
    soft = np.linalg.solve(w, j.T)
    found = np.zeros(7)
    found[moving] = soft @ np.linalg.solve(j @ soft, r + v * j @ g) - v * g
    return found


def inertia(chair: Chair, q: Array) -> Array:
    """(7, 7) by u: sum of m Jv'Jv + Jw' I Jw over chair, shoulder, upper arm, forearm, hand and payload, and rotors."""
    up, _, side, fore = chair.arm(q)
    shoulder, elbow, hand = chair.joints(q)
    axes = np.array([[0.0, -1.0, 0.0], up, -side, fore])
    origins = (shoulder, shoulder, elbow, elbow)
    total = np.diag(ROTORS)

    def add(mass: float, centre: Array, joints: int, along: Array, length: float, radius: float) -> None:
        linear, angular = np.zeros((3, 7)), np.zeros((3, 7))
        linear[0, 0] = linear[1, 1] = angular[2, 2] = 1.0
        linear[:2, 2] = -centre[1], centre[0]
        for i in range(joints):
            linear[:, 3 + i], angular[:, 3 + i] = np.cross(axes[i], centre - origins[i]), axes[i]
        spin, tilt = mass * radius**2 / 2, mass * (3 * radius**2 + length**2) / 12
        about = tilt * np.eye(3) + (spin - tilt) * np.outer(along, along)
        total[:] += mass * linear.T @ linear + angular.T @ about @ angular

    turning = np.zeros((7, 7))
    turning[0, 0] = turning[1, 1] = chair.chair_mass
    turning[2, 2] = 12.0
    total += turning
    add(2.0, shoulder, 1, axes[0], 0.1, 0.06)
    add(2.5, (shoulder + elbow) / 2, 2, up, chair.d5, 0.05)
    add(1.5, elbow + 0.4 * chair.d7 * fore, 3, fore, 0.8 * chair.d7, 0.04)
    add(0.8, hand - 0.06 * fore, 4, fore, 0.12, 0.04)
    add(chair.payload, hand, 4, fore, 0.0, 0.0)
    return total


def gradient(chair: Chair, q: Array) -> Array:
    """(7,) of the posture cost, by central differences."""
    step = 1e-5 * np.eye(7)
    step[:3] = 0.0
    return (cost(chair, q + step) - cost(chair, q - step)) / 2e-5


def cost(chair: Chair, q: Array) -> Array:
    """(...,) x^4/4 of each joint's place x in its range, and (1 - m)^2/2, m the squared volume of three columns."""
    middle, half = (chair.upper + chair.lower) / 2, (chair.upper - chair.lower) / 2
    x = (q[..., 3:] - middle) / half
    volume = np.linalg.det(chair.jacobian(q)[..., :3, 3:6])
    m = (volume / (chair.d5 * chair.d7**2)) ** 2
    return np.asarray(np.sum(x**4, axis=-1) / 4 + (1 - m) ** 2 / 2)


run = judging(__name__, LEAST, Runs(one_run))
