"""ARDIS, a wheelchair with a four-joint arm, as one chain (Table 1, Honzik).

The paper gives only the joints' order and axes. Every length, mass and limit is an assumption that an argument
replaces. With the defaults the hand reaches the floor, a table and a lift's buttons, as the paper requires.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.kinematics.body import Body
from rehab_opt.kinematics.chain import SerialChain, per_joint
from rehab_opt.kinematics.denavit_hartenberg import DH
from rehab_opt.kinematics.drive import Differential, Mecanum, checked_amounts, checked_lengths
from rehab_opt.kinematics.inertia import rod
from rehab_opt.kinematics.mobile_arm import CHAIR, Capsule, MobileArm, Outline

__all__ = ["ARDIS_KEEP_OUT", "ARDIS_READY", "ardis"]

Array = NDArray[np.float64]

_NAMES = ("forward", "left", "turn", "shoulder_flexion", "shoulder_rotation", "elbow", "wrist")
# The upper arm goes from 20 deg backwards to 165 deg forward and down; at 85 deg the elbow is nearly stretched.
_LOWER = (-math.inf, -math.inf, -math.inf, *np.deg2rad([-165.0, -100.0, -75.0, -170.0]))
_UPPER = (math.inf, math.inf, math.inf, *np.deg2rad([20.0, 100.0, 85.0, 170.0]))

ARDIS_READY = np.array([0.0, 0.0, 0.0, -0.9, 0.0, -0.1, 0.0])
"""[m, rad] Start posture: the hand is in front of the armrest."""
ARDIS_READY.flags.writeable = False

ARDIS_KEEP_OUT = (
    Capsule("trunk and head", (-0.15, 0.0, 0.55), (-0.15, 0.0, 1.25), 0.18),
    Capsule("legs", (-0.1, 0.0, 0.55), (0.40, 0.0, 0.50), 0.18),
    Capsule("chair", (-0.25, 0.0, 0.25), (0.30, 0.0, 0.25), 0.24),
)
"""Assumed shapes of a sitting adult between the wheels, and of the chair below."""


def ardis(
    *,
    a3: float = 0.10,
    d4: float = 0.38,
    d5: float = 0.45,
    d7: float = 0.50,
    mount_height: float = 0.70,
    chair_mass: float = 120.0,
    chair_turn_inertia: float = 12.0,
    shoulder_mass: float = 2.0,
    upper_arm_mass: float = 2.5,
    forearm_mass: float = 1.5,
    hand_mass: float = 0.8,
    payload: float = 0.0,
    rotors: ArrayLike = (0.0, 0.0, 0.0, 0.15, 0.15, 0.10, 0.02),
    lower: ArrayLike = _LOWER,
    upper: ArrayLike = _UPPER,
    velocity: ArrayLike = (0.8, 0.8, 1.0, 1.0, 1.0, 1.2, 1.5),
    acceleration: ArrayLike = (1.0, 1.0, 1.5, 4.0, 4.0, 4.0, 6.0),
    mecanum: Mecanum | None = None,
    differential: Differential | None = None,
    outline: Outline | None = None,
    keep_out: Sequence[Capsule] = ARDIS_KEEP_OUT,
    limit_cost: float = 1.0,
    singular_cost: float = 1.0,
) -> MobileArm:
    """The chair with its arm on the right side. World frame: x forward, y left, z up, floor at 0.

    At q = 0 the upper arm points up and the forearm forward; negative q4 lowers the upper arm to the front, q5 turns it
    about its own axis, positive q6 stretches the elbow, and q7 turns the hand about the forearm axis z7.

    Parameters
    ----------
    a3, d4 : [m] distance of the shoulder to the front and to the right of the chair's turning point.
    d5, d7 : [m] lengths of the upper arm, and of forearm and hand.
    mount_height : [m] height of the shoulder above the floor.
    chair_mass : [kg] with its user. chair_turn_inertia : [kg m^2] about the turning point.
    shoulder_mass, upper_arm_mass, forearm_mass, hand_mass, payload : [kg]; the hand holds the payload.
    rotors : (7,) inertia of motors and gears at the joints [kg m^2; for the chair kg].
    lower, upper, velocity, acceleration : (7,) limits; those of the chair are in the chassis frame, and its positions
        are unbounded.
    mecanum, differential, outline, keep_out : see `MobileArm`.
    limit_cost, singular_cost : weights of the posture cost c of Eq. (1).

    Raises
    ------
    ConfigurationError : an argument is out of range.
    """
    checked_lengths(d5=d5, d7=d7, mount_height=mount_height, chair_mass=chair_mass)
    checked_amounts(
        chair_turn_inertia=chair_turn_inertia, shoulder_mass=shoulder_mass, upper_arm_mass=upper_arm_mass,
        forearm_mass=forearm_mass, hand_mass=hand_mass, payload=payload,
    )  # fmt: skip
    rows = (
        DH(0.0, -math.pi / 2, 0.0, math.pi / 2, prismatic=True),
        DH(0.0, math.pi / 2, 0.0, -math.pi / 2, prismatic=True),
        DH(a3, math.pi / 2),
        DH(0.0, -math.pi / 2, d4),
        DH(0.0, math.pi / 2, d5),
        DH(0.0, math.pi / 2, 0.0, math.pi / 2),
        DH(0.0, 0.0, d7),
    )
    chain = SerialChain(
        rows, lower=lower, upper=upper, velocity=velocity, acceleration=acceleration, names=_NAMES,  # type: ignore[arg-type]
        base=_base(mount_height),
    )  # fmt: skip
    # Link frame 3 is under the shoulder, with x forward, y down and z right. The upper arm lies along -y of frame 5,
    # the forearm along z of frames 6 (at the elbow) and 7 (at the hand).
    upper_arm, forearm = np.array([0.0, d5, 0.0]), np.array([0.0, 0.0, d7])
    bodies = (
        Body("chair", CHAIR, chair_mass, np.array([-a3, 0.0, 0.0]), chair_turn_inertia * np.eye(3)),
        Body("shoulder", 4, shoulder_mass, np.zeros(3), rod(shoulder_mass, (0.0, 0.1, 0.0), 0.06)),
        Body("upper arm", 5, upper_arm_mass, -0.5 * upper_arm, rod(upper_arm_mass, upper_arm, 0.05)),
        Body("forearm", 6, forearm_mass, 0.4 * forearm, rod(forearm_mass, 0.8 * forearm, 0.04)),
        Body("hand", 7, hand_mass, np.array([0.0, 0.0, -0.06]), rod(hand_mass, (0.0, 0.0, 0.12), 0.04)),
        Body("payload", 7, payload, np.zeros(3), np.zeros((3, 3))),
    )
    return MobileArm(
        chain,
        bodies=bodies,
        rotors=per_joint("rotors", rotors, len(rows)),
        mecanum=Mecanum(radius=0.10, half_gauge=0.28, half_base=0.25, limit=10.0) if mecanum is None else mecanum,
        differential=Differential(radius=0.15, half_gauge=0.28, limit=7.0) if differential is None else differential,
        outline=Outline(rear=-0.45, front=0.55, right=-0.33, left=0.33) if outline is None else outline,
        keep_out=keep_out,  # type: ignore[arg-type]
        limit_cost=limit_cost,
        singular_cost=singular_cost,
        hand_volume=d5 * d7**2,  # upper arm and forearm at right angles to each other and to the joint axes
    )


def _base(height: float) -> Array:
    """(4, 4) pose of frame 0 of Table 1 in the world: z of this frame points forward, -x left, -y up."""
    return np.array([[0.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, height], [0.0, 0.0, 0.0, 1.0]])
