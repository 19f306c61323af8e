import math
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from rehab_opt.control.command import Bound, Status
from rehab_opt.control.smoothing import Smoother, measured_lag, smooth_path
from rehab_opt.errors import ConfigurationError

V, A, J, DT = 1.0, 5.0, 50.0, 0.001


def smoother(**changes):
    return Smoother(**{"velocity": V, "acceleration": A, "jerk": J, "dt": DT, **changes})


def run(s, targets, **inputs):
    return np.array([s.step(target, **inputs).value for target in targets])


def assert_within_bounds(positions, s_velocity, s_acceleration, s_jerk, dt, *, asked=0.0):
    """Independent of the library's certificate: differences of all positions at once, with the rounding they carry.

    A profile is counted from positions to what is `asked`: near the start it carries the rounding of the larger one.
    """
    noise = 64 * np.finfo(float).eps * max(np.abs(positions).max(), np.abs(asked).max())
    for order, bound in ((1, s_velocity), (2, s_acceleration), (3, s_jerk)):
        differences = np.abs(np.diff(positions, order, axis=0)) / dt**order
        assert np.all(differences <= np.asarray(bound) * (1 + 1e-6) + noise / dt**order), order


def rest_to_rest_seconds(distance, v, a, j):
    """Closed form of the jerk-limited move from rest to rest (the textbook's seven-segment profile)."""
    ramp = 2 * math.sqrt(v / j) if v * j < a * a else v / a + a / j  # time from rest to v
    if distance >= v * ramp:
        return distance / v + ramp
    if distance >= 2 * a**3 / j**2:  # the acceleration bound is reached, the velocity bound is not
        return a / j + math.sqrt((a / j) ** 2 + 4 * distance / a)
    return 4 * (distance / (2 * j)) ** (1 / 3)


limits = st.tuples(st.floats(0.05, 10.0), st.floats(0.2, 100.0), st.floats(1.0, 5000.0))
seeds = st.integers(0, 2**32 - 1)


# ------------------------------------------------------------------------------------------------ one move
@given(limits=limits, distance=st.floats(1e-3, 50.0), sign=st.sampled_from([-1.0, 1.0]))
def test_a_move_from_rest_to_rest_takes_the_time_of_the_closed_form(limits, distance, sign):
    v, a, j = limits
    seconds = rest_to_rest_seconds(distance, v, a, j)
    dt = seconds / 200.0
    s = Smoother(velocity=v, acceleration=a, jerk=j, dt=dt)
    s.reset([0.0])
    positions = run(s, [[sign * distance]] * 202)[:, 0] * sign
    assert positions[200] == pytest.approx(distance, abs=1e-9 * (1 + distance))
    assert positions[198] < distance  # not earlier either
    assert np.all(np.diff(positions) >= -1e-12)


def test_the_target_is_reached_exactly_and_held():
    s = smoother(axes=3)
    s.reset(np.zeros(3))
    target = np.array([0.3, -0.2, 0.1])
    command = [s.step(target) for _ in range(3000)][-1]
    np.testing.assert_array_equal(command.value, target)
    assert command.status is Status.OK
    assert command.solver == "ruckig"
    assert command.residual == 0.0
    assert not np.any(s.velocity)
    assert s.arrived


def test_axes_do_not_wait_for_each_other():
    alone, both = smoother(), smoother(axes=2)
    alone.reset([0.0])
    both.reset([0.0, 0.0])
    np.testing.assert_allclose(run(both, [[0.1, 5.0]] * 900)[:, :1], run(alone, [[0.1]] * 900), atol=1e-15, rtol=0)


# ------------------------------------------------------------------------------------------ all the bounds
@settings(deadline=None, max_examples=150)
@example(n=1, limits=[(1.0, 1.0, 1.0)] * 9, dt=1e-4, change=1.0, bounded=False, moving=True, seed=0)
@given(
    n=st.integers(1, 9),
    limits=st.lists(limits, min_size=9, max_size=9),
    dt=st.floats(1e-4, 0.1),
    change=st.sampled_from([1.0, 0.3, 0.02]),
    bounded=st.booleans(),
    moving=st.booleans(),
    seed=seeds,
)
def test_no_bound_is_exceeded_whatever_is_asked(*, n, limits, dt, change, bounded, moving, seed):
    rng = np.random.default_rng(seed)
    v, a, j = np.array(limits[:n]).T
    reach = np.maximum(v * dt * 100, 0.1)
    lower, upper = (-reach * rng.uniform(0, 1, n), reach * rng.uniform(0, 1, n)) if bounded else (-np.inf, np.inf)
    s = Smoother(velocity=v, acceleration=a, jerk=j, dt=dt, lower=lower, upper=upper, axes=n)
    s.reset(np.zeros(n))
    faults = [np.full(n, np.nan), np.full(n, np.inf), np.full(n, -1e300), np.zeros(n + 1), None, "left", 1j]
    positions, target, speed, stamp = [np.zeros(n)] * 4, np.zeros(n), None, 0.0
    for _ in range(250):
        if rng.random() < change:
            target = reach * rng.uniform(-1.5, 1.5, n)
            speed = v * rng.uniform(-1.2, 1.2, n) if moving else None
        stamp += dt if rng.random() < 0.95 else rng.choice([0.0, -dt, 100 * dt, np.nan])
        stamp = stamp if math.isfinite(stamp) else 0.0
        asked = faults[rng.integers(len(faults))] if rng.random() < 0.05 else target
        command = s.step(asked, speed, enable=bool(rng.random() < 0.95), stamp=stamp)
        assert np.all(np.isfinite(command.value))
        assert Bound.POSITION not in command.yielded
        assert command.residual == 0.0 or not command.status.certified
        assert "certificate" not in command.reason
        positions.append(command.value)
    positions = np.array(positions)
    assert_within_bounds(positions, v, a, j, dt, asked=1.5 * reach)
    assert np.all(positions >= lower)
    assert np.all(positions <= upper)


@settings(deadline=None, max_examples=100)
@given(limits=limits, dt=st.floats(1e-3, 0.02), seed=seeds)
def test_a_target_on_the_bound_is_reached_from_any_motion_and_not_overrun(limits, dt, seed):
    v, a, j = limits
    rng = np.random.default_rng(seed)
    s = Smoother(velocity=v, acceleration=a, jerk=j, dt=dt, lower=-0.3, upper=0.3)
    s.reset([0.0])
    moves = run(s, np.repeat(rng.uniform(-0.3, 0.3, (20, 1)), rng.integers(1, 40, 20), axis=0))
    ticks = math.ceil(3 * rest_to_rest_seconds(0.6, v, a, j) / dt)
    assume(ticks < 5_000)
    home = run(s, [[0.3]] * ticks)
    assert home[-1, 0] == pytest.approx(0.3, abs=1e-9)
    assert max(moves.max(), home.max()) <= 0.3
    assert min(moves.min(), home.min()) >= -0.3


def test_a_target_outside_the_bounds_is_clipped_and_flagged():
    s = smoother(lower=[-1.0], upper=[0.2])
    s.reset([0.0])
    commands = [s.step([0.5]) for _ in range(2000)]
    assert commands[-1].value[0] == 0.2
    assert commands[-1].status is Status.OK
    assert "clipped" in commands[-1].reason
    assert Bound.TASK in commands[-1].yielded


def test_a_start_too_fast_for_the_bound_brakes_and_says_so():
    s = smoother(lower=-1.0, upper=0.05)
    s.reset([0.0], velocity=[1.0])
    commands = [s.step([0.0]) for _ in range(3000)]
    positions = np.array([command.value for command in commands])
    assert positions.max() > 0.05  # physically unavoidable
    assert commands[0].status is Status.BRAKING
    assert any(Bound.POSITION in command.yielded for command in commands)
    assert_within_bounds(positions, V, A, J, DT)
    assert commands[-1].value[0] == pytest.approx(0.0, abs=1e-12)
    assert commands[-1].status is Status.OK


def test_an_axis_outside_its_bounds_is_led_back_slowly_and_flagged():
    s = smoother(axes=2, lower=-0.1, upper=0.1)
    s.reset([0.3, 0.0])
    commands = [s.step([0.0, 0.05]) for _ in range(4000)]
    positions = np.array([command.value for command in commands])
    outside = positions[:, 0] > 0.1
    assert np.all(np.diff(positions[outside, 0]) <= 1e-15)
    assert np.abs(np.diff(positions[outside, 0])).max() <= 0.1 * V * DT * (1 + 1e-9)
    assert np.all([Bound.POSITION in command.yielded for command in commands[: int(outside.sum())]])
    assert commands[-1].reason == ""
    np.testing.assert_allclose(positions[-1], [0.0, 0.05], atol=1e-12)
    assert_within_bounds(positions, V, A, J, DT)


def test_a_locked_axis_stands():
    s = smoother(lower=[0.2, -1.0], upper=[0.2, 1.0])
    s.reset([0.2, 0.0])
    positions = run(s, np.random.default_rng(0).uniform(-1, 1, (500, 2)))
    assert np.all(positions[:, 0] == 0.2)


@settings(deadline=None, max_examples=60)
@given(limits=limits, seed=seeds)
def test_the_stop_keeps_the_position_bounds_wherever_it_is_asked_for(limits, seed):
    v, a, j = limits
    rng = np.random.default_rng(seed)
    dt = 0.02 * rest_to_rest_seconds(0.2, v, a, j)
    s = Smoother(velocity=v, acceleration=a, jerk=j, dt=dt, lower=-0.1, upper=0.1)
    s.reset([0.0])
    for _ in range(30):
        positions = [s.step([rng.choice([-0.1, 0.1])]).value for _ in range(rng.integers(1, 20))]
        positions += [s.step([math.nan]).value for _ in range(rng.integers(1, 30))]
        assert np.abs(positions).max() <= 0.1
    for _ in range(600):
        command = s.step([math.nan])
    assert command.status is Status.HOLDING


# -------------------------------------------------------------------------------- enabling, faults, stamps
@pytest.mark.parametrize(
    ("inputs", "expected"),
    [
        ({"target": [math.nan]}, "target is not"),
        ({"target": [math.inf]}, "target is not"),
        ({"target": [1e300]}, "away"),
        ({"target": [10**400]}, "target is not"),
        ({"target": [1.0, 2.0]}, "target is not"),
        ({"target": None}, "target is not"),
        ({"target": [0.5], "target_velocity": [math.nan]}, "target velocity is not"),
        ({"target": [0.5], "enable": False}, "disabled"),
        ({"target": [0.5], "enable": math.nan}, "disabled"),
        ({"target": [0.5], "enable": None}, "disabled"),
        ({"target": [0.5], "enable": "yes"}, "disabled"),
        ({"target": [0.5], "enable": np.array(True)}, "disabled"),
        ({"target": [0.5], "enable": np.array([True, True])}, "disabled"),
        ({"target": [0.5], "enable": np.float32("nan")}, "disabled"),
        ({"target": [0.5], "stamp": math.nan}, "stamp is not finite"),
        ({"target": [0.5], "stamp": 0.0}, "stamp"),
    ],
)
def test_every_fault_brakes_to_rest_within_the_bounds_and_the_motion_goes_on_without_a_jump(inputs, expected):
    s = smoother(dt=DT)
    s.reset([0.0])
    before = [s.step([0.5], stamp=k * DT).value for k in range(1, 301)]
    command = s.step(**inputs)
    assert command.status is Status.BRAKING
    assert expected in command.reason
    assert (command.solver, command.residual, command.scale) == ("", math.inf, 0.0)
    during = [command.value, *(s.step(**inputs).value for _ in range(799))]
    held = s.step(**inputs)
    assert held.status is Status.HOLDING
    assert held.value == during[-1]
    s.step([0.5], stamp=1.2)
    after = [s.step([0.5], stamp=1.2 + k * DT).value for k in range(1, 2000)]
    assert_within_bounds(np.array([[0.0]] * 3 + before + during), V, A, J, DT)
    assert_within_bounds(np.array(during[-5:] + [held.value] * 2 + after), V, A, J, DT)
    assert after[-1] == pytest.approx([0.5], abs=1e-12)


def test_enabling_anew_in_the_middle_of_the_stop_is_smooth():
    s = smoother()
    s.reset([0.0])
    positions = [s.step([1.0], enable=(k // 70) % 2 == 0).value for k in range(4000)]
    assert_within_bounds(np.array([[0.0]] * 3 + positions), V, A, J, DT)


def test_an_array_overwritten_by_the_caller_is_a_new_target():
    s = smoother()
    s.reset([0.0])
    for target in (np.array([0.1]), [0.1]):
        run(s, [target] * 2000)
        target[0] = -0.1
        assert run(s, [target] * 2000)[-1, 0] == pytest.approx(-0.1)


def test_the_value_cannot_be_written_and_is_not_written_later():
    s = smoother()
    s.reset([0.0])
    first = s.step([1.0]).value
    kept = first.copy()
    s.step([1.0])
    np.testing.assert_array_equal(first, kept)
    with pytest.raises(ValueError, match="read-only"):
        first[0] = 1.0


class Broken:
    """Stands in for Ruckig: refuses every question, or answers it with what is no number."""

    duration = 1.0
    position_extrema = ()

    def __init__(self, error=None):
        self.error = error

    def calculate(self, *_):
        if self.error:
            raise self.error

    def at_time(self, _):
        return [math.nan], [math.nan], [math.nan]


def test_a_planner_that_refuses_everything_leaves_the_safe_profile_in_use():
    s = smoother()
    s.reset([0.0])
    before = [s.step([0.5]).value for _ in range(200)]
    s._profiles._solver = Broken(ValueError("-101 is not a valid Result"))
    commands = [s.step([-0.5]) for _ in range(3000)]
    assert all(command.status in (Status.BRAKING, Status.HOLDING) for command in commands)
    assert commands[-1].value[0] == 0.5
    assert_within_bounds(np.array([[0.0]] * 3 + before + [command.value for command in commands]), V, A, J, DT)


def test_a_profile_that_is_no_number_is_never_sent():
    s = smoother()
    s.reset([0.0])
    last = [s.step([0.5]).value for _ in range(200)][-1]
    s._profiles._plan, s._profiles._spare, s._profiles._solver = Broken(), Broken(), Broken()
    command = s.step([0.5])
    assert command.value == last
    assert command.status is Status.HOLDING
    assert "certificate" in command.reason


def test_a_profile_that_breaks_a_bound_is_replaced_by_the_stop():
    s = smoother()
    s.reset([0.0])
    for _ in range(200):
        s.step([0.5])
    p, v = s.position, s.velocity

    class Jump(Broken):
        def at_time(self, _):
            return [p[0] + 0.1], [0.0], [0.0]

    s._profiles._plan = Jump()
    command = s.step([0.5])
    assert abs(command.value[0] - p[0] - v[0] * DT) <= A * DT**2
    assert command.status is Status.BRAKING
    assert "certificate" in command.reason


# ----------------------------------------------------------------------------------------- moving targets
@given(share=st.floats(0.05, 0.9), limits=limits)
@settings(deadline=None, max_examples=20)
def test_the_lag_behind_a_steady_target_is_as_documented_and_zero_with_its_velocity(share, limits):
    v, a, j = limits
    speed = share * v
    plain = Smoother(velocity=v, acceleration=a, jerk=j)
    lag = plain.lag(speed)[0]
    assert lag == pytest.approx(
        rest_to_rest_seconds(1e9 * v, speed, a, j) / 2 - 1e9 * v / speed / 2, rel=1e-3, abs=1e-6
    )
    dt = (lag + v / a + a / j) / 100
    for velocity, expected in ((None, lag), ([speed], 0.0)):
        s = Smoother(velocity=v, acceleration=a, jerk=j, dt=dt)
        s.reset([0.0])
        ticks = int(4000 / (1 - share) ** 0.5)
        positions = run(s, speed * dt * np.arange(1, ticks + 1)[:, None], target_velocity=velocity)
        assert ticks * dt - positions[-1, 0] / speed == pytest.approx(expected, abs=dt)


def test_a_moving_target_is_followed_closely_with_its_velocity():
    t = DT * np.arange(1, 6001)
    s = smoother()
    s.reset([0.0])
    target, velocity = 0.3 * np.sin(2 * t), 0.6 * np.cos(2 * t)
    positions = np.array([s.step([x], [w]).value[0] for x, w in zip(target, velocity, strict=True)])
    assert np.abs(positions - target)[1500:].max() < 1e-3
    assert_within_bounds(positions[:, None], V, A, J, DT)


def test_a_moving_target_that_is_not_renewed_is_followed_for_max_age_only():
    s = smoother(max_age=0.05)
    s.reset([0.0])
    for k in range(1, 2001):
        s.step([0.3 * DT * k], [0.3])
    commands = [s.step([0.3 * DT * 2000], [0.3]) for _ in range(600)]
    good = [command.status is Status.OK for command in commands]
    assert all(good[:49])
    assert not any(good[51:])
    assert "not renewed" in commands[60].reason
    assert commands[40].value[0] == pytest.approx(0.3 * DT * 2041)
    assert commands[-1].status is Status.HOLDING


@pytest.mark.parametrize("velocity", [None, [0.3]])
def test_a_target_that_leaves_the_bounds_is_followed_to_the_bound(velocity):
    s = smoother(lower=-1, upper=0.5)
    s.reset([0.0])
    positions = np.array([s.step([0.3 * DT * (k // 10 * 10)], velocity).value for k in range(3000)])
    assert positions.max() <= 0.5
    assert positions[-1, 0] == pytest.approx(0.5, abs=1e-12)
    assert_within_bounds(positions, V, A, J, DT)


# ------------------------------------------------------------------------------------------ a whole path
def test_a_smooth_path_within_the_bounds_is_kept_to_the_micrometre():
    t = np.linspace(0, 6, 601)
    u = t / 6
    path = np.stack([10 * u**3 - 15 * u**4 + 6 * u**5, -0.5 * (10 * u**3 - 15 * u**4 + 6 * u**5)], axis=1)
    found = smooth_path(t, path, velocity=V, acceleration=A, jerk=J)
    assert found.compensation == "velocity"
    assert found.deviation.max() < 1e-5
    assert abs(found.lag) < DT
    assert found.residual == 0.0
    plain = smooth_path(t, path, velocity=V, acceleration=A, jerk=J, compensate=False)
    assert plain.lag > 0.03
    assert plain.deviation.max() > 1e-2


@pytest.mark.parametrize("compensate", [False, True])
def test_a_path_with_corners_and_steps_is_followed_within_the_bounds_to_its_end(compensate):
    t = np.arange(0, 4, 0.01)
    path = np.stack([0.5 * np.abs(t % 2 - 1), np.floor(t) / 4], axis=1)
    found = smooth_path(t, path, velocity=V, acceleration=A, jerk=J, lower=0, upper=1, compensate=compensate)
    assert_within_bounds(found.positions, V, A, J, DT)
    np.testing.assert_array_equal(found.positions[0], path[0])
    np.testing.assert_allclose(found.positions[-1], path[-1], atol=1e-12)
    assert found.times[0] == 0.0
    assert np.all((found.positions >= 0) & (found.positions <= 1))
    if compensate:
        assert abs(found.lag) < 0.03


def test_a_known_delay_is_measured():
    t = np.arange(0, 10, 0.01)
    for delay in (0.0, 0.123, -0.05, 1.0):
        target, late = (np.stack([np.sin(x), 100 * np.cos(0.7 * x)], axis=1) for x in (t, t - delay))
        assert measured_lag(t, target, late) == pytest.approx(delay, abs=2e-3)
    assert measured_lag(t, 0 * target, 0 * target) == 0.0


@pytest.mark.parametrize(
    ("times", "points"),
    [
        ([0.0, 0.0], [[0.0], [1.0]]),
        ([0.0, math.nan], [[0.0], [1.0]]),
        ([0.0], [[0.0]]),
        ([0.0, 1.0], [[0.0], [math.inf]]),
        ([0.0, 1.0], [0.0, 1.0]),
        ([0.0, 1.0], [[0.0]]),
        ("a", [[0.0], [1.0]]),
        ([0.0, 1.0], "a"),
        ([0.0, 10**400], [[0.0], [1.0]]),
        ([0.0, 1.0], [[0.0], [1.0, 2.0]]),
    ],
)
def test_an_unusable_path_is_refused(times, points):
    with pytest.raises(ConfigurationError):
        smooth_path(times, points, velocity=V, acceleration=A, jerk=J)


# --------------------------------------------------------------------------------------------- arguments
@pytest.mark.parametrize(
    "changes",
    [
        {"velocity": 0.0},
        {"velocity": math.nan},
        {"acceleration": math.inf},
        {"jerk": [1.0, -1.0]},
        {"velocity": [1.0, 1.0], "jerk": [1.0, 1.0, 1.0]},
        {"lower": 1.0, "upper": 0.0},
        {"lower": math.nan},
        {"lower": math.inf},
        {"dt": 0.0},
        {"dt": math.nan},
        {"axes": 0},
        {"axes": 2, "velocity": [1.0, 1.0, 1.0]},
        {"return_speed": 0.0},
        {"max_age": 0.0},
        {"dt": "x"},
        {"max_age": "x"},
        {"axes": "x"},
        {"axes": 1.5},
        {"return_speed": "x"},
        {"return_speed": [0.1, 0.1]},
        {"velocity": "x"},
        {"velocity": None},
        {"acceleration": {}},
        {"jerk": [[1.0], [1.0, 2.0]]},
        {"lower": "x"},
        {"upper": 10**400},
    ],
)
def test_unusable_bounds_are_refused_by_name(changes):
    with pytest.raises(ConfigurationError, match="|".join(changes)):
        smoother(**changes)


@pytest.mark.parametrize("changes", [{"dt": "x"}, {"velocity": "x"}, {"lower": "x"}])
def test_what_no_smoother_can_use_is_refused_with_a_path_by_name(changes):
    with pytest.raises(ConfigurationError) as caught:
        smooth_path([0.0, 1.0], [[0.0], [1.0]], **{"velocity": V, "acceleration": A, "jerk": J, **changes})
    assert caught.value.argument in changes


@pytest.mark.parametrize("enable", [True, 1, 1.0, np.True_])
def test_a_scalar_that_is_true_enables(enable):
    s = smoother()
    s.reset([0.0])
    assert s.step([0.5], enable=enable).status is Status.OK


@pytest.mark.parametrize("state", [([math.nan],), ([0.0, 0.0],), ([0.0], [2.0]), ([0.0], [math.nan])])
def test_an_unusable_start_is_refused(state):
    with pytest.raises(ConfigurationError):
        smoother().reset(*state)


def test_there_is_no_step_without_a_start():
    with pytest.raises(ConfigurationError, match="reset"):
        smoother().step([0.0])


def test_ruckig_is_loaded_only_where_it_is_used():
    code = "import sys, rehab_opt, rehab_opt.control.smoothing; sys.exit('ruckig' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
