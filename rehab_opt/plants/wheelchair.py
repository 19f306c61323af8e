"""A simulated wheelchair with an arm: wheels follow their commanded speeds with a lag; the arm runs in MuJoCo."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.kinematics.drive import Drive as ChassisDrive
from rehab_opt.kinematics.mobile_arm import CHAIR, MobileArm
from rehab_opt.plants.arm_model import ArmModel, own_arm_model
from rehab_opt.plants.channel import Channel
from rehab_opt.plants.drives import Drive
from rehab_opt.plants.mjcf import row_pose
from rehab_opt.plants.mujoco_arm import MujocoArm
from rehab_opt.plants.plant import Truth
from rehab_opt.plants.sampled import SampledPlant

__all__ = ["Wheelchair", "chair_arm_model", "own_chair_arm_model"]

Array = NDArray[np.float64]

TORQUE_LIMIT = (80.0, 60.0, 40.0, 10.0)
"""Largest torques [N m]; an assumption, about three times the torques that hold the arm stretched forward."""
COULOMB = (2.0, 2.0, 1.0, 0.3)
"""Dry friction [N m] of the joints; an assumption."""
VISCOUS = (2.0, 2.0, 1.0, 0.2)
"""Viscous friction [N m s/rad] of the joints; an assumption."""


class Wheelchair(SampledPlant):
    """A wheelchair with an arm; a `Plant` whose command is the wheel speeds, then the arm's joint velocities.

    The positions are those of `MobileArm`: the chair's position and heading in the world, then the arm's joints. Each
    wheel follows its commanded speed with a first-order lag. Wheels have no torque limit and do not slip. Chair and arm
    do not accelerate each other, and the chair does not tilt. The channel's `position_noise` is the
    standard deviation both for joints [rad] and for the chair's position [m].

    Parameters
    ----------
    robot : chair and arm. wheels : drive of the chair, from `robot.drive(name)`.
    wheel_lag : time constant of each wheel's speed [s].
    drive : drive of the arm's joints, by default a `VelocityServo`.
    arm : dynamics of the arm, by default `chair_arm_model`; for an arm from a robot file use `own_chair_arm_model`.
    dt, channel, seed, physics_step : as for `SampledPlant`.

    Raises
    ------
    ConfigurationError : MuJoCo is not installed, or a number is out of range.
    """

    def __init__(
        self,
        robot: MobileArm,
        wheels: ChassisDrive,
        *,
        dt: float,
        wheel_lag: float = 0.08,
        drive: Drive | None = None,
        arm: ArmModel | None = None,
        channel: Channel | None = None,
        seed: int | np.random.Generator = 0,
        physics_step: float = 1e-3,
    ) -> None:
        super().__init__(robot.chain.n, dt=dt, channel=channel, seed=seed, physics_step=physics_step)
        if not 0.0 <= wheel_lag < math.inf:
            raise ConfigurationError("wheel_lag", wheel_lag, "seconds, zero or more")
        self._keep = math.exp(-self.physics_step / wheel_lag) if wheel_lag else 0.0
        count = len(wheels.rolling)
        self._twist = np.array([wheels.motion(one).twist for one in np.eye(count)]).reshape(count, CHAIR).T
        self._count = count
        step, model = self.physics_step, chair_arm_model(robot) if arm is None else arm
        self._arm = MujocoArm(model, dt=step, drive=drive, seed=self.rng, physics_step=step)
        self.reset(np.zeros(self.n))

    @property
    def truth(self) -> Truth:
        """The current true state; the wheels' efforts are not modelled and are zero."""
        arm = self._arm.truth
        position, velocity, force = self._readings()
        return Truth(self._now, position, velocity, np.concatenate([np.zeros(CHAIR), arm.effort]), force)

    @property
    def wheels(self) -> Array:
        """Current wheel speeds (w,) [rad/s]."""
        return self._wheels.copy()

    def _start(self, position: Array, velocity: Array) -> Array:
        self._place, self._wheels = position[:CHAIR].copy(), np.zeros(self._count)
        self._moving = np.zeros(CHAIR)
        self._arm.reset(position[CHAIR:], velocity[CHAIR:])
        return np.zeros(self._count + self.n - CHAIR)

    def _advance(self, now: float, command: Array, push: Array | None) -> None:
        wanted, joints = command[: self._count], command[self._count :]
        self._wheels = wanted + self._keep * (self._wheels - wanted)
        forward, left, turn = (self._twist @ self._wheels).tolist()
        x, y, heading = self._place.tolist()
        step = self.physics_step
        middle = heading + 0.5 * step * turn
        cos, sin = math.cos(middle), math.sin(middle)
        self._moving = np.array([cos * forward - sin * left, sin * forward + cos * left, turn])
        self._place = np.array([x, y, heading]) + step * self._moving
        self._arm.step(joints, None if push is None else _about_vertical(push, -heading))

    def _readings(self) -> tuple[Array, Array, Array]:
        arm = self._arm.truth
        return (
            np.concatenate([self._place, arm.position]),
            np.concatenate([self._moving, arm.velocity]),
            _about_vertical(arm.force, float(self._place[2])),
        )


def _about_vertical(vector: Array, angle: float) -> Array:
    x, y, z = vector.tolist()
    cos, sin = math.cos(angle), math.sin(angle)
    return np.array([cos * x - sin * y, sin * x + cos * y, z])


def chair_arm_model(
    robot: MobileArm,
    *,
    torque_limit: ArrayLike = TORQUE_LIMIT,
    coulomb: ArrayLike = COULOMB,
    viscous: ArrayLike = VISCOUS,
) -> ArmModel:
    """Dynamics of the arm on a chair at the world's origin.

    Parameters
    ----------
    robot : chair and arm, with masses and rotor inertias.
    torque_limit, coulomb, viscous : arrays (4,) or scalars as in `ArmModel`; the defaults are assumptions.
    """
    arm = _arm_alone(robot)
    return ArmModel(arm, arm.bodies, robot.rotors[CHAIR:], torque_limit, coulomb, viscous)  # type: ignore[arg-type]


def own_chair_arm_model(robot: MobileArm) -> ArmModel:
    """Dynamics of an arm from a robot file on a chair at the world's origin, with the file's masses and efforts.

    Raises
    ------
    ConfigurationError : as for `own_arm_model`.
    """
    return own_arm_model(_arm_alone(robot))


def _arm_alone(robot: MobileArm) -> SerialChain:
    """Chain of the arm alone, with its base on a chair at the world's origin."""
    chain = robot.chain
    base = chain.base
    for row in chain.rows[:CHAIR]:
        base = base @ row_pose(row, 0.0)
    return SerialChain(
        chain.rows[CHAIR:],
        lower=chain.lower[CHAIR:],
        upper=chain.upper[CHAIR:],
        velocity=chain.velocity[CHAIR:],
        acceleration=chain.acceleration[CHAIR:],
        names=chain.names[CHAIR:],
        base=base,
        tool=chain.tool,
        effort=chain.effort[CHAIR:],
        bodies=tuple(body._replace(link=body.link - CHAIR) for body in robot.bodies if body.link > CHAIR),
    )
