"""The UR5 agrees with the closed form of its manipulability, and with the vendor's files where they are at hand."""

import re
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from rehab_opt import ur5
from tests.kinematics.dh_oracle import Array

configurations = st.lists(st.floats(-2 * np.pi, 2 * np.pi), min_size=6, max_size=6).map(np.array)
MAX_MANIPULABILITY = 0.11988
ROBOT = ur5()


def closed_form(q: Array) -> float:
    """math.md, section 8: |a2 a3 s3 s5 (a2 c2 + a3 c23 + d5 s234)|."""
    a2, a3, d5 = -0.425, -0.39225, 0.09465
    reach = a2 * np.cos(q[1]) + a3 * np.cos(q[1] + q[2]) + d5 * np.sin(q[1] + q[2] + q[3])
    return float(abs(a2 * a3 * np.sin(q[2]) * np.sin(q[4]) * reach))


@settings(max_examples=200)
@given(configurations)
def test_manipulability_is_the_closed_form(q: Array) -> None:
    assert ROBOT.manipulability(q) == pytest.approx(closed_form(q), abs=1e-13)


def test_largest_manipulability_is_the_one_computed_before() -> None:
    rng = np.random.default_rng(3)
    best = 0.0
    for _ in range(12):
        found = minimize(
            lambda q: -ROBOT.manipulability(q),
            rng.uniform(-np.pi, np.pi, 6),
            jac=lambda q: -ROBOT.manipulability_gradient(q),
            bounds=list(zip(ROBOT.lower, ROBOT.upper, strict=True)),
        )
        best = max(best, -found.fun)
    assert best == pytest.approx(MAX_MANIPULABILITY, abs=5e-6)
    assert max(map(closed_form, rng.uniform(-np.pi, np.pi, (20_000, 6)))) <= best


# ----------------------------------------------------------------------------------------------- vendor's files
def entries(path: Path) -> Iterator[tuple[str, str, str]]:
    """(block, key, value) of a YAML file of one key, blocks and their entries, as the vendor's are."""
    block = ""
    for line in path.read_text().splitlines():
        if match := re.fullmatch(r"  (\w+):", line):
            block = match[1]
        elif match := re.fullmatch(r"    (\w+): *(\S.*)", line):
            yield block, match[1], match[2]


def test_limits_are_the_vendor_s(recorded: Callable[[str], Path]) -> None:
    limits = {(joint, key): value for joint, key, value in entries(recorded("ur5_limits/joint_limits.yaml"))}

    def degrees(key: str) -> list[float]:
        return [float(limits[f"{name}_joint", key].removeprefix("!degrees")) for name in ROBOT.names]

    np.testing.assert_allclose(np.rad2deg(ROBOT.lower), degrees("min_position"))
    np.testing.assert_allclose(np.rad2deg(ROBOT.upper), degrees("max_position"))
    np.testing.assert_allclose(np.rad2deg(ROBOT.velocity), degrees("max_velocity"))


def test_pose_is_the_vendor_s_chain_of_frames(recorded: Callable[[str], Path]) -> None:
    links: dict[str, dict[str, float]] = {}
    for link, key, value in entries(recorded("ur5_limits/default_kinematics.yaml")):
        links.setdefault(link, {})[key] = float(value)
    assert len(links) == 6

    def chain_of_frames(q: Array) -> Array:
        pose = np.eye(4)
        for link, angle in zip(links.values(), q, strict=True):
            fixed, joint = np.eye(4), np.eye(4)
            fixed[:3, :3] = Rotation.from_euler("xyz", [link["roll"], link["pitch"], link["yaw"]]).as_matrix()
            fixed[:3, 3] = link["x"], link["y"], link["z"]
            joint[:3, :3] = Rotation.from_euler("z", angle).as_matrix()
            pose = pose @ fixed @ joint
        return pose

    rng = np.random.default_rng(5)
    tool = np.linalg.inv(chain_of_frames(np.zeros(6))) @ ROBOT.pose(np.zeros(6))
    np.testing.assert_allclose(tool[:3, 3], 0.0, atol=1e-8)
    for q in rng.uniform(-2 * np.pi, 2 * np.pi, (200, 6)):
        np.testing.assert_allclose(ROBOT.pose(q), chain_of_frames(q) @ tool, atol=1e-8)
