import math
import subprocess
import sys

import numpy as np
import pytest
import ruckig
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from rehab_opt.control.axis_motion import AxisStop, axis_bounds
from rehab_opt.control.command import Relaxed, Status
from rehab_opt.control.profiles import Profiles
from rehab_opt.control.smoother import Smoother
from tests.refusals import refuses

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


@pytest.mark.parametrize("seed", range(2))
def test_asked_for_a_farther_place_before_it_is_at_full_speed_an_axis_goes_on_and_loses_no_time(seed):
    rng, dt = np.random.default_rng(seed), 0.005
    for sign in (-1.0, 1.0) * 5:
        v, a = rng.uniform(0.2, 3.0), rng.uniform(1.0, 20.0)
        j = a * rng.uniform(2.0, 30.0)
        ramp = 2 * math.sqrt(v / j) if v * j < a * a else v / a + a / j  # from rest to v
        distance = v * (ramp + rng.uniform(1.0, 2.0))
        seconds = rest_to_rest_seconds(distance, v, a, j)
        s = Smoother(velocity=v, acceleration=a, jerk=j, dt=dt)
        s.reset([0.0])
        first = round((ramp - rng.uniform(0.0, 1.0) * min(a / j, ramp / 2)) / dt)
        run(s, [[0.9 * sign * distance]] * first)
        late = run(s, [[sign * distance]] * (math.ceil(seconds / dt) + 1 - first))
        assert late[-1, 0] == pytest.approx(sign * distance, abs=1e-9)


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


@settings(deadline=None, max_examples=30)
@given(limits=limits, way=st.lists(st.floats(-5.0, 5.0), min_size=3, max_size=3))
def test_a_straight_way_is_kept_from_rest_and_takes_the_time_of_its_slowest_axis(limits, way):
    way = np.array(way)
    longest = np.max(np.abs(way))
    assume(longest > 1e-3)
    s = Smoother(
        velocity=limits[0],
        acceleration=limits[1],
        jerk=limits[2],
        dt=rest_to_rest_seconds(longest, *limits) / 200.0,
        axes=3,
        straight=True,
    )
    s.reset(np.zeros(3))
    positions = run(s, [way] * 202)
    along = positions @ way / (way @ way)
    np.testing.assert_allclose(positions, along[:, None] * way, rtol=0, atol=1e-7 * longest)
    assert along[198] < 1  # not earlier
    assert positions[200] == pytest.approx(way, abs=1e-9 * (1 + longest))


# ------------------------------------------------------------------------------------------ all the bounds


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_target_near_the_bound_that_is_asked_for_anew_in_every_tick_needs_no_stop(sign):
    # Ruckig brakes by a rounding error before it plans on; a piece that it does not use is at 0, outside this range.
    low, high = sorted((0.2 * sign, 1.5 * sign))
    smoother = Smoother(velocity=0.671, acceleration=5.98, jerk=32.45, dt=0.005, lower=low, upper=high, axes=1)
    smoother.reset([1.4 * sign])
    commands = [smoother.step([(0.21 + 1e-6 * k) * sign]) for k in range(600)]
    assert {command.status for command in commands} == {Status.OK}


def test_a_target_outside_the_bounds_is_clipped_and_flagged():
    s = smoother(lower=[-1.0], upper=[0.2])
    s.reset([0.0])
    commands = [s.step([0.5]) for _ in range(2000)]
    assert commands[-1].value[0] == 0.2
    assert commands[-1].status is Status.OK
    assert "clipped" in commands[-1].reason
    assert Relaxed.TASK in commands[-1].relaxed


def test_a_start_too_fast_for_the_bound_brakes_and_says_so():
    s = smoother(lower=-1.0, upper=0.05)
    s.reset([0.0], velocity=[1.0])
    commands = [s.step([0.0]) for _ in range(3000)]
    positions = np.array([command.value for command in commands])
    assert positions.max() > 0.05  # physically unavoidable
    assert commands[0].status is Status.BRAKING
    assert any(Relaxed.POSITION in command.relaxed for command in commands)
    assert_within_bounds(positions, V, A, J, DT)
    assert commands[-1].value[0] == pytest.approx(0.0, abs=1e-12)
    assert commands[-1].status is Status.OK


def test_a_locked_axis_stands():
    s = smoother(lower=[0.2, -1.0], upper=[0.2, 1.0])
    s.reset([0.2, 0.0])
    positions = run(s, np.random.default_rng(0).uniform(-1, 1, (500, 2)))
    assert np.all(positions[:, 0] == 0.2)


@settings(deadline=None, max_examples=60)
@given(limits=limits, fraction=st.floats(-1, 1), ramp=st.floats(-1, 1), far=st.floats(-50.0, 50.0))
def test_the_stop_of_an_axis_is_the_time_optimal_one_and_its_range_is_true(limits, fraction, ramp, far):
    v, a, j = limits
    speed, acceleration = fraction * v, ramp * a
    stop = AxisStop(far, speed, acceleration, most=a, jerk=j)
    question, found = ruckig.InputParameter(1), ruckig.Trajectory(1)
    question.control_interface = ruckig.ControlInterface.Velocity
    question.current_position, question.current_velocity = [far], [speed]
    question.current_acceleration, question.target_velocity = [acceleration], [0.0]
    question.max_velocity, question.max_acceleration, question.max_jerk = [10 * v], [a], [j]
    ruckig.Ruckig(1).calculate(question, found)
    assert stop.seconds == pytest.approx(found.duration, rel=1e-6, abs=1e-9)
    times = np.linspace(0.0, stop.seconds, 401)
    states = np.array([stop.at(t) for t in times])
    np.testing.assert_allclose(
        states[:, 0], [found.at_time(t)[0][0] for t in times], rtol=1e-9, atol=1e-7 * v * stop.seconds + 1e-12
    )
    slack = 1e-12 * (1 + np.abs(states[:, 0]).max())
    assert stop.lowest <= states[:, 0].min() + slack
    assert stop.highest >= states[:, 0].max() - slack
    step = v * stop.seconds / 40 + acceleration**2 / j * stop.seconds
    assert states[:, 0].min() - stop.lowest <= step
    assert np.abs(states[:, 2]).max() <= a * (1 + 1e-9)
    assert stop.at(stop.seconds + 1.0)[1:] == (0.0, 0.0)


@settings(deadline=None, max_examples=120)
@given(limits=limits, fraction=st.floats(-1, 1), ramp=st.floats(-1, 1), room=st.floats(-5.0, 0.0), seed=seeds)
def test_a_plan_is_refused_where_any_instant_of_it_is_outside(limits, fraction, ramp, room, seed):
    """Ruckig's own extrema leave out where an axis turns round at constant acceleration."""
    v, a, j = limits
    rng = np.random.default_rng(seed)
    speed, acceleration = fraction * v, ramp * a
    assume(abs(speed + acceleration * abs(acceleration) / (2 * j)) <= v)
    seconds = v / a + a / j
    start, goal, reach = *rng.uniform(-1, 1, 2) * v * seconds, 2 * v * seconds
    moves = [rng.uniform(-0.9, 0.9) * v] if rng.random() < 0.5 else [0.0]
    dt = 0.01 * seconds
    lower, upper = min(start, goal) - 10**room * reach, max(start, goal) + 10**room * reach
    bounds = axis_bounds(lower=[lower], upper=[upper], velocity=[v], acceleration=[a], jerk=[j])
    with pytest.MonkeyPatch.context() as patch:
        planner, profiles = Planner(patch), Profiles(bounds, dt=dt, recovery_speed=0.1)
    profiles.start([start], [0.0])
    profiles.v, profiles.a = [speed], [acceleration]
    if profiles.move([goal], moves):
        plan, w = planner.newest, moves[0]
        first = goal - w * dt if w else 0.0  # a goal that moves is planned for where it rests
        positions = [first + plan.at_time(t)[0][0] + w * t for t in np.linspace(0.0, plan.duration, 400)]
        assert max(positions) <= upper + 1e-9 * reach
        assert min(positions) >= lower - 1e-9 * reach


# -------------------------------------------------------------------------------- enabling, faults, stamps
@pytest.mark.parametrize(
    ("inputs", "expected"),
    [
        ({"target": [math.nan]}, "target is not"),
        ({"target": [1e300]}, "away"),
        ({"target": [1.0, 2.0]}, "target is not"),
        ({"target": [0.5], "target_velocity": [math.nan]}, "target velocity is not"),
        ({"target": [0.5], "enable": False}, "disabled"),
        ({"target": [0.5], "enable": math.nan}, "disabled"),
        ({"target": [0.5], "enable": np.array([True, True])}, "disabled"),
        ({"target": [0.5], "stamp": 0.0}, "stamp"),
    ],
)
def test_every_fault_brakes_to_rest_within_the_bounds_and_the_motion_goes_on_without_a_jump(inputs, expected):
    s = smoother(dt=DT)
    s.reset([0.0])
    before = [s.step([0.5], stamp=k * DT).value for k in range(1, 301)]
    inputs = {"stamp": 301 * DT, **inputs}
    command = s.step(**inputs)
    assert command.status is Status.BRAKING
    assert expected in command.reason
    assert (command.solver, command.residual, command.scale) == ("", math.inf, 0.0)
    during = [command.value, *(s.step(**inputs).value for _ in range(799))]
    held = s.step(**inputs)
    assert held.status is Status.HOLDING
    assert held.value == during[-1]
    s.step([0.5], stamp=1.2)
    after = [s.step([0.5], stamp=1.2 + k * DT).value for k in range(1, 1100)]
    assert_within_bounds(np.array([[0.0]] * 3 + before + during), V, A, J, DT)
    assert_within_bounds(np.array(during[-5:] + [held.value] * 2 + after), V, A, J, DT)
    assert after[-1] == pytest.approx([0.5], abs=1e-12)


class Planner:
    """Ruckig in smoothers that are made from now on: it refuses, or its profiles are elsewhere, where it is told so."""

    def __init__(self, monkeypatch):
        self.refuses, self.position, self.newest = None, None, None
        told, solver, trajectory = self, ruckig.Ruckig, ruckig.Trajectory

        class Trajectory:
            def __init__(self, axes):
                self.made = trajectory(axes)

            def at_time(self, time):
                if told.position is None:
                    return self.made.at_time(time)
                return [told.position], [told.position * 0.0], [told.position * 0.0]

            def __getattr__(self, name):
                return getattr(self.made, name)

        class Ruckig:
            def __init__(self, axes):
                self.made = solver(axes)

            def calculate(self, question, answer):
                if told.refuses:
                    raise told.refuses
                told.newest = answer
                return self.made.calculate(question, answer.made)

        monkeypatch.setattr(ruckig, "Ruckig", Ruckig)
        monkeypatch.setattr(ruckig, "Trajectory", Trajectory)


def test_a_planner_that_refuses_everything_cannot_keep_the_axes_from_stopping(monkeypatch):
    planner, s = Planner(monkeypatch), smoother()
    s.reset([0.0])
    before = [s.step([0.5]).value for _ in range(200)]
    speed, acceleration = s.velocity[0], s.acceleration[0]
    planner.refuses = ValueError("-101 is not a valid Result")
    commands = [s.step([-0.5]) for _ in range(3000)]
    assert all(command.status in (Status.BRAKING, Status.HOLDING) for command in commands)
    stopped = [command.status for command in commands].index(Status.HOLDING)
    assert stopped * DT <= (speed + acceleration**2 / (2 * J)) / A + 2 * A / J + acceleration / J + 2 * DT
    assert_within_bounds(np.array([[0.0]] * 3 + before + [command.value for command in commands]), V, A, J, DT)


@pytest.mark.parametrize("away", [math.nan, 0.1])
def test_a_profile_that_is_no_number_or_breaks_a_bound_is_replaced_by_the_stop(away, monkeypatch):
    planner, s = Planner(monkeypatch), smoother()
    s.reset([0.0])
    before = [s.step([0.5]).value for _ in range(200)]
    planner.position = s.position[0] + away
    commands = [s.step([0.5]) for _ in range(1000)]
    assert "certificate" in commands[0].reason
    assert commands[0].status is Status.BRAKING
    assert commands[-1].status is Status.HOLDING
    assert_within_bounds(np.array([[0.0]] * 3 + before + [command.value for command in commands]), V, A, J, DT)


# ----------------------------------------------------------------------------------------- moving targets
@given(fraction=st.floats(0.05, 0.9), limits=limits)
@settings(deadline=None, max_examples=8)
def test_the_lag_behind_a_steady_target_is_as_documented_and_zero_with_its_velocity(fraction, limits):
    v, a, j = limits
    speed = fraction * v
    plain = Smoother(velocity=v, acceleration=a, jerk=j)
    lag = plain.lag(speed)[0]
    assert lag == pytest.approx(
        rest_to_rest_seconds(1e9 * v, speed, a, j) / 2 - 1e9 * v / speed / 2, rel=1e-3, abs=1e-6
    )
    dt = (lag + v / a + a / j) / 100
    for velocity, expected in ((None, lag), ([speed], 0.0)):
        s = Smoother(velocity=v, acceleration=a, jerk=j, dt=dt)
        s.reset([0.0])
        ticks = int(1000 / (1 - fraction) ** 0.5)
        positions = run(s, speed * dt * np.arange(1, ticks + 1)[:, None], target_velocity=velocity)
        assert ticks * dt - positions[-1, 0] / speed == pytest.approx(expected, abs=dt)


@pytest.mark.parametrize("fraction", [0.6, 0.9, 0.98])
def test_a_target_that_sets_off_is_caught_up_with_in_the_time_of_the_closed_form(fraction):
    """By speeding up the axis falls behind; at its bound it gains on the target; then it slows down to its speed."""
    speed = fraction * V
    up, down = V / A + A / J, 2 * math.sqrt((V - speed) / J)
    seconds = up + ((speed - V / 2) * up - (V - speed) * down / 2) / (V - speed) + down
    s = Smoother(velocity=V, acceleration=A, jerk=J, dt=0.01)
    s.reset([0.0])
    targets = speed * 0.01 * np.arange(1, 1201)[:, None]
    behind = (targets - run(s, targets, target_velocity=[speed]))[:, 0]
    met = round(seconds / 0.01)
    assert behind[met - 3] > 1e-9  # not earlier
    np.testing.assert_allclose(behind[met + 1 :], 0.0, rtol=0, atol=1e-12)


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


# --------------------------------------------------------------------------------------------- arguments
def test_what_cannot_be_used_is_named():
    settings = [
        ("velocity", 0.0), ("velocity", math.nan), ("velocity", "x"), ("velocity", None),
        ("acceleration", math.inf), ("acceleration", {}), ("jerk", [1.0, -1.0]), ("jerk", [[1.0], [1.0, 2.0]]),
        ("lower", math.nan), ("lower", math.inf), ("lower", "x"), ("upper", 10**400), ("dt", 0.0), ("dt", math.nan),
        ("dt", "x"), ("dt", 1e-300), ("axes", 0), ("axes", "x"), ("axes", 1.5), ("axes", True), ("straight", 1),
        ("recovery_speed", 0.0), ("recovery_speed", "x"), ("recovery_speed", [0.1, 0.1]), ("max_age", 0.0),
        ("max_age", "x"),
    ]  # fmt: skip
    refuses(smoother, *(({name: value}, name) for name, value in settings))
    refuses(smoother, ({"lower": 1.0, "upper": 0.0}, "lower"), ({"axes": 2, "velocity": [1.0] * 3}, "velocity"))
    states = (([math.nan],), ([0.0, 0.0],), ([0.0], [2.0]), ([0.0], [math.nan]))
    refuses(smoother().reset, *((state, "expected") for state in states))
    refuses(smoother().step, (([0.0],), "reset"))


def test_ruckig_is_loaded_only_where_it_is_used():
    code = "import sys, rehab_opt, rehab_opt.control.smoothing; sys.exit('ruckig' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
