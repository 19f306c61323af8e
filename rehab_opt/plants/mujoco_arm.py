"""A serial arm in MuJoCo, with servos, mass, friction and delays."""

from __future__ import annotations

import math
from collections.abc import Sequence
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.plants.arm_model import ArmModel
from rehab_opt.plants.channel import Channel
from rehab_opt.plants.contacts import Contact
from rehab_opt.plants.drives import Drive, DriveState, VelocityServo
from rehab_opt.plants.mjcf import HAND, arm_mjcf
from rehab_opt.plants.plant import Truth
from rehab_opt.plants.sampled import SampledPlant

__all__ = ["MujocoArm", "mujoco_module"]

Array = NDArray[np.float64]

POSTURES = 64
"""Number of random postures, with a fixed seed, over which the mean inertia of each joint is computed for its drive."""


class MujocoArm(SampledPlant):
    """A serial arm with a drive in each joint, simulated in MuJoCo; a `Plant`.

    The drives compensate the arm's gravity and Coriolis torques exactly, but not contacts, friction and coupled
    inertia. Links do not collide, and joints stop only at the model's mechanical stops, not at joint limits. Contacts
    act on the hand, which is a point.

    Parameters
    ----------
    model : kinematics and dynamics of the arm. dt : duration of a tick [s].
    drive : drive of the joints, by default a `VelocityServo`.
    contacts : contacts of the hand, in the base frame.
    channel, seed, physics_step : as for `SampledPlant`.

    Raises
    ------
    ConfigurationError : MuJoCo is not installed, or a number is out of range.
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
        super().__init__(model.chain.n, dt=dt, channel=channel, seed=seed, physics_step=physics_step)
        self.model = model
        self.drive: Drive = VelocityServo() if drive is None else drive
        self.contacts = tuple(contacts)
        self._mujoco = mujoco_module()
        try:
            self._arm = self._mujoco.MjModel.from_xml_string(arm_mjcf(model, step=self.physics_step))
        except ValueError as refused:
            said = str(refused).partition("\n")[0]
            raise ConfigurationError("model", model.chain.names, f"an arm that MuJoCo takes: {said}") from refused
        self._data = self._mujoco.MjData(self._arm)
        self._hand = self._mujoco.mj_name2id(self._arm, self._mujoco.mjtObj.mjOBJ_SITE, HAND)
        self._jacobian = np.zeros((3, self.n))
        self._inertia = self._typical_inertia()
        self.reset(np.zeros(self.n))

    @property
    def truth(self) -> Truth:
        """The current true state."""
        data = self._data
        return Truth(self._now, data.qpos.copy(), data.qvel.copy(), self._effort, self._force)

    @property
    def energy(self) -> float:
        """Sum of the arm's kinetic and potential energy [J]."""
        mujoco, data = self._mujoco, self._data
        mujoco.mj_forward(self._arm, data)
        momentum = np.zeros(self.n)
        mujoco.mj_mulM(self._arm, data, momentum, data.qvel)
        height = self._arm.body_mass @ data.xipos @ np.array(self.model.gravity)
        return float(0.5 * momentum @ data.qvel - height)

    @property
    def hand_pose(self) -> Array:
        """Pose (4, 4) of the tool in the base frame, computed by MuJoCo."""
        self._mujoco.mj_kinematics(self._arm, self._data)
        pose = np.eye(4)
        pose[:3, :3] = self._data.site_xmat[self._hand].reshape(3, 3)
        pose[:3, 3] = self._data.site_xpos[self._hand]
        return pose

    def inertia(self, position: ArrayLike) -> Array:
        """Inertia matrix (n, n) [kg m^2, kg] of the arm with its rotors at the joint positions `position` (n,)."""
        mujoco, data = self._mujoco, self._mujoco.MjData(self._arm)
        data.qpos[:] = position
        mujoco.mj_forward(self._arm, data)
        full = np.zeros((self.n, self.n))
        for row, one in zip(full, np.eye(self.n), strict=True):  # arguments of `mj_fullM` differ between versions
            mujoco.mj_mulM(self._arm, data, row, one)
        return full

    def feedforward(self) -> Array:
        """Current gravity and Coriolis torques (n,) [N m, N], which the drives compensate."""
        self._mujoco.mj_forward(self._arm, self._data)
        return np.asarray(self._data.qfrc_bias.copy())

    def _start(self, position: Array, velocity: Array) -> Array:
        self._mujoco.mj_resetData(self._arm, self._data)
        self._data.qpos[:], self._data.qvel[:] = position, velocity
        self._effort, self._force = np.zeros(self.n), np.zeros(3)
        return self.drive.start(position, self._inertia, self.model.torque_limit, self.physics_step)

    def _advance(self, now: float, command: Array, push: Array | None) -> None:
        mujoco, arm, data = self._mujoco, self._arm, self._data
        mujoco.mj_step1(arm, data)
        state = DriveState(data.qpos, data.qvel, self._moves, data.qacc, self._force)
        self._effort = self.drive.torque(command, state, data.qfrc_bias)
        data.qfrc_applied[:] = self._effort
        if self.contacts or push is not None:
            jacobian, place = self._moves(), data.site_xpos[self._hand]
            speed = jacobian @ data.qvel
            touch = np.zeros(3) if push is None else push
            for each in self.contacts:
                touch = touch + each.force(now, place, speed)
            self._force = touch
            data.qfrc_applied += jacobian.T @ touch
        elif self._force.any():
            self._force = np.zeros(3)
        mujoco.mj_step2(arm, data)

    def _readings(self) -> tuple[Array, Array, Array]:
        return self._data.qpos.copy(), self._data.qvel.copy(), self._force

    def _moves(self) -> Array:
        """Jacobian (3, n) of the hand's position."""
        self._mujoco.mj_jacSite(self._arm, self._data, self._jacobian, None, self._hand)
        return self._jacobian

    def _typical_inertia(self) -> Array:
        """Mean inertia (n,) [kg m^2, kg] of each joint over random postures; missing limits count as -pi and pi."""
        chain, rng = self.model.chain, np.random.default_rng(0)
        lower = np.where(np.isfinite(chain.lower), chain.lower, -math.pi)
        upper = np.where(np.isfinite(chain.upper), chain.upper, math.pi)
        drawn = [np.diag(self.inertia(rng.uniform(lower, upper))) for _ in range(POSTURES)]
        return np.asarray(np.mean(drawn, axis=0), dtype=np.float64)


def mujoco_module() -> Any:
    """Import the module `mujoco`.

    Raises
    ------
    ConfigurationError : MuJoCo is not installed.
    """
    try:
        return import_module("mujoco")
    except ImportError as absent:
        expected = "MuJoCo, which is not installed: pip install 'rehab_opt[physics]'"
        raise ConfigurationError("plant", "mujoco", expected) from absent
