"""What a chair's hand task asks of the joints, against plain numpy."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from rehab_opt import ardis
from rehab_opt.control.hand_task import HandTask

ARM = [3, 4, 5, 6]


@pytest.mark.parametrize("up", [-1.0, 0.02, 0.2])
def test_arm_that_gets_little_hand_speed_for_its_joints_rests_on_the_way_up_the_cost(up: float) -> None:
    """Joints go at (h^2 / h' - h') / 0.06 of their speeds at most, h' a hundredth of the command."""
    task, size, fastest = HandTask(ardis(), ("x", "y", "z"), ARM, 1.0), 0.2, ardis().chain.velocity[3:]
    for per_joint_speed in (0.005, 0.011, 0.03, 0.5):  # h over the command
        joints, h, least = fastest * [1.0, 0.3, -0.2, 0.1] / per_joint_speed, per_joint_speed * size, 0.01 * size
        gradient = np.r_[np.zeros(3), up * joints / (joints @ joints) / per_joint_speed]
        speeds = (h**2 / least - least) / 0.06
        aside = min(speeds * per_joint_speed, 1.0)
        uphill = min(max(up / 0.05, 0.0), 1.0)
        found = float(task._kept_aside(ca.SX(joints), ca.SX(gradient), ca.SX(size)))
        assert found == pytest.approx(1 - uphill * (1 - aside) if up > 0 else 1.0, rel=1e-9)


def test_task_that_leaves_self_motion_or_a_chair_that_drives_is_asked_as_it_is() -> None:
    for rows, moving in ((("x", "y"), ARM), (("x", "y", "z"), [0, *ARM])):
        task, nothing = HandTask(ardis(), rows, moving, 1.0), ca.SX.zeros(7)
        assert float(task._kept_aside(ca.SX.ones(len(moving)), nothing, ca.SX(0.2))) == 1.0
