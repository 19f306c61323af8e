"""Force field, gate and upper bound as published: Eqs. (15)-(23), Rossa et al.

The published equations have these weaknesses. Near the end of the path the weighted mean pulls the hand back, at the
end with about 0.4 S sigma. Every recorded point has the same weight, so pauses of the recorded hand count more. The
force jumps at the boundary of the comfortable workspace. If k1 < 0, the resistance due to the k1 term decreases towards
the target. Far from the path every weight of Eq. (16) underflows, Eq. (17) is 0 / 0, and the force is zero.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError

__all__ = ["FieldLaw"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class FieldLaw:
    """Force F(x, v) of Eq. (20), switched off by the gate of Eq. (23) and limited to `force_limit` (section IV).

    Parameters
    ----------
    path : (m, 2) [m] reference points xi_t; the last one is the target.
    stiffness : S [N/m] for both axes, scalar or (2,).
    drag : k1 [N/m] of Eq. (21), of either sign. width : sigma [m]. damping : D [N s/m], scalar or (2,).
    released : function of a point (2,), true where the force is zero; for scenarios 1 to 3 `comfortable.contains`. With
        None the force acts everywhere.
    force_limit : [N].

    Raises
    ------
    ConfigurationError : an argument is invalid.
    """

    path: Array
    stiffness: float | Array
    drag: float
    width: float
    damping: float | Array = 0.0
    released: Callable[[Array], bool] | None = None
    force_limit: float = math.inf

    def __post_init__(self) -> None:
        path = np.array(self.path, dtype=np.float64)
        if path.ndim != 2 or path.shape[1] != 2 or not len(path) or not np.isfinite(path).all():
            raise ConfigurationError("path", np.shape(self.path), "finite points (m, 2) in metres")
        object.__setattr__(self, "path", path)
        for name in ("stiffness", "damping"):
            object.__setattr__(self, name, np.array(getattr(self, name), dtype=np.float64))
        for name in ("width", "force_limit"):
            if not getattr(self, name) > 0:
                raise ConfigurationError(name, getattr(self, name), "a number above zero")

    def remaining_length(self) -> Array:
        """(m,) [m] xi_l, Eq. (22)."""
        steps = np.linalg.norm(np.diff(self.path, axis=0), axis=1)
        return np.concatenate((np.cumsum(steps[::-1])[::-1], [0.0]))

    @cached_property
    def _drag_energies(self) -> Array:
        """(m,) [J] the terms of Eq. (15) that are the same for every hand position."""
        return np.asarray(self.drag * self.remaining_length() ** 2)

    def energy(self, x: ArrayLike) -> float:
        """Energy Phi [J] at x (2,), Eq. (17)."""
        weights, energies, _ = self._terms(np.asarray(x, dtype=np.float64))
        total = weights.sum()
        return float(weights @ energies / total) if total > 0 else 0.0

    def force(self, x: ArrayLike, v: ArrayLike = (0.0, 0.0)) -> Array:
        """(2,) [N] for a hand at x (2,) moving at v (2,)."""
        point = np.asarray(x, dtype=np.float64)
        if self.released is not None and self.released(point):  # Eq. (23)
            return np.zeros(2)
        weights, energies, away = self._terms(point)
        total = weights.sum()
        if not total > 0:
            return np.zeros(2)
        weights = weights / total
        slope = weights * (energies - weights @ energies) / self.width**2
        elastic = slope @ away - weights @ (self.stiffness * away)
        force: Array = elastic - self.damping * np.asarray(v, dtype=np.float64)
        size = float(np.linalg.norm(force))
        return force * (self.force_limit / size) if size > self.force_limit else force

    def _terms(self, x: Array) -> tuple[Array, Array, Array]:
        """Weights (m,) of Eq. (16), energies (m,) of Eq. (15), and x - xi_t (m, 2)."""
        away = x - self.path
        weights = np.exp(-(away**2).sum(axis=1) / (2 * self.width**2))
        energies = self._drag_energies + 0.5 * (self.stiffness * away**2).sum(axis=1)
        return weights, energies, away
