"""Eq. (1) against what it is said to minimise, found by scipy instead."""

import numpy as np
import pytest
from scipy.optimize import minimize

from rehab_opt.kinematics.ardis import ARDIS_READY, ardis
from rehab_opt.published.pseudoinverse_law import PseudoinverseLaw

ROBOT = ardis()


def random_posture(rng: np.random.Generator) -> np.ndarray:
    return np.concatenate([rng.uniform(-3, 3, 3), rng.uniform(ROBOT.chain.lower[3:], ROBOT.chain.upper[3:])])


@pytest.mark.parametrize("drive", ["mecanum", "differential"])
@pytest.mark.parametrize("rows", [("x", "y"), ("z", "roll7"), ("x", "y", "z", "rx")])
def test_the_law_minimises_kinetic_energy_and_posture_cost_under_the_task(drive: str, rows: tuple[str, ...]) -> None:
    law, rng = PseudoinverseLaw(ROBOT, drive=drive), np.random.default_rng(5)  # type: ignore[arg-type]
    for _ in range(5):
        q, twist = random_posture(rng), 0.2 * rng.standard_normal(len(rows))
        velocity = law.rate(q, twist, rows)
        jacobian = law.task_jacobian(q, rows)
        np.testing.assert_allclose(jacobian @ velocity, twist, atol=1e-10)
        if drive == "differential":
            jacobian = np.vstack([jacobian, ROBOT.differential.constraints(q)])
            assert jacobian[-1] @ velocity == pytest.approx(0, abs=1e-10)
        w, slope = ROBOT.inertia(q), np.linalg.norm(twist) * ROBOT.inertia(q) @ ROBOT.posture_gradient(q)
        free = np.linalg.svd(jacobian)[2][len(jacobian) :]

        def cost(z: np.ndarray, start=velocity, free=free, w=w, slope=slope) -> float:
            v = start + free.T @ z
            return v @ w @ v / 2 + slope @ v

        assert cost(np.zeros(len(free))) <= minimize(cost, np.full(len(free), 0.1)).fun + 1e-9


def test_no_twist_is_no_motion_and_chassis_rows_turn_with_the_chair() -> None:
    law, q = PseudoinverseLaw(ROBOT), ARDIS_READY.copy()
    assert not law.rate(q, [0, 0, 0]).any()
    straight = law.rate(q, [0.1, 0.05, 0.0])
    q[2] = 1.2
    np.testing.assert_allclose(ROBOT.chassis_velocity(q, law.rate(q, [0.1, 0.05, 0.0])), straight, atol=1e-12)
    turned = law.rate(q, [0.1, 0.05, 0.0], frame="world")
    np.testing.assert_allclose((ROBOT.chain.jacobian(q) @ turned)[:3], [0.1, 0.05, 0.0], atol=1e-12)


def test_near_a_singular_posture_the_law_breaks_limits() -> None:
    law, q = PseudoinverseLaw(ROBOT), ARDIS_READY.copy()
    q[3:6] = -np.pi / 2, 0.0, ROBOT.chain.upper[5] - 1e-3
    velocity = law.rate(q, [0.0, 0.0, 0.3])
    fast = law.rate(q, [0.3, 0.0, 0.0])
    assert law.excess(q, np.zeros(7), np.zeros(7), 0.01).position <= 0
    broken = [law.excess(q, each, np.zeros(7), 0.01) for each in (velocity, fast)]
    assert max(each.acceleration for each in broken) > 0
    assert law.wheels(q, fast).shape == (4,)
