"""The person who is led: the hand goes where their arm can, and back within their range it is given back as it was.

Judged with the arm of Table I in plain numpy, somewhere beside the robot: where the reference is within the range of
motion the robot's hand is at it; where it is beyond, the hand comes to rest at a pose that some posture within the
range has, and no posture near that one is nearer to the reference, a radian counting as a tenth of a metre.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from rehab_opt import Interaction, MirrorTracker, SerialChain, human_arm, ur5
from tests.judge.arm_ik_answers import RANGES, hand_pose
from tests.judge.numbering import Runs, judging
from tests.judge.references import good_posture, minimum_jerk
from tests.judge.ur5_numbers import LARGEST, manipulability, tool, turn_between
from tests.judge.verdict import Verdict

GUARANTEES = ("G20",)
LEAST = {"within the range": 50_000, "beyond the range": 50_000, "judged at rest": 500}
CI_TICKS = 3600
SHARE = 0.05
TURN = 0.1
"""[m/rad]"""
NEAR, REACHED = 2e-3, 2e-3
"""[m] of the hand from a reference within the range; of its pose from one that the arm has."""
LAG = 1e-3
"""[m] by which the model of the led arm may lag behind a pose within its range."""
FOUND = 150
"""Ticks at most that the model of the led arm takes to its first posture."""
STARTS = 40
"""Postures at most from which one with the hand's pose is looked for: a least square may end beside it."""
NEAREST = 0.02
"""[m] by which another posture may be nearer."""


def one_run(verdict: Verdict, number: int, rng: np.random.Generator) -> None:
    """A reach of two seconds, held for four."""
    beyond, dt = number % 2 == 1, 0.01
    start = good_posture(rng, 0.6)
    lower, upper = np.deg2rad(np.array(RANGES["regular"], dtype=float)).T
    grip = np.eye(4)
    grip[:3, :3] = Rotation.from_rotvec(rng.standard_normal(3)).as_matrix()
    grip[:3, 3] = rng.uniform(-0.05, 0.05, 3)
    here = rng.uniform(lower + 0.2 * (upper - lower), upper - 0.2 * (upper - lower))
    base = tool(start[None])[0] @ np.linalg.inv(hand_pose(here[None])[0] @ grip)
    way = rng.uniform(lower, upper) - here
    if beyond:
        out = rng.choice(8, 2, replace=False)
        way[out] = rng.choice([-1.0, 1.0], 2) * (upper - lower)[out] * rng.uniform(0.8, 1.2, 2)
        way = np.clip(way, -0.8, 0.8)
    part = np.r_[np.zeros(20), minimum_jerk(200), np.ones(380)]
    joints = here + 0.8 * part[:, None] * way
    poses = base @ hand_pose(joints) @ grip
    twists = np.zeros((len(part), 6))
    twists[1:, :3] = np.diff(poses[:, :3, 3], axis=0) / dt
    twists[1:, 3:] = turn_between(poses[1:, :3, :3], poses[:-1, :3, :3]) / dt
    arm = dataclasses.replace(human_arm(range_of_motion="regular"), base=base)
    control = tracker(arm, grip, dt)
    verdict.begin(number, "beyond the range" if beyond else "within the range")
    q, commands, short = np.empty((len(part) + 1, 6)), [], []
    q[0] = start
    for k, (pose, twist) in enumerate(zip(poses, twists, strict=True)):
        commands.append(control.step(q[k], pose, twist))
        short.append((*control.short, *control.beyond_person))
        q[k + 1] = q[k] + dt * commands[-1].value
    answers = verdict.answers(commands, dt)
    finding = np.char.find(answers.reason, "finds its posture") >= 0
    verdict.within("ticks until the person's posture is found", finding.sum(), FOUND)
    found = tool(q[1:])
    apart = np.linalg.norm(found[:, :3, 3] - poses[:, :3, 3], axis=1)
    easy = bool(manipulability(q).min() > 0.1 and (answers.status[-100:] == "ok").all() and control.lag < 1e-3)
    outside = ((joints < lower) | (joints > upper)).any(axis=1)
    if not outside.any() and not finding[-20:].any():
        verdict.within("model away from a reference within the range, in the end [m]",
                       np.array(short)[-20:, 2], LAG)  # fmt: skip
        verdict.within("model turned from a reference within the range, in the end [rad]",
                       np.array(short)[-20:, 3], LAG / TURN)  # fmt: skip
    if easy and not outside.any():
        verdict.within("hand away from a reference within the range, in the end [m]", apart[-20:], NEAR)
        verdict.during("within the range", np.ones(len(part), dtype=bool), dt)
    if easy and outside.any():
        verdict.during("beyond the range", outside, dt)
    if easy:
        goal = np.linalg.inv(base) @ found[-1] @ np.linalg.inv(grip)
        asked = np.linalg.inv(base) @ poses[-1] @ np.linalg.inv(grip)
        posture, missing = nearest(goal, np.clip(joints[-1], lower, upper), lower, upper)
        for begin in rng.uniform(lower, upper, (STARTS, 8)):
            if missing <= REACHED:
                break
            posture, missing = min((posture, missing), nearest(goal, begin, lower, upper), key=lambda each: each[1])
        verdict.within("hand's pose from one that the arm has [m]", missing, REACHED)
        _, best = nearest(asked, posture, lower, upper)
        verdict.within("another posture is nearer to the reference by [m]", away(goal, asked) - best, NEAREST)
        verdict.during("judged at rest", np.arange(len(part)) >= len(part) - 20, dt)


def tracker(arm: SerialChain, grip: np.ndarray, dt: float) -> MirrorTracker:
    """One for a UR5 that is quick enough not to matter."""
    return MirrorTracker(
        ur5(acceleration=np.full(6, 30.0), velocity=np.full(6, 3.0)), person=arm, grip=grip,
        dt=dt, max_manipulability=LARGEST, floor=0.05, linear_speed=1.0, angular_speed=3.0, interaction=Interaction(),
        compile=False,
    )  # fmt: skip


def error(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """(6,) [m] place, and turn by `TURN`, between two poses."""
    return np.r_[one[:3, 3] - other[:3, 3], TURN * turn_between(one[None, :3, :3], other[None, :3, :3])[0]]


def away(one: np.ndarray, other: np.ndarray) -> float:
    """[m] the size of that."""
    return float(np.linalg.norm(error(one, other)))


def nearest(goal: np.ndarray, start: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> tuple[np.ndarray, float]:
    """Posture whose hand is nearest to a pose in the arm's frame, and how far off it is, found from a posture."""
    middle = np.clip(start, lower + 1e-9, upper - 1e-9)
    found = least_squares(lambda x: error(goal, hand_pose(x[None])[0]), middle, bounds=(lower, upper), xtol=1e-12)
    return found.x, float(np.linalg.norm(found.fun))


run = judging(__name__, LEAST, Runs(one_run))
