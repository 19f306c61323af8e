"""The 8-DOF upper limb of Rossa et al., Table I, for either side and any range of motion.

Base frame at the shoulder: z up, y forward, x to the participant's right. The handle lies along the hand's x axis;
a vertical handle has `pose[:3, 0]` along +z. Joint values are the absolute angles of Table I.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.kinematics.denavit_hartenberg import DH
from rehab_opt.kinematics.real_array import real_array

__all__ = ["ARM_JOINTS", "ARM_REST", "ARM_SEGMENTS", "RANGES_OF_MOTION_DEG", "human_arm"]

ARM_JOINTS = (
    "scapular_retraction",
    "glenohumeral_rotation",
    "shoulder_adduction",
    "humeral_flexion",
    "forearm_extension",
    "wrist_flexion",
    "wrist_deviation",
    "wrist_supination",
)

ARM_REST = np.deg2rad([180.0, 0.0, 90.0, 0.0, 0.0, 0.0, -90.0, 0.0])
"""(8,) [rad] rest angles of Table I: the arm hangs down."""
ARM_REST.flags.writeable = False

ARM_SEGMENTS: Mapping[str, float] = MappingProxyType(
    {"acromiohumeral": 0.130, "humerus": 0.290, "forearm": 0.300, "hand": 0.070}
)
"""[m] Segment lengths l0 to l3 of the paper's participant (section II-D)."""

# Table I as printed, except joint 7's regular limits, which are printed in reverse order (-30, -45). All are absolute
# angles except joint 1's: these are offsets from its rest of 180 deg, since otherwise the handle is never vertical.
_REGULAR_DEG = ((-10, 15), (-20, 10), (50, 90), (20, 80), (0, 70), (-50, 60), (-45, -30), (10, 50))
_RESTRICTED_DEG = ((0, 0), (0, 5), (70, 90), (30, 70), (30, 60), (30, 60), (-30, -30), (40, 45))
# The elbow's inner angle of 110 +- 2 deg is a flexion of 70 +- 2 deg; the caption limits no other joint.
_FIGURE_3_DEG = (*_REGULAR_DEG[:4], (68, 72), *_REGULAR_DEG[5:])
RANGES_OF_MOTION_DEG: Mapping[str, Mapping[str, tuple[float, float]]] = MappingProxyType(
    {
        name: MappingProxyType(dict(zip(ARM_JOINTS, limits, strict=True)))
        for name, limits in (
            ("regular", _REGULAR_DEG),
            ("restricted", _RESTRICTED_DEG),
            ("figure_3", _FIGURE_3_DEG),
        )
    }
)
"""[deg] The participant's ranges of motion by anatomical name; scapular_retraction is relative to its rest angle.

"regular" gives the paper's regular workspace W_r. The paper describes the comfortable workspace W_c in two ways:
"restricted" is that of Table I, "figure_3" that of the caption of Fig. 3.
"""

ARM_VELOCITY = 3.0
"""[rad/s] Assumption: the paper gives no joint speeds."""
ARM_ACCELERATION = 30.0
"""[rad/s^2] Assumption: the paper gives no joint accelerations."""


def human_arm(
    *,
    range_of_motion: str | Mapping[str, Sequence[float]] = "regular",
    segments: Mapping[str, float] | Sequence[float] = ARM_SEGMENTS,
    side: Literal["left", "right"] = "left",
    velocity: ArrayLike = ARM_VELOCITY,
    acceleration: ArrayLike = ARM_ACCELERATION,
) -> SerialChain:
    """Upper limb with a person's own limits.

    Parameters
    ----------
    range_of_motion : "regular" or "restricted" (Table I), "figure_3" (caption of Fig. 3: the regular range with the
        elbow flexed by 68 to 72 deg), or your own (lower, upper) [rad] by every name of `ARM_JOINTS`. As in Table I
        these are absolute angles, but scapular_retraction is relative to its rest. Equal limits lock a joint.
    segments : l0 to l3 [m] as four numbers or by name; a missing name gets the length of the paper's participant.
    side : "left" as in the paper, or "right", its mirror image in the sagittal plane (x -> -x). Equal joint angles give
        mirrored postures and a mirrored handle axis.
    velocity, acceleration : (8,) or scalar [rad/s, rad/s^2]; defaults are assumptions.

    Raises
    ------
    ConfigurationError : an unknown or missing joint name, an inverted range, a length that is not positive.
    """
    lower, upper = _limits(range_of_motion)
    l0, l1, l2, l3 = _lengths(segments)
    right_angle = math.pi / 2
    table = [  # a, alpha, d of Table I
        (l0, 0.0, 0.0),
        (0.0, -right_angle, 0.0),
        (0.0, -right_angle, 0.0),
        (l1, 0.0, 0.0),
        (l2, 0.0, 0.0),
        (0.0, right_angle, 0.0),
        (0.0, -right_angle, 0.0),
        (0.0, 0.0, l3),
    ]
    # With M = diag(-1, 1, 1) = -Rx(pi), M A(theta, d, a, alpha) M = Rx(pi) A(theta, -d, -a, alpha) Rx(pi): the
    # mirrored arm is a Denavit-Hartenberg chain of the same joint angles. The hand frame mirrors as M R diag(1,-1,1),
    # which keeps x along the handle and z along the fingers.
    if side not in ("left", "right"):
        raise ConfigurationError("side", side, "'left' or 'right'")
    mirror = -1.0 if side == "right" else 1.0
    return SerialChain(
        tuple(DH(a=mirror * a, alpha=alpha, d=mirror * d) for a, alpha, d in table),
        lower=lower,  # type: ignore[arg-type]
        upper=upper,  # type: ignore[arg-type]
        velocity=velocity,  # type: ignore[arg-type]
        acceleration=acceleration,  # type: ignore[arg-type]
        names=ARM_JOINTS,
        base=np.diag([1.0, mirror, mirror, 1.0]),
        tool=np.diag([mirror, 1.0, mirror, 1.0]),
    )


def _limits(range_of_motion: str | Mapping[str, Sequence[float]]) -> tuple[ArrayLike, ArrayLike]:
    if isinstance(range_of_motion, str):
        if range_of_motion not in RANGES_OF_MOTION_DEG:
            expected = " or ".join(repr(name) for name in RANGES_OF_MOTION_DEG)
            raise ConfigurationError("range_of_motion", range_of_motion, f"{expected}, or limits by joint name")
        by_name = {name: np.deg2rad(pair) for name, pair in RANGES_OF_MOTION_DEG[range_of_motion].items()}
    elif isinstance(range_of_motion, Mapping):
        by_name = {name: _pair(name, pair) for name, pair in range_of_motion.items()}
        missing = [name for name in ARM_JOINTS if name not in by_name]
        if missing:
            raise ConfigurationError("range_of_motion", sorted(by_name), f"limits of {', '.join(missing)} too")
    else:
        raise ConfigurationError("range_of_motion", range_of_motion, "a name, or limits by joint name")
    limits = np.array([by_name[name] for name in ARM_JOINTS])
    limits[0] += ARM_REST[0]
    return limits[:, 0], limits[:, 1]


def _pair(name: str, pair: object) -> NDArray[np.float64]:
    if name not in ARM_JOINTS:
        raise ConfigurationError("range_of_motion", name, f"joint names among {', '.join(ARM_JOINTS)}")
    try:
        limits = real_array(pair)
    except (TypeError, ValueError, OverflowError):
        limits = np.empty(0)
    if limits.shape != (2,) or not limits[0] <= limits[1]:
        raise ConfigurationError(f"range_of_motion[{name!r}]", pair, "(lower, upper) with lower <= upper")
    return limits


def _lengths(segments: Mapping[str, float] | Sequence[float]) -> tuple[float, ...]:
    if isinstance(segments, Mapping):
        unknown = [name for name in segments if name not in ARM_SEGMENTS]
        if unknown:
            raise ConfigurationError("segments", unknown[0], f"segment names among {', '.join(ARM_SEGMENTS)}")
        given: Iterable[object] = [{**ARM_SEGMENTS, **segments}[name] for name in ARM_SEGMENTS]
    else:
        given = segments if isinstance(segments, Sequence | np.ndarray) else ()
    try:
        lengths = tuple(map(float, real_array(list(given)).tolist()))
    except (TypeError, ValueError, OverflowError):
        lengths = ()
    if len(lengths) != len(ARM_SEGMENTS):
        raise ConfigurationError("segments", segments, f"{len(ARM_SEGMENTS)} lengths: {', '.join(ARM_SEGMENTS)}")
    # l0 and l3 may be zero (a wrist without a hand); the humerus and forearm may not.
    if not all(0 <= length < 2 for length in lengths) or not all(lengths[1:3]):
        raise ConfigurationError("segments", segments, "lengths in metres, 0 to 2, humerus and forearm above 0")
    return lengths
