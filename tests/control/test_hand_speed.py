"""Hand speed on the way to rest, beside velocities and Jacobians of the bench at 161 places of it."""

import casadi as ca
import numpy as np
import pytest

from bench.physics.geometry import jacobians
from rehab_opt import DH, SerialChain, ur5
from rehab_opt.control.limits_ahead import HandSpeed, State, Way
from rehab_opt.control.manoeuvre import Manoeuvre, further
from rehab_opt.symbolic.tick import Stages

DT = 0.01
TWISTS = np.array([0, -1, 1, -1, 1, -1, 0]) * np.pi / 2
SEVEN = SerialChain(
    tuple(DH(0, twist, d, 0) for twist, d in zip(TWISTS, (0.36, 0, 0.42, 0, 0.4, 0, 0.126), strict=True)),
    lower=-2.9, upper=2.9, velocity=2.0, acceleration=3.0,
)  # fmt: skip


@pytest.mark.parametrize("linear", [0.1, 0.25])
@pytest.mark.parametrize("chain", [SEVEN, ur5(acceleration=1.5), ur5(acceleration=0.5)], ids=["seven", "ur5", "slow"])
def test_hand_speed_is_within_two_percent_on_long_ways_to_rest(chain, linear):
    angular, rng, part = 4 * linear, np.random.default_rng(4711), np.linspace(0, 1, 161)
    manoeuvre = Manoeuvre(chain, DT, recovery_speed=0.1)
    q, u = ca.SX.sym("q", chain.n), ca.SX.sym("u", chain.n)
    tick, way = Stages(), Way(State(q, u, chain.jacobian_expression(q), ca.SX(0, 1)), u, further(manoeuvre.ticks(u)))
    excess = HandSpeed(chain, manoeuvre, linear=linear, angular=angular).excess(tick, way)
    checked, worst = tick.function("checked", [q, u], [ca.mmax(excess), way.ticks]), 0.0
    for _ in range(40):
        here = rng.uniform(-2.8, 2.8, chain.n)
        slowest = np.linalg.svd(jacobians(chain, here[None])[0])[2]  # in its last rows: later the hand is faster
        velocity = rng.standard_normal(chain.n) * 10.0 ** np.linspace(-3, 0, chain.n) @ slowest
        velocity *= chain.velocity.min() / np.abs(velocity).max()
        low, high = 0.0, 1.0
        for _ in range(25):
            low, high = (m, high) if float(checked(here, (m := (low + high) / 2) * velocity)[0]) <= 0 else (low, m)
        velocity *= low
        ticks = float(checked(here, velocity)[1])
        there = here + DT * (1 + ticks * part)[:, None] * velocity
        if np.all((there > chain.lower) & (there < chain.upper)):
            twists = np.sqrt(1 - part)[:, None] * (jacobians(chain, there) @ velocity)
            worst = max(worst, *np.linalg.norm(twists[:, :3], axis=1) / linear)
            worst = max(worst, *np.linalg.norm(twists[:, 3:], axis=1) / angular)
    assert 0.99 <= worst <= 1.02
