"""Proportional-integral control of the force on a hand, one axis at a time."""

from __future__ import annotations

__all__ = ["ForceLoop"]


class ForceLoop:
    """u = F + gain e + integral * int e, with e = F - measured force; the integral waits while u is at its limit.

    Parameters
    ----------
    gain, integral : [1], [1/s]. limit : [N] of the motors. step : [s] from one call for an axis to the next.
    """

    __slots__ = ("_gain", "_integral", "_limit", "_summed")

    def __init__(self, gain: float, integral: float, limit: float, *, step: float) -> None:
        self._gain, self._integral, self._limit = gain, integral * step, limit
        self._summed = [0.0, 0.0]

    def motor(self, axis: int, error: float, force: float) -> float:
        """[N] of the motors of `axis`, 0 or 1."""
        summed = self._summed[axis] + self._integral * error
        motor = force + self._gain * error + summed
        if -self._limit <= motor <= self._limit:
            self._summed[axis] = summed
            return motor
        return min(max(motor, -self._limit), self._limit)
