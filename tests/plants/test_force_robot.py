"""The robot of the scenarios under a hand: its friction."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rehab_opt.plants.force_robot import ForceRobot, RobotModel


@pytest.mark.parametrize("angle", [0.0, 0.7, math.pi / 2, 4.0])
def test_dry_friction_is_against_the_motion_whatever_its_direction(angle: float) -> None:
    model = RobotModel(noise=0.0)
    robot = ForceRobot(model, hand_mass=1.0, start=(0.0, 0.0), dt=0.001, rng=np.random.default_rng(1), ticks=2)
    way = np.array([math.cos(angle), math.sin(angle)])
    robot.vx, robot.vy = 0.5 * way
    robot.step(0.0, 0.0, 0.0, 0.0)
    lost = (model.mass + 1.0) * (0.5 * way - (robot.vx, robot.vy)) / 0.001
    np.testing.assert_allclose(lost, (model.coulomb + 0.5 * model.viscous) * way, rtol=0.01)
