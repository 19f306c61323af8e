"""Convert ranges of motion between a goniometer's angles and the joints of `human_arm`.

Names, zeros and signs are those of the neutral zero method of the American Academy of Orthopaedic Surgeons ("Joint
Motion: Method of Measuring and Recording", 1965): the arm hangs beside the trunk, elbow straight, thumb forward, hand
in line with the forearm; each movement is measured alone, all others at zero. An angle is positive in the direction of
its name, so a range is `(-extension, flexion)`; left and right arms use the same signs. The conversion is exact for one
movement at a time. Combined angles of the shoulder and wrist follow the joint order of Table I, Rossa et al. Combined
wrist ranges are therefore right only while the forearm is near mid-position (thumb up), as on a vertical handle.
`rehab_opt.workspace.clinical_angles` computes the joint angles of the ISB standard (Wu et al., J. Biomech. 38(5),
2005).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.human_arm import ARM_JOINTS, ARM_REST

__all__ = [
    "GONIOMETER",
    "Movement",
    "arm_posture",
    "arm_range_of_motion",
    "goniometer_angles",
    "goniometer_range",
    "range_in_words",
]

Array = NDArray[np.float64]


class Movement(NamedTuple):
    """One movement that a goniometer measures.

    Attributes
    ----------
    joint : the joint of `ARM_JOINTS` that moves.
    sign : joint = sign * angle + offset.
    offset_deg : [deg] joint angle where the goniometer reads zero; scapular_retraction counts from its rest angle.
    positive, negative : names of the movement in the two directions.
    zero : description of the zero position.
    range_deg : [deg] range of a very mobile person plus a margin; an angle beyond has a wrong unit or zero position.
    """

    joint: str
    sign: int
    offset_deg: float
    positive: str
    negative: str
    zero: str
    range_deg: tuple[float, float]


GONIOMETER: Mapping[str, Movement] = MappingProxyType(
    {
        "scapular_retraction": Movement(
            "scapular_retraction", 1, 0.0, "retraction", "protraction", "shoulder at rest", (-45, 45)
        ),
        "shoulder_flexion": Movement(
            "humeral_flexion", 1, 0.0, "flexion", "extension", "arm hangs", (-80, 190)
        ),
        "shoulder_abduction": Movement(
            "shoulder_adduction", -1, 90.0, "abduction", "adduction", "arm hangs", (-80, 190)
        ),
        "shoulder_external_rotation": Movement(
            "glenohumeral_rotation", 1, 0.0, "external rotation", "internal rotation",
            "upper arm at the side, forearm forward", (-120, 120),
        ),
        "elbow_flexion": Movement("forearm_extension", 1, 0.0, "flexion", "extension", "straight arm", (-25, 165)),
        "forearm_pronation": Movement(
            "wrist_supination", 1, 90.0, "pronation", "supination", "thumb up, the elbow bent", (-120, 110)
        ),
        "wrist_flexion": Movement(
            "wrist_deviation", 1, -90.0, "flexion", "extension", "hand in line with the forearm", (-100, 100)
        ),
        "wrist_ulnar_deviation": Movement(
            "wrist_flexion", -1, 0.0, "ulnar deviation", "radial deviation", "hand in line with the forearm", (-60, 70)
        ),
    }
)  # fmt: skip
"""Movements by name. Table I names its joints for the supinated forearm; with the thumb up, joint 7 flexes the wrist
and joint 6 deviates it. Positive joint 5 flexes the elbow, and positive joint 8 pronates."""


def arm_range_of_motion(goniometer: Mapping[str, Sequence[float]]) -> dict[str, tuple[float, float]]:
    """Convert measured ranges to (lower, upper) [rad] by joint name, for `human_arm(range_of_motion=...)`.

    Parameters
    ----------
    goniometer : (lower, upper) [rad] by every name of `GONIOMETER`. With a contracture both may have the same sign: an
        elbow that lacks 30 deg of extension and flexes to 120 deg has (30, 120) deg.

    Raises
    ------
    ConfigurationError : an unknown or missing name, an inverted range, an angle beyond human ranges (the message names
        the likely mistake).
    """
    for name in goniometer:
        if name not in GONIOMETER:
            raise ConfigurationError("goniometer", name, f"movements among {', '.join(GONIOMETER)}")
    missing = [name for name in GONIOMETER if name not in goniometer]
    if missing:
        raise ConfigurationError("goniometer", sorted(goniometer), f"ranges of {', '.join(missing)} too")
    ranges: dict[str, tuple[float, float]] = {}
    for name, movement in GONIOMETER.items():
        lower, upper = _pair(name, goniometer[name])
        strange = _looks_like(name, math.degrees(lower), math.degrees(upper))
        if strange:
            raise ConfigurationError(f"goniometer[{name!r}]", goniometer[name], strange)
        ends = [movement.sign * angle + math.radians(movement.offset_deg) for angle in (lower, upper)]
        ranges[movement.joint] = (min(ends), max(ends))
    return {joint: ranges[joint] for joint in ARM_JOINTS}


def goniometer_range(range_of_motion: Mapping[str, Sequence[float]]) -> dict[str, tuple[float, float]]:
    """Convert ranges of joints to (lower, upper) [rad] by name of `GONIOMETER`; inverse of `arm_range_of_motion`.

    Parameters
    ----------
    range_of_motion : (lower, upper) [rad] of all of `ARM_JOINTS`, as `human_arm` takes them.

    Raises
    ------
    ConfigurationError : a missing joint, an inverted range. Ranges beyond human ones are accepted: Table I of the paper
        has 60 deg of radial deviation.
    """
    missing = [joint for joint in ARM_JOINTS if joint not in range_of_motion]
    if missing:
        raise ConfigurationError("range_of_motion", sorted(range_of_motion), f"ranges of {', '.join(missing)} too")
    ranges: dict[str, tuple[float, float]] = {}
    for name, movement in GONIOMETER.items():
        pair = _pair(movement.joint, range_of_motion[movement.joint])
        ends = [movement.sign * (angle - math.radians(movement.offset_deg)) for angle in pair]
        ranges[name] = (min(ends), max(ends))
    return ranges


def arm_posture(angles: Mapping[str, float]) -> Array:
    """(8,) [rad] joint values of `human_arm` at these goniometer angles [rad]; missing angles are zero.

    Raises
    ------
    ConfigurationError : an unknown name, an angle that is not finite.
    """
    q = np.array([next(_zero(of) for of in GONIOMETER.values() if of.joint == joint) for joint in ARM_JOINTS])
    for name, angle in angles.items():
        if name not in GONIOMETER:
            raise ConfigurationError("angles", name, f"movements among {', '.join(GONIOMETER)}")
        if not -math.inf < angle < math.inf:
            raise ConfigurationError(f"angles[{name!r}]", angle, "a finite angle [rad]")
        movement = GONIOMETER[name]
        q[ARM_JOINTS.index(movement.joint)] = movement.sign * angle + _zero(movement)
    return q


def goniometer_angles(q: ArrayLike) -> dict[str, float]:
    """Angles [rad] by name of `GONIOMETER` at posture q (8,) [rad] of `human_arm`; inverse of `arm_posture`.

    Raises
    ------
    ConfigurationError : not eight finite numbers.
    """
    values = np.asarray(q, dtype=np.float64)
    if values.shape != (len(ARM_JOINTS),) or not np.isfinite(values).all():
        raise ConfigurationError("q", values.shape, f"({len(ARM_JOINTS)},) finite joint values [rad]")
    return {
        name: float(movement.sign * (values[ARM_JOINTS.index(movement.joint)] - _zero(movement)))
        for name, movement in GONIOMETER.items()
    }


def range_in_words(name: str, lower: float, upper: float) -> str:
    """A range [rad] of a movement in a clinician's words: "elbow: 30 to 120 deg of flexion"."""
    movement = GONIOMETER[name]
    part = name.partition("_")[0]
    low, high = (round(math.degrees(angle), 1) + 0.0 for angle in (lower, upper))
    if low == high:
        return f"{part}: locked at {_in_words(low, movement)}"
    if low >= 0:
        return f"{part}: {low:g} to {high:g} deg of {movement.positive}"
    if high <= 0:
        return f"{part}: {-high:g} to {-low:g} deg of {movement.negative}"
    return f"{part}: {-low:g} deg of {movement.negative} to {high:g} deg of {movement.positive}"


def _in_words(angle: float, movement: Movement) -> str:
    return f"{abs(angle):g} deg of {movement.positive if angle >= 0 else movement.negative}"


def _zero(movement: Movement) -> float:
    """[rad] absolute joint angle where the goniometer reads zero."""
    return math.radians(movement.offset_deg) + (ARM_REST[0] if movement.joint == ARM_JOINTS[0] else 0.0)


def _pair(name: str, pair: Sequence[float]) -> tuple[float, float]:
    try:
        lower, upper = (float(limit) for limit in pair)
    except (TypeError, ValueError, OverflowError):
        lower = upper = math.nan
    if not -math.inf < lower <= upper < math.inf:
        raise ConfigurationError(f"range of {name}", pair, "finite (lower, upper) with lower <= upper")
    return lower, upper


def _looks_like(name: str, lower: float, upper: float) -> str:
    """Likely mistake in a range [deg] of a movement, as text; empty if none shows."""
    movement = GONIOMETER[name]
    least, most = movement.range_deg
    if least <= lower and upper <= most:
        return ""
    expected = f"within {least:g} to {most:g} deg, zero: {movement.zero}, positive: {movement.positive}"
    if max(abs(lower), abs(upper)) > 720:
        return f"{expected} (degrees given as radians, or counts of an encoder?)"
    if name == "elbow_flexion" and upper > most:
        return f"{expected} (180 deg at the straight arm? then [180 - upper, 180 - lower])"
    if name == "forearm_pronation":
        return f"{expected} (counted from the supinated hand, as ISB does? then 90 deg less)"
    if name.startswith("wrist") and upper > 120:
        return f"{expected} (180 deg in line with the forearm? then 180 deg less)"
    return f"{expected} (another zero?)"
