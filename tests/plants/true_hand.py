"""Where MuJoCo has the tool of a simulated arm."""

from __future__ import annotations

import numpy as np

from rehab_opt.plants.mujoco_arm import MujocoArm


def hand_pose(plant: MujocoArm) -> np.ndarray:
    """(4, 4) in the base frame."""
    plant._mujoco.mj_kinematics(plant._arm, plant._data)
    pose = np.eye(4)
    pose[:3, :3] = plant._data.site_xmat[plant._hand].reshape(3, 3)
    pose[:3, 3] = plant._data.site_xpos[plant._hand]
    return pose
