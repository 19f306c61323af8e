"""A chain is what its Denavit-Hartenberg rows say; everything else about it follows by differentiation."""

import copy
import pickle
from dataclasses import FrozenInstanceError

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from rehab_opt import DH, ConfigurationError, SerialChain, human_arm, ur5
from tests.kinematics.dh_oracle import Array, chain_pose, chains_with_joints, differentiated
from tests.refusals import refuses

LIMITS = {"lower": -1.0, "upper": 1.0, "velocity": 1.0, "acceleration": 1.0}
ROWS = (DH(a=0.1, alpha=0.2), DH(a=0.3, alpha=0.0))


def planar(n: int) -> SerialChain:
    """Parallel axes: no more than three ways to move, whatever the number of joints."""
    return SerialChain((DH(a=0.2, alpha=0.0),) * n, **LIMITS)


# -------------------------------------------------------------------------------------------------------- pose
@settings(max_examples=60)
@given(chains_with_joints())
def test_pose_is_the_product_of_the_rows(case: tuple[SerialChain, Array]) -> None:
    chain, q = case
    expected = chain_pose(chain.rows, q, chain.base, chain.tool)
    np.testing.assert_allclose(chain.pose(q), expected, atol=1e-12)


@settings(max_examples=30)
@given(chains_with_joints())
def test_jacobian_is_the_derivative_of_the_pose(case: tuple[SerialChain, Array]) -> None:
    chain, q = case
    jacobian = chain.jacobian(q)
    assert jacobian.shape == (6, chain.n)
    np.testing.assert_allclose(jacobian, differentiated(chain, q), atol=1e-7)


# ---------------------------------------------------------------------------------------------- manipulability
def volume(chain: SerialChain, q: Array) -> float:
    return float(np.prod(np.linalg.svd(chain.jacobian(q), compute_uv=False)))


def size(chain: SerialChain, q: Array) -> float:
    """What rounding in a determinant is to be measured by."""
    return max(1.0, float(np.linalg.norm(chain.jacobian(q), 2))) ** min(chain.n, 6)


@settings(max_examples=40)
@given(chains_with_joints())
def test_manipulability_is_the_product_of_singular_values(case: tuple[SerialChain, Array]) -> None:
    chain, q = case
    assert chain.manipulability(q) == pytest.approx(volume(chain, q), abs=1e-7 * size(chain, q), rel=1e-6)


@settings(max_examples=30)
@given(chains_with_joints(st.sampled_from([2, 3, 5, 6, 7, 8])))
def test_manipulability_gradient_is_its_derivative(case: tuple[SerialChain, Array]) -> None:
    chain, q = case
    scale = size(chain, q)
    assume(volume(chain, q) > 1e-3 * scale)
    h = 1e-5
    steps = h * np.eye(chain.n)
    expected = [(volume(chain, q + step) - volume(chain, q - step)) / (2 * h) for step in steps]
    np.testing.assert_allclose(chain.manipulability_gradient(q), expected, atol=1e-5 * scale)


@settings(max_examples=12)
@given(st.integers(6, 9), st.data())
def test_gradient_is_exactly_zero_where_the_chain_can_never_move_freely(n: int, data: st.DataObject) -> None:
    q = [data.draw(st.floats(-3, 3)) for _ in range(n)]
    chain = planar(n)
    assert chain.manipulability(q) == 0.0
    np.testing.assert_array_equal(chain.manipulability_gradient(q), np.zeros(n))


@settings(max_examples=30)
@given(chains_with_joints(), st.data())
def test_gradient_is_finite_where_two_axes_coincide(case: tuple[SerialChain, Array], data: st.DataObject) -> None:
    chain, q = case
    i = data.draw(st.integers(0, chain.n - 1))
    doubled = SerialChain(
        (*chain.rows[:i], DH(a=0.0, alpha=0.0, prismatic=chain.rows[i].prismatic), *chain.rows[i:]), **LIMITS
    )
    q = np.insert(q, i, 0.3)
    w, gradient = doubled.manipulability(q), doubled.manipulability_gradient(q)
    assert np.isfinite(gradient).all()
    assert w >= 0.0
    if w == 0.0:
        np.testing.assert_array_equal(gradient, np.zeros(doubled.n))


def test_other_limits_leave_the_first_chain_as_it_was() -> None:
    chain = planar(2)
    slower = chain.with_limits(velocity=[0.1, 0.2], upper=0.3)
    assert slower.velocity.tolist() == [0.1, 0.2]
    assert slower.upper.tolist() == [0.3, 0.3]
    assert slower.lower.tolist() == chain.lower.tolist()
    assert chain.velocity.tolist() == [1.0, 1.0]
    assert chain.with_limits(lower=1.0).locked.tolist() == [True, True]


@pytest.mark.parametrize("limits", [{"lower": -170.0}, {"upper": [1.0, 170.0]}, {"lower": -170.0, "upper": 170.0}])
def test_degrees_for_radians_are_refused(limits: dict[str, object]) -> None:
    """Such limits were never felt: a joint went as far as it was led."""
    with pytest.raises(ConfigurationError, match=r"lower, upper of joint_[12] = .*: expected radians within two turns"):
        SerialChain(ROWS, **LIMITS).with_limits(**limits)  # type: ignore[arg-type]
    with pytest.raises(ConfigurationError, match=r"lower, upper of shoulder_pan"):
        ur5(lower=-360.0, upper=360.0)
    for row in (DH(a=0.3, alpha=90), DH(a=0.3, alpha=0.0, theta=-90.0)):
        with pytest.raises(ConfigurationError, match=r"rows\[1\] = .*: expected alpha and theta in radians"):
            SerialChain((ROWS[0], row), **LIMITS)


def test_a_chain_cannot_be_changed() -> None:
    chain = planar(2)
    with pytest.raises(FrozenInstanceError):
        chain.lower = np.zeros(2)  # type: ignore[misc]
    for name in ("lower", "upper", "velocity", "acceleration", "base", "tool", "locked"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(chain, name)[0] = 5.0


@pytest.mark.parametrize("used", [False, True])
@pytest.mark.parametrize("again", [lambda chain: pickle.loads(pickle.dumps(chain)), copy.copy, copy.deepcopy])
def test_a_chain_survives_pickling_and_copying(used: bool, again: object) -> None:
    chain, q = human_arm(range_of_motion="restricted", side="right"), np.linspace(-1, 1, 8)
    if used:  # its functions exist by now
        chain.pose(q)
        assert chain.locked.any()
    twin = again(chain)  # type: ignore[operator]
    np.testing.assert_array_equal(twin.pose(q), chain.pose(q))
    np.testing.assert_array_equal(twin.locked, chain.locked)
    assert twin.names == chain.names
    for name in ("lower", "upper", "velocity", "acceleration", "base", "tool"):
        np.testing.assert_array_equal(getattr(twin, name), getattr(chain, name))


# --------------------------------------------------------------------------------------------------- bad arguments
def test_a_bad_argument_is_named() -> None:
    mirrored, lacking, sheared = np.diag([1, 1, -1, 1]), np.full((4, 4), np.nan), np.eye(4) + np.eye(4)[[1, 2, 3, 0]]
    wrong = [
        ("lower", np.nan), ("lower", 2.0), ("lower", [0.0]), ("upper", np.nan), ("velocity", 0.0),
        ("velocity", np.nan), ("velocity", [1.0, 0.0]), ("acceleration", 0.0), ("acceleration", np.nan),
        ("names", ("a",)), ("base", np.eye(3)), ("base", mirrored), ("tool", lacking), ("tool", sheared),
        ("rows", ()), ("rows", (DH(np.nan, 0.0),)), ("rows", (DH(0.0, 0.0, np.inf),)),
    ]  # fmt: skip
    refuses(SerialChain, *(({"rows": ROWS, **LIMITS, name: value}, name) for name, value in wrong))
    refuses(planar(2).pose, *(((q,), "q = ") for q in ("here", [1.0], np.zeros((2, 2)), [1.0, 2.0, 3.0])))


class Rising(SerialChain):
    """Its tool rises by half the square of its second joint."""

    def frames_expression(self, q, rows=None):
        frames = super().frames_expression(q, rows)
        frames[-1][2, 3] += q[1] ** 2 / 2
        return frames


@pytest.mark.parametrize("kinds", [(SerialChain, Rising), (Rising, SerialChain)])
def test_what_a_subclass_writes_otherwise_is_its_own(kinds):
    arm, q = ur5(), np.array([0.3, -1.1, 1.4, 0.2, 0.5, -0.4])
    rng = np.random.default_rng(len(kinds[0].__name__))
    given = {name: getattr(arm, name) for name in ("rows", "lower", "upper", "velocity", "acceleration")}
    tool = arm.tool.copy()
    tool[:3, 3] = rng.uniform(-0.1, 0.1, 3)  # a chain that no test before has written
    each = {kind: kind(**given, tool=tool).jacobian(q) for kind in kinds}
    offset = each[Rising] - each[SerialChain]
    np.testing.assert_allclose(offset[3:], 0.0, atol=1e-12)
    axes = each[SerialChain][3:]
    np.testing.assert_allclose(offset[:3], np.cross(axes.T, [0.0, 0.0, q[1] ** 2 / 2]).T, atol=1e-12)
