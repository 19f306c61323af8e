"""Times of many solves in a few numbers. A solve that failed took infinitely long."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import gmean

__all__ = ["SHIFT", "percentile", "performance_profile", "shifted_geometric_mean", "tail"]

Array = NDArray[np.float64]

SHIFT = 10e-6
"""[s] Shift of the geometric mean: what is quicker than this hardly counts as quicker, a tick costs as much anyway."""


def percentile(seconds: ArrayLike, fraction: float) -> float:
    """The smallest time that at least `fraction` (0 to 1) of the solves kept to; infinite where too many failed."""
    times = np.asarray(seconds, dtype=np.float64)
    return float(np.quantile(times, fraction, method="inverted_cdf")) if times.size else float("nan")


def tail(seconds: ArrayLike, fraction: float) -> float:
    """`percentile` of so many solves that one of them may lie beyond it; NaN for fewer: it would be the largest."""
    few = np.size(seconds) * (1.0 - fraction) < 1.0 - 1e-9
    return float("nan") if few else percentile(seconds, fraction)


def shifted_geometric_mean(seconds: ArrayLike, *, limit: float, shift: float = SHIFT) -> float:
    """exp(mean(log(t + shift))) - shift [s]; a failure counts as `limit`, NaN for no solves."""
    times = np.minimum(np.asarray(seconds, dtype=np.float64), limit)
    return float(gmean(times + shift)) - shift if times.size else float("nan")


def performance_profile(seconds: Mapping[str, ArrayLike]) -> dict[str, tuple[Array, Array]]:
    """Dolan and More's profile of each solver: factors, and the share of instances it solves within that factor.

    Parameters
    ----------
    seconds : (N,) of each solver on the same instances, infinite where it failed. Instances that all failed count.

    Returns
    -------
    Of each solver the sorted factors beside the fastest solver (finite ones only) and the share up to each.
    """
    times = {name: np.asarray(each, dtype=np.float64) for name, each in seconds.items()}
    fastest = np.min(np.stack(list(times.values())), axis=0)
    profiles = {}
    for name, each in times.items():
        solved = np.isfinite(each)
        factors = np.sort(each[solved] / fastest[solved])
        profiles[name] = (factors, np.arange(1, factors.size + 1) / max(each.size, 1))
    return profiles
