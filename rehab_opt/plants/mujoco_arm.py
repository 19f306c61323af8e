"""An arm with servos in MuJoCo: what a controller's commands come to on a robot that has mass, friction and delays."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.chain import per_joint
from rehab_opt.plants.arm_model import ArmModel
from rehab_opt.plants.channel import Channel, Commands, Sensors
from rehab_opt.plants.contacts import Contact
from rehab_opt.plants.drives import Drive, DriveState, VelocityServo
from rehab_opt.plants.mjcf import HAND, arm_mjcf
from rehab_opt.plants.physics import mujoco_module
from rehab_opt.plants.plant import Measurement, Truth

__all__ = ["MujocoArm", "steps_in"]

Array = NDArray[np.float64]

POSTURES = 64
"""Drawn over the joints' ranges, always the same ones: the drives are tuned to the mean inertia of each joint."""


class MujocoArm:
    """A serial arm with a drive in each joint, in MuJoCo; a `Plant`.

    The drives know gravity and velocity torques of the arm exactly (not what touches it), as a vendor's do; nothing
    else is compensated: friction, the coupling of the joints' inertias and the torque limits are there. Links do not
    collide with anything, and joints have no mechanical stops: their limits are the controller's to hold. Contacts act
    on the hand, a point.

    Parameters
    ----------
    model : the arm. dt : [s] of a tick.
    drive : `VelocityServo` by default.
    channel : delays and noise; none by default.
    contacts : what touches the hand, in the base frame, (3,).
    seed : of everything random, or its generator.
    physics_step : [s] at most, of the physics; a tick has a whole number of steps.

    Raises
    ------
    ConfigurationError : MuJoCo is not installed; a number out of range.
    """

    def __init__(
        self,
        model: ArmModel,
        *,
        dt: float,
        drive: Drive | None = None,
        channel: Channel | None = None,
        contacts: Sequence[Contact] = (),
        seed: int | np.random.Generator = 0,
        physics_step: float = 5e-4,
    ) -> None:
        self.model, self.dt = model, dt
        self.drive: Drive = VelocityServo() if drive is None else drive
        self.channel = Channel() if channel is None else channel
        self.contacts = tuple(contacts)
        self.rng = np.random.default_rng(seed)
        self._steps, self._h = steps_in(dt, physics_step)
        self._mujoco = mujoco_module()
        self._arm = self._mujoco.MjModel.from_xml_string(arm_mjcf(model, step=self._h))
        self._data = self._mujoco.MjData(self._arm)
        self._hand = self._mujoco.mj_name2id(self._arm, self._mujoco.mjtObj.mjOBJ_SITE, HAND)
        self._jacobian = np.zeros((3, model.chain.n))
        self._inertia = self._typical_inertia()
        self.reset(np.zeros(model.chain.n))

    @property
    def measured(self) -> Measurement:
        """What the sensors said last."""
        return self._measured

    @property
    def truth(self) -> Truth:
        """What is so now."""
        data = self._data
        return Truth(self._now, data.qpos.copy(), data.qvel.copy(), self._effort, self._force)

    @property
    def energy(self) -> float:
        """[J] kinetic and potential, of the arm alone."""
        mujoco, data = self._mujoco, self._data
        mujoco.mj_forward(self._arm, data)
        mujoco.mj_energyPos(self._arm, data)
        mujoco.mj_energyVel(self._arm, data)
        return float(data.energy[0] + data.energy[1])

    @property
    def hand_pose(self) -> Array:
        """(4, 4) of the tool in the base frame, by MuJoCo's kinematics."""
        mujoco, data = self._mujoco, self._data
        mujoco.mj_kinematics(self._arm, data)
        pose = np.eye(4)
        pose[:3, :3] = data.site_xmat[self._hand].reshape(3, 3)
        pose[:3, 3] = data.site_xpos[self._hand]
        return pose

    def inertia(self, position: ArrayLike) -> Array:
        """(n, n) [kg m^2, kg] of the arm with its rotors at `position` (n,)."""
        mujoco, n = self._mujoco, self.model.chain.n
        data = mujoco.MjData(self._arm)
        data.qpos[:] = position
        mujoco.mj_forward(self._arm, data)
        full = np.zeros((n, n))
        mujoco.mj_fullM(self._arm, data, full)
        return full

    def reset(self, position: ArrayLike, velocity: ArrayLike | None = None) -> Measurement:
        """At rest at `position` (n,) [rad, m], or moving with `velocity` (n,); the noise goes on where it was."""
        n = self.model.chain.n
        start = per_joint("position", position, n, finite=True)
        self._mujoco.mj_resetData(self._arm, self._data)
        self._data.qpos[:] = start
        if velocity is not None:
            self._data.qvel[:] = per_joint("velocity", velocity, n, finite=True)
        still = self.drive.start(np.array(start), self._inertia, self.model.torque_limit, self._h)
        self._commands = Commands(self.channel, self.rng, still)
        self._sensors = Sensors(self.channel, self.rng)
        self._now, self._tick = 0.0, 0
        self._effort, self._force = np.zeros(n), np.zeros(3)
        self._keep()
        self._measured = self._sensors.read(0.0)
        return self._measured

    def step(self, command: ArrayLike, push: ArrayLike | None = None) -> Measurement:
        """One tick; `command` as the drive takes it, `push` (3,) [N] on the hand."""
        mujoco, arm, data, h = self._mujoco, self._arm, self._data, self._h
        pushed = np.zeros(3) if push is None else np.asarray(push, dtype=np.float64)
        felt_at_all = bool(self.contacts) or push is not None
        begin = self._tick * self.dt
        self._commands.send(begin, np.array(command, dtype=np.float64))
        for k in range(self._steps):
            now = begin + k * h
            mujoco.mj_step1(arm, data)
            state = DriveState(data.qpos, data.qvel, self._moves)
            self._effort = self.drive.torque(self._commands.at(now), state, data.qfrc_bias)
            data.qfrc_applied[:] = self._effort
            if felt_at_all:
                jacobian, place = self._moves(), data.site_xpos[self._hand]
                speed = jacobian @ data.qvel
                self._force = pushed + sum(
                    (each.force(now, place, speed) for each in self.contacts), np.zeros(3)
                )
                data.qfrc_applied += jacobian.T @ self._force
            else:
                self._force = pushed
            mujoco.mj_step2(arm, data)
            self._now = begin + (k + 1) * h
            self._keep()
        self._tick += 1
        self._now = self._tick * self.dt
        self._measured = self._sensors.read(self._now)
        return self._measured

    def _keep(self) -> None:
        self._sensors.keep(self._now, self._data.qpos.copy(), self._data.qvel.copy(), self._force)

    def _moves(self) -> Array:
        """(3, n) Jacobian of the hand's place."""
        self._mujoco.mj_jacSite(self._arm, self._data, self._jacobian, None, self._hand)
        return self._jacobian

    def _typical_inertia(self) -> Array:
        """(n,) mean over postures; joints without limits are drawn over a turn, or a metre."""
        chain, rng = self.model.chain, np.random.default_rng(0)
        lower = np.where(np.isfinite(chain.lower), chain.lower, -math.pi)
        upper = np.where(np.isfinite(chain.upper), chain.upper, math.pi)
        drawn = [np.diag(self.inertia(rng.uniform(lower, upper))) for _ in range(POSTURES)]
        return np.asarray(np.mean(drawn, axis=0), dtype=np.float64)


def steps_in(dt: float, physics_step: float) -> tuple[int, float]:
    """How many steps of the physics a tick has, and how long they are [s]: `physics_step` at most.

    Raises
    ------
    ConfigurationError : a number that is no tick, or no step.
    """
    if not 0.0 < dt < 1.0:
        raise ConfigurationError("dt", dt, "seconds above 0, below 1")
    if not 1e-6 <= physics_step <= 0.01:
        raise ConfigurationError("physics_step", physics_step, "seconds from 1e-6 to 0.01")
    steps = max(1, math.ceil(dt / physics_step - 1e-9))
    return steps, dt / steps
