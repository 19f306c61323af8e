"""The force as a linear function of the learnt parameters: for a given sigma, Eq. (20) is linear in phi_0, S and D."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rehab_opt.field.assembly import assembled, rest_point
from rehab_opt.field.samples import SampledPath, Samples
from rehab_opt.field.weights import influences

__all__ = ["ForceModel", "shared_model", "station_model"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ForceModel:
    """Named parameters, none negative, and the samples that they give."""

    paths: Sequence[SampledPath]
    width: float
    target: Array | None
    names: tuple[str, ...]
    """Names of the parameters; the last is the damping."""
    profile: Callable[[SampledPath, Array], tuple[Array, Array]]
    """phi_0 (m,) and S (m, 2) of a path's samples from the parameters; linear."""

    def path_values(self, parameters: Array) -> tuple[list[Array], list[Array]]:
        """phi_0 and S of every path."""
        pairs = [self.profile(path, parameters) for path in self.paths]
        return [offsets for offsets, _ in pairs], [stiffness for _, stiffness in pairs]

    def samples(self, parameters: Array) -> Samples:
        """Samples of the field; energies and stiffness are linear in the parameters, positions and weights constant."""
        offsets, stiffness = self.path_values(parameters)
        return assembled(self.paths, offsets, stiffness, along="remaining", width=self.width, target=self.target)

    def design(self, points: Array, velocities: Array | None = None) -> Array:
        """(N, 2, n) force at points (N, 2) with each parameter at 1 and the others at 0."""
        n = len(self.names)
        each = [self.samples(unit) for unit in np.eye(n)[:-1]]
        offsets = np.column_stack([samples.offsets for samples in each])
        stiffness = np.stack([samples.stiffness for samples in each], axis=2)
        lean = np.stack([samples.lean for samples in each], axis=2)
        forces = np.zeros((len(points), 2, n))
        for rows, weights, away in influences(each[0], self.width, points):
            around = away - np.einsum("nk,nki->ni", weights, away)[:, None, :]
            for i in range(2):
                slope = weights * around[:, :, i] / self.width**2
                forces[rows, i, :-1] = slope @ offsets - weights @ lean[:, i]
                forces[rows, i, :-1] -= (weights * away[:, :, i]) @ stiffness[:, i]
                for j in range(2):
                    forces[rows, i, :-1] += (slope * away[:, :, j]) @ lean[:, j]
                    forces[rows, i, :-1] += (slope * away[:, :, j] ** 2 / 2) @ stiffness[:, j]
        if velocities is not None:
            forces[:, :, -1] = -velocities
        return forces


def shared_model(paths: Sequence[SampledPath], width: float, *, rest_on_target: bool) -> ForceModel:
    """One stiffness S, one drag k1 (Eq. 21), one damping D."""

    def profile(path: SampledPath, parameters: Array) -> tuple[Array, Array]:
        stiffness, drag, _ = parameters
        return drag * path.remaining**2, np.full(path.points.shape, stiffness)

    target = rest_point(paths, "remaining", width) if rest_on_target else None
    return ForceModel(paths, width, target, ("stiffness", "drag", "damping"), profile)


def station_model(paths: Sequence[SampledPath], width: float, stations: int, *, rest_on_target: bool) -> ForceModel:
    """phi_0 and S at stations along the path, linear between them; one damping D.

    Parameters are the decreases of phi_0 from station to station, so that it never rises along the demonstration, and
    the stiffness at each station, from the target backwards.
    """
    fractions = np.linspace(0.0, 1.0, stations)

    def profile(path: SampledPath, parameters: Array) -> tuple[Array, Array]:
        falls, stiffness = parameters[: stations - 1], parameters[stations - 1 : -1]
        fraction = path.remaining / max(float(path.remaining[0]), 1e-12)
        offsets = np.interp(fraction, fractions, np.concatenate(([0.0], np.cumsum(falls))))
        return offsets, np.repeat(np.interp(fraction, fractions, stiffness)[:, None], 2, axis=1)

    names = [f"fall of phi_0 at {(low + high) / 2:.2f} of the way left" for low, high in pairwise(fractions)]
    names += [f"stiffness at {fraction:.2f} of the way left" for fraction in fractions]
    target = rest_point(paths, "remaining", width) if rest_on_target else None
    return ForceModel(paths, width, target, (*names, "damping"), profile)
