"""What was recorded while somebody led a hand: where it was, how it moved, and with which force it was led."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.field.samples import checked_paths

__all__ = ["Demonstration"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Demonstration:
    """One recorded movement.

    Parameters
    ----------
    positions : (N, 2) [m] of the hand, first to last.
    forces : (N, 2) [N] on the hand.
    velocities : (N, 2) [m/s]; by central differences where None, which needs `dt` or `times`.
    dt : [s] between samples, or
    times : (N,) [s] of the samples, rising.

    Raises
    ------
    ConfigurationError : lengths that differ, numbers that are not finite, fewer than three samples.
    """

    positions: Array
    forces: Array
    velocities: Array = None  # type: ignore[assignment]  # always there once it is made
    dt: float | None = None
    times: Array | None = None

    def __post_init__(self) -> None:
        """Check, and complete the velocities."""
        (positions,) = checked_paths(np.asarray(self.positions), "positions")
        if len(positions) < 3:
            raise ConfigurationError("positions", f"{len(positions)} samples", "at least three")
        object.__setattr__(self, "positions", positions)
        object.__setattr__(self, "forces", _column("forces", self.forces, positions))
        velocities = self.velocities
        if velocities is None:
            velocities = np.gradient(positions, self._spacing(len(positions)), axis=0)
        object.__setattr__(self, "velocities", _column("velocities", velocities, positions))

    def _spacing(self, count: int) -> float | Array:
        if self.times is not None:
            times = np.asarray(self.times, dtype=np.float64)
            if times.shape != (count,) or not np.all(np.diff(times) > 0) or not np.all(np.isfinite(times)):
                raise ConfigurationError("times", times.shape, f"{count} rising times in seconds")
            return times
        if isinstance(self.dt, int | float) and 0 < self.dt < math.inf:
            return float(self.dt)
        raise ConfigurationError("dt", self.dt, "seconds between samples, or times, or velocities")


def _column(argument: str, values: ArrayLike, positions: Array) -> Array:
    array = np.array(values, dtype=np.float64)
    if array.shape != positions.shape or not np.all(np.isfinite(array)):
        raise ConfigurationError(argument, array.shape, f"finite numbers of shape {positions.shape}")
    return array
