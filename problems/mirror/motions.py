"""Write the recordings beside this script: `python problems/mirror/motions.py`.

The recordings are generated, since those of Xu, Guo, Zhang 2021 are not published: a healthy right hand performs the
paper's tasks. Each motion is designed for the mirrored left hand on a UR5 at the origin (x forward from the robot, y
left, z up). It is then mirrored to the right hand and written in the format of a tracker of virtual reality: Unity
axes, 90 Hz, quaternions x, y, z, w. Fruit and door pass near the elbow, wrist and shoulder singularities (the paper's
first situation). Wiping a table stays far from them (its second situation); meanwhile the patient turns, as the track
of a helmet shows.

The patient sits 1.1 m in front of the robot and faces it. Frames:

    hand frame  x to the fingertips, y out of the back of the hand, z across it ("lateral" = z); the robot's tool frame
    mirror      plane y = SAGITTAL of the robot's frame, normal y
    VR          Unity axes; turned to x forward, y left, z up, its frame lies at VR_POSE in the robot's frame

Between the poses below, the hand moves in straight lines and even turns with minimum jerk. It rests for a moment at
each pose. The door's handle moves round the hinge.
"""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rehab_opt import ur5
from rehab_opt.control.between_poses import turn_between, turned
from rehab_opt.kinematics.vr import Mirror, quaternions_of

Array = NDArray[np.float64]

RATE = 90.0  # [Hz]
SAGITTAL = 0.45  # [m]
MIRROR = Mirror((0.0, SAGITTAL, 0.0), (0.0, 1.0, 0.0), "z")
VR_POSE = np.array([[-1.0, 0, 0, 1.1], [0, -1.0, 0, SAGITTAL], [0, 0, 1.0, -0.6], [0, 0, 0, 1.0]])
REST = 0.4  # [s]

START = np.array([3.2, -1.5, 1.9, -2.0, -1.4, 0.2])
"""(6,) [rad] joint angles of the robot where the motions begin."""
# Postures on the way, each near a singularity: w / w_max is 0.2, 0.2 and 0.15.
FRUIT = np.array([3.4, -0.85, 0.20, -1.00, -1.4, 0.2])  # the arm stretched: elbow
TWIST = np.array([3.3, -1.3, 1.6, -1.9, -0.24, 0.5])  # the hand turned aside: wrist
BASKET = np.array([3.0, -2.25, 2.15, -1.9, -1.4, 0.2])  # close to the robot's axis: shoulder
HANDLE = np.array([3.3, -0.80, 0.22, -1.0, -1.0, 0.2])  # far out: elbow; the pull turns the hand towards the wrist's
HINGE = 0.42, math.radians(55.0)  # [m] distance from the handle; [rad] angle by which the door is opened
STROKES = [(0.0, 0.15), (0.05, -0.15), (0.1, 0.15), (0.15, -0.15), (0.2, 0.15)]  # [m] x, y from the start
HELMET = np.array([[-1.0, 0, 0, 1.1], [0, -1.0, 0, SAGITTAL], [0, 0, 1.0, 0.55], [0, 0, 0, 1.0]])
LOOKS_ASIDE = math.radians(12.0), 6.0  # to either side, and the period [s]


def minimum_jerk(seconds: float) -> Array:
    """(N,) from 0 to 1 at the recording's rate."""
    u = np.linspace(0.0, 1.0, max(round(seconds * RATE), 2), endpoint=False)
    return u**3 * (10.0 - 15.0 * u + 6.0 * u**2)


def line(a: Array, b: Array, speed: float) -> list[Array]:
    """Poses from a to b, the hand at most at `speed` [m/s] and 1 rad/s, then a rest."""
    way, turn = float(np.linalg.norm(b[:3, 3] - a[:3, 3])), turn_between(a, b)
    seconds = 1.875 * max(way / speed, float(np.linalg.norm(turn)) / 1.0)
    return [between(a, b, turn, s) for s in minimum_jerk(seconds)] + [b] * round(REST * RATE)


def between(a: Array, b: Array, turn: Array, fraction: float) -> Array:
    """The pose at a fraction of the way from a to b."""
    pose = np.eye(4)
    pose[:3, :3] = turned(a[:3, :3], fraction * turn)
    pose[:3, 3] = a[:3, 3] + fraction * (b[:3, 3] - a[:3, 3])
    return pose


def pick_fruit() -> list[Array]:
    """Poses of the left hand: reach up for the fruit, turn it off its twig, put it into the basket, come back."""
    start, fruit, twist, basket = (ur5().pose(q) for q in (START, FRUIT, TWIST, BASKET))
    return [
        *[start] * round(REST * RATE), *line(start, fruit, 0.22), *line(fruit, twist, 0.22), *line(twist, basket, 0.22),
        *line(basket, start, 0.22),
    ]  # fmt: skip


def refrigerator_door() -> list[Array]:
    """Poses of the left hand: to the handle, round the hinge and back (faster than the robot may move it), and home."""
    start, handle = (ur5().pose(q) for q in (START, HANDLE))
    radius, opening = HINGE
    hinge = handle[:3, 3] + [0.0, -radius, 0.0]
    pull = [around(handle, hinge, opening * s) for s in minimum_jerk(2.2)]
    opened = around(handle, hinge, opening)
    push = [around(handle, hinge, opening * (1.0 - s)) for s in minimum_jerk(1.8)]
    return [
        *[start] * round(REST * RATE), *line(start, handle, 0.35), *pull, *[opened] * round(REST * RATE), *push,
        *line(handle, start, 0.35),
    ]  # fmt: skip


def wipe_table() -> list[Array]:
    """Poses of the left hand: strokes over a table, each further away, with a turn of the hand, and back."""
    start = ur5().pose(START)
    ends = [start]
    for x, y in STROKES:
        pose = around(start, start[:3, 3], y)  # 1 rad a metre
        pose[:2, 3] += (x, y)
        ends.append(pose)
    legs = [pose for a, b in pairwise([*ends, start]) for pose in line(a, b, 0.2)]
    return [*[start] * round(REST * RATE), *legs]


def turning(samples: int) -> list[Array]:
    """Motions (4, 4) of a patient who turns about the vertical through the helmet, to one side and the other."""
    turn, period = LOOKS_ASIDE
    angles = turn * np.sin(2.0 * math.pi / (period * RATE) * np.arange(samples)) ** 3  # begins at rest
    return [around(np.eye(4), HELMET[:3, 3], angle) for angle in angles]


def around(pose: Array, hinge: Array, angle: float) -> Array:
    """`pose` turned about the vertical through `hinge`."""
    rotation = turned(np.eye(3), np.array([0.0, 0.0, angle]))
    found = np.eye(4)
    found[:3, :3] = rotation @ pose[:3, :3]
    found[:3, 3] = hinge + rotation @ (pose[:3, 3] - hinge)
    return found


def unity_from_robot(positions: Array, quaternions: Array) -> tuple[Array, Array]:
    """Inverse of `robot_from_unity`."""
    p, q = positions, quaternions
    return (
        np.stack([-p[..., 1], p[..., 2], p[..., 0]], axis=-1),
        np.stack([q[..., 1], -q[..., 2], -q[..., 0], q[..., 3]], axis=-1),
    )


def recorded(poses: list[Array], motions: list[Array] | None = None) -> str:
    """The text of a recording of the right hand whose mirror image moves through `poses`, the patient by `motions`."""
    moved = np.eye(4) if motions is None else np.array(motions)
    return tracked(moved @ MIRROR.poses(np.linalg.inv(moved) @ np.array(poses)))


def tracked(poses: Array) -> str:
    """The text of a recording of `poses` (N, 4, 4) of the robot's frame."""
    seen = np.linalg.inv(VR_POSE) @ poses
    positions, quaternions = unity_from_robot(seen[:, :3, 3], quaternions_of(seen[:, :3, :3]))
    lines = ["t_s,x_m,y_m,z_m,qx,qy,qz,qw"]
    for i, (p, q) in enumerate(zip(positions, quaternions, strict=True)):
        lines.append(",".join([f"{i / RATE:.6f}", *(f"{x:.6f}" for x in p), *(f"{x:.5f}" for x in q)]))
    return "\n".join(lines) + "\n"


def calibration_points() -> str:
    """Corners of the table and two points above, in VR and in the robot's frame, touched with 1 mm of error."""
    rng = np.random.default_rng(6)
    robot = np.array([[0.3, -0.3, 0], [0.3, 0.6, 0], [0.8, 0.6, 0], [0.8, -0.3, 0], [0.5, 0.1, 0.4], [0.7, 0.4, 0.3]])
    seen = (robot - VR_POSE[:3, 3]) @ VR_POSE[:3, :3] + 1e-3 * rng.standard_normal(robot.shape)
    unity, _ = unity_from_robot(seen, np.tile([0.0, 0.0, 0.0, 1.0], (len(seen), 1)))
    lines = ["vr_x_m,vr_y_m,vr_z_m,robot_x_m,robot_y_m,robot_z_m"]
    lines += [",".join(f"{x:.4f}" for x in (*a, *b)) for a, b in zip(unity, robot, strict=True)]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Write the files beside this script."""
    here = Path(__file__).parent
    (here / "pick_fruit.csv").write_text(recorded(pick_fruit()))
    (here / "refrigerator_door.csv").write_text(recorded(refrigerator_door()))
    wiping = wipe_table()
    (here / "wipe_table.csv").write_text(recorded(wiping, turning(len(wiping))))
    (here / "wipe_table_helmet.csv").write_text(tracked(np.array(turning(len(wiping))) @ HELMET))
    (here / "calibration_points.csv").write_text(calibration_points())


if __name__ == "__main__":
    main()
