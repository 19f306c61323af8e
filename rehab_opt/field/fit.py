"""Quality of a field's fit to demonstrations, and the parameters that the demonstrations leave undetermined."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rehab_opt.field.demonstration import Demonstration

__all__ = ["Fit", "Identified", "constant_stiffness_error", "identified", "rms"]

Array = NDArray[np.float64]

WEAK = 1e-3
"""Fraction of the largest singular value; parameter directions with a smaller one are undetermined."""
PARTS = 8
"""Number of parts of a demonstration, each a few tenths of a second long. Errors in different parts count as
independent."""
TAKES_PART = 0.3
"""A parameter counts as undetermined if its component in an undetermined direction exceeds this."""


class Fit(NamedTuple):
    """Quality of a learnt field."""

    parameters: dict[str, float]
    """Learnt parameters by name, in SI units."""
    standard_error: dict[str, float]
    """Standard error of each parameter, from noise and from sway that lasts up to an eighth of a movement; infinite if
    the data do not determine it. It does not cover errors of the field's form."""
    width: float
    """[m] sigma."""
    training_error: float
    """[N] root mean square error of the reproduced force."""
    held_out: tuple[int, ...]
    """Numbers of the held-out demonstrations."""
    held_out_error: float
    """[N] the same error on the held-out demonstrations; NaN without any."""
    held_out_fraction: float
    """`held_out_error` as a fraction of the root mean square of the held-out forces."""
    chosen_on_held_out: bool
    """Whether the width was chosen by the held-out error, which is then a little too small."""
    constant_stiffness_error: float
    """[N] Error of the best constant spring to the nearest path point and damper, on the same demonstrations."""
    singular_values: Array
    """Singular values of the matrix from parameters to recorded forces, whose columns are scaled to unit length."""
    condition: float
    """Ratio of the largest to the smallest singular value."""
    unidentified: tuple[str, ...]
    """Parameters that the data leave undetermined, alone or in combination; their values mean nothing."""
    rest_stiffness: float
    """[N/m] least curvature of the energy at the target; negative if the field does not rest there. NaN without a
    target."""
    constraints_active: int
    """Samples of the path at which the constraint of no backward force is active."""
    solver: str
    residual: float
    """Certificate residual of the QP, in its scaled units."""
    seconds: float


class Identified(NamedTuple):
    """Which parameters the data determine, and how accurately."""

    singular_values: Array
    condition: float
    unidentified: tuple[str, ...]
    standard_error: Array


def identified(design: Array, names: Sequence[str], errors: Array, lengths: Sequence[int]) -> Identified:
    """Which parameters are determined by a regression with matrix `design` (rows, n), residuals `errors` (rows,) [N].

    `lengths` are the numbers of rows of the demonstrations.

    Hands sway for tenths of a second, so the errors of neighbouring samples are correlated. Each demonstration is
    therefore cut into parts; errors are correlated within a part and independent between parts (Liang and Zeger,
    Biometrika 1986). The standard error is the larger of this estimate and that for independent samples.
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
    """[N] rms error of a plain spring and damper, fitted to `training`, in `tested`.

    Its force is F = S (nearest point of `path` (m, 2) - x) - D v.
    """

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
