"""A user's own limits on a posture are kept in every tick, judged by kinematics in plain numpy."""

import math
from functools import partial
from typing import Any

import casadi as ca
import numpy as np
import pytest

from rehab_opt import Limit, PoseTracker, Relaxed, SerialChain, Status, ur5
from rehab_opt.control.limit import all_limits
from tests.judge.references import minimum_jerk
from tests.judge.ur5_numbers import frames, tool
from tests.refusals import refuses

START = np.array([0.3, -1.4, 1.9, -1.9, -1.2, 0.4])
TABLE = 0.45
"""[m] that the elbow stays above."""


def elbow_above(height: float, **options: Any) -> Limit:
    """The elbow stays above a table."""

    def distance(chain: SerialChain, q: ca.SX) -> ca.SX:
        return chain.frames_expression(q)[2][2, 3] - height

    return Limit(distance, **options)


def elbow(q: np.ndarray) -> np.ndarray:
    return frames(np.atleast_2d(q))[:, 2, 2, 3]


def led(
    control: PoseTracker, goal: np.ndarray, *, ticks: int, released: int = 10**9, faults: float = 0.0, seed: int = 0
) -> tuple[np.ndarray, np.ndarray, list[Any]]:
    """Postures, velocities and commands while the tool is led to the pose of a posture."""
    rng, q, dt = np.random.default_rng(seed), START.copy(), control.dt
    ends = tool(np.stack([START, goal]))
    part = minimum_jerk(ticks)
    postures, velocities, commands = [q], [np.zeros(6)], []
    for k in range(ticks):
        pose = ends[1].copy()
        pose[:3, 3] = ends[0, :3, 3] + part[k] * (ends[1, :3, 3] - ends[0, :3, 3])
        told = q * np.nan if rng.random() < faults else q
        commands.append(control.step(told, pose, np.zeros(6), enable=k < released))
        q = q + dt * commands[-1].value
        postures.append(q)
        velocities.append(commands[-1].value)
    return np.array(postures), np.array(velocities), commands


def goals(seed: int, count: int) -> list[np.ndarray]:
    """Postures whose elbow is below the table."""
    rng, found = np.random.default_rng(seed), []
    while len(found) < count:
        q = START + rng.uniform(-1.2, 1.2, 6)
        if elbow(q)[0] < TABLE - 0.1:
            found.append(q)
    return found


@pytest.mark.parametrize(("dt", "acceleration"), [(0.02, 2.0), (0.004, 30.0)])
def test_elbow_stays_above_the_table_and_gets_there(dt: float, acceleration: float) -> None:
    robot = ur5(acceleration=np.full(6, acceleration), velocity=np.full(6, 2.0))
    plain = PoseTracker(robot, dt=dt, compile=False, linear_speed=1.0)
    control = PoseTracker(robot, dt=dt, compile=False, linear_speed=1.0, limits=[elbow_above(TABLE)])
    reached = beyond = 0
    for goal in goals(int(1e6 * dt + acceleration), 3):
        for each in (plain, control):
            each.reset()
        postures, velocities, commands = led(control, goal, ticks=round(6.0 / dt))
        heights = elbow(postures)
        assert heights.min() >= TABLE - 1e-9
        assert np.abs(np.diff(velocities, axis=0)).max() <= acceleration * dt * (1 + 1e-6)
        assert all(each.status.certified for each in commands)
        reached += heights.min() < TABLE + 0.03
        beyond += elbow(led(plain, goal, ticks=round(4.0 / dt))[0]).min() < TABLE - 0.01
    assert beyond >= 2  # without the limit the same motions do lead below
    assert reached >= 2


def test_distance_that_falls_fast_keeps_its_rate_behind_three_that_are_less() -> None:
    """An arm on a chair was stopped 0.19 of its command across where a fourth side of a box became one of three."""
    rate, room = 0.8, 0.6

    def distances(_: SerialChain, q: ca.SX) -> ca.SX:
        return ca.vertcat(START[0] + room - q[0], q[1:4] + 0.1 - START[1:4])

    control = PoseTracker(ur5(), dt=0.005, compile=False, limits=[Limit(distances, rate=rate)])
    postures, velocities, _ = led(control, START + np.array([0.4, 0, 0, 0, 0, 0]), ticks=200)
    left = START[0] + room - postures[:-1, 0]
    assert velocities.max() > 0.4
    assert (velocities[1:, 0] - rate * left).max() < 1e-3


def test_arm_that_starts_beyond_a_limit_goes_no_further() -> None:
    control = PoseTracker(ur5(), dt=0.005, compile=False, limits=[elbow_above(0.6)])
    assert elbow(START)[0] < 0.6
    for goal in goals(1, 3):
        control.reset()
        braking = control.step(START, tool(goal[None])[0], np.zeros(6), enable=False)
        assert braking.relaxed & Relaxed.POSITION
        path, _, commands = led(control, goal, ticks=400)
        heights = elbow(path)
        assert np.all(np.diff(heights) >= -1e-9)
        told = np.array([bool(each.relaxed & Relaxed.POSITION) for each in commands])
        np.testing.assert_array_equal(told, heights[: len(told)] < 0.6 - 1e-9)


def test_acceleration_yields_to_a_limit_that_came_too_late_and_says_so() -> None:
    robot = ur5(acceleration=np.full(6, 1.0), velocity=np.full(6, 2.0))
    control = PoseTracker(robot, dt=0.005, compile=False, limits=[elbow_above(float(elbow(START)[0]) - 0.005)])
    down = np.array([0.0, 1.5, 0.0, 0.0, 0.0, 0.0])
    assert elbow(START + 0.1 * down)[0] < elbow(START)[0] - 0.005
    control.reset(down)
    command = control.step(START, tool(START[None])[0], np.zeros(6))
    q, hurried = START + 0.005 * command.value, bool(command.relaxed & Relaxed.ACCELERATION)
    for _ in range(50):
        command = control.step(q, tool(START[None])[0], np.zeros(6))
        hurried |= bool(command.relaxed & Relaxed.ACCELERATION)
        q = q + 0.005 * command.value
        assert elbow(q)[0] >= elbow(START)[0] - 0.005 - 1e-9
    assert hurried


@pytest.mark.parametrize(("kind", "compile_"), [("slope", False), ("distance", None), ("root", False)])
def test_a_limit_that_is_no_number_stops_and_does_not_raise(kind: str, compile_: bool | None) -> None:
    """In CasADi's virtual machine it ended in a RuntimeError: "Ill-posed problem"."""
    robot = ur5(velocity=1.0)
    here = robot.pose(START)[:3, 3]

    def distance(chain: Any, q: ca.SX) -> ca.SX:
        off = chain.pose_expression(q)[:3, 3] - ca.DM(here)
        away, below = ca.norm_2(off), off[2] - 1e-9
        return {"slope": 1e-6 - away, "distance": 0.3 + ca.log(below), "root": ca.sqrt(below)}[kind]

    control = PoseTracker(robot, dt=0.002, limits=[Limit(distance)], compile=compile_)
    target = robot.pose(START)
    target[2, 3] -= 0.2
    for _ in range(3):
        command = control.step(START, target, np.zeros(6))
        assert command.status in {Status.HOLDING, Status.BLOCKED}
        assert not command.value.any()
        assert command.reason


def test_each_distance_has_a_row_on_the_way_at_every_place_however_near_another_is() -> None:
    """One distance had all three, of three places; a second one's row came and went with them, and an arm trembled.

    Later each had one, of the place where least was left: an arm trembled as that changed, and braked too late.
    """
    limits = all_limits([Limit(lambda chain, q: ca.vertcat(0.1, 0.2, 0.3) + q[:3])], ur5(), 0.01, 1.0)
    none = ca.SX.zeros(0, 7)
    rows, _ = limits.on_the_way(
        ca.SX.zeros(6), ca.SX.zeros(6), bodies=none, way=lambda q, u, t: q + t * u, seconds=(0.25, 0.5, 0.75, 1.0),
        change=ca.DM.zeros(6),
    )  # fmt: skip
    np.testing.assert_array_equal(np.array(ca.DM(rows)) != 0, np.tile(np.eye(3, 6) > 0, (4, 1)))


def test_a_distance_that_dips_between_two_places_of_the_way_is_what_it_is_there() -> None:
    limits = all_limits([Limit(lambda chain, q: (q[0] - 0.375) ** 2)], ur5(), 0.01, 1.0)
    last = ca.SX([1, 0, 0, 0, 0, 0])
    rows, most = limits.on_the_way(
        ca.SX.zeros(6), last, bodies=ca.SX.zeros(0, 7), way=lambda q, u, t: q + t * u, seconds=(0.25, 0.5, 0.75, 1.0),
        change=ca.DM.zeros(6),
    )  # fmt: skip
    left = np.array(ca.DM(most - rows @ last)).ravel()
    assert left[0] == pytest.approx(0.0, abs=1e-12)  # 0.125^2 there, and nothing half-way to the next


def test_limit_that_is_none_is_refused_by_name() -> None:
    wrong: list[tuple[Any, ...]] = [
        (Limit(lambda chain, q: q[0], rate=0.0), "rate"), (Limit(lambda chain, q: q[0], rate=math.nan), "rate"),
        (Limit(lambda chain, q: ca.SX(1.0)), "distances"), (Limit(lambda chain, q: q[9]), "distances"),
        (Limit(lambda chain, q: q[0] - ca.SX.sym("height")), "distances"),
        (Limit(lambda chain, q: q.height), "distances"),  # type: ignore[attr-defined]
        (Limit(lambda chain, q: q[0] > 0.3), "distances", "not the comparison"),
        (Limit(lambda chain, q: ca.vertcat(q[0], q[1] > 0.3)), "distances", "not the comparison"),
        (Limit(lambda chain, q: "above"), "distances"),  # type: ignore[arg-type,return-value]
    ]  # fmt: skip
    make = partial(PoseTracker, ur5(), compile=False)
    refuses(make, *(({"limits": [limit]}, f"limits[0].{name}", *words) for limit, name, *words in wrong))
    refuses(make, ({"limits": elbow_above(0.1)}, "limits"), ({"limits": [lambda chain, q: q[0]]}, "limits"))
