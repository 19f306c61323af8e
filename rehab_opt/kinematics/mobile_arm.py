"""A chair and the arm on it as one redundant robot: chain, inertia, wheels, outline and posture."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics import DRIVES
from rehab_opt.kinematics.arm_links import (
    ArmLink,
    arm_links,
    arm_reach,
    hand_volume,
    links_as_capsules,
    maximise_hand_volume,
)
from rehab_opt.kinematics.body import Body, checked_bodies
from rehab_opt.kinematics.chain import SerialChain, per_joint
from rehab_opt.kinematics.drive import Differential, Drive, Fixed, Mecanum, Omnidirectional, checked_amounts
from rehab_opt.kinematics.inertia import inertia_expression
from rehab_opt.kinematics.link_capsules import Capsule
from rehab_opt.kinematics.plausible import check_place, checked_length
from rehab_opt.symbolic.shared import HasEvaluator

__all__ = ["CHAIR", "Capsule", "MobileArm", "Outline"]

Array = NDArray[np.float64]

CHAIR = 3
"""Number of the chair's joints: forward, left, turn. The arm's joints follow."""
MIN_JOINTS = 4
"""Least number of joints of an arm: three for the hand's position, one for its rotation."""
SATURATED = 1.5
"""Fraction of its half range beyond which a joint's posture cost grows linearly."""
FLAT = 1e-6
"""Fraction of reach^3 below which `hand_volume` counts as zero; otherwise rounding errors would shake planar arms."""


class Outline(NamedTuple):
    """The chair from above, a rectangle in the chassis frame [m]: x forward, y left."""

    rear: float
    front: float
    right: float
    left: float

    @property
    def corners(self) -> Array:
        """(4, 2) [m] corners of the rectangle."""
        return np.array([[x, y] for x in (self.front, self.rear) for y in (self.left, self.right)])


@dataclass(frozen=True, eq=False)
class MobileArm(HasEvaluator):
    """A chair at q1 (forward) and q2 (left) [m], turned by q3 [rad], with an arm of four or more joints q4 to qn [rad].

    World and chassis frames have x forward, y left, z up, the floor at z = 0; at q = 0 they coincide. The norm of the
    speeds of q1 and q2 is bounded, so the chain's first two velocity limits are equal. Acceleration limits of the chair
    are in the chassis frame. The chair's position has no limits; obstacles can bound it. Immutable; any thread may use
    it.

    Parameters
    ----------
    chain : the n joints.
    bodies : masses. rotors : (n,) inertia that motors and gears add at each joint [kg m^2 or kg].
    mecanum, differential : wheels of the two kinds of chair; see `drive` for bases without wheels.
    outline : the chair from above.
    keep_out : shapes of chair and user, which the arm must not enter.
    arm_radius : [m] radius of capsules from joint to joint, for a chain without capsules.
    limit_cost, singular_cost : weights of the terms of `posture_cost`.
    hand_volume : [m^3] largest sqrt(det(J J^T)), where J is the hand's linear Jacobian for the arm's joints; computed
        by default. If the arm cannot move its hand in every direction, it is 0, and `posture_cost` has only the terms
        of joint limits.

    Raises
    ------
    ConfigurationError : a chain of another kind, a bounded position of the chair, a number out of range, an impossible
        inertia.
    """

    chain: SerialChain
    bodies: tuple[Body, ...] = field(kw_only=True)
    rotors: Array = field(kw_only=True)
    mecanum: Mecanum = field(kw_only=True)
    differential: Differential = field(kw_only=True)
    outline: Outline = field(kw_only=True)
    keep_out: tuple[Capsule, ...] = field(default=(), kw_only=True)
    arm_radius: float = field(default=0.05, kw_only=True)
    limit_cost: float = field(default=1.0, kw_only=True)
    singular_cost: float = field(default=1.0, kw_only=True)
    hand_volume: float | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        chain = self.chain
        kinds = [row.prismatic for row in chain.rows] if isinstance(chain, SerialChain) else []
        if len(kinds) < CHAIR + MIN_JOINTS or kinds != [True] * 2 + [False] * (len(kinds) - 2):
            expected = f"two joints that slide, and {MIN_JOINTS + 1} or more that turn"
            said = [f"{name} {'slides' if kind else 'turns'}" for name, kind in zip(chain.names, kinds, strict=True)]
            raise (
                ConfigurationError("chain", ", ".join(said), expected)
                if kinds
                else ConfigurationError("chain", chain, expected)
            )
        if np.isfinite(chain.lower[:CHAIR]).any() or np.isfinite(chain.upper[:CHAIR]).any():
            raise ConfigurationError("lower, upper", (chain.lower, chain.upper), "a chair without position limits")
        for name, *ends in zip(chain.names, chain.lower.tolist(), chain.upper.tolist(), strict=True):
            if math.isfinite(ends[0]) != math.isfinite(ends[1]):
                raise ConfigurationError(f"joint {name}, lower, upper", ends, "two finite limits, or none either way")
        if chain.velocity[0] != chain.velocity[1] or chain.acceleration[0] != chain.acceleration[1]:
            raise ConfigurationError(
                "velocity, acceleration", (chain.velocity, chain.acceleration), "the same forward and to the left"
            )
        for name, kind in (("mecanum", Mecanum), ("differential", Differential)):
            if not isinstance(getattr(self, name), kind):
                raise ConfigurationError(name, getattr(self, name), f"a {kind.__name__}")
        object.__setattr__(self, "bodies", checked_bodies(self.bodies, chain.n))
        _check_outline(self.outline)
        object.__setattr__(self, "keep_out", _checked_keep_out(self.keep_out))
        checked_amounts(arm_radius=self.arm_radius, limit_cost=self.limit_cost, singular_cost=self.singular_cost)
        arm = np.arange(chain.n) >= CHAIR
        standing = chain.with_limits(lower=np.where(arm, chain.lower, 0.0), upper=np.where(arm, chain.upper, 0.0))
        for i, capsule in enumerate(self.keep_out):
            check_place(f"keep_out[{i}]", capsule, standing)
        checked_length("arm_radius", self.arm_radius, standing)
        checked_length("outline", max(self.outline, key=abs), standing)
        rotors = per_joint("rotors", self.rotors, chain.n, finite=True)
        object.__setattr__(self, "rotors", rotors)
        volume = self.hand_volume
        if volume is None:
            found = maximise_hand_volume(chain, first=CHAIR)
            volume = found if found > FLAT * self.reach**3 else 0.0
        checked_amounts(hand_volume=volume)
        object.__setattr__(self, "hand_volume", volume)
        if not np.linalg.eigvalsh(self.inertia(np.zeros(chain.n)))[0] > 0.0:
            raise ConfigurationError("bodies, rotors", (self.bodies, rotors), "masses that make W positive definite")

    # ------------------------------------------------------------------------------------------------ numbers
    @property
    def mass(self) -> float:
        """[kg] total mass of the bodies."""
        return float(sum(body.mass for body in self.bodies))

    def inertia(self, q: ArrayLike) -> Array:
        """(n, n) inertia matrix W at joint values q (n,): the kinetic energy is q'^T W q' / 2 [J]."""
        return self._evaluate(self.inertia_expression, q)

    def posture_cost(self, q: ArrayLike) -> float:
        """Scalar c of Eq. (1), without unit; it grows towards joint limits and singular postures of the arm."""
        return float(self._evaluate(self.posture_cost_expression, q)[0])

    def posture_gradient(self, q: ArrayLike) -> Array:
        """(n,) gradient of `posture_cost`; zero for the chair."""
        return self._evaluate(self.posture_gradient_expression, q)

    def chassis_velocity(self, q: ArrayLike, velocity: ArrayLike) -> Array:
        """(n,) joint velocities (forward, left, turn, arm); the chair's are rotated from world to chassis frame."""
        return self._turned(q, velocity, -1.0)

    def world_velocity(self, q: ArrayLike, velocity: ArrayLike) -> Array:
        """(n,) joint velocities; the chair's are rotated from chassis to world frame."""
        return self._turned(q, velocity, 1.0)

    def drive(self, name: str) -> Drive:
        """The drive with this name, one of `DRIVES`.

        Raises
        ------
        ConfigurationError : unknown name.
        """
        if not isinstance(name, str) or name not in DRIVES:
            raise ConfigurationError("drive", name, f"one of {', '.join(DRIVES)}")
        own = {"mecanum": self.mecanum, "differential": self.differential, "omnidirectional": Omnidirectional()}
        return own.get(name, Fixed())

    def with_limits(self, **limits: Any) -> MobileArm:
        """The same robot with other joint limits: see `SerialChain.with_limits`."""
        return replace(self, chain=self.chain.with_limits(**limits))

    def _turned(self, q: ArrayLike, velocity: ArrayLike, sign: float) -> Array:
        heading = sign * float(per_joint("q", q, self.chain.n)[2])
        v = np.array(per_joint("velocity", velocity, self.chain.n))
        cos, sin = math.cos(heading), math.sin(heading)
        v[:2] = cos * v[0] - sin * v[1], sin * v[0] + cos * v[1]
        return v

    @cached_property
    def links(self) -> tuple[ArmLink, ...]:
        """The arm's links, as capsules."""
        return arm_links(self.chain, first=CHAIR, radius=self.arm_radius)

    @cached_property
    def bodied_chain(self) -> SerialChain:
        """The chain with capsules: its own or, if it has none, those of the arm's `links` and the column below."""
        chain = self.chain
        if chain.capsules:
            return chain
        column = links_as_capsules(chain, arm_links(chain, first=CHAIR, radius=self.arm_radius, moved=False), "column")
        return replace(chain, capsules=(*links_as_capsules(chain, self.links, "link"), *column))

    @cached_property
    def reach(self) -> float:
        """[m] upper bound of the distance between any joint axis of the arm and any point of its links or its tool."""
        return arm_reach(self.chain, self.links, first=CHAIR)

    # -------------------------------------------------------------------------------------------- expressions
    def inertia_expression(self, q: ca.SX) -> ca.SX:
        """(n, n) expression of `inertia`."""
        return inertia_expression(self.chain, self.bodies, self.rotors, q)

    def posture_cost_expression(self, q: ca.SX) -> ca.SX:
        """`limit_cost` times the sum of x^4/4 over the arm's joints, plus `singular_cost` times (1 - m)^2/2.

        x in [-1, 1] is a joint's position in its range; beyond `SATURATED`, x^4/4 continues linearly. A joint without
        limits costs nothing. m is det(J J^T) as a fraction of its largest value, where J is the hand's linear Jacobian
        for the arm's joints. If the arm alone cannot move its hand in every direction, the term of m is left out.
        """
        chain = self.chain
        cost = ca.SX(0)
        for i in range(CHAIR, chain.n):
            half = float(chain.upper[i] - chain.lower[i]) / 2
            if half in (0.0, math.inf):
                continue
            x = ca.fabs(q[i] - float(chain.upper[i] + chain.lower[i]) / 2) / half
            beyond = ca.fmax(x - SATURATED, 0)
            cost += self.limit_cost * (ca.fmin(x, SATURATED) ** 4 / 4 + SATURATED**3 * beyond)
        still = ca.vertcat(ca.SX.zeros(CHAIR), q[CHAIR:])  # the chair's pose has no effect
        if not self.hand_volume:
            return cost
        fraction = hand_volume(chain, still, first=CHAIR) / self.hand_volume**2
        return cost + self.singular_cost * (1 - fraction) ** 2 / 2

    def posture_gradient_expression(self, q: ca.SX) -> ca.SX:
        """(n,) expression of `posture_gradient`."""
        symbol = ca.SX.sym("q", self.chain.n)  # q may be an expression
        return ca.substitute(ca.gradient(self.posture_cost_expression(symbol), symbol), symbol, q)

    # ------------------------------------------------------------------------------------------------ plumbing
    def _evaluate(self, expression: Callable[[ca.SX], ca.SX], q: ArrayLike) -> Array:
        return self._evaluator.of(expression, per_joint("q", q, self.chain.n))


def _check_outline(outline: object) -> None:
    expected = "an Outline of finite numbers, rear before front and right before left"
    if not isinstance(outline, Outline):
        raise ConfigurationError("outline", outline, expected)
    rear, front, right, left = _metres("outline", outline, 4, expected)
    if not (rear < front and right < left):
        raise ConfigurationError("outline", outline, expected)


def _checked_keep_out(keep_out: object) -> tuple[Capsule, ...]:
    """The capsules, after a check that they are finite, because NaN would disable them."""
    if not isinstance(keep_out, (list, tuple)) or isinstance(keep_out, Capsule):
        raise ConfigurationError("keep_out", keep_out, "a list or tuple of Capsule")
    for i, capsule in enumerate(keep_out):
        if not isinstance(capsule, Capsule):
            raise ConfigurationError(f"keep_out[{i}]", capsule, "a Capsule")
        for end in (capsule.start, capsule.end):
            _metres(f"keep_out[{i}]", end, 3, "a Capsule with three finite numbers for either end")
        checked_amounts(**{f"keep_out[{i}].radius": capsule.radius})
    return tuple(keep_out)


def _metres(argument: str, value: Any, n: int, expected: str) -> Array:
    try:
        return per_joint(argument, [each + 0.0 for each in value], n, finite=True)
    except (TypeError, ValueError, OverflowError, ConfigurationError) as problem:
        raise ConfigurationError(argument, value, expected) from problem
