"""The bound on how a tool's speed changes within a tick, against differences of its pose, for chains of any kind."""

import casadi as ca
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from rehab_opt import DH, SerialChain
from rehab_opt.control.tool_speed import tool_jerk


def random_chain(rng: np.random.Generator) -> SerialChain:
    n = int(rng.integers(1, 8))
    lengths = rng.normal(size=(n, 4)) * [0.4, 2.0, 0.3, 2.0]
    rows = [DH(*row, prismatic=bool(rng.random() < 0.3)) for row in lengths.tolist()]
    tool = np.eye(4)
    tool[:3, 3] = rng.normal(size=3) * rng.choice([0.0, 0.2])
    return SerialChain(rows, lower=-3.0, upper=3.0, velocity=3.0, acceleration=9.0, tool=tool)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), dt=st.sampled_from([1e-3, 5e-3, 2e-2, 1e-1]))
def test_jerk_and_largest_speed_of_a_tool_in_a_tick(seed: int, dt: float) -> None:
    rng = np.random.default_rng(seed)
    chain = random_chain(rng)
    q, v = rng.uniform(-2, 2, chain.n), rng.uniform(-3, 3, chain.n)
    x, u = ca.SX.sym("x", chain.n), ca.SX.sym("u", chain.n)
    jerk = np.array(ca.Function("f", [x, u], [tool_jerk(chain, x, u, dt)])(q, v)).ravel()

    def place(t: float) -> np.ndarray:
        return chain.pose(q + t * v)[:3, 3]

    h = 1e-3
    thirds, speeds = [], []
    for t in np.linspace(0, dt, 11):
        thirds.append((place(t + 2 * h) - 2 * place(t + h) + 2 * place(t - h) - place(t - 2 * h)) / (2 * h**3))
        speeds.append((place(t + h) - place(t - h)) / (2 * h))
    assert np.linalg.norm(thirds, axis=1).max() <= jerk[0] * (1 + 1e-2) + 1e-3
    norms = np.linalg.norm(speeds, axis=1)
    # What a plan's passage goes by: the ends of the tick, and an eighth of the jerk for the way.
    assert norms.max() <= max(norms[0], norms[-1]) + dt**2 / 8 * jerk[0] + 1e-5


def test_the_jerk_of_what_slides_along_what_turns() -> None:
    """At the axis it is 3 O^2 v: nothing of it is lost, and hardly anything added."""
    chain = SerialChain(
        [DH(0.0, np.pi / 2), DH(0.0, 0.0, prismatic=True)], lower=-3.0, upper=3.0, velocity=3.0, acceleration=9.0
    )
    jerk = float(tool_jerk(chain, ca.SX([0.3, 0.0]), ca.SX([2.0, 1.0]), 1e-3))
    assert 12.0 <= jerk <= 12.01
