"""How much the repeats of one movement differ.

Darling and Cooke, "Changes in the variability of movement trajectories with practice", J. Mot. Behav. 19(3), 1987.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.measures.samples import vectors

__all__ = ["end_variability", "path_variability"]

Array = NDArray[np.float64]

INSTANTS = 101
"""From 0 to 100 % of a movement."""


def path_variability(trials: Sequence[ArrayLike]) -> float:
    """Root mean square distance [m] of the trials from their mean path, at equal fractions of their time.

    With p_k(u) trial k at the fraction u of its own time, K trials,

        sqrt( mean over u of  sum_k |p_k(u) - mean(u)|^2 / (K - 1) )

    so that trials which differ in speed alone do not differ. Cut rest off before.

    Parameters
    ----------
    trials : K >= 2 of (N_k, d) [m], evenly sampled, N_k >= 2, of any lengths.
    """
    paths = _trials(trials)
    shares = np.linspace(0.0, 1.0, INSTANTS)
    at = np.stack(
        [
            np.column_stack([np.interp(shares, np.linspace(0.0, 1.0, len(path)), column) for column in path.T])
            for path in paths
        ]
    )
    return float(np.sqrt(_spread(at).mean()))


def end_variability(trials: Sequence[ArrayLike]) -> float:
    """Root mean square distance [m] of the trials' last points from their mean: sqrt(sum_k |e_k - mean|^2 / (K - 1)).

    Variable error (its constant partner is `end_error` of the mean end). Parameters, errors: as
    `path_variability`.
    """
    ends = np.stack([path[-1] for path in _trials(trials)])
    return float(np.sqrt(_spread(ends[:, None])[0]))


def _spread(at: Array) -> Array:
    """(T,) [m^2] of K trials (K, T, d): variance over trials, summed over coordinates."""
    return np.asarray(at.var(axis=0, ddof=1).sum(axis=1))


def _trials(trials: Sequence[ArrayLike]) -> list[Array]:
    paths = [vectors(f"trials[{i}]", trial, fewest=2) for i, trial in enumerate(trials)]
    if len(paths) < 2:
        raise ConfigurationError("trials", f"{len(paths)} trials", "two or more")
    for i, path in enumerate(paths):
        if path.shape[1] != paths[0].shape[1]:
            expected = f"{paths[0].shape[1]} coordinates, as the first"
            raise ConfigurationError(f"trials[{i}]", f"{path.shape[1]} coordinates", expected)
    return paths
