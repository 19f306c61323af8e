"""Arms that people have, from their vendors' numbers."""

from __future__ import annotations

import numpy as np

from tests.kinematics.robot_files.random_arms import Edge, random_edge

# Kinova's Gen3 with 7 joints: gen3_macro.xacro of ros_kortex (BSD-3), whose right angles are rounded to 5 digits. Four
# of its joints have no ends. Converted to Denavit-Hartenberg rows, one origin lies 13.6 km away.
GEN3 = [
    ("0 0 0.15643", "3.1416 2.7629E-18 -4.9305E-36", None, 1.3963),
    ("0 0.005375 -0.12838", "1.5708 2.1343E-17 -1.1102E-16", 2.41, 1.3963),
    ("0 -0.21038 -0.006375", "-1.5708 1.2326E-32 -2.9122E-16", None, 1.3963),
    ("0 0.006375 -0.21038", "1.5708 -6.6954E-17 -1.6653E-16", 2.66, 1.3963),
    ("0 -0.20843 -0.006375", "-1.5708 2.2204E-16 -6.373E-17", None, 1.2218),
    ("0 0.00017505 -0.10593", "1.5708 9.2076E-28 -8.2157E-15", 2.23, 1.2218),
    ("0 -0.10593 -0.00017505", "-1.5708 -5.5511E-17 9.6396E-17", None, 1.2218),
]


def gen3() -> list[Edge]:
    rng, edges = np.random.default_rng(3), []
    for i, (xyz, rpy, end, speed) in enumerate(GEN3):
        edge = random_edge(
            rng, f"joint_{i}", "revolute" if end else "continuous", edges[-1].child if i else "base", f"l{i}"
        )
        edge.xyz, edge.rpy = np.array(xyz.split(), float), np.array(rpy.split(), float)
        edge.axis, edge.velocity = np.array([0.0, 0.0, 1.0]), speed
        edge.lower, edge.upper = (-end, end) if end else (0.0, 0.0)
        edges.append(edge)
    return edges


UR5_TOOL = (0.0, 0.0823, 0.0)
"""[m] of the flange in the last link; it is turned by -90 deg about x, and the base by 180 deg about z."""


def vendors_ur5() -> list[Edge]:
    """Origins and axes of ur_description's UR5 (BSD-3), limits as `ur5` has them."""
    half = np.pi / 2
    origins = [
        ([0, 0, 0.089159], [0, 0, 0], "z"), ([0, 0.13585, 0], [0, half, 0], "y"), ([0, -0.1197, 0.425], [0, 0, 0], "y"),
        ([0, 0, 0.39225], [0, half, 0], "y"), ([0, 0.093, 0], [0, 0, 0], "z"), ([0, 0, 0.09465], [0, 0, 0], "y"),
    ]  # fmt: skip
    rng, edges = np.random.default_rng(0), []
    for i, (xyz, rpy, axis) in enumerate(origins):
        edge = random_edge(rng, f"joint_{i}", "revolute", f"link_{i - 1}" if i else "base", f"link_{i}")
        edge.xyz, edge.rpy, edge.axis = np.array(xyz, float), np.array(rpy, float), np.eye(3)["xyz".index(axis)]
        edge.upper, edge.velocity = (np.pi if i == 2 else 2 * np.pi), np.pi
        edge.lower = -edge.upper
        edges.append(edge)
    return edges
