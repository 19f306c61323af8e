"""The bench's mirrored motion as one structured NLP: a slice of it, and that its judge sees what is broken."""

from __future__ import annotations

import argparse

import numpy as np
import pytest
from numpy.typing import NDArray

from bench.plan_nlp import Programme, first_guess, judge, knots_of
from bench.unseen.ur5_branches import flange
from rehab_opt import MirrorTracker, ur5

START = np.array([0.0, -1.2, 1.5, -1.8, -1.57, 0.0])
OPTIONS = argparse.Namespace(uncompiled=True, iterations=200, seconds=60.0)
SPEED, FLOOR, DT = 0.25, 0.3, 0.01


def line(*, length: float, seconds: float) -> NDArray[np.float64]:
    """Poses `DT` apart along y from where the arm starts, turned by a quarter of a radian about z meanwhile."""
    part = np.linspace(0.0, 1.0, round(seconds / DT) + 1)
    part = part**3 * (10 - 15 * part + 6 * part**2)
    poses = np.tile(ur5().pose(START), (len(part), 1, 1))
    poses[:, 1, 3] += length * part
    c, s = np.cos(0.25 * part), np.sin(0.25 * part)
    turn = np.zeros((len(part), 3, 3))
    turn[:, 0, 0], turn[:, 0, 1], turn[:, 1, 0], turn[:, 1, 1], turn[:, 2, 2] = c, -s, s, c, 1.0
    poses[:, :3, :3] = turn @ poses[:, :3, :3]
    return poses


@pytest.fixture(scope="module")
def tracker() -> MirrorTracker:
    return MirrorTracker(ur5(), floor=FLOOR, linear_speed=SPEED, dt=DT, compile=False)


def test_knots_keep_the_recordings_pace_and_lie_as_far_apart_as_the_hand_goes(tracker: MirrorTracker) -> None:
    """The whole takes the recording's own time at least, though knots are even at the hand's largest speed."""
    poses = line(length=0.3, seconds=0.5)  # more than twice as fast as the hand may be
    found = knots_of(tracker, poses, START, rate=20.0)
    apart = np.linalg.norm(np.diff(found.poses[:, :3, 3], axis=0), axis=1)
    assert len(found.seconds) == 100
    assert np.allclose(found.poses[[0, -1]], poses[[0, -1]], atol=1e-9)
    assert apart.max() <= SPEED * found.spacing * (1 + 1e-9)
    assert found.seconds.sum() == pytest.approx(0.5 + DT, abs=1e-9)  # a tick until the first one


def test_an_nlp_follows_what_is_too_fast_later_and_breaks_nothing(tracker: MirrorTracker) -> None:
    poses = line(length=0.3, seconds=0.5)
    reference = knots_of(tracker, poses, START, rate=20.0)
    solution = Programme(tracker, 100, "fatrop", OPTIONS).solve(reference, first_guess(tracker, reference, START))
    q = solution.ticks(DT)
    problem = {"tracker": {"linear_speed_m_s": SPEED, "floor": FLOOR}}
    found = judge(tracker, q, poses, problem, off=0.0)
    assert not solution.refusal
    assert found.kept
    assert found.passed == 1.0
    assert 0.3 / SPEED <= found.seconds <= 1.2 * 0.3 / SPEED
    assert np.linalg.norm(flange(q[-1:])[0, :3, 3] - poses[-1, :3, 3]) < 2e-3
    # The judge is not satisfied by whatever comes: the same way in half the time breaks the hand's speed.
    assert not judge(tracker, q[::2], poses, problem, off=0.0).kept
