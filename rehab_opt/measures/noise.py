"""How much of a measure may be the recording's noise: white noise as it comes through `low_passed` and differences."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.measures.arguments import positive, vectors
from rehab_opt.measures.samples import ONCE_EACH_WAY

__all__ = ["noise_of_derivative", "white_noise"]

Array = NDArray[np.float64]

FREQUENCIES = 2001


def white_noise(points: ArrayLike, smooth: ArrayLike, rate_hz: float, *, cutoff_hz: float) -> float:
    """Standard deviation [m] of the noise in each coordinate of points (N, d), were all of it white.

    Parameters
    ----------
    smooth : (N, d) the same points low-passed at `cutoff_hz`; what the filter took away tells of the noise.

    Raises
    ------
    ConfigurationError : arrays of different shapes, numbers that are not finite.
    """
    p, s = vectors("points", points), vectors("smooth", smooth)
    if p.shape != s.shape:
        raise ConfigurationError("smooth", f"shape {s.shape}", f"{p.shape}, as the points")
    passed, _ = _response(rate_hz, cutoff_hz)
    return float(np.sqrt(((p - s) ** 2).mean() / ((1 - passed) ** 2).mean()))


def noise_of_derivative(noise: float, rate_hz: float, *, cutoff_hz: float, order: int) -> float:
    """Standard deviation [m/s^order] that white noise of `noise` [m] leaves in a derivative: 1 velocity, 3 its jerk.

    As `hand_velocity` and `dimensionless_jerk` take them: a central difference, then second differences.
    """
    passed, angle = _response(rate_hz, cutoff_hz)
    differences = np.sin(angle) * (2 - 2 * np.cos(angle)) ** ((order - 1) // 2) * positive("rate_hz", rate_hz) ** order
    return float(noise * np.sqrt(((passed * differences) ** 2).mean()))


def _response(rate_hz: float, cutoff_hz: float) -> tuple[Array, Array]:
    """Gain of the filter run both ways, and radians a sample, at frequencies from 0 to half the rate."""
    angle = np.linspace(0.0, np.pi, FREQUENCIES)
    corner = np.pi * positive("cutoff_hz", cutoff_hz) / ONCE_EACH_WAY / positive("rate_hz", rate_hz)
    # The bilinear transform of the analogue filter, which squeezes infinity to half the rate.
    passed = np.append(1 / (1 + (np.tan(angle[:-1] / 2) / np.tan(corner)) ** 4), 0.0)
    return passed, angle
