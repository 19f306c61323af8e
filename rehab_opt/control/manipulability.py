"""Largest manipulability w_max of a chain; a manipulability floor is a fraction of it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.chain import SerialChain

__all__ = ["maximise_manipulability"]

Array = NDArray[np.float64]

STARTS, LOOKED_AT = 6, 600
TURN, SLIDE = math.pi, 1.0
"""[rad, m] A joint without limits is searched this far to either side of zero."""


def maximise_manipulability(chain: SerialChain, *, starts: int = STARTS, seed: int = 0) -> tuple[float, Array]:
    """Maximum of Yoshikawa's measure within the joint limits, and a posture (n,) at which it occurs.

    The result is the best of several quasi-Newton ascents from seeded random postures, so it is a lower bound of the
    true maximum. A chain that is singular at every sampled posture raises `ConfigurationError`.
    """
    from scipy.optimize import minimize  # noqa: PLC0415  (loaded when used)

    far = np.array([SLIDE if row.prismatic else TURN for row in chain.rows])
    below = np.where(np.isfinite(chain.upper), chain.upper - 2 * far, -far)
    lower = np.where(np.isfinite(chain.lower), chain.lower, below)
    upper = np.where(np.isfinite(chain.upper), chain.upper, lower + 2 * far)
    rng = np.random.default_rng(seed)
    postures = sorted(rng.uniform(lower, upper, (LOOKED_AT, chain.n)), key=lambda q: -chain.manipulability(q))[:starts]
    best, where = 0.0, postures[0]
    for posture in postures:
        found = minimize(
            lambda q: (-chain.manipulability(q), -chain.manipulability_gradient(q)),
            posture,
            jac=True,
            method="L-BFGS-B",
            bounds=list(zip(lower, upper, strict=True)),
            options={"ftol": 1e-13, "gtol": 1e-9, "maxiter": 200},
        )
        value = chain.manipulability(found.x)
        if value > best:
            best, where = value, np.asarray(found.x, dtype=np.float64)
    if not best > 1e-9:
        raise ConfigurationError("chain", chain.names, "a chain that is not singular in every posture")
    return best, where
