"""Whether lengths, speeds and angles can be meant: one rule for all controllers.

What a caller gives in millimetres is a thousand times too large, what is in degrees 57 times. A length is compared with
the robot's reach, be it a finger's or a gantry's, a speed with the fastest that its joints make of it, and an angle of
a joint with two turns. Factors and floors are generous: what is refused is no motion of that robot.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.chain import SerialChain, per_joint
from rehab_opt.kinematics.denavit_hartenberg import TWO_TURNS

__all__ = ["ROOM", "check_speeds", "checked_length", "checked_posture", "farthest", "fastest", "implausible"]

LINEAR = ("x", "y", "z")

ROOM = 20.0
"""[m] from the origin, on each axis, within which a hand is that no robot is given for."""
FAR, NEAR = 10.0, 1.0
"""A robot's reaches, and [m] at least, beyond which a length is a mistake."""
FAST, WHIRL = 10.0, 12.0 * math.pi
"""[m/s, rad/s] No robot's hand is asked for more, unless its joints are faster."""
BEYOND = 10.0
"""Times the fastest motion of a hand beyond which a reference is a mistake; one that is too fast is slowed."""


def farthest(chain: SerialChain) -> float:
    """[m] from the base beyond which a place is a mistake."""
    return max(FAR * chain.reach, NEAR)


def fastest(chain: SerialChain) -> tuple[float, float]:
    """[m/s, rad/s] beyond which a hand's speed is a mistake: no posture of this chain gives as much."""
    turning = np.array([not row.prismatic for row in chain.rows])
    beyond = [chain.reach_from(i) for i in range(chain.n)]
    linear = np.where(turning, beyond * chain.velocity, chain.velocity).sum()
    return max(FAST, float(linear)), max(WHIRL, float(chain.velocity[turning].sum()))


def implausible(chain: SerialChain, names: Sequence[ca.SX], values: Sequence[ca.SX], rows: Sequence[str]) -> ca.SX:
    """Whether a pose (16,), by rows, is too far away; whether a twist (k,), of these rows, is too fast.

    Parameters
    ----------
    names : symbols called `pose` and `twist`, among others or not there. values : what stands in their places.
    """
    named = {each[0].name().rsplit("_", 1)[0]: value for each, value in zip(names, values, strict=True)}
    far, fast, (linear, angular) = ca.SX(0), ca.SX(0), fastest(chain)
    if "pose" in named:
        far = ca.norm_2(named["pose"][[3, 7, 11]] - ca.DM(chain.base[:3, 3])) > farthest(chain)
    if "twist" in named:
        most = ca.DM([BEYOND * (linear if row in LINEAR else angular) for row in rows])
        fast = ca.mmax(ca.fabs(named["twist"]) / most) > 1
    return ca.vertcat(far, fast)


def checked_length(argument: str, value: float, chain: SerialChain) -> float:
    """The length [m]; raises `ConfigurationError` for one of no robot's size."""
    if not abs(value) <= farthest(chain):
        expected = f"at most {farthest(chain):.3g} m, ten times the arm's reach: is it in metres?"
        raise ConfigurationError(argument, value, expected)
    return value


def check_speeds(chain: SerialChain, *, linear: float, angular: float) -> None:
    """Refuse largest speeds of a hand [m/s, rad/s] that no posture of the chain gives."""
    for argument, value, most, unit in zip(
        ("linear_speed", "angular_speed"), (linear, angular), fastest(chain), ("m/s", "rad/s"), strict=True
    ):
        if not value <= most:
            expected = f"at most {most:.3g} {unit}, more than this arm can: is it in {unit}?"
            raise ConfigurationError(argument, value, expected)


def checked_posture(argument: str, values: ArrayLike | None, chain: SerialChain) -> NDArray[np.float64] | None:
    """Joint values (n,) [rad, m], finite, or None; raises `ConfigurationError` for those of no robot."""
    if values is None:
        return None
    q = per_joint(argument, values, chain.n, finite=True)
    for name, row, value in zip(chain.names, chain.rows, q.tolist(), strict=True):
        if row.prismatic:
            checked_length(f"{argument} of {name}", value, chain)
        elif abs(value) > TWO_TURNS:
            raise ConfigurationError(f"{argument} of {name}", value, "an angle within two turns: is it in radians?")
    return q
