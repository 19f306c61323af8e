"""How well a field reproduces its demonstrations, and which parameters they do not determine."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rehab_opt.field.demonstration import Demonstration

__all__ = ["Fit", "Identified", "constant_stiffness_error", "identified", "rms"]

Array = NDArray[np.float64]

WEAK = 1e-3
"""Fraction of the largest singular value: what changes the recorded forces by less is not determined by them."""
PARTS = 8
"""Of a demonstration, a few tenths of a second each: longer than what a hand does at one stroke."""
TAKES_PART = 0.3
"""Fraction of a unit vector from which on a parameter is named."""


class Fit(NamedTuple):
    """Quality of a learnt field."""

    parameters: dict[str, float]
    """What was learnt, by name, SI."""
    standard_error: dict[str, float]
    """Of each, from the data's noise and from sway that lasts up to an eighth of a movement; infinite where they hold
    nothing of it. That no field of this form may give such forces is not in it."""
    width: float
    """[m] sigma."""
    training_error: float
    """[N] root mean square of the force that is not reproduced."""
    held_out: tuple[int, ...]
    """Numbers of the demonstrations that were kept back."""
    held_out_error: float
    """[N] the training error, on those; NaN where none were."""
    held_out_fraction: float
    """That as a fraction of the root mean square of their forces."""
    chosen_on_held_out: bool
    """Whether the width was chosen by the held-out error, which then flatters the field a little."""
    constant_stiffness_error: float
    """[N] on the same demonstrations, of the best constant spring and damper to the nearest point of the path."""
    singular_values: Array
    """Of the recorded forces as a function of the parameters, each parameter in units of its largest effect."""
    condition: float
    """Largest by smallest of them."""
    unidentified: tuple[str, ...]
    """Parameters that the data leave open, alone or against each other: their values are the regularisation's."""
    rest_stiffness: float
    """[N/m] least curvature of the energy at the target; below zero the field does not rest there. NaN without one."""
    constraints_active: int
    """Samples of the path where the force along it is held from pointing backwards."""
    solver: str
    residual: float
    """Certificate of the QP, in its scaled units."""
    seconds: float


class Identified(NamedTuple):
    """What data determine of parameters."""

    singular_values: Array
    condition: float
    unidentified: tuple[str, ...]
    standard_error: Array


def identified(design: Array, names: Sequence[str], errors: Array, lengths: Sequence[int]) -> Identified:
    """From a design (rows, n) and what it leaves (rows,) [N]; `lengths` are the rows of each demonstration.

    A hand sways and a therapist leans for tenths of a second: errors of neighbouring samples are alike, and a thousand
    of them say no more than fifty. So each demonstration is cut into parts, whose errors count as one each
    (Liang and Zeger, Biometrika 1986); where that gives less than independent samples would, these count.
    """
    sizes = np.linalg.norm(design, axis=0)
    silent = sizes <= 1e-12 * sizes.max(initial=1e-300)
    scaled = design / np.where(silent, 1.0, sizes)
    values, vectors = np.linalg.eigh(scaled.T @ scaled)
    singular = np.sqrt(np.maximum(values, 0.0))[::-1]
    weak = vectors[:, np.sqrt(np.maximum(values, 0.0)) < WEAK * singular[0]]
    open_ = silent | (np.abs(weak) > TAKES_PART).any(axis=1)
    parts = np.concatenate([k * PARTS + np.arange(rows) * PARTS // rows for k, rows in enumerate(lengths)])
    scores = np.zeros((PARTS * len(lengths), len(names)))
    np.add.at(scores, parts, scaled * errors[:, None])
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1 / np.maximum(values, 0.0)
        alone = (errors**2).mean() * ((vectors**2) * inverse).sum(axis=1)
        together = (((scores @ vectors) * inverse @ vectors.T) ** 2).sum(axis=0)
        together *= len(scores) / max(len(scores) - len(names), 1)
        error = np.sqrt(np.fmax(alone, together)) / sizes
    error[silent] = np.inf
    condition = float(singular[0] / singular[-1]) if singular[-1] > 0 else np.inf
    return Identified(
        singular, condition, tuple(np.array(names)[open_].tolist()), np.nan_to_num(error, nan=0.0, posinf=np.inf)
    )


def rms(vectors: Array) -> float:
    """[N] root mean square length of vectors (N, 2)."""
    return float(np.sqrt((vectors**2).sum(axis=1).mean())) if len(vectors) else float("nan")


def constant_stiffness_error(path: Array, training: Sequence[Demonstration], tested: Sequence[Demonstration]) -> float:
    """[N] rms error on `tested` of F = S (nearest point of `path` (m, 2) - x) - D v, fitted to `training`."""

    def design(parts: Sequence[Demonstration]) -> tuple[Array, Array]:
        x = np.concatenate([part.positions for part in parts])
        v = np.concatenate([part.velocities for part in parts])
        back = np.concatenate([_to_nearest(path, x[i : i + 1000]) for i in range(0, len(x), 1000)])
        forces = np.concatenate([part.forces for part in parts])
        return np.stack((back, -v), axis=2), forces

    if not tested:
        return float("nan")
    columns, forces = design(training)
    best = np.linalg.lstsq(columns.reshape(-1, 2), forces.reshape(-1), rcond=None)[0]
    columns, forces = design(tested)
    return rms(columns @ best - forces)


def _to_nearest(path: Array, points: Array) -> Array:
    distance = ((points[:, None, :] - path[None, :, :]) ** 2).sum(axis=2)
    nearest: Array = path[distance.argmin(axis=1)] - points
    return nearest
