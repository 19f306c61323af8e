"""Every controller's command has every field, whichever way it was made: the quick way skips the constructor."""

import numpy as np
import pytest
import shapely

from rehab_opt import (
    Assistance,
    Command,
    MirrorTracker,
    PoseTracker,
    PotentialField,
    RedundancyResolver,
    Workspace,
    ardis,
    ur5,
)
from rehab_opt.kinematics.ardis import ARDIS_READY

READY = np.array([0.0, -1.2, 1.5, -1.8, -1.57, 0.0])


def pose_tracker() -> tuple[Command, Command]:
    robot = PoseTracker(ur5(), dt=0.001)
    pose = robot.chain.pose(READY)
    return robot.step(READY, pose, np.zeros(6)), robot.step(READY * np.nan, pose, np.zeros(6))


def mirror_tracker() -> tuple[Command, Command]:
    robot = MirrorTracker(ur5(), floor=0.1, dt=0.001)
    pose = robot.chain.pose(READY)
    for _ in range(3):
        usual = robot.step(READY, pose, np.zeros(6))
    return usual, robot.step(READY * np.nan, pose, np.zeros(6))


def chair_and_arm() -> tuple[Command, Command]:
    robot = RedundancyResolver(ardis(), row_sets=[("x", "y", "z")], compile=False)
    return robot.step(ARDIS_READY, [0.01, 0.0, 0.0]), robot.step(ARDIS_READY, [np.nan, 0.0, 0.0])


def assistance() -> tuple[Command, Command]:
    field = PotentialField(np.array([[0.0, 0.0], [0.3, 0.0]]), stiffness=1000.0, drag=200.0, width=0.025, damping=5.0)
    comfortable = Workspace(shapely.box(-0.05, -0.05, 0.05, 0.05), accuracy=1e-3)
    helper = Assistance(field, comfortable=comfortable, mode="assist", force_limit=30.0)
    return helper.step([0.2, 0.0], [0.0, 0.0]), helper.step([np.nan, 0.0], [0.0, 0.0])


@pytest.mark.parametrize("made", [pose_tracker, mirror_tracker, chair_and_arm, assistance])
def test_a_command_has_every_field_and_can_be_shown(made: object) -> None:
    for command in made():  # type: ignore[operator]
        assert len(command) == len(Command._fields)
        assert "status" in repr(command)
        assert np.isfinite(command.value).all()
    assert (command.wheels is not None) == (made is chair_and_arm)
