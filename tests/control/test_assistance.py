"""Claims about Assistance that a person's safety rests on."""

import math
from typing import Any

import numpy as np
import pytest
import shapely

from rehab_opt import Assistance, PotentialField, Relaxed, Status, Workspace
from rehab_opt.control.assistance_statement import assistance_statement
from rehab_opt.control.bounded_force import BoundedForce
from tests.refusals import refuses

S = np.linspace(0.0, 1.0, 200)
PATH = np.column_stack([-0.15 + 0.3 * S, 0.4 + 0.03 * np.sin(3 * S)])
COMFORTABLE = Workspace(shapely.box(-0.18, 0.365, -0.06, 0.435), accuracy=1e-3)
EMPTY = Workspace(shapely.Polygon(), accuracy=0.0)
INSIDE, OUTSIDE = np.array([-0.1, 0.4]), np.array([0.0, 0.44])
DT, SLEW, LIMIT = 1e-3, 200.0, 30.0
FIELDS = {
    "stretch": {"drag": 0.0}, "assist": {"drag": 200.0}, "resist": {"drag": 100.0, "drag_along": "travelled"},
    "follow": {"drag": 0.0}, "hold": {"drag": 0.0},
}  # fmt: skip


def field(mode: str = "assist", **options: object) -> PotentialField:
    given = {"stiffness": 1000.0, "width": 0.025, "damping": 0.0, "compile": False, **FIELDS[mode], **options}
    return PotentialField(PATH, **given)  # type: ignore[arg-type]


READY = {mode: field(mode) for mode in FIELDS}


def assistance(mode: str = "assist", each: PotentialField | None = None, **options: object) -> Assistance:
    given = {
        "comfortable": COMFORTABLE, "mode": mode, "compile": False, "energy_budget": 1e3, "trust_stillness": True,
        "slew_limit": SLEW, "growth_limit": 1e5,
    }  # fmt: skip
    return Assistance(each or READY.get(mode, READY["assist"]), **{**given, **options})  # type: ignore[arg-type]


# ------------------------------------------------------------------------------------------------------------- faults
def test_a_tank_that_ran_dry_blocks_for_a_reason_that_stays_the_same() -> None:
    """It said OK while 1.8e-12 N were left of 30 N, and another number in every tick."""
    helper, dry = assistance(energy_budget=1.0, trust_stillness=False), []
    for _ in range(3000):
        command = helper.step(OUTSIDE, (0.0, 0.0))
        delivered = float(command.value @ helper.desired_force) / math.hypot(*helper.desired_force) ** 2
        assert (command.status is Status.BLOCKED) == (delivered <= 1e-3) == (command.scale == 0.0)
        dry += [command] * (command.status is Status.BLOCKED)
    assert len(dry) > 1000
    assert all(each.relaxed == Relaxed.TASK for each in dry)
    (reason,) = {each.reason for each in dry}
    assert reason.endswith("0 J afford 0 N")


def test_a_desired_force_far_beyond_the_limit_is_not_blocked_by_it() -> None:
    helper = BoundedForce(lambda *_: (1e6, 0.0), growth_limit=1e5, trust_stillness=True, compile=False)
    for _ in range(100):
        command = helper.step((0.0, 0.0))
    assert command.status is Status.OK
    assert command.value[0] == pytest.approx(30.0)
    assert command.scale == pytest.approx(30e-6)


# --------------------------------------------------------------------------------------------------------------- gate
def test_the_onset_grows_from_the_boundary() -> None:
    helper = assistance(onset=0.01, force_limit=500.0, slew_limit=1e5, energy_budget=1e6)
    for beyond in (0.0, 0.002, 0.005, 0.01, 0.02):
        x = np.array([-0.06 + beyond, 0.41])
        helper.reset()
        for _ in range(30):
            command = helper.step(x)
        np.testing.assert_allclose(command.value, min(1.0, beyond / 0.01) * READY["assist"].force(x), atol=1e-7)


# ------------------------------------------------------------------------------------------------------------- bounds
@pytest.mark.parametrize("ceiling", [30.0, 11.0, 9.0, 8.2])
def test_the_force_is_the_nearest_point_of_ceiling_and_slew_disc(ceiling: float) -> None:
    """Beside a search around both circles, from a last force of 10 N by at most 2 N: also where the ceiling fell."""
    last, step, turns = np.array([6.0, 8.0]), 2.0, np.linspace(0, 2 * np.pi, 20_001)
    screen, met = assistance_statement().screen, 0
    circle = np.column_stack([np.cos(turns), np.sin(turns)])
    for angle in np.linspace(0.05, 6.2, 40):
        for size in (0.3, 0.999):
            desired = size * ceiling * np.array([math.cos(angle), math.sin(angle)])
            answer, residual, _ = screen((*desired, ceiling, step, 30.0), last)
            found = np.array(answer).ravel()[:2]
            places = np.vstack([desired, ceiling * circle, last + step * circle])
            inside = np.hypot(*places.T) <= ceiling * (1 + 1e-9)
            inside &= np.hypot(*(places - last).T) <= step * (1 + 1e-9)
            assert np.hypot(*(found - desired)) <= np.hypot(*(places[inside] - desired).T).min() + 1e-9
            assert np.hypot(*found) <= ceiling * (1 + 1e-12)
            assert np.hypot(*(found - last)) <= step * (1 + 1e-12)
            assert float(residual) < 1e-10
            met += np.array(answer).ravel()[-1] > 1e-6
    assert (met > 10) == (ceiling < 10.0)


def test_the_estimated_velocity_lags_by_what_is_stated() -> None:
    damped = field("follow", damping=100.0, stiffness=0.0)
    helper = assistance("follow", each=damped, velocity_lag=0.02, force_limit=300.0, slew_limit=1e5, energy_budget=1e6)
    acceleration, x0 = 0.5, np.array([-0.17, 0.4])
    for k in range(400):
        t = k * DT
        command = helper.step(x0 + [0.5 * acceleration * t**2, 0.0])
    lag = t - (-command.value[0] / 100.0) / acceleration
    assert lag == pytest.approx(0.02 + DT / 2, rel=0.02)


def test_velocity_given_damps_without_lag() -> None:
    helper = assistance(
        "follow", each=field("follow", damping=20.0), force_limit=300.0, slew_limit=1e5, energy_budget=1e6
    )
    for _ in range(5):
        command = helper.step(INSIDE, [0.3, -0.2])
    np.testing.assert_allclose(command.value, READY["follow"].force(INSIDE) - [6.0, -4.0], atol=1e-9)


# ------------------------------------------------------------------------------------------------------------ the rest


def test_another_field_takes_over_within_the_slew_bound() -> None:
    points = [np.array([[-0.15, 0.4]]), np.array([[-0.08, 0.42]])]
    first, second = (PotentialField(point, stiffness=3500.0, width=0.04, compile=False) for point in points)
    helper = assistance("hold", each=first)
    before = [helper.step(INSIDE) for _ in range(400)][-1].value
    helper.set_field(second)
    after = helper.step(INSIDE).value
    assert np.linalg.norm(after - before) <= SLEW * DT + 1e-12
    settled = [helper.step(INSIDE) for _ in range(600)][-1].value
    assert settled @ (points[1][0] - INSIDE) > 0.9 * np.linalg.norm(settled) * np.linalg.norm(points[1][0] - INSIDE)


# -------------------------------------------------------------------------------------------------------------- carry
@pytest.mark.parametrize("bad", [math.nan, 10**400])
def test_a_field_carried_nowhere_is_let_go_and_one_carried_back_pulls_again(bad: float) -> None:
    helper = assistance("hold")
    for _ in range(100):
        held = helper.step(INSIDE)
    assert np.any(held.value)
    sizes_then, last = [], held.value
    for _ in range(300):
        helper.shift(bad, 0.0)
        command = helper.step(INSIDE)
        assert np.linalg.norm(command.value - last) <= SLEW * DT * (1 + 1e-9)
        last = command.value
        sizes_then.append(math.hypot(*last))
    assert sizes_then[-1] == 0.0
    helper.shift(0.0, 0.0)
    for _ in range(100):
        command = helper.step(INSIDE)
    assert command.status is Status.OK
    np.testing.assert_allclose(command.value, held.value, atol=1e-9)


def test_what_cannot_be_used_is_named() -> None:
    settings: list[tuple[str, Any]] = [
        ("comfortable", None), ("comfortable", EMPTY), ("mode", "push"), ("force_limit", 0.0),
        ("force_limit", math.nan), ("slew_limit", -1.0), ("trust_stillness", "no"), ("energy_budget", math.inf),
        ("speed_cap", 0.0), ("dt", 0.0), ("onset", -1.0), ("onset", 20.0), ("return_force", 0.0), ("solver", "none"),
        ("max_age", 0.0), ("velocity_lag", 0.0), ("velocity_lag", 10.0), ("tolerance", 2.0), ("position_noise", ""),
        ("position_noise", False),
    ]  # fmt: skip
    refuses(assistance, *(({name: value}, name) for name, value in settings))
    refuses(assistance, ({"mode": "resist", "each": READY["assist"]}, "mode"), ({"each": READY["resist"]}, "mode"))
    refuses(BoundedForce, ((None,), "desired_force"))
    helper = assistance("hold")
    refuses(helper.step, *(((x,), "x") for x in ([1.0], "ab", None, [1j, 0], [True, False])))
    refuses(helper.step, *(((OUTSIDE, v), "v") for v in ([1.0, 2.0, 3.0], [True, False])))
    refuses(helper.shift, *(((bad, 0.0), "dx, dy") for bad in ("a", None, [1.0, 2.0])))
    refuses(helper.set_field, (("a field",), "field"))
    for x in ([0, 0], (10**400, 1), np.float32([0.1, 0.2])):
        assert np.all(np.isfinite(helper.step(x).value))
