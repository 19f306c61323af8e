"""By how much one motion trails another."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

__all__ = ["measured_lag"]


def measured_lag(times: ArrayLike, targets: ArrayLike, positions: ArrayLike) -> float:
    """Delay [s] after which the targets match the positions best: least squares, each axis counted by its own range.

    Parameters
    ----------
    times : (N,) [s], increasing.
    targets, positions : (N, n) [u].

    Returns
    -------
    Between plus and minus a quarter of the whole time; negative where the positions lead; 0 where nothing moves.
    """
    from scipy.optimize import minimize_scalar  # noqa: PLC0415  (loaded when used)

    t = np.asarray(times, dtype=np.float64)
    wanted, got = np.asarray(targets, dtype=np.float64), np.asarray(positions, dtype=np.float64)
    span = np.ptp(wanted, axis=0)
    moving = span > 0.0
    if not moving.any():
        return 0.0
    wanted, got = wanted[:, moving] / span[moving], got[:, moving] / span[moving]

    def mismatch(lag: float) -> float:
        late = [np.interp(t - lag, t, column) for column in wanted.T]
        return float(np.mean((np.array(late).T - got) ** 2))

    reach = 0.25 * float(t[-1] - t[0])
    coarse = np.linspace(-reach, reach, 101)
    best = float(coarse[int(np.argmin([mismatch(lag) for lag in coarse]))])
    step = float(coarse[1] - coarse[0])
    return float(minimize_scalar(mismatch, bounds=(best - step, best + step), method="bounded").x)
