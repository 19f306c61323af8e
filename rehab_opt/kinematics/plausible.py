"""Detect values in wrong units: one rule for lengths, speeds and angles of all controllers.

A length in millimetres is a thousand times too large, an angle in degrees 57 times. A length is compared with the
robot's reach, a speed with the largest hand speed that its joints allow, and a joint angle with two turns. The limits
are wide: the robot cannot perform the motion of a rejected value.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.chain import SerialChain, per_joint
from rehab_opt.kinematics.denavit_hartenberg import FASTEST, SIX_TURNS, TWO_TURNS
from rehab_opt.kinematics.link_capsules import Capsule
from rehab_opt.kinematics.room import MOVING, SIGHT, Box, KeepOut

__all__ = [
    "ROOM", "check_place", "check_speeds", "checked_length", "checked_posture", "farthest", "fastest", "implausible",
]  # fmt: skip

LINEAR = ("x", "y", "z")

ROOM = 20.0
"""[m] Largest accepted coordinate of a hand position if no robot is known."""
FAR, NEAR = 10.0, 1.0
"""Largest accepted length: `FAR` times the robot's reach, but at least `NEAR` [m]."""
BEYOND = 3.0
"""Ratio of a reference's speed to the fastest hand motion. Above this ratio the reference is invalid; up to it the
reference is slowed down."""


def farthest(chain: SerialChain) -> float:
    """[m] largest accepted distance of a position from the base."""
    return max(FAR * chain.reach, NEAR)


def fastest(chain: SerialChain) -> tuple[float, float]:
    """[m/s, rad/s] largest accepted hand speeds; no posture of this chain exceeds them."""
    turning = np.array([not row.prismatic for row in chain.rows])
    beyond = [chain.reach_from(i) for i in range(chain.n)]
    linear = np.where(turning, beyond * chain.velocity, chain.velocity).sum()
    return max(FASTEST, float(linear)), max(SIX_TURNS, float(chain.velocity[turning].sum()))


def implausible(chain: SerialChain, names: Sequence[ca.SX], values: Sequence[ca.SX], rows: Sequence[str]) -> ca.SX:
    """Two flags: a pose (16,), in row order, is too far away; values of a twist (k,) or of an obstacle are too large.

    Parameters
    ----------
    names : input symbols; those called `pose`, `twist` and, beside a pose, `obstacles` (k capsules of `MOVING` numbers)
        are checked. values : the values of all inputs.
    rows : names of the twist's components.
    """
    named = {each[0].name().rsplit("_", 1)[0]: value for each, value in zip(names, values, strict=True)}
    far, fast, (linear, angular) = ca.SX(0), ca.SX(0), fastest(chain)
    if "pose" in named:
        far = ca.norm_2(named["pose"][[3, 7, 11]] - ca.DM(chain.base[:3, 3])) > farthest(chain)
    if "twist" in named:
        most = ca.DM([BEYOND * (linear if row in LINEAR else angular) for row in rows])
        fast = ca.mmax(ca.fabs(named["twist"]) / most) > 1
    if {"pose", "obstacles"} <= {*named}:
        bodies = ca.reshape(named["obstacles"], MOVING, -1)
        most = ca.DM([SIGHT] * 6 + [BEYOND * linear] * 6 + [farthest(chain)])
        larger = ca.fabs(bodies[:-1, :]) > ca.repmat(most, 1, bodies.shape[1])
        fast = ca.logic_or(fast, ca.sum2(ca.sum1(larger) * (bodies[-1, :] != 0)) > 0)
    return ca.vertcat(far, fast)


def checked_length(argument: str, value: float, chain: SerialChain) -> float:
    """The length [m]; raises `ConfigurationError` if it is far beyond the robot's size."""
    if not abs(value) <= farthest(chain):
        expected = f"at most {farthest(chain):.3g} m, ten times the arm's reach: is it in metres?"
        raise ConfigurationError(argument, value, expected)
    return value


def check_place(argument: str, body: KeepOut | Capsule | Box, chain: SerialChain) -> None:
    """Raise `ConfigurationError` for a body whose distance or size is far beyond the robot's size."""
    base = chain.base[:3, 3]
    if isinstance(body, KeepOut):
        lengths = [float(np.dot(body.normal, base)) - body.offset]
    else:
        ends = [body.centre] if isinstance(body, Box) else [body.start, body.end]
        sizes = body.size if isinstance(body, Box) else [body.radius]
        lengths = [*(float(np.linalg.norm(np.subtract(end, base))) for end in ends), *sizes]
    for length in lengths:
        checked_length(argument, length, chain)


def check_speeds(chain: SerialChain, *, linear: float, angular: float = 0.0, argument: str = "linear_speed") -> None:
    """Raise `ConfigurationError` for speed limits [m/s, rad/s] beyond what the chain's hand can do."""
    for name, value, most, unit in zip(
        (argument, "angular_speed"), (linear, angular), fastest(chain), ("m/s", "rad/s"), strict=True
    ):
        if not value <= most:
            expected = f"at most {most:.3g} {unit}, beyond what this arm can do: is it in {unit}?"
            raise ConfigurationError(name, value, expected)


def checked_posture(argument: str, values: ArrayLike | None, chain: SerialChain) -> NDArray[np.float64] | None:
    """Joint values (n,) [rad, m] or None; raises `ConfigurationError` unless finite and in SI units."""
    if values is None:
        return None
    q = per_joint(argument, values, chain.n, finite=True)
    for name, row, value in zip(chain.names, chain.rows, q.tolist(), strict=True):
        if row.prismatic:
            checked_length(f"{argument} of {name}", value, chain)
        elif abs(value) > TWO_TURNS:
            raise ConfigurationError(f"{argument} of {name}", value, "an angle within two turns: is it in radians?")
    return q
