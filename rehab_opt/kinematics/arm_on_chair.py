"""Any arm on a wheelchair as one chain."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.ardis import ARDIS_KEEP_OUT
from rehab_opt.kinematics.body import Body, checked_bodies
from rehab_opt.kinematics.chain import SerialChain, per_joint
from rehab_opt.kinematics.drive import Differential, Mecanum, checked_amounts, checked_lengths
from rehab_opt.kinematics.link import Link
from rehab_opt.kinematics.mobile_arm import CHAIR, MIN_JOINTS, Capsule, MobileArm, Outline
from rehab_opt.kinematics.real_array import is_real
from rehab_opt.kinematics.rigid import inverse_pose, rigid

__all__ = ["arm_on_chair"]

Array = NDArray[np.float64]

MASSLESS = (
    "no link of the arm has a mass in its file: chair and arm share the motion by the chair's mass and the rotors"
)

# Rotations from the world to the joint "forward", from there to "left", and to "turn": z lies along x, along y, and up.
_FORWARD = np.array([[0.0, 0.0, 1.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
_LEFT = np.array([[0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])


def arm_on_chair(
    arm: SerialChain,
    *,
    mount: ArrayLike,
    rotors: ArrayLike = 0.05,
    chair_mass: float = 120.0,
    chair_turn_inertia: float = 12.0,
    velocity: tuple[float, float] = (0.8, 1.0),
    acceleration: tuple[float, float] = (1.0, 1.5),
    mecanum: Mecanum | None = None,
    differential: Differential | None = None,
    outline: Outline | None = None,
    keep_out: Sequence[Capsule] = ARDIS_KEEP_OUT,
    arm_radius: float = 0.05,
    limit_cost: float = 1.0,
    singular_cost: float = 1.0,
) -> MobileArm:
    """A chair with an arm of at least four revolute joints, for `RedundancyResolver`.

    World frame as in `ardis`: x forward, y left, z up, floor at 0. The arm's capsules stay out of `keep_out`; an arm
    without capsules gets segments from joint to joint.

    Parameters
    ----------
    arm : chain with masses (`SerialChain.bodies`). A link that is heavier than the chair gives a note.
    mount : (4, 4) pose of the arm's base frame in the chassis frame [m].
    rotors : inertia that motors and gears add to the arm's joints [kg m^2], a scalar or one for each joint; the default
        is an assumption.
    chair_mass : [kg] with its user. chair_turn_inertia : [kg m^2] about the turning point.
    velocity, acceleration : limits of the chair along the floor [m/s, m/s^2] and in turning [rad/s, rad/s^2].
        Assumptions.
    mecanum, differential, outline, keep_out : see `MobileArm`; the defaults are those of `ardis`.
    arm_radius, limit_cost, singular_cost : see `MobileArm`.

    Raises
    ------
    ConfigurationError : an argument is out of range.
    """
    if not isinstance(arm, SerialChain):
        raise ConfigurationError("arm", arm, "a SerialChain")
    if arm.n < MIN_JOINTS or any(row.prismatic for row in arm.rows):
        said = ", ".join(
            f"{name} {'slides' if row.prismatic else 'turns'}" for name, row in zip(arm.names, arm.rows, strict=True)
        )
        raise ConfigurationError("arm", said, f"{MIN_JOINTS} or more joints, all of which turn")
    checked_lengths(chair_mass=chair_mass)
    checked_amounts(chair_turn_inertia=chair_turn_inertia)
    foot = rigid("mount", mount) @ arm.base
    bodies = checked_bodies([each._replace(link=each.link + CHAIR) for each in arm.bodies], CHAIR + arm.n)
    heavy = [f"{each.name} of {each.mass:g} kg is heavier than the chair with its user" for each in bodies
             if each.mass > chair_mass]  # fmt: skip
    for name, pair in (("velocity", velocity), ("acceleration", acceleration)):
        if not isinstance(pair, (tuple, list, np.ndarray)) or len(pair) != 2 or not all(map(is_real, pair)):
            raise ConfigurationError(name, pair, "two numbers, along the floor and turning")
    along, turning = velocity
    faster, turns = acceleration
    free = np.full(CHAIR, np.inf)
    chain = SerialChain(
        (Link(_FORWARD.T @ _LEFT, prismatic=True), Link(_LEFT.T, prismatic=True), Link(foot), *arm.rows),
        lower=np.concatenate([-free, arm.lower]),
        upper=np.concatenate([free, arm.upper]),
        velocity=np.concatenate([[along, along, turning], arm.velocity]),
        acceleration=np.concatenate([[faster, faster, turns], arm.acceleration]),
        effort=np.concatenate([free, arm.effort]),
        names=("forward", "left", "turn", *arm.names),
        base=_FORWARD,
        tool=arm.tool,
        capsules=tuple(each._replace(frame=each.frame + CHAIR) for each in arm.capsules),
        notes=(*arm.notes, *([] if arm.bodies else [MASSLESS]), *heavy),
    )
    back = inverse_pose(foot)
    chair = Body("chair", CHAIR, chair_mass, back[:3, 3], chair_turn_inertia * np.eye(3))
    return MobileArm(
        chain,
        bodies=(chair, *bodies),
        rotors=np.concatenate([np.zeros(CHAIR), per_joint("rotors", rotors, arm.n, finite=True)]),
        mecanum=Mecanum(radius=0.10, half_gauge=0.28, half_base=0.25, limit=10.0) if mecanum is None else mecanum,
        differential=Differential(radius=0.15, half_gauge=0.28, limit=7.0) if differential is None else differential,
        outline=Outline(rear=-0.45, front=0.55, right=-0.33, left=0.33) if outline is None else outline,
        keep_out=keep_out,  # type: ignore[arg-type]
        arm_radius=arm_radius,
        limit_cost=limit_cost,
        singular_cost=singular_cost,
    )
