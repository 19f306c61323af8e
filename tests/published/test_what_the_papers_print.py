"""Statements of docs/reference/deviations.md about what the papers print, each computed from the print itself."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rehab_opt import PotentialField, human_arm
from rehab_opt.kinematics.drive import Mecanum
from rehab_opt.published.field_law import FieldLaw
from rehab_opt.published.tangent_law import damped_pseudoinverse
from rehab_opt.session.files import load_problem
from rehab_opt.session.scenario.problem import ScenarioProblem

Array = NDArray[np.float64]


# ------------------------------------------------------------------------------------ Rossa et al., remark 1 of II-C
def test_remark_1_is_false_for_a_jacobian_that_is_not_square() -> None:
    j, slopes = np.array([[1.0, 1.0]]), np.diag([1.0, 2.0])
    transformed, printed = damped_pseudoinverse(j @ slopes, 0.0), np.linalg.inv(slopes) @ np.linalg.pinv(j)
    np.testing.assert_allclose(transformed.T, [[0.2, 0.4]])
    np.testing.assert_allclose(printed.T, [[0.5, 0.25]])  # the printed order of factors, J+ dzeta^-1, does not multiply
    square = np.array([[1.0, 1.0], [0.0, 1.0]])
    np.testing.assert_allclose(
        damped_pseudoinverse(square @ slopes, 0.0), np.linalg.inv(slopes) @ np.linalg.inv(square)
    )


def test_remark_1_is_false_for_the_arm_of_table_i() -> None:
    arm = human_arm()
    middle, width = (arm.upper + arm.lower) / 2, arm.upper - arm.lower
    off = 0.3 * width * np.array([1, -1, 1, -1, 1, -1, 1, -1])
    j = arm.jacobian(middle + off)[:5]
    slopes = np.diag(width / np.pi / (1 + np.tan(np.pi * off / width) ** 2))  # Eq. (11)
    transformed, printed = damped_pseudoinverse(j @ slopes, 0.0), np.linalg.inv(slopes) @ np.linalg.pinv(j)
    for each in (transformed, printed):
        np.testing.assert_allclose(j @ slopes @ each, np.eye(5), atol=1e-9)  # both lead the hand as asked
    assert np.linalg.norm(transformed - printed) > 0.1 * np.linalg.norm(transformed)


def test_eq_12_minimises_the_transformed_speed_and_not_the_joint_speed() -> None:
    j, slopes = np.array([[1.0, 1.0]]), np.diag([1.0, 2.0])
    q_rate = slopes @ damped_pseudoinverse(j @ slopes, 0.0) @ [1.0]
    np.testing.assert_allclose(j @ q_rate, [1.0])
    assert np.linalg.norm(q_rate) > 1.1 * np.linalg.norm(np.linalg.pinv(j) @ [1.0])


# ----------------------------------------------------------------------- Rossa et al., scenario 3: Eq. (21) and k1 < 0
def resisting() -> tuple[Array, dict[str, float]]:
    """The path of the shipped scenario 3 as its field samples it, and S, |k1|, sigma."""
    said = load_problem("upper_limb/scenario_3_resist").problem
    assert isinstance(said, ScenarioProblem)
    assert said.field.stiffness_N_m is not None
    assert said.field.width_mm is not None
    stiffness, width = said.field.stiffness_N_m, 1e-3 * said.field.width_mm
    points = np.array(said.task.points_m)
    path = PotentialField(points, stiffness=stiffness, width=width, compile=False).paths[0].points
    drag = said.field.resistance_N / (2 * float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum()))
    return path, {"stiffness": stiffness, "drag": drag, "width": width}


def printed_energy(x: Array, path: Array, *, stiffness: float, drag: float, width: float) -> float:
    """Eqs. (15)-(17), (21), (22) term by term."""
    over, under = 0.0, 0.0
    for j, point in enumerate(path):
        left = sum(float(np.linalg.norm(path[i] - path[i + 1])) for i in range(j, len(path) - 1))
        square = float((x - point) @ (x - point))
        weight = np.exp(-square / (2 * width**2))
        over += weight * (drag * left**2 + stiffness * square / 2)
        under += weight
    return over / under


def along(place: int, path: Array, **numbers: float) -> float:
    """[N] minus the slope of the printed energy along the path, by finite differences."""
    forward = path[min(place + 1, len(path) - 1)] - path[place - 1]
    step = 1e-6 * forward / np.linalg.norm(forward)
    energies = [printed_energy(path[place] + sign * step, path, **numbers) for sign in (1, -1)]
    return -(energies[0] - energies[1]) / 2e-6


def test_published_resistance_is_largest_at_the_target_by_the_weighted_mean_and_not_by_k1() -> None:
    path, numbers = resisting()
    last, outside = len(path) - 1, range(6, len(path))  # W_c ends 70 mm before the target
    resists = {**numbers, "drag": -numbers["drag"]}
    whole = np.array([along(i, path, **resists) for i in outside])
    by_k1 = whole - [along(i, path, **{**numbers, "drag": 0.0}) for i in outside]
    assert whole[-1] == np.min(whole)
    np.testing.assert_allclose([whole[-1], by_k1[-1]], [-17.53, -1.13], atol=0.02)
    assert np.argmin(by_k1) == 0
    assert np.all(np.diff(by_k1[1:]) > 0.0)  # k1's part falls towards the target
    assert np.max(whole) > 0.5  # 30 mm before the target the hand is not resisted at all
    tangent = (path[last] - path[last - 1]) / np.linalg.norm(path[last] - path[last - 1])
    np.testing.assert_allclose(FieldLaw(path, **resists).force(path[last]) @ tangent, whole[-1], atol=1e-5)


# ------------------------------------------------------------------------------------------- Honzik, Eqs. (2) and (3)
HALF_GAUGE, HALF_BASE, RADIUS = 0.3, 0.25, 0.15


def wheel_speeds(forward: float, left: float, turn: float) -> Array:
    """[rad/s] of wheels 1 to 4 in the X arrangement, from rollers at 45 deg that roll without slip along their axis."""
    places = [(HALF_BASE, -HALF_GAUGE), (HALF_BASE, HALF_GAUGE), (-HALF_BASE, HALF_GAUGE), (-HALF_BASE, -HALF_GAUGE)]
    speeds = []
    for (x, y), across in zip(places, (1.0, -1.0, 1.0, -1.0), strict=True):
        contact = np.array([forward - turn * y, left + turn * x])
        speeds.append(float(np.array([1.0, across]) @ contact) / RADIUS)
    return np.array(speeds)


def test_honziks_wheels_as_printed_turn_the_chair_twice_as_fast_and_drive_it_sideways() -> None:
    whole = 2 * HALF_GAUGE + 2 * HALF_BASE  # a is the wheel gauge, b the wheel base
    printed = np.array([[-1, 1, whole], [1, 1, -whole], [-1, 1, -whole], [1, 1, whole]]) / RADIUS
    moved = np.linalg.pinv(np.column_stack([wheel_speeds(*axis) for axis in np.eye(3)])) @ printed
    # Columns: q1' (forward), q2' (left), q3' (turn) of Eq. (3); rows: how the chair moves forward, left, turning.
    np.testing.assert_allclose(moved, [[0, 1, 0], [-1, 0, 0], [0, 0, 2]], atol=1e-12)
    ours = Mecanum(radius=RADIUS, half_gauge=HALF_GAUGE, half_base=HALF_BASE, limit=1.0)
    np.testing.assert_allclose(ours.rolling, np.column_stack([wheel_speeds(*axis) for axis in np.eye(3)]), atol=1e-12)
