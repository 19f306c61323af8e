"""Common form of URDF and MJCF files: steps from a base link to a tip, each fixed or with a joint."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rehab_opt.kinematics.denavit_hartenberg import exact
from rehab_opt.kinematics.link_capsules import CapsuleOnLink
from rehab_opt.kinematics.rigid import ROUNDED
from rehab_opt.kinematics.robot_file.xml_tree import Source

__all__ = [
    "BARELY",
    "Inertial",
    "Joint",
    "Step",
    "moved",
    "turned_about",
    "turned_by_quaternion",
    "turned_by_rpy",
    "unit_vector",
]

Array = NDArray[np.float64]

BARELY = 1e-7
"""Error of a unit vector rounded to eight digits; not worth a note."""


class Joint(NamedTuple):
    """A moving joint with its data from the file; NaN where the file gives none."""

    name: str
    prismatic: bool
    axis: Array
    """(3,) unit vector in the joint's frame."""
    lower: float
    upper: float
    velocity: float
    coupled_to: str = ""
    """Name of the joint to which this one is coupled, or empty."""
    effort: float = math.inf
    """Largest effort of its drive [N m or N], infinite if the file has none above zero."""


class Inertial(NamedTuple):
    """Mass, centre of mass and inertia of a link, in the link's frame."""

    mass: float
    """[kg]"""
    centre: Array
    """(3,) centre of mass [m]."""
    inertia: Array
    """(3, 3) about the centre [kg m^2]."""


class Step(NamedTuple):
    """A fixed transform, then optionally a joint, then optionally a link.

    A step with `aside` set is a branch, such as a camera or a gripper's finger: it starts at the last link of the
    chain, and the next step does not continue from it.
    """

    origin: Array
    """(4, 4)"""
    joint: Joint | None = None
    link: str = ""
    """Link whose frame lies here; empty for a step between two joints of one link."""
    inertial: Inertial | None = None
    bodies: tuple[CapsuleOnLink, ...] = ()
    """Capsules around the link's collision geometry, if requested."""
    aside: bool = False


def moved(x: float, y: float, z: float) -> Array:
    """(4, 4) pose of a translation by x, y and z [m]."""
    pose = np.eye(4)
    pose[:3, 3] = x, y, z
    return pose


def turned_by_rpy(roll: float, pitch: float, yaw: float) -> Array:
    """(3, 3) rotation about the fixed axes x, then y, then z [rad]."""
    (cr, sr), (cp, sp), (cy, sy) = ((exact(math.cos, a), exact(math.sin, a)) for a in (roll, pitch, yaw))
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def turned_by_quaternion(quaternion: Array) -> Array:
    """(3, 3) rotation from a unit quaternion (4,), real part first."""
    w, x, y, z = quaternion.tolist()
    return np.array(
        [
            [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
        ]
    )


def turned_about(axis: Array, angle: float) -> Array:
    """(3, 3) rotation about a unit axis (3,) by an angle [rad] (Rodrigues)."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turn: Array = np.eye(3) + exact(math.sin, angle) * cross + (1.0 - exact(math.cos, angle)) * (cross @ cross)
    return turn


def unit_vector(vector: Array, source: Source, key: str) -> tuple[Array, str]:
    """`vector` (k,) normalised, and a note if rounded numbers were corrected.

    Raises
    ------
    RobotFileError : the length differs from 1 by more than `ROUNDED`.
    """
    length = float(np.linalg.norm(vector))
    if not abs(length - 1.0) <= ROUNDED:
        written = " ".join(f"{each:.6g}" for each in vector)
        raise source.refuse(key, written, f"a vector of length 1 (its length is {length:.6g})")
    if abs(length - 1.0) <= BARELY:
        return vector / length if length != 1.0 else vector, ""
    return vector / length, f"{key}: the length is off by {abs(length - 1.0):.2g}, as rounded numbers are; 1 is used"
