"""The largest manipulability of a chain: what a floor is a share of."""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.chain import SerialChain

__all__ = ["drawn_ways", "largest_manipulability", "way_out"]

Array = NDArray[np.float64]

STARTS, LOOKED_AT = 6, 600
SHARES = (0.002, 0.006, 0.02, 0.06, 0.2, 0.5)
"""Of a way out, where w must have grown: next to a posture singular twice it may fall first."""
DISTANCES, DRAWN, GAIN = (0.05, 0.1, 0.2, 0.4, 0.8), 16, 1e-9
"""[rad or m] How far ways are tried, how many are drawn a joint, and what counts as a gain of w."""
ALL_BITS = 2**64 - 1
TURN, SLIDE = math.pi, 1.0
"""[rad, m] Where a joint without limits is looked at: a full turn, and a metre either way."""


def largest_manipulability(chain: SerialChain, *, starts: int = STARTS, seed: int = 0) -> tuple[float, Array]:
    """Yoshikawa's measure at its maximum within the joint limits, and a posture (n,) that has it.

    The best of bounded quasi-Newton ascents from the `starts` best of seeded random postures: the same answer in every
    run. It is a lower bound of the true maximum; of the UR5 it is the closed form's to 1e-9.

    Raises
    ------
    ConfigurationError : the chain is singular wherever it was looked at.
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


def way_out(chain: SerialChain, q: Array, *, turn: int = 0) -> Array:
    """(n,) direction, of length 1/2, in which w grows from a posture where its gradient shows none.

    The best of the joint axes, their pairs and a few directions drawn by a seed, either way, at the smallest distance
    at which any of them gains without losing before: the same in every run, and in C. `turn` is the seed.
    """
    n = chain.n
    axes = np.eye(n)
    pairs = [axes[i] + sign * axes[j] for i in range(n) for j in range(i) for sign in (1.0, -1.0)]
    ways = [_of_length_one(way) for way in (*axes, *pairs, *drawn_ways(DRAWN * n, n, seed=turn))]
    lower, upper = np.minimum(chain.lower, q), np.maximum(chain.upper, q)

    def ahead(way: Array, distance: float) -> float:
        return chain.manipulability(np.clip(q + distance * way, lower, upper))

    here = chain.manipulability(q)
    best, direction = here, np.zeros(n)
    for distance in DISTANCES:
        for way in ways:
            for signed in (distance, -distance):
                w = ahead(way, signed)
                if not w > best + GAIN:
                    continue
                before = [ahead(way, share * signed) for share in SHARES]
                if all(a <= b for a, b in itertools.pairwise((here, *before, w))):
                    best, direction = w, math.copysign(1.0, signed) * way
        if direction.any():
            break
    return np.asarray(0.5 * direction)


def drawn_ways(count: int, n: int, *, seed: int) -> Array:
    """(count, n) numbers evenly from -1 to 1: SplitMix64, which C draws as well."""
    state, numbers = seed & ALL_BITS, np.empty(count * n)
    for i in range(count * n):
        state = (state + 0x9E3779B97F4A7C15) & ALL_BITS
        mixed = ((state ^ (state >> 30)) * 0xBF58476D1CE4E5B9) & ALL_BITS
        mixed = ((mixed ^ (mixed >> 27)) * 0x94D049BB133111EB) & ALL_BITS
        numbers[i] = ((mixed ^ (mixed >> 31)) >> 11) * 2.0**-52 - 1.0
    return numbers.reshape(count, n)


def _of_length_one(way: Array) -> Array:
    squares = 0.0
    for each in way.tolist():
        squares += each * each
    return np.asarray(way / math.sqrt(squares))
