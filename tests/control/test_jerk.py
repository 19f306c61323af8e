"""Jerk as a bound of `PoseTracker`: judged by finite differences of what was sent, as a drive does."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray

from rehab_opt import (
    DH,
    ConfigurationError,
    KeepOut,
    MirrorTracker,
    PoseTracker,
    SerialChain,
    ur5,
)
from rehab_opt.control.jerk_bounds import JerkBounds
from rehab_opt.symbolic import BufferedFunction
from tests.control.test_limit import TABLE, elbow_above
from tests.export.conftest import built, c_compiler  # noqa: F401  (fixtures)

Array = NDArray[np.float64]

PANDA = Path(__file__).parents[2] / "problems/robots/franka_panda/panda.urdf"
ROUNDING = 1e-9
"""Of a bound, and [rad] of a position."""


def panda() -> SerialChain:
    return SerialChain.from_urdf(PANDA, tip="panda_link8", acceleration=10.0)


def excess(chain: SerialChain, jerk: Array, dt: float, start: Array, sent: Array) -> dict[str, float]:
    """By how much velocities (N, n), from rest, break each bound, as a share of it; of positions [rad]."""
    still = np.zeros((2, chain.n))
    changes = np.diff(np.vstack([still, sent]), axis=0) / dt
    places = start + dt * np.cumsum(sent, axis=0)
    return {
        "velocity": float((np.abs(sent) / chain.velocity).max() - 1),
        "acceleration": float((np.abs(changes) / chain.acceleration).max() - 1),
        "jerk": float((np.abs(np.diff(changes, axis=0)) / dt / jerk).max() - 1),
        "position": float(np.maximum(places - chain.upper, chain.lower - places).max()),
    }


@pytest.mark.parametrize("pushed", [False, True])
def test_whoever_chooses_in_the_interval_keeps_every_bound(pushed: bool) -> None:
    """The hardest choices: an end for a while, the ends in turn, any, and the way to rest; ranges of 0.1 to 4 rad.

    A joint that is pushed, beyond its limits too, while it goes on, keeps all but those.
    """
    rng, n = np.random.default_rng(3), 12
    rows = [DH(0.1, 0.0)] * n
    for dt in (1e-2,):
        half, jerk = rng.choice([0.05, 0.3, 2.0], n), rng.choice([60.0, 300.0, 2000.0], n)
        limits = {"velocity": rng.uniform(0.3, 3.0, n), "acceleration": rng.uniform(1.0, 20.0, n)}
        chain = SerialChain(rows, lower=-half, upper=half, **limits)
        q, last, change = (ca.SX.sym(name, n) for name in ("q", "last", "change"))
        bounds = JerkBounds.checked(chain, jerk, dt, 0.1).interval(q, last, change)
        interval = BufferedFunction(
            ca.Function("interval", [q, last, change], [bounds.lower, bounds.upper, bounds.brake_lower])
        )
        state, sent = [np.zeros(n)] * 3, []
        for k in range(3000):
            if k % 250 == 0:
                kind = rng.integers(5, size=n)
            if pushed and (fast := np.abs(state[1]) > 0.9 * chain.velocity).any():
                again = fast & (rng.random(n) < 0.02)
                beyond = np.sign(state[1]) * (half + rng.uniform(0, 0.3, n))
                state[0], kind = np.where(again, beyond, state[0]), np.where(again, rng.integers(5, size=n), kind)
            for array, values in zip(interval.inputs, state, strict=True):
                array[:] = values
            interval()
            lower, upper, rest = interval.outputs
            assert np.all(lower <= upper)
            turn = np.where(rng.random(n) < 0.5, lower, upper)
            u = np.choose(kind, [lower, upper, rng.uniform(lower, upper), turn, rest])
            state = [state[0] + dt * u, u, (u - state[1]) / dt]
            sent.append(u)
        broken = excess(chain, jerk, dt, np.zeros(n), np.array(sent))
        kept = broken.keys() - {"position"} if pushed else broken
        assert all(broken[name] <= ROUNDING for name in kept), (dt, broken)
        places = dt * np.cumsum(sent, axis=0)
        assert pushed or np.all(np.abs(places).max(axis=0)[half < 1.0] > half[half < 1.0] - 1e-3)  # the limits are met


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_braking_joints_come_to_rest_as_soon_as_the_jerk_lets_them(sign: float) -> None:
    """By the ramp down, the acceleration and the ramp up again of the closed form; none turns round."""
    v, a, jerk, dt = np.array([0.05, 0.5, 2.0]), 5.0, 60.0, 1e-3
    chain = SerialChain([DH(0.1, 0.0)] * 3, lower=-9.0, upper=9.0, velocity=3.0, acceleration=a)
    q, last, change = (ca.SX.sym(name, 3) for name in ("q", "last", "change"))
    found = JerkBounds.checked(chain, jerk, dt, 0.1).interval(q, last, change)
    rest = ca.Function("rest", [q, last, change], [found.brake_lower])
    seconds = np.where(v * jerk < a * a, 2 * np.sqrt(v / jerk), v / a + a / jerk)
    state, sent = [np.zeros(3), sign * v, np.zeros(3)], []
    for _ in range(round(seconds.max() / dt) + 5):
        u = np.array(rest(*state)).ravel()
        state = [state[0] + dt * u, u, (u - state[1]) / dt]
        sent.append(u)
    assert np.min(sign * np.array(sent)) >= -1e-9
    moving = np.sum(np.abs(sent) > 1e-9, axis=0)
    np.testing.assert_allclose(moving * dt, seconds, rtol=0, atol=3 * dt)


@pytest.mark.parametrize(("jerk", "gain"), [(500.0, 10.0)])
def test_a_pose_is_reached_and_kept_without_swinging(jerk: float, gain: float) -> None:
    chain = panda()
    q = np.array([0.0, -0.6, 0.0, -2.2, 0.0, 1.6, 0.8])
    target = chain.pose(q + 0.1)
    tracker = PoseTracker(
        chain, dt=1e-3, jerk=jerk, gain=gain, linear_speed=0.25, posture=q + 0.1, compile=False
    )  # no self-motion to another
    sent = []
    for _ in range(3000):
        command = tracker.step(q, target, np.zeros(6))
        sent.append(command.value)
        q = q + 1e-3 * command.value
    away = chain.pose(q) - target
    assert np.abs(away).max() < 1e-6
    turns = np.sum(np.diff(np.sign(np.array(sent)[np.abs(sent).max(axis=1) > 1e-4]), axis=0) != 0, axis=0)
    assert turns.max() <= 4


def test_what_comes_before_a_drives_bounds_is_refused_with_it() -> None:
    robot = ur5()
    plane = KeepOut.through([0, 0, -1.0], [0, 0, 1])
    with pytest.raises(ConfigurationError, match=r"jerk = 900.0: expected None with limits"):
        PoseTracker(robot, jerk=900.0, gain=10.0, compile=False, limits=[elbow_above(TABLE)])
    with pytest.raises(ConfigurationError, match=r"jerk = 900.0: expected None with MirrorTracker"):
        MirrorTracker(robot, keep_out=[plane], max_manipulability=0.1, jerk=900.0, compile=False)
    for bad in (0.0, -1.0, np.nan, np.inf, [1.0, 2.0]):
        with pytest.raises(ConfigurationError, match="jerk = "):
            PoseTracker(robot, jerk=bad, compile=False)
    with pytest.raises(ConfigurationError, match=r"gain = 50.0: expected at most 15 /s"):
        PoseTracker(robot, jerk=900.0, compile=False)
