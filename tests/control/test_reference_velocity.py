"""The reference velocity is within its rows and nearest to what is asked: by multipliers of the test's own."""

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import nnls

from rehab_opt.control.reference_velocity import ReferenceVelocity
from rehab_opt.control.stopping import FAR
from rehab_opt.symbolic.tick import Stages

N, M = 6, 4


def held() -> ca.Function:
    """J, v, velocity without bounds, stopping speeds, drift, last velocity, R, r -> velocity within both, its twist."""
    sizes = {"v": 6, "free": N, "low": N, "high": N, "drift": N, "last": N}
    twist, free, low, high, drift, last = (ca.SX.sym(name, size) for name, size in sizes.items())
    matrix, rows, upper, tick = ca.SX.sym("J", 6, N), ca.SX.sym("R", M, N), ca.SX.sym("r", M), Stages()
    of = ReferenceVelocity(matrix, twist, drift, None, np.ones(N), np.zeros(N, dtype=bool), rows, upper)  # type: ignore[arg-type]
    inputs = [ca.vec(matrix), twist, free, low, high, drift, last, ca.vec(rows), upper]
    return tick.function("held", inputs, [of.within_rows(tick, free, low, high, last, needed=ca.SX(1))])


HELD = held()


@pytest.mark.parametrize("parallel", [0.0, 0.03, 1.0])
def test_reference_is_the_nearest_one_within_its_rows(parallel: float) -> None:
    rng = np.random.default_rng(int(100 * parallel))
    active = several = 0
    for _ in range(300):
        left, _, right = np.linalg.svd(rng.standard_normal((6, N)))
        matrix, asked = left @ np.diag(rng.uniform(1.0, 1.5, 6)) @ right, 0.05 * rng.standard_normal(6)
        free = np.linalg.solve(matrix, asked)
        rows = rng.standard_normal((M, N))
        rows[3] = rows[2] + parallel * rng.standard_normal(N)
        rows *= np.where(rows @ free < 0, -1.0, 1.0)[:, None]  # all of them are in the way
        most = np.abs(rows @ free) * rng.choice([0.0, 0.5, 2.0], M) - 1e-3 * rng.random(M)
        last = 0.05 * rng.standard_normal(N)
        inputs = matrix.T.ravel(), asked, free, -FAR * np.ones(N), FAR * np.ones(N), np.zeros(N), last
        velocity = np.array(HELD(*inputs, rows.T.ravel(), most)).ravel()[:N]
        assert np.all(rows @ velocity <= most + 1e-8)
        met = rows @ velocity > most - 1e-7
        downhill = matrix.T @ (asked - matrix @ velocity)
        pushed = nnls(rows[met].T, downhill)[1] if met.any() else float(np.linalg.norm(downhill))
        assert pushed < 1e-5
        active, several = active + bool(met.any()), several + bool(met.sum() > 1)
    assert active > 150
    assert several > 50
