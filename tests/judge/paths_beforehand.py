"""What is found of a path before a run: what an arm does of it (`arm_path`), how much a robot goes along (`Seats`).

A UR5 within its range or in a narrow one, along paths that postures of its own have, some of them with a stretch that
is out of reach, others on which the wrist stretches again and again. Both are asked for by sessions alone, and are
public in `rehab_opt.control`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rehab_opt import ur5
from rehab_opt.control.arm_path import arm_path
from rehab_opt.control.seats import Seats, Walk
from tests.judge.mirror_planes import RADII
from tests.judge.mirror_runs import Settings, draw, tracker
from tests.judge.numbering import numbered
from tests.judge.references import good_posture, reaches
from tests.judge.ur5_numbers import LIMIT, frames, links, manipulability, tool, turn_between
from tests.judge.verdict import Verdict

GUARANTEES = ("G25",)
LEAST = {
    "walked": 100_000, "walked, not done": 10_000, "walked, that postures have": 30_000, "along a path": 100_000,
    "along a path, out of reach": 1000, "along a path, the wrist near stretched": 20_000,
}  # fmt: skip
CI_TICKS = 4000
SHARE = 0.05
Array = NDArray[np.float64]
REACHED = 1e-3, math.radians(1.0)
"""[m, rad] within which a pose counts."""
SAMPLES, DT = 120, 0.01
POSES, MANY = 40, 30
STEP, ROUNDING = 0.03, 1e-9
"""[rad] From sample to sample at most; what two kinematics differ by."""
FLOOR = 1.05
"""Of a tracker's floor, what a seat counts as above it."""
SURE = 1.2
"""A posture that has that much of the floor, and poses that far within what counts, are not cut off by rounding."""
MISSED = 0.02
"""Of the poses that some posture near by has, what a walk or an arm may miss."""
CROSSING, WRIST = 3, 4
"""Paths on which the wrist stretches, whose joint this is: where it is at 0, w is zero, and two joints turn as one."""


def run(ticks: int, seed: int, *, only: int | None = None) -> Verdict:
    """An arm and hundreds of seats in turn."""
    verdict = Verdict("paths_beforehand", seed, LEAST)
    for number, rng in numbered(verdict, ticks, only):
        (an_arm, seats, seats)[number % 3](verdict, number, rng)
    return verdict


def missing(poses: Array, asked: Array) -> tuple[Array, Array]:
    """(N,) [m] and [rad] from poses (N, 4, 4) to those asked for."""
    turn = turn_between(asked[:, :3, :3], poses[:, :3, :3])
    opposite = np.trace(asked[:, :3, :3] @ poses[:, :3, :3].transpose(0, 2, 1), axis1=1, axis2=2) < 0.0
    turned = np.where(opposite, math.pi, np.linalg.norm(turn, axis=1))  # more than a quarter: far, whatever it is
    return np.linalg.norm(poses[:, :3, 3] - asked[:, :3, 3], axis=1), turned


# ------------------------------------------------------------------------------------------------------ along a path
def an_arm(verdict: Verdict, number: int, rng: np.random.Generator) -> None:
    """An arm in a narrow range that holds a tool, along what postures in it do, and a way beyond its reach."""
    start = good_posture(rng, 0.4)
    wide = rng.uniform(0.4, 1.5, 6)
    lower, upper = np.maximum(start - wide, -LIMIT), np.minimum(start + wide, LIMIT)
    joints = np.clip(reaches(rng, start, SAMPLES, DT, size=0.6), lower + 0.02, upper - 0.02)
    grip = np.eye(4)
    grip[:3, 3] = rng.uniform(-0.1, 0.1, 3)
    tools, within = tool(joints) @ grip, np.ones(SAMPLES, dtype=bool)
    if rng.random() < 0.5:
        away = np.repeat(tools[-1:], SAMPLES // 3, axis=0)
        away[:, :3, 3] *= 1 + np.linspace(0, 2.0, len(away))[:, None]
        far = np.linalg.norm(away[:, :3, 3], axis=1) > 1.3
        tools = np.concatenate([tools, away, away[::-1], tools[::-1]])
        within = np.concatenate([within, np.zeros(2 * len(away), dtype=bool), within])
        verdict.during("along a path, out of reach", far, DT)
    verdict.begin(number, f"an arm, {len(tools)} samples")
    done = along(verdict, lower, upper, grip, tools, number)
    verdict.within("of the poses that some posture reaches, lost", 1 - done[within].mean(), MISSED)
    fractions = [through_the_wrist(verdict, rng, number) for _ in range(CROSSING)]
    verdict.within("of the poses of a wrist that stretches on the way, lost", 1 - np.mean(fractions), MISSED)


def through_the_wrist(verdict: Verdict, rng: np.random.Generator, number: int) -> float:
    """Share that is reached of a path on which the wrist stretches, again and again, in an arm of narrow range."""
    start = good_posture(rng, 0.4)
    wide = rng.uniform(0.4, 1.5, 6)
    lower, upper = np.maximum(start - wide, -LIMIT), np.minimum(start + wide, LIMIT)
    upper[WRIST] = float(rng.uniform(0.1, 0.3))
    lower[WRIST] = -upper[WRIST]
    knots = np.clip(start + rng.uniform(-0.5, 0.5, (5, 6)), lower, upper)
    knots[:, WRIST] = rng.uniform(lower[WRIST], upper[WRIST], 5)
    weight = np.hanning(21) / np.hanning(21).sum()
    lines = [np.interp(np.linspace(0, 4, SAMPLES), np.arange(5), each) for each in knots.T]
    joints = np.column_stack([np.convolve(np.pad(each, 10, mode="edge"), weight, "valid") for each in lines])
    near = np.abs(joints[:, WRIST]) < 0.1
    verdict.during("along a path, the wrist near stretched", near, DT)
    return float(along(verdict, lower, upper, np.eye(4), tool(joints), number).mean())


def along(verdict: Verdict, lower: Array, upper: Array, grip: Array, tools: Array, seed: int) -> NDArray[np.bool_]:
    """Which of the poses (N, 4, 4) are reached by what is found of them; and whether that is a motion of the arm."""
    path = arm_path(ur5(lower=lower, upper=upper), grip, tools, dt=DT, seed=seed)
    verdict.ticks += len(path.q)
    verdict.during("along a path", np.ones(len(path.q), dtype=bool), DT)
    verdict.within("a posture beyond its range [rad]", np.maximum(path.q - upper, lower - path.q), ROUNDING)
    step = np.abs(np.diff(path.q, axis=0)).max(axis=1)
    verdict.within("a posture jumps [rad]", step, STEP + ROUNDING)
    verdict.holds("each sample is asked for, in order, and the same again while the posture changes",
                  np.diff(path.reference_index, prepend=-1) >= 0)  # fmt: skip
    verdict.holds("nothing of the recording is left out", np.isin(np.arange(len(tools)), path.reference_index))
    shown = tool(path.q) @ grip
    verdict.within("the tool elsewhere than the hand holds it [m, 1]", np.abs(path.poses - shown), ROUNDING)
    moved = np.diff(shown[:, :3, 3], axis=0, prepend=shown[:1, :3, 3])
    turned = turn_between(shown[:, :3, :3], np.concatenate([shown[:1], shown[:-1]])[:, :3, :3])
    off = np.abs(path.twists - np.column_stack([moved, turned]) / DT)
    verdict.within("twists of another motion [m/s, rad/s]", off, ROUNDING / DT)
    away, turned = missing(shown, tools[path.reference_index])
    done = np.zeros(len(tools), dtype=bool)
    np.logical_or.at(done, path.reference_index, (away <= SURE * REACHED[0]) & (turned <= SURE * REACHED[1]))
    return done


# ------------------------------------------------------------------------------------------------------------- seats
def seats(verdict: Verdict, number: int, rng: np.random.Generator) -> None:
    """Many walks of one robot, from postures on paths that postures of it have; of some the end is out of reach."""
    middle = good_posture(rng, 0.6)
    given = draw(rng, middle, planes=rng.random() < 0.4)
    anchor = int(rng.integers(POSES))
    joints = np.empty((POSES, MANY, 6))
    for m in range(MANY):
        start = middle + 0.3 * rng.standard_normal(6)
        joints[:, m] = reaches(rng, start, POSES, 0.05, size=float(rng.choice([0.2, 0.6])))
    paths = tool(joints.reshape(-1, 6)).reshape(POSES, MANY, 4, 4)
    beyond = rng.random(MANY) < 0.3
    out = np.clip(3 * np.arange(POSES) / POSES - 2, 0, 1)
    paths[..., :3, 3] *= 1 + out[:, None, None] * beyond[:, None]
    walk = Seats(tracker(given)).walk(paths, joints[anchor], anchor)
    verdict.begin(number, f"seats, floor {given.floor:g}, anchor {anchor}, {len(given.planes)} planes")
    verdict.ticks += POSES * MANY
    judge_walks(verdict, given, walk, paths, joints, beyond)


def judge_walks(verdict: Verdict, given: Settings, walk: Walk, paths: Array, joints: Array, beyond: Array) -> None:
    """Whether what counts as done is so, and what should is."""
    q, done, above, elbows = walk.q, walk.done, walk.above, walk.elbows
    flat, floor = q.reshape(-1, 6), FLOOR * given.floor
    w = manipulability(flat).reshape(done.shape)
    away, turned = (each.reshape(done.shape) for each in missing(tool(flat), paths.reshape(-1, 4, 4)))
    within = np.all((q >= given.lower) & (q <= given.upper), axis=2)
    clear = np.full(done.shape, math.inf)
    for normal, offset in given.planes:
        heights = links(flat)[:, 1:] @ normal - offset - RADII
        clear = np.minimum(clear, heights.min(axis=1).reshape(done.shape))
    verdict.within("w / w_max by two kinematics", np.abs(above - w), 1e-6)
    places = frames(flat)[:, 1:3, :2, 3].reshape(*done.shape, 2, 2)
    verdict.within("joints before the wrist by two kinematics [m]", np.abs(elbows - places), ROUNDING)
    verdict.within("done, away from the pose [m]", np.where(done, away, 0.0), REACHED[0] + ROUNDING)
    verdict.within("done, turned from the pose [rad]", np.where(done, turned, 0.0), REACHED[1] + ROUNDING)
    verdict.holds("done, above the floor", ~done | (w >= floor * (1 - 2e-3)))
    verdict.holds("done, within the joint limits", ~done | within)
    verdict.holds("done, outside every keep-out", ~done | (clear > 0.0))
    started = within[0] & (w[0] >= given.floor)
    verdict.holds("none is done where the first posture is under the floor or outside the limits", ~done | started)
    has = (away * SURE <= REACHED[0]) & (turned * SURE <= REACHED[1]) & (w >= SURE * floor)
    sure = has & within & within[0] & (w[0] >= SURE * floor)
    if not given.planes:
        verdict.holds("done where the posture has the pose, above the floor", done | ~sure)
    # A path whose own postures are well within everything is gone along from one of them.
    near = np.all((joints >= given.lower) & (joints <= given.upper), axis=(0, 2))
    near &= (manipulability(joints.reshape(-1, 6)).reshape(done.shape) >= 1.5 * floor).all(axis=0) & ~beyond
    if near.any() and not given.planes:
        verdict.within("of the poses that postures near by have, lost", 1 - done[:, near].mean(), MISSED)
        verdict.during("walked, that postures have", np.ones(POSES * int(near.sum()), dtype=bool), 0.05)
    verdict.during("walked", np.ones(done.size, dtype=bool), 0.05)
    verdict.during("walked, not done", ~done.ravel(), 0.05)
