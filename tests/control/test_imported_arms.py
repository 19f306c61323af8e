"""Arms from files under the trackers: what is judged is computed from the file's own origins and axes in numpy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from rehab_opt import KeepOut, MirrorTracker, SerialChain
from rehab_opt.kinematics.link_capsules import CapsuleOnLink
from tests.kinematics.robot_files.known_arms import gen3
from tests.kinematics.robot_files.random_arms import (
    Edge,
    moving,
    pose_of,
    random_arm,
    random_postures,
    urdf,
)

Array = NDArray[np.float64]
DT = 0.005


def arm(seed: int, tmp_path: Path, **options: object) -> tuple[list[Edge], SerialChain]:
    """A random arm of 3 to 8 joints, or Kinova's Gen3; its joints within 20 % of a middle start free."""
    rng = np.random.default_rng(seed)
    edges = gen3() if seed == 0 else random_arm(rng, 3 + seed % 6)
    file = tmp_path / "arm.urdf"
    file.write_text(urdf(edges))
    return edges, SerialChain.from_urdf(file, acceleration=20.0, tip=edges[-1].child, **options)  # type: ignore[arg-type]


def reachable(edges: list[Edge], rng: np.random.Generator, chain: SerialChain) -> Array:
    """A posture that is not nearly singular."""
    postures = random_postures(edges, rng, 40)
    return postures[np.argmax([chain.manipulability(q) for q in postures])]


def link_poses(edges: list[Edge], q: Array) -> list[Array]:
    return [pose_of(edges[: i + 1], q[: len(moving(edges[: i + 1]))]) for i in range(len(edges))]


@pytest.mark.parametrize(("seed", "pressed"), [(0, True), (3, False)])
def test_no_capsule_and_no_joint_crosses_a_plane_and_the_hand_is_never_too_fast(
    tmp_path: Path, seed: int, pressed: bool
) -> None:
    """`pressed`: the arm has joints enough to come near the plane, and no floor or limit that stops it before."""
    rng = np.random.default_rng(seed)
    some = gen3() if seed == 0 else random_arm(np.random.default_rng(seed), 3 + seed % 6)
    start, end, radius = np.array([0.02, 0.0, 0.0]), np.array([0.0, -0.1, 0.05]), 0.04
    bodies = [CapsuleOnLink(edge.child, tuple(start), tuple(end), radius) for edge in some[1:]]
    edges, chain = arm(seed, tmp_path, capsules=bodies)
    q = reachable(edges, rng, chain)
    largest = max(chain.manipulability(each) for each in random_postures(edges, rng, 300))
    normal = rng.standard_normal(3)
    normal /= np.linalg.norm(normal)

    def heights(posture: Array) -> Array:
        found = []
        for edge, pose in zip(edges, link_poses(edges, posture), strict=True):
            found.append(pose[:3, 3] @ normal)
            if any(body.link == edge.child for body in bodies):
                found += [(pose[:3, :3] @ point + pose[:3, 3]) @ normal - radius for point in (start, end)]
        return np.array(found)

    still = np.ptp([heights(each) for each in random_postures(edges, rng, 20)], axis=0) < 1e-9  # no joint moves them
    plane = KeepOut.through((heights(q)[~still].min() - 0.02) * normal, normal)
    tracker = MirrorTracker(
        chain, dt=DT, floor=0.1, keep_out=[plane], max_manipulability=largest, linear_speed=0.25, compile=False
    )
    first, hand = pose_of(edges, q), pose_of(edges, q)[:3, 3]
    nearest = np.inf
    for k in range(200):
        reference = first.copy()
        reference[:3, 3] -= 0.2 * np.sin(0.01 * k) * normal  # into the plane
        twist = np.concatenate([-0.2 * 0.01 / DT * np.cos(0.01 * k) * normal, np.zeros(3)])
        if rng.random() < 0.05:
            twist[rng.integers(6)] = rng.choice([np.nan, np.inf, 1e9])
        command = tracker.step(q, reference, twist)
        assert np.all(np.isfinite(command.value))
        q = q + command.value * DT
        nearest = min(nearest, (heights(q)[~still] - plane.offset).min())
        assert nearest >= -1e-9
        then = pose_of(edges, q)[:3, 3]
        assert np.linalg.norm(then - hand) <= 0.25 * DT * (1 + 1e-9)
        hand = then
    assert nearest < 0.015 or not pressed
