"""A stretch of a mirrored motion, decided at once, keeps the tracker's bounds and follows as well as they allow."""

import functools
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from bench.solvers.mirror_window import STEADYING, MirrorWindow
from rehab_opt.control.hand_bounds import HandBounds
from rehab_opt.kinematics.ur5 import ur5
from rehab_opt.optim.nlp import NLPAnswer
from rehab_opt.optim.nlp_solvers import NLPSolver, nlp_solver
from tests.control.mirror_campaign import LARGEST, Array, closed_form

START = np.array([3.2, -1.5, 1.9, -2.0, -1.4, 0.2])
CHAIN = ur5(velocity=1.0, acceleration=4.0)
FLOOR, SPEED, DEVIATION, SPACING, KNOTS, TURN = 0.3, 0.25, 0.05, 0.1, 4, 0.1
BOUNDS = HandBounds(CHAIN, FLOOR, LARGEST, SPEED, DEVIATION, (), rate=20.0, dt=SPACING, recovery_speed=0.1)
WINDOW = MirrorWindow(BOUNDS, knots=KNOTS, turn_length=TURN)
seeds = st.integers(0, 10**6)


@functools.cache
def ipopt() -> NLPSolver:
    solver = nlp_solver(WINDOW.nlp, "ipopt")
    assert isinstance(solver, NLPSolver)
    return solver


def line(start: Array, velocity: Array, turning: Array, knots: int = KNOTS) -> Array:
    """(K, 4, 4) poses of a tool that leaves that of `start` evenly."""
    poses = np.tile(CHAIN.pose(start), (knots, 1, 1))
    for k, pose in enumerate(poses, 1):
        pose[:3, 3] += k * SPACING * velocity
        pose[:3, :3] = Rotation.from_rotvec(k * SPACING * turning).as_matrix() @ pose[:3, :3]
    return poses


def solved(here: Array, before: Array, poses: Array) -> tuple[NLPAnswer, Array]:
    """The answer, and its joints (K, n)."""
    solver = ipopt()
    solver.parameters[:] = WINDOW.parameters_of(here, before, poses)
    answer = solver.solve(WINDOW.standing(here))
    return answer, answer.x.reshape(KNOTS, -1)


def cost_of(here: Array, before: Array, joints: Array, poses: Array) -> float:
    """The sum of the docstring, in plain numpy."""
    path, total = np.vstack([before, here, joints]), 0.0
    for q, pose in zip(joints, poses, strict=True):
        tool = CHAIN.pose(q)
        turn = Rotation.from_matrix(pose[:3, :3] @ tool[:3, :3].T).magnitude()
        total += 0.5 * float(np.sum((tool[:3, 3] - pose[:3, 3]) ** 2)) + 0.5 * (TURN * 2 * math.sin(turn / 2)) ** 2
    return total + 0.5 * STEADYING * float(np.sum(np.diff(path, 2, axis=0) ** 2))


@pytest.mark.nightly
@settings(max_examples=25, deadline=None)
@given(seeds, st.floats(0.0, 0.6))
def test_an_answer_keeps_every_bound(seed: int, speed: float) -> None:
    rng = np.random.default_rng(seed)
    here = START + rng.uniform(-0.3, 0.3, 6)
    before = here + rng.uniform(-0.03, 0.03, 6)
    way = rng.normal(size=3)
    poses = line(here, speed * way / np.linalg.norm(way), rng.uniform(-1.0, 1.0, 3))
    answer, joints = solved(here, before, poses)
    if speed < SPEED:
        assert answer.certified
    elif not answer.certified:  # the reference has run away from the hand
        return
    path = np.vstack([before, here, joints])
    assert np.all(np.abs(np.diff(path[1:], axis=0)) <= CHAIN.velocity * SPACING + 1e-8)
    assert np.all(np.abs(np.diff(path, 2, axis=0)) <= CHAIN.acceleration * SPACING**2 + 1e-8)
    assert np.all((joints >= CHAIN.lower) & (joints <= CHAIN.upper))
    assert min(closed_form(q) for q in joints) >= min(FLOOR, closed_form(here)) - 1e-7
    hands = np.array([CHAIN.pose(q)[:3, 3] for q in path[1:]])
    assert np.all(np.linalg.norm(np.diff(hands, axis=0), axis=1) <= SPEED * SPACING + 1e-7)
    most = max(DEVIATION, float(np.linalg.norm(hands[0] - poses[0][:3, 3])))
    assert np.all(np.linalg.norm(hands[1:] - poses[:, :3, 3], axis=1) <= most + 1e-7)
    assert answer.cost == pytest.approx(cost_of(here, before, joints, poses), rel=1e-7, abs=1e-13)
    np.testing.assert_allclose(answer.report, [closed_form(q) for q in joints], atol=1e-9)


def test_it_stops_at_the_floor_where_the_reference_goes_on_to_a_singularity() -> None:
    stretched = np.array([3.2, -1.5, 0.75, -0.82, -1.4, 0.2])
    outwards = CHAIN.pose(stretched)[:3, 3] / np.linalg.norm(CHAIN.pose(stretched)[:3, 3])
    assert closed_form(stretched) > FLOOR
    poses = line(stretched, 0.2 * outwards, np.zeros(3))
    free = MirrorWindow(replace(BOUNDS, floor=1e-3), knots=KNOTS)
    unguarded = nlp_solver(free.nlp, "ipopt")
    unguarded.parameters[:] = free.parameters_of(stretched, stretched, poses)
    assert min(closed_form(q) for q in unguarded.solve(free.standing(stretched)).x.reshape(KNOTS, -1)) < FLOOR - 0.02
    answer, joints = solved(stretched, stretched, poses)
    assert answer.certified
    assert min(closed_form(q) for q in joints) == pytest.approx(FLOOR, abs=1e-6)
