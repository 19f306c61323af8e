"""The UR5 (CB3) with the vendor's Denavit-Hartenberg lengths and limits."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.kinematics.denavit_hartenberg import DH
from rehab_opt.kinematics.link_capsules import LinkCapsule

__all__ = ["UR5_ACCELERATION", "UR5_CAPSULES", "ur5"]

UR5_ACCELERATION = 15.0
"""[rad/s^2] Assumption: the vendor publishes no acceleration limit."""

_ROWS = (
    DH(a=0.0, alpha=math.pi / 2, d=0.089159),
    DH(a=-0.425, alpha=0.0),
    DH(a=-0.39225, alpha=0.0),
    DH(a=0.0, alpha=math.pi / 2, d=0.10915),
    DH(a=0.0, alpha=-math.pi / 2, d=0.09465),
    DH(a=0.0, alpha=0.0, d=0.0823),
)
_NAMES = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
_ASIDE, _LARGE, _SMALL = 0.149, 0.073, 0.066
UR5_CAPSULES = (
    LinkCapsule("shoulder", 1, (0.0, 0.0, 0.0), (0.0, 0.0, _ASIDE), _LARGE),
    LinkCapsule("upper_arm", 2, (0.425, 0.0, _ASIDE), (0.0, 0.0, _ASIDE), _LARGE),
    LinkCapsule("elbow", 2, (0.0, 0.0, _ASIDE), (0.0, 0.0, 0.0), _LARGE),
    LinkCapsule("forearm", 3, (0.39225, 0.0, 0.0), (0.0, 0.0, 0.0), _SMALL),
    LinkCapsule("wrist_1", 4, (0.0, -0.10915, 0.0), (0.0, 0.0, 0.0), _SMALL),
    LinkCapsule("wrist_2", 5, (0.0, 0.09465, 0.0), (0.0, 0.0, 0.0), _SMALL),
    LinkCapsule("wrist_3", 5, (0.0, 0.0, 0.0), (0.0, 0.0, 0.025), _SMALL),
)
"""Capsules that enclose the vendor's collision meshes of all moving links (ur_description, meshes/ur5).

The upper arm lies 0.136 m beside the line of its Denavit-Hartenberg frames, the forearm 0.017 m. The radii are those of
the joint housings plus a few millimetres; the tubes between them are thinner (0.051, 0.04 m). The last capsule extends
9 mm beyond the flange. Cables and tools on the flange are not covered.
"""
# Vendor's joint_limits.yaml: +-360 deg, the elbow +-180 deg, because further on it hits the robot's body.
_REACH = np.deg2rad([360.0, 360.0, 180.0, 360.0, 360.0, 360.0])


def ur5(
    *,
    lower: ArrayLike | None = None,
    upper: ArrayLike | None = None,
    velocity: ArrayLike = math.pi,
    acceleration: ArrayLike = UR5_ACCELERATION,
    base: ArrayLike | None = None,
    tool: ArrayLike | None = None,
    capsules: Sequence[LinkCapsule] = UR5_CAPSULES,
) -> SerialChain:
    """UR5 from the vendor's nominal kinematics.

    Parameters
    ----------
    lower, upper : (6,) joint limits [rad]; default +-2 pi, elbow +-pi.
    velocity : (6,) or scalar [rad/s]; default pi, the vendor's limit.
    acceleration : (6,) or scalar [rad/s^2]; default `UR5_ACCELERATION`, an assumption.
    base, tool : (4, 4) pose of the robot's base in the base frame, and of the tool in the flange frame.
    capsules : the links' shapes; default `UR5_CAPSULES`. Add one for a tool on the flange (frame 6).
    """
    return SerialChain(
        _ROWS,
        lower=-_REACH if lower is None else lower,  # type: ignore[arg-type]
        upper=_REACH if upper is None else upper,  # type: ignore[arg-type]
        velocity=velocity,  # type: ignore[arg-type]
        acceleration=acceleration,  # type: ignore[arg-type]
        names=_NAMES,
        base=np.eye(4) if base is None else base,  # type: ignore[arg-type]
        tool=np.eye(4) if tool is None else tool,  # type: ignore[arg-type]
        capsules=tuple(capsules),
    )
