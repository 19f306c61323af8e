"""What an arm does of a path, found before a run (`arm_path`).

A UR5 within its range or in a narrow one, along paths that postures of its own have, some of them with a stretch that
is out of reach, others on which the wrist stretches again and again. Sessions alone ask for it; it is public in
`rehab_opt.control`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rehab_opt import ur5
from rehab_opt.control.arm_path import arm_path
from tests.judge.numbering import Runs, judging
from tests.judge.references import good_posture, reaches
from tests.judge.ur5_numbers import LIMIT, tool, turn_between
from tests.judge.verdict import Verdict

GUARANTEES = ("G10",)
LEAST = {
    "along a path": 100_000, "along a path, out of reach": 1000, "along a path, the wrist near stretched": 20_000,
}  # fmt: skip
CI_TICKS = 4000
SHARE = 0.05
Array = NDArray[np.float64]
REACHED = 1e-3, math.radians(1.0)
"""[m, rad] within which a pose counts."""
SAMPLES, DT = 120, 0.01
STEP, ROUNDING = 0.03, 1e-9
"""[rad] From sample to sample at most; what two kinematics differ by."""
SURE = 1.2
"""A posture that has that much of the floor, and poses that far within what counts, are not cut off by rounding."""
MISSED = 0.02
"""Of the poses that some posture near by has, what a walk or an arm may miss."""
CROSSING, WRIST = 3, 4
"""Paths on which the wrist stretches, whose joint this is: where it is at 0, w is zero, and two joints turn as one."""


def missing(poses: Array, asked: Array) -> tuple[Array, Array]:
    """(N,) [m] and [rad] from poses (N, 4, 4) to those asked for."""
    turn = turn_between(asked[:, :3, :3], poses[:, :3, :3])
    opposite = np.trace(asked[:, :3, :3] @ poses[:, :3, :3].transpose(0, 2, 1), axis1=1, axis2=2) < 0.0
    turned = np.where(opposite, math.pi, np.linalg.norm(turn, axis=1))  # more than a quarter: far, whatever it is
    return np.linalg.norm(poses[:, :3, 3] - asked[:, :3, 3], axis=1), turned


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


run = judging(__name__, LEAST, Runs(an_arm))
