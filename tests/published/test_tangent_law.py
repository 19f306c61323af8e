import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from rehab_opt.kinematics.human_arm import human_arm
from rehab_opt.published.tangent_law import TangentLaw, Tracking, damped_pseudoinverse
from tests.refusals import refuses

REGULAR, RESTRICTED = human_arm(), human_arm(range_of_motion="restricted")
HELD = np.array([-0.167, 0.518, -0.24])  # a point of the table in the midst of the regular reach

ARMS = pytest.mark.parametrize("arm", [REGULAR, RESTRICTED, human_arm(side="right")])
seeds = st.integers(0, 2**32 - 1)


def repeated(target, n=100):
    return np.repeat([target], n, axis=0)


# -------------------------------------------------------------------------------------------- the transform
@ARMS
@given(seed=seeds)
@settings(max_examples=20)
def test_eq_9_inverts_eq_8(arm, seed):
    law = TangentLaw(arm)
    q = np.random.default_rng(seed).uniform(arm.lower, arm.upper)
    np.testing.assert_allclose(law.joints(law.transformed(q)), q, atol=1e-12)


@ARMS
@given(seed=seeds, size=st.floats(0.01, 100.0))
@settings(max_examples=20)
def test_eq_11_is_the_derivative_of_eq_9(arm, seed, size):
    law = TangentLaw(arm)
    free = ~arm.locked
    v, h = size * np.random.default_rng(seed).normal(size=free.sum()), 1e-6
    difference = np.array([(law.joints(v + h * e) - law.joints(v - h * e))[free] for e in np.eye(len(v))]) / (2 * h)
    np.testing.assert_allclose(difference, np.diag(law.slope(v)), atol=1e-9)


@ARMS
@given(seed=seeds)
@settings(max_examples=20)
def test_eq_10_is_the_derivative_of_the_task_by_v(arm, seed):
    law = TangentLaw(arm)
    v, h = 2 * np.random.default_rng(seed).normal(size=(~arm.locked).sum()), 1e-6
    columns = [(law.task(law.joints(v + h * e)) - law.task(law.joints(v - h * e))) / (2 * h) for e in np.eye(len(v))]
    np.testing.assert_allclose(law.task_jacobian(v), np.transpose(columns), atol=1e-8)


@ARMS
@given(v=arrays(float, 8, elements=st.floats(allow_nan=False)))
@settings(max_examples=50)
def test_no_v_leaves_the_joint_limits(arm, v):
    law = TangentLaw(arm)
    q = law.joints(v[: (~arm.locked).sum()])
    assert np.all((q >= arm.lower) & (q <= arm.upper))


@given(seed=seeds, damping=st.floats(1e-9, 1.0), rows=st.integers(1, 5), columns=st.integers(0, 8), flat=st.booleans())
@settings(max_examples=50)
def test_eq_13_is_the_singular_values_filtered(seed, damping, rows, columns, flat):
    jacobian = np.random.default_rng(seed).normal(size=(rows, columns))
    if flat:
        jacobian[-1] = jacobian[0]
    left, singular, right = np.linalg.svd(jacobian, full_matrices=False)
    expected = right.T @ np.diag(singular / (singular**2 + damping)) @ left.T
    np.testing.assert_allclose(damped_pseudoinverse(jacobian, damping), expected, atol=1e-7 / damping**0.5)


# ------------------------------------------------------------------------------------------------- the path


def test_the_error_of_a_constant_target_goes_to_zero_where_it_is_reachable_and_is_reported_where_not():
    path = TangentLaw(REGULAR).follow(repeated(HELD, 150), start=(REGULAR.lower + REGULAR.upper) / 2)
    assert path.position_error[0] > 0.05
    assert path.position_error[-1] < 1e-9
    assert (path.status[0], path.status[-1]) == (Tracking.OFF, Tracking.OK)
    found = TangentLaw(REGULAR).follow(repeated([0.0, 2.0, -0.24], 30))
    assert set(found.status) == {Tracking.OFF}
    assert found.position_error[-1] > 1.0


@ARMS
@given(seed=seeds)
@settings(max_examples=5, deadline=None)
def test_no_target_drives_a_joint_out_of_its_limits_or_raises(arm, seed):
    rng = np.random.default_rng(seed)
    path = rng.uniform(-1, 1, (12, 3)) * 10.0 ** rng.uniform(-1, 6, (12, 1))
    found = TangentLaw(arm, dt=0.01).follow(path)
    assert np.all((found.q >= arm.lower) & (found.q <= arm.upper))
    assert np.all(np.isfinite(found.q))
    for q, target, error, tilt in zip(found.q, path, found.position_error, found.handle_tilt, strict=True):
        pose = arm.pose(q)
        assert error == pytest.approx(np.linalg.norm(pose[:3, 3] - target))
        assert tilt == pytest.approx(math.acos(np.clip(pose[2, 0], -1, 1)), abs=1e-7)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e300])
def test_a_target_that_is_no_number_holds_the_posture_and_says_so(bad):
    path = repeated(HELD, 30)
    path[10:20, 1] = bad
    found = TangentLaw(REGULAR).follow(path)
    assert np.all(np.isfinite(found.q))
    assert found.status[10:20] == [Tracking.HOLDING] * 10
    assert np.all(np.isnan(found.position_error[10:20]))
    np.testing.assert_array_equal(found.q[10:20], np.repeat(found.q[9:10], 10, axis=0))
    assert found.status[20:] == [Tracking.OK] * 10


# -------------------------------------------------------------------------------------------------- arguments
def test_unusable_numbers_are_refused_by_name():
    refuses(
        lambda **arguments: TangentLaw(REGULAR, **arguments),
        ({"gain": 0.0}, "gain"),
        ({"damping": 0.0}, "damping"),
        ({"dt": -1.0}, "dt"),
        ({"handle_tilt": math.inf}, "handle_tilt"),
        ({"saturation": math.nan}, "saturation"),
        ({"substeps": 1.5}, "substeps"),
    )
