"""Frames of virtual reality, the mirror and continuity, against scipy and by construction."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from problems.mirror.motions import unity_from_robot
from rehab_opt.kinematics.vr import (
    Mirror,
    continuous_quaternions,
    fit_frame,
    poses_of,
    quaternions_of,
    robot_from_unity,
    rotations_of,
)
from tests.refusals import refuses

seeds = st.integers(0, 2**32 - 1)


def some(seed: int, n: int = 20) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.standard_normal((n, 3)), Rotation.random(n, rng=rng).as_quat()


@given(seeds)
def test_unity_turns_are_the_same_turns_of_the_same_things(seed: int) -> None:
    # A change of basis B with det -1: p' = B p, R' = B R B^-1. Unity's quaternions turn by the left-hand rule, and the
    # matrix of a left-handed quaternion in left-handed coordinates is written like any other.
    basis = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    positions, quaternions = some(seed)
    p, q = robot_from_unity(positions, quaternions)
    np.testing.assert_allclose(p, positions @ basis.T)
    turned = basis @ Rotation.from_quat(quaternions).as_matrix() @ basis.T
    np.testing.assert_allclose(Rotation.from_quat(q).as_matrix(), turned, atol=1e-12)
    back = unity_from_robot(p, q)
    np.testing.assert_array_equal(back[0], positions)
    np.testing.assert_array_equal(back[1], quaternions)


@given(seeds, st.floats(0, 0.01))
def test_a_frame_is_found_from_points_and_told_with_its_residual(seed: int, noise: float) -> None:
    rng = np.random.default_rng(seed)
    points, _ = some(seed, 5)
    turn, shift = Rotation.random(rng=rng), rng.standard_normal(3)
    partners = turn.apply(points) + shift + noise * rng.standard_normal((5, 3))
    fit = fit_frame(points, partners)
    oracle, distance = Rotation.align_vectors(partners - partners.mean(axis=0), points - points.mean(axis=0))
    np.testing.assert_allclose(fit.pose[:3, :3], oracle.as_matrix(), atol=1e-7)
    assert fit.rms * np.sqrt(5) == pytest.approx(distance, abs=1e-6)  # scipy: a root of a difference
    np.testing.assert_allclose(np.linalg.norm(fit.points(points) - partners, axis=1), fit.residuals, atol=1e-9)
    assert fit.rms <= 3 * noise + 1e-9


@given(seeds, st.floats(0.5, 2.0))
def test_a_scaled_arm_is_found_too(seed: int, size: float) -> None:
    rng = np.random.default_rng(seed)
    points, _ = some(seed, 6)
    partners = size * Rotation.random(rng=rng).apply(points) + rng.standard_normal(3)
    fit = fit_frame(points, partners, scale=True)
    assert fit.scale == pytest.approx(size, rel=1e-9)
    assert fit.rms < 1e-9


def test_points_that_fix_no_frame_are_refused() -> None:
    line = np.outer(np.arange(5.0), [1, 2, 3])
    refuses(fit_frame, *(((points, points), "source") for points in (np.zeros((2, 3)), line, np.full((4, 3), np.nan))))


def test_a_mirrored_set_of_points_is_not_taken_for_a_rotation() -> None:
    points, _ = some(3, 8)
    fit = fit_frame(points, points * [1, -1, 1])
    assert np.linalg.det(fit.pose[:3, :3]) == pytest.approx(1.0)
    assert fit.rms > 0.1


@given(seeds, st.sampled_from(["x", "y", "z"]))
def test_the_mirror_keeps_two_hand_axes_and_turns_the_third(seed: int, lateral: str) -> None:
    positions, quaternions = some(seed)
    poses = poses_of(positions, quaternions)
    mirror = Mirror((0.1, 0.2, 0.3), (1.0, -2.0, 0.5), lateral)  # type: ignore[arg-type]
    mirrored = mirror.poses(poses)
    for i, axis in enumerate("xyz"):
        image = poses[:, :3, i] @ mirror.matrix
        np.testing.assert_allclose(mirrored[:, :3, i], -image if axis == lateral else image, atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(mirrored[:, :3, :3]), 1.0)
    np.testing.assert_allclose(mirror.poses(mirrored), poses, atol=1e-12)


@given(seeds)
def test_mirrored_twists_are_those_of_the_mirrored_motion(seed: int) -> None:
    rng = np.random.default_rng(seed)
    (p,), (q,) = some(seed, 1)
    v, w, h = rng.standard_normal(3), rng.standard_normal(3), 1e-6
    mirror = Mirror((0.3, 0.1, 0), (0.2, 1, 0), "z")
    after = (Rotation.from_rotvec(h * w) * Rotation.from_quat(q)).as_quat()
    a, b = mirror.poses(poses_of([p, p + h * v], [q, after]))
    linear = (b[:3, 3] - a[:3, 3]) / h
    angular = Rotation.from_matrix(b[:3, :3] @ a[:3, :3].T).as_rotvec() / h
    np.testing.assert_allclose(mirror.twists(np.append(v, w)), [*linear, *angular], atol=1e-4)


@given(seeds)
def test_quaternions_do_not_jump_and_stay_the_same_rotations_also_in_a_stream(seed: int) -> None:
    rng = np.random.default_rng(seed)
    steps = Rotation.from_rotvec(0.3 * rng.standard_normal((30, 3)))
    turns, now = [], Rotation.random(rng=rng)
    for step in steps:
        now = step * now
        turns.append(now.as_quat() * rng.choice([-1, 1]) * rng.uniform(0.5, 2))
    whole = continuous_quaternions(turns)
    assert np.sum(whole[1:] * whole[:-1], axis=1).min() > 0.5
    np.testing.assert_allclose(np.abs(np.sum(whole * turns / np.linalg.norm(turns, axis=1, keepdims=True), axis=1)), 1)
    stream = [continuous_quaternions([turns[0]])[0]]
    for each in turns[1:]:
        stream.append(continuous_quaternions([each], stream[-1])[0])
    np.testing.assert_allclose(stream, whole, atol=1e-15)


@given(seeds)
def test_rotations_and_quaternions_are_scipys(seed: int) -> None:
    _, q = some(seed)
    np.testing.assert_allclose(rotations_of(2.0 * q), Rotation.from_quat(q).as_matrix(), atol=1e-12)
    back = quaternions_of(rotations_of(q))
    np.testing.assert_allclose(np.abs(np.sum(back * q, axis=1)), 1.0, atol=1e-12)
