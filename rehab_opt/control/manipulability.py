"""Largest manipulability w_max of a chain, which scales a floor, and directions out of singular postures."""

from __future__ import annotations

import math
from functools import reduce

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.chain import SerialChain

__all__ = [
    "DISTANCES",
    "DRAWN",
    "ascent_function",
    "drawn_ways",
    "escape_function",
    "known_ways",
    "maximise_manipulability",
]

Array = NDArray[np.float64]

STARTS, LOOKED_AT = 6, 600
SHARES = (0.002, 0.006, 0.02, 0.06, 0.2, 0.5)
"""Fractions of a direction at which w must have grown; near a doubly singular posture it may fall first."""
DISTANCES, DRAWN, GAIN = (0.05, 0.1, 0.2, 0.4, 0.8), 16, 1e-9
"""[rad or m] Distances that are tried, random directions per joint, and least gain of w."""
TOGETHER = 10
"""Directions per group that C evaluates in sequence."""
SEEDS = 0, 201
"""Seeds of the random directions, at first and for another direction."""
ALL_BITS = 2**64 - 1
TURN, SLIDE = math.pi, 1.0
"""[rad, m] Range of a joint without limits: one turn, and 1 m either way."""


def maximise_manipulability(chain: SerialChain, *, starts: int = STARTS, seed: int = 0) -> tuple[float, Array]:
    """Maximum of Yoshikawa's measure within the joint limits, and a posture (n,) that has it.

    It is the best of bounded quasi-Newton ascents from the `starts` best of seeded random postures, so every run gives
    the same answer. It is a lower bound of the true maximum; for the UR5 it equals the closed form to 1e-9.

    Raises
    ------
    ConfigurationError : the chain is singular at every sampled posture.
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


def escape_function(chain: SerialChain) -> ca.Function:
    """Function: posture q (n,), whether to search another one -> direction in which w grows despite a zero gradient.

    The direction has length 1/2, or zero if none is found. Candidates are the joint axes, their pairs and a few random
    directions (another search has another seed), with both signs. The best is taken at the smallest distance at which
    one gains without a loss before. It is the same in every run and in C.
    """
    n, ascent = chain.n, ascent_function(chain)
    at, far, known = inputs = [ca.MX.sym(name, size) for name, size in (("q", n), ("far", 1), ("found", n + 1))]

    def best(ways: Array) -> ca.Function:
        found = known
        for some in np.split(ways, range(TOGETHER, len(ways), TOGETHER)):  # all at once would take more memory
            columns = ca.MX.sym("ways", n, len(some))
            better = reduce(lambda so_far, way: ascent(at, way, far, so_far), ca.horzsplit(columns), known)
            together = ca.Function(f"best_of_{len(some)}", [*inputs, columns], [better])
            found = together(at, far, found, ca.DM(some.T))
        return ca.Function("best", inputs, [found])

    first, other = (best(np.vstack([known_ways(n), drawn_ways(DRAWN * n, n, seed=seed)])) for seed in SEEDS)
    looked = ca.Function.if_else("looked", other, first)
    q, again, found = ca.MX.sym("q", n), ca.MX.sym("again"), ca.MX.zeros(n + 1)
    columns = looked.mx_in()
    looks, same = ca.Function("looks", columns, looked.call(columns)), ca.Function("same", columns, [columns[3]])
    either = ca.Function.if_else("either", same, looks)
    for distance in DISTANCES:
        found = either(found[0] > 0, again, q, distance, found)
    return ca.Function("escape", [q, again], [found[1:]])


def known_ways(n: int) -> Array:
    """(n^2, n) the joint axes and their pairs, with both signs."""
    axes = np.eye(n)
    pairs = [axes[i] + sign * axes[j] for i in range(n) for j in range(i) for sign in (1.0, -1.0)]
    return np.array([*axes, *pairs])


def ascent_function(chain: SerialChain) -> ca.Function:
    """Function: posture q, direction (n,), distance [rad or m], best so far -> best including +-direction.

    The best consists of its gain of w and its direction of length 1/2. A direction counts if it gains more than the
    best so far and w never falls along it.
    """
    n = chain.n
    symbol = ca.SX.sym("q", n)
    w = ca.Function("manipulability", [symbol], [chain.manipulability_expression(symbol)], {"cse": True})
    q, way, distance, found = (
        ca.MX.sym(name, size) for name, size in (("q", n), ("way", n), ("far", 1), ("found", n + 1))
    )
    lower, upper = ca.fmin(q, ca.DM(chain.lower)), ca.fmax(q, ca.DM(chain.upper))

    def ahead(far: ca.MX) -> ca.MX:
        return w(ca.fmin(ca.fmax(q + far * way, lower), upper))

    last = ahead(distance)
    gain, rises, before = last - w(q), ca.MX(1), w(q)
    for fraction in SHARES:
        there = ahead(fraction * distance)
        rises, before = ca.logic_and(rises, before <= there), there
    better = ca.vertcat(gain, 0.5 * distance / ca.fabs(distance) * way)
    inputs = [q, way, distance, found]
    looked = ca.Function("looked", inputs, [ca.if_else(ca.logic_and(rises, before <= last), better, found)])
    same = ca.Function("same", inputs, [found])
    either = ca.Function.if_else("either", looked, same)
    one = ca.Function("one", inputs, [either(gain > found[0] + GAIN, *inputs)])
    unit = way / ca.norm_2(way)
    return ca.Function("ascent", inputs, [one(q, unit, -distance, one(q, unit, distance, found))])


def drawn_ways(count: int, n: int, *, seed: int) -> Array:
    """(count, n) uniform random numbers from -1 to 1, by SplitMix64."""
    state, numbers = seed & ALL_BITS, np.empty(count * n)
    for i in range(count * n):
        state = (state + 0x9E3779B97F4A7C15) & ALL_BITS
        mixed = ((state ^ (state >> 30)) * 0xBF58476D1CE4E5B9) & ALL_BITS
        mixed = ((mixed ^ (mixed >> 27)) * 0x94D049BB133111EB) & ALL_BITS
        numbers[i] = ((mixed ^ (mixed >> 31)) >> 11) * 2.0**-52 - 1.0
    return numbers.reshape(count, n)
