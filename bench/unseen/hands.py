"""Recordings of hands for the bench: minimum-jerk reaches with turns at random, and slices of a real recording."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from bench.unseen.person_reach import hand

__all__ = ["RANGE_DEG", "SHOULDERS", "reach_recording", "slice_recording"]

Array = NDArray[np.float64]

RATE = 90.0
"""[Hz] of both kinds."""
SHOULDERS = 0.36
"""[m] between the shoulders."""
RANGE_DEG = {
    "scapular_retraction": (-25.0, 25.0), "glenohumeral_rotation": (-90.0, 90.0), "shoulder_adduction": (-60.0, 170.0),
    "humeral_flexion": (-90.0, 140.0), "forearm_extension": (-60.0, 90.0), "wrist_flexion": (-80.0, 80.0),
    "wrist_deviation": (-130.0, -40.0), "wrist_supination": (-110.0, 110.0),
}  # fmt: skip
"""The led arm's range of motion, that of problems/mirror/vr_hand.toml."""
LEFT_HAND = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
"""Fingers, back and across of a left hand in Table I's hand frame."""
PATIENT = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""Table I's shoulder axes (right, forward, up) in the patient's (forward, left, up)."""
FLIP = np.diag([1.0, -1.0, 1.0]), np.diag([1.0, 1.0, -1.0])
"""A hand across the sagittal plane: of its place, and of its own axes."""
BUSY = 0.35
"""[m] Height above and depth below the shoulder in which targets lie, in front of it."""


def reach_recording(folder: Path, seed: int, *, seconds: float = 8.0) -> dict[str, Any]:
    """Reaches of 0.5 to 1.5 s between hand poses that the led arm's mirror image has; the keys of `recording`."""
    rng = np.random.default_rng(seed)
    lower, upper = _limits()
    middle, half = (lower + upper) / 2, (upper - lower) / 2
    targets: list[Array] = []
    while len(targets) < 40:
        pose = hand(middle + 0.8 * half * rng.uniform(-1, 1, (1, 8)))[0]
        x, y, z = pose[:3, 3]
        if y > 0.15 and abs(z) < BUSY and abs(x) < BUSY:  # in front, not behind the back
            targets.append(pose)
    times = np.arange(round(seconds * RATE)) / RATE
    places, turns, at = np.empty((len(times), 3)), np.empty((len(times), 3, 3)), 0.0
    for a, b in itertools.pairwise(targets):
        # Not further at once than a hand goes, and a turn at random on top of it.
        b[:3, 3] = a[:3, 3] + (b[:3, 3] - a[:3, 3]) * min(1.0, 0.35 / np.linalg.norm(b[:3, 3] - a[:3, 3]))
        way = (Rotation.from_matrix(a[:3, :3]).inv() * Rotation.from_matrix(b[:3, :3])).as_rotvec()
        way *= min(1.0, 0.9 / float(np.linalg.norm(way)))
        b[:3, :3] = a[:3, :3] @ Rotation.from_rotvec(way).as_matrix()
        long = rng.uniform(0.5, 1.5)
        part = np.clip((times - at) / long, 0, 1)
        part = np.minimum(part**3 * (10 - 15 * part + 6 * part**2), 1)  # 2e-16 above it, by rounding
        now = times >= at
        places[now] = a[:3, 3] + part[now, None] * (b[:3, 3] - a[:3, 3])
        turns[now] = Slerp([0, 1], Rotation.from_matrix([a[:3, :3], b[:3, :3]]))(part[now]).as_matrix()
        at += long + rng.uniform(0.0, 0.3)
        if at > seconds:
            break
    # From the left arm's shoulder to the healthy hand's, in the patient's axes.
    mirrored = places @ PATIENT.T @ FLIP[0]
    axes = FLIP[0] @ PATIENT @ turns @ LEFT_HAND @ FLIP[1]
    rows = np.column_stack([times, mirrored, Rotation.from_matrix(axes).as_quat()])
    name = f"reaches_{seed}.csv"
    header = "t_s,x_m,y_m,z_m,qx,qy,qz,qw"
    np.savetxt(folder / name, rows, delimiter=",", header=header, comments="", fmt="%.6f")
    return {"file": name, "hand": "right", "frame": "robot", "fingers": "+x", "back": "+y"}


def slice_recording(first: int, *, rows: int = 480) -> dict[str, Any]:
    """Rows of the real hand, as problems/mirror/vr_hand.toml reads it; the keys of `recording`."""
    return {
        "file": "data:vr_hand_tracker/tracker_record_rows_1_3000.csv", "hand": "right", "frame": "unity",
        "fingers": "+x", "back": "+y", "position_columns": [4, 5, 6], "quaternion_columns": [11, 12, 13, 14],
        "rate_hz": RATE, "rows": [first, first + rows - 1],
    }  # fmt: skip


def _limits() -> tuple[Array, Array]:
    found = np.deg2rad(np.array(list(RANGE_DEG.values())))
    found[0] += np.pi  # Table I counts the first joint from its rest
    return found[:, 0], found[:, 1]
