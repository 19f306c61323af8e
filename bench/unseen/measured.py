"""What a run did of a recording, by the oracle: shares of the poses in reach, and bounds that were broken."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from bench.unseen.hands import LEFT_HAND, PATIENT
from bench.unseen.person_reach import NAMES, reaches
from bench.unseen.ur5_branches import branch_of, flange, manipulability, postures

__all__ = ["Broken", "Reach", "broken", "judged", "off_path", "passed", "reach"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

NEAR, TURNED = 5e-3, math.radians(5.0)
"""[m, rad] within which a pose is passed."""
BETWEEN = 8
"""Places on a joint path for each sample of it."""
POSES = 150
"""Of a recording, evenly in time, that are judged."""


class Reach(NamedTuple):
    """Of N poses asked for: what robot and person could do."""

    person: Flags
    """(N,) the led arm gets there."""
    branches: Flags
    """(N, 8) some posture of this kind is above the floor and within limits."""
    poses: Array
    """(N, 4, 4) of the tool."""

    @property
    def anyhow(self) -> Flags:
        """(N,) in reach of both, on whatever branch."""
        return np.asarray(self.person & self.branches.any(axis=1))

    def on(self, branch: int) -> Flags:
        """(N,) in reach of both on one branch: what a motion above the floor can do from there."""
        return np.asarray(self.person & self.branches[:, branch])


def judged(poses: Array) -> Array:
    """Those poses (N, 4, 4) of a recording's (M, 4, 4) that are judged; lost sight left out."""
    seen = poses[np.isfinite(poses[:, 0, 3])]
    return np.asarray(seen[np.unique(np.linspace(0, len(seen) - 1, POSES).astype(int))])


def reach(poses: Array, problem: dict[str, Any], *, elbow: float = math.pi) -> Reach:
    """What is in reach of the tool's poses (N, 4, 4), by the numbers of a problem file."""
    found = postures(poses)
    flat = np.nan_to_num(found.reshape(-1, 6))
    good = ~np.isnan(found).any(axis=2)
    good &= (manipulability(flat) >= problem["tracker"]["floor"]).reshape(-1, 8)
    good &= (np.abs(flat[:, 2]) <= elbow).reshape(-1, 8)  # the others are within half a turn of limits of a whole one
    kinds = branch_of(flat).reshape(-1, 8)
    branches = np.stack([(good & (kinds == k)).any(axis=1) for k in range(8)], axis=1)
    return Reach(_person(poses, problem), branches, poses)


def _person(poses: Array, problem: dict[str, Any]) -> Flags:
    patient, arm = problem["patient"], problem["patient"].get("arm")
    if arm is None:
        return np.ones(len(poses), dtype=bool)
    facing = math.radians(patient["facing_deg"])
    c, s = math.cos(facing), math.sin(facing)
    base, grip = np.eye(4), np.eye(4)
    base[:3, :3] = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ PATIENT
    base[:3, 3] = arm["shoulder_m"]
    turn = np.eye(3)
    for axis, angle in enumerate(problem["robot"].get("grip_deg", (0.0, 0.0, 0.0))):
        turn = _about(axis, math.radians(angle)) @ turn
    grip[:3, :3] = LEFT_HAND @ turn
    grip[:3, 3] = LEFT_HAND @ np.array(problem["robot"].get("grip_m", (0.0, 0.0, 0.0)))
    limits = np.deg2rad([arm["range_of_motion"][f"{name}_deg"] for name in NAMES])
    limits[0] += math.pi
    return reaches(np.linalg.inv(base) @ poses @ np.linalg.inv(grip), limits[:, 0], limits[:, 1])


def _about(axis: int, angle: float) -> Array:
    i, j = ((1, 2), (2, 0), (0, 1))[axis]
    turn = np.eye(3)
    turn[i, i] = turn[j, j] = math.cos(angle)
    turn[i, j], turn[j, i] = -math.sin(angle), math.sin(angle)
    return turn


def passed(q: Array, poses: Array) -> Flags:
    """(N,) whether the joint path q (M, 6) passes within 5 mm and 5 deg of the tool's poses (N, 4, 4).

    The path is q's and what is between: a hand at 0.25 m/s is 1.25 mm on in a tick of 5 ms.
    """
    at = np.arange((len(q) - 1) * BETWEEN + 1) / BETWEEN
    tools = flange(np.column_stack([np.interp(at, np.arange(len(q)), joint) for joint in q.T]))
    found = np.zeros(len(poses), dtype=bool)
    for i, pose in enumerate(poses):
        near = tools[np.linalg.norm(tools[:, :3, 3] - pose[:3, 3], axis=1) <= NEAR]
        cosine = (np.einsum("nij,ij->n", near[:, :3, :3], pose[:3, :3]) - 1) / 2
        found[i] = bool((cosine >= math.cos(TURNED)).any())
    return found


def off_path(points: Array, path: Array) -> float:
    """[m] from points (N, 3) to the way through other ones (M, 3), at most: to the ends and 32nds of its lines."""
    ways = np.diff(path, axis=0)
    way = np.concatenate([path, *(path[:-1] + k / 32 * ways for k in range(1, 32))])
    return float(KDTree(way).query(points)[0].max())


class Broken(NamedTuple):
    """Largest of a run's motion, as a share of its bound; above 1 is broken. The floor: least over floor."""

    acceleration: float
    hand_speed: float
    floor: float


def broken(q: Array, velocities: Array, dt: float, problem: dict[str, Any], *, acceleration: float) -> Broken:
    """Of joint positions (M, 6) and the velocities held after them (M, 6)."""
    ends = np.vstack([q, q[-1:] + dt * velocities[-1:]])
    change = np.diff(np.vstack([np.zeros(6), velocities]), axis=0) / dt
    tools = flange(ends)[:, :3, 3]
    fast = np.linalg.norm(np.diff(tools, axis=0), axis=1) / dt
    tracker = problem["tracker"]
    return Broken(
        float(np.abs(change).max() / acceleration),
        float(fast.max() / tracker["linear_speed_m_s"]),
        float(manipulability(ends).min() / tracker["floor"]),
    )
