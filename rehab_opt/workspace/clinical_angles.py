"""Convert clinical (ISB) angles of the arm to the model joints of Table I, by rotations.

The model's shoulder (joints 2 to 4) and wrist (6 to 8) each turn about three axes through one point. So do the clinical
angles, but in another order and about other axes. Three clinical angles together therefore give three model joints,
exactly except at the two singular postures below. A table of one clinical angle per joint would be wrong: with the arm
raised, axial rotation of the humerus is the model's adduction.

`CLINICAL_ANGLES` lists the assumptions and their certainty.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.kinematics.human_arm import ARM_REST

__all__ = [
    "CLINICAL_ANGLES",
    "WITHOUT_A_JOINT",
    "ClinicalAngle",
    "isb_shoulder",
    "isb_wrist",
    "model_scapula",
    "model_shoulder",
    "model_wrist",
]

Array = NDArray[np.float64]


class ClinicalAngle(NamedTuple):
    """One clinical angle, and how the model uses it."""

    column: str  # name in the files of Vanmechelen et al.
    name: str  # clinical name; the name gives the positive direction
    sign: int  # clinical value = sign * (value in the file)
    joints: tuple[str, ...]  # model joints that this angle moves
    zero: str  # posture at zero
    sure: str  # "high": shown by forward kinematics; "fair": convention read off the data; "low": a choice
    why: str


SHOULDER = ("glenohumeral_rotation", "shoulder_adduction", "humeral_flexion")
WRIST = ("wrist_flexion", "wrist_deviation", "wrist_supination")

CLINICAL_ANGLES = (
    ClinicalAngle(
        "ScPro", "scapular_protraction", 1, ("scapular_retraction",), "each row's own start of the reach", "low",
        "the model counts retraction from a rest the files do not hold; it turns 0.13 m about the vertical, all the "
        "scapula does in it",
    ),
    ClinicalAngle(
        "ShAbd", "elevation_plane", 1, SHOULDER, "raised to the side; 90 deg: to the front", "fair",
        "ISB order plane, elevation, axial rotation; forward reaches end at 85 to 95 deg, as they must",
    ),
    ClinicalAngle(
        "ShEl", "shoulder_elevation", -1, SHOULDER, "arm hangs", "high",
        "negative in the files, as ISB counts it; grows from 20 to 85 deg in a forward reach",
    ),
    ClinicalAngle(
        "ShRot", "humeral_axial_rotation", 1, SHOULDER, "anatomical posture; internal rotation positive", "fair",
        "plane and axial rotation are of opposite sign, as for an elbow that stays near the side",
    ),
    ClinicalAngle(
        "ElbFlExt", "elbow_flexion", 1, ("forearm_extension",), "straight arm", "high",
        "joint 5 moves the forearm forward as it grows, whatever its name; the carrying angle is left out",
    ),
    ClinicalAngle(
        "ElbProSup", "forearm_pronation", 1, WRIST, "fully supinated (palm forward in the hanging arm)", "fair",
        "reaches forwards end palm down (within 10 deg) and the thumb rises in the grasp of a vertical object, but "
        "to 43 deg from upright only: the zero may be off by that (`grasp_zero` in session/cp_reach.py)",
    ),
    ClinicalAngle(
        "WristFlExt", "wrist_flexion", 1, WRIST, "hand in line with the forearm", "fair",
        "the paper reports more wrist flexion in dyskinetic cerebral palsy: its rows are the larger ones",
    ),
    ClinicalAngle(
        "WristDev", "ulnar_deviation", 1, WRIST, "hand in line with the forearm", "low",
        "ISB counts ulnar deviation positive; nothing in the files contradicts or confirms it, means are near zero",
    ),
)  # fmt: skip
"""The mapping as data. Left and right arms have the same signs: files are assumed to mirror left arms, as `human_arm`
does."""

HANGING = 1e-9
"""Sine of the elevation below which the arm counts as hanging."""

WITHOUT_A_JOINT = ("ScRot", "ScTil", "TrFl", "TrLatFl", "TrRot")
"""Columns without a joint in the model: scapular rotation and tilt, and the trunk, which is fixed."""


def model_shoulder(plane: ArrayLike, elevation: ArrayLike, axial: ArrayLike) -> tuple[Array, Array, Array]:
    """Joints 2, 3 and 4 [rad] of the model from humerothoracic angles [rad] of broadcastable shapes.

    Joint 1 is assumed at rest; if it is at r from rest, subtract r from joint 2 (both turn about the vertical).

    Rz(q2) Ry(pi/2 - q3) Rx(q4) = Rz(-plane) Ry(elevation) Rz(-axial) in the left arm's base frame. Singular if the arm
    is raised sideways without axial rotation (sin(elevation) cos(axial) = 1), where joints 2 and 4 have the same axis.
    """
    p, e, r = _together(plane, elevation, axial)
    abduction = np.arcsin(np.clip(np.sin(e) * np.cos(r), -1.0, 1.0))
    flexion = np.arctan2(-np.sin(e) * np.sin(r), np.cos(e))
    turn = np.arctan2(-np.sin(r), np.cos(e) * np.cos(r)) - p
    return _wrapped(turn), ARM_REST[2] - abduction, flexion


def model_wrist(pronation: ArrayLike, flexion: ArrayLike, ulnar: ArrayLike) -> tuple[Array, Array, Array]:
    """Joints 6, 7 and 8 [rad] of the model from forearm and wrist angles [rad] of broadcastable shapes.

    The model rotates the hand about its long axis last; in anatomy the forearm rotates first. The model's wrist flexion
    and deviation therefore refer to the supinated forearm. Rx(q6) Ry(-(q7 + pi/2)) Rz(-q8) = Rz(-pronation) Rx(flexion)
    Ry(-ulnar). Singular if the hand points sideways at a right angle to the forearm. Joint 8 is within half a turn of
    90 deg (thumb up).
    """
    g, f, d = _together(pronation, flexion, ulnar)
    sg, cg, sf, cf, sd, cd = np.sin(g), np.cos(g), np.sin(f), np.cos(f), np.sin(d), np.cos(d)
    # Fingers (-z of the hanging hand) and the first row of the rotation.
    across, forward, down = cg * sd + sg * sf * cd, -sg * sd + cg * sf * cd, cf * cd
    first_x, first_y = cg * cd - sg * sf * sd, sg * cf
    joint_7 = ARM_REST[6] + np.arcsin(np.clip(across, -1.0, 1.0))
    joint_8 = np.pi / 2 + _wrapped(np.arctan2(first_y, first_x) - np.pi / 2)
    return np.arctan2(forward, down), joint_7, joint_8


def isb_shoulder(joint_2: ArrayLike, joint_3: ArrayLike, joint_4: ArrayLike) -> tuple[Array, Array, Array]:
    """Elevation plane, elevation (0 to pi) and axial rotation [rad] from joints 2, 3 and 4 [rad].

    Inverse of `model_shoulder`. For a hanging arm (elevation 0) only the sum of plane and axial rotation is defined,
    and the plane is zero.
    """
    turn, adduction, flexion = _together(joint_2, joint_3, joint_4)
    a = ARM_REST[2] - adduction
    sa, ca, sf, cf = np.sin(a), np.cos(a), np.sin(flexion), np.cos(flexion)
    raised = np.hypot(sa, ca * sf)
    elevation = np.arctan2(raised, ca * cf)
    hangs = raised < HANGING
    plane = np.where(hangs, 0.0, -(turn + np.arctan2(-sf, sa * cf)))
    # The first two entries of the last row of R = Rz(turn) Ry(a) Rx(flexion), or all of R for a hanging arm.
    axial = np.where(hangs, -turn, np.arctan2(-ca * sf, sa))
    return _wrapped(plane), elevation, _wrapped(axial)


def isb_wrist(joint_6: ArrayLike, joint_7: ArrayLike, joint_8: ArrayLike) -> tuple[Array, Array, Array]:
    """Pronation, wrist flexion (within a right angle) and ulnar deviation [rad] from joints 6, 7 and 8 [rad].

    Inverse of `model_wrist`; singular if the wrist is flexed by a right angle.
    """
    a, b, c = _together(joint_6, joint_7, joint_8)
    b, c = -(b - ARM_REST[6]), -c
    sa, ca, sb, cb, sc, cc = np.sin(a), np.cos(a), np.sin(b), np.cos(b), np.sin(c), np.cos(c)
    flexion = np.arcsin(np.clip(sa * cc + ca * sb * sc, -1.0, 1.0))
    ulnar = np.arctan2(sa * sc - ca * sb * cc, ca * cb)
    return np.arctan2(-cb * sc, ca * cc - sa * sb * sc), flexion, ulnar


def model_scapula(protraction: ArrayLike) -> Array:
    """Joint 1 [rad], relative to rest, for protraction (..., T) [rad]; the first sample of each row is the rest."""
    rows = np.asarray(protraction, dtype=np.float64)
    return rows[..., :1] - rows


def _wrapped(angle: Array) -> Array:
    """`angle`, shifted by whole turns into (-pi, pi]."""
    return np.asarray(-((np.pi - angle) % (2 * np.pi)) + np.pi)


def _together(*angles: ArrayLike) -> tuple[Array, ...]:
    return tuple(np.broadcast_arrays(*(np.asarray(angle, dtype=np.float64) for angle in angles)))
