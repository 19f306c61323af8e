"""Learn fields from recorded forces by a convex QP: for a given sigma the force is linear in S, k1 and D."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Sequence
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError, RehabOptError
from rehab_opt.field.assembly import assembled, rest_point
from rehab_opt.field.demonstration import Demonstration, check_agreement, check_closeness, check_units
from rehab_opt.field.energy import energies_and_forces, field_kernel
from rehab_opt.field.fit import Fit, constant_stiffness_error, identified, rms
from rehab_opt.field.potential import PotentialField, sample_spacing
from rehab_opt.field.samples import SampledPath, checked_paths, mean_path, resampled_path
from rehab_opt.kinematics.real_array import is_real, positive
from rehab_opt.optim.backends import backend
from rehab_opt.optim.certificate import certificate_function, is_certified
from rehab_opt.optim.recorder import recorder_now
from rehab_opt.optim.rows import Instance
from rehab_opt.symbolic import Compile

__all__ = ["learnt_field"]

Array = NDArray[np.float64]

NAMES = ("stiffness", "drag", "damping")
"""The parameters: S [N/m], k1 [N/m] of Eq. (21), D [N s/m]."""
TOLERANCE = 1e-6
"""Largest certificate residual of the scaled QP, whose numbers are about one."""
MAX_ROWS = 400
"""Largest number of path samples, evenly chosen, at which the force may not point backwards."""
RIDGE = 1e-12
"""Weight of the scaled parameters' squares in the cost; it sets parameters that the data leave undetermined."""
LEAST = 1.0
"""Least ratio of the stiffness to its standard error; below it nothing is learnt. (For a stiffness of zero a
solver returns 1e-12 N/m, and noise a little more.)"""


class Solution(NamedTuple):
    """Certified solution of one fit."""

    parameters: Array
    solver: str
    residual: float
    active: int


class FitProblem(NamedTuple):
    """QP over parameters theta: min mean |design theta - forces|^2, subject to theta >= 0, along theta >= 0."""

    design: Array
    """(rows, n)"""
    forces: Array
    """(rows,) [N]"""
    along: Array
    """(m, n)"""

    @property
    def unit(self) -> Array:
        """(n,) scale of each parameter: with this value it alone gives forces as large as the recorded ones."""
        size = np.sqrt((self.design**2).mean(axis=0) / max(float((self.forces**2).mean()), 1e-12))
        return np.asarray(1 / np.maximum(np.where(size > 1e-12 * size.max(), size, size.max()), 1e-12))

    def solved(self, solvers: Sequence[str]) -> Solution:
        """Solve the QP in scaled units, with the first of the `solvers` whose answer is certified."""
        design, forces, along = self
        n, m, unit = design.shape[1], len(along), self.unit
        mean_square = max(float((forces**2).mean()), 1e-12)
        columns = design * unit
        hessian = columns.T @ columns / len(forces) / mean_square + RIDGE * np.eye(n)
        gradient = -columns.T @ forces / len(forces) / mean_square
        rows = along * unit
        rows = rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-12)
        free = np.full(m, np.inf), np.full(n, np.inf)
        qp = Instance((hessian + hessian.T) / 2, gradient, rows, np.zeros(m), free[0], np.zeros(n), free[1])
        recorder = recorder_now()
        if recorder is not None:
            recorder.stream(f"field_learning_{m}_{n}", TOLERANCE, Instance, ticks=False, shared=True).see(*qp)
        certify = certificate_function(n, m)
        tried = []
        for name in solvers:
            claim = backend(name, n, m, argument="solvers").solve(qp)
            x, residual = certify(*qp, 1, *claim[:3])
            tried.append(f"{name} {float(residual):.1e}")
            if is_certified(float(residual), TOLERANCE):
                active = int((np.abs(claim.row_multipliers) > TOLERANCE).sum())
                return Solution(np.array(x).reshape(-1) * unit, name, float(residual), active)
        raise RehabOptError(f"no solver gave a certified fit: residuals {', '.join(tried)}, at most {TOLERANCE:g}")


def learnt_field(
    demonstrations: Sequence[Demonstration],
    *,
    width: float | Sequence[float],
    path: ArrayLike | Sequence[ArrayLike] | None = None,
    held_out: Sequence[int] | None = None,
    rest_on_target: bool = True,
    spacing: float | None = None,
    solvers: Sequence[str] = ("daqp", "proxqp", "osqp"),
    compile: Compile = None,
) -> PotentialField:
    """The field whose forces are nearest to the recorded ones; its `fit` has the errors.

        min   mean |F(x, v) - F_recorded|^2
        s.t.  S >= 0, k1 >= 0, D >= 0, t_j . F(x_j) >= 0 at the path's samples x_j

    The last constraint is on the force itself: although phi_0 falls along the path, the stiffness can pull a hand
    backwards. The constraint leaves out samples nearer to the target than the spread of the paths' ends, because a path
    that ends beyond the target needs a force back to it.

    Parameters
    ----------
    demonstrations : the recordings.
    width : sigma [m]; from several, the one with the least held-out error is chosen.
    path : path of the field, as in `PotentialField`. None means the mean of the demonstrations, smoothed over
        half of `width`. With their own positions as paths, no spring could pull back along the sway of a hand.
    held_out : numbers of the demonstrations that are held out for testing; by default every fifth, or one of two to
        four.
    rest_on_target, spacing, compile : as in `PotentialField`.
    solvers : tried in turn until one gives a certified answer.

    Raises
    ------
    ConfigurationError : an argument is invalid; a demonstration has a wrong unit, runs against the path (without one,
        against the first demonstration), or stays further from it than the largest width; the forces show no stiffness.
    RehabOptError : no solver gave a certified answer.
    """
    several = isinstance(demonstrations, (list, tuple)) and len(demonstrations) > 0
    if not (several and all(isinstance(each, Demonstration) for each in demonstrations)):
        raise ConfigurationError("demonstrations", demonstrations, "a list or tuple of at least one Demonstration")
    kept = _held_out(held_out, len(demonstrations))
    one = not (isinstance(width, Sequence) or (isinstance(width, np.ndarray) and width.ndim == 1))
    widths = [positive("width", each) for each in ([width] if one else width)]  # type: ignore[union-attr]
    if not widths:
        raise ConfigurationError("width", width, "at least one width in metres")
    if not isinstance(solvers, (list, tuple)):
        raise ConfigurationError("solvers", solvers, "a list or tuple of solvers' names")
    task = Task(
        training=[each for i, each in enumerate(demonstrations) if i not in kept],
        tested=[demonstrations[i] for i in kept],
        kept=kept,
        rest_on_target=rest_on_target,
        solvers=tuple(solvers),
        compile=compile,
        widths=len(widths),
    )
    check_units(demonstrations)
    given = None if path is None else checked_paths(path)
    check_agreement(demonstrations, given, min(widths))
    found = []
    for each in widths:
        step, source = sample_spacing(each, spacing)
        around = given or (mean_path([one.positions for one in task.training], each / 2),)
        check_closeness(demonstrations, around, max(widths))
        found.append(_learnt(task, [resampled_path(points, step, source) for points in around], each))
    best = min(found, key=_error)
    fit = cast("Fit", best.fit)
    stiffness, spread = fit.parameters["stiffness"], fit.standard_error["stiffness"]
    if not stiffness > LEAST * spread:
        value = f"forces that hold no hand on a path (a stiffness of {stiffness:.2g} +- {spread:.2g} N/m)"
        expected = (
            "guided movements that deviated a little from the path and did not return to earlier points; "
            "force on the hand, sensor's offset removed"
        )
        raise ConfigurationError("demonstrations", value, expected)
    return best


class Task(NamedTuple):
    """Data and options of one learning problem."""

    training: Sequence[Demonstration]
    tested: Sequence[Demonstration]
    kept: tuple[int, ...]
    rest_on_target: bool
    solvers: tuple[str, ...]
    compile: Compile
    widths: int


def _error(field: PotentialField) -> float:
    fit = cast("Fit", field.fit)
    return fit.training_error if math.isnan(fit.held_out_error) else fit.held_out_error


def force_columns(paths: Sequence[SampledPath], width: float, points: Array, *, rest_on_target: bool) -> Array:
    """(N, 2, 3) [N] forces at points (N, 2) per unit of each parameter of `NAMES`; zero for the damping D."""
    target = rest_point(paths, "remaining", width) if rest_on_target else None
    forces = np.zeros((len(points), 2, len(NAMES)))
    for column, (stiffness, drag) in enumerate(((1.0, 0.0), (0.0, 1.0))):
        samples = assembled(
            paths,
            [drag * path.remaining**2 for path in paths],
            [np.full(path.points.shape, stiffness) for path in paths],
            along="remaining",
            width=width,
            target=target,
        )
        forces[:, :, column] = energies_and_forces(field_kernel(samples, width, compile=False).mine, points)[1]
    return forces


def _learnt(task: Task, paths: Sequence[SampledPath], width: float) -> PotentialField:
    begun = time.perf_counter()
    x = np.concatenate([each.positions for each in task.training])
    v = np.concatenate([each.velocities for each in task.training])
    forces = np.concatenate([each.forces for each in task.training]).reshape(-1)
    design = force_columns(paths, width, x, rest_on_target=task.rest_on_target)
    design[:, :, -1] = -v
    design = design.reshape(len(forces), -1)
    solution = FitProblem(design, forces, _along_path(task, paths, width)).solved(task.solvers)
    errors = design @ solution.parameters - forces
    told = identified(design, NAMES, errors, [2 * len(each.positions) for each in task.training])
    stiffness, drag, damping = solution.parameters
    field = PotentialField.of_samples(
        paths,
        [drag * path.remaining**2 for path in paths],
        [np.full(path.points.shape, stiffness) for path in paths],
        width=width,
        damping=damping,
        rest_on_target=task.rest_on_target,
        compile=task.compile,
    )
    field.drag = float(drag)
    wrong = [field.force(each.positions, each.velocities) - each.forces for each in task.tested]
    error = rms(np.concatenate(wrong)) if wrong else math.nan
    size = rms(np.concatenate([each.forces for each in task.tested])) if wrong else math.nan
    points = np.concatenate([path.points for path in paths])
    field.fit = Fit(
        parameters=dict(zip(NAMES, solution.parameters.tolist(), strict=True)),
        standard_error=dict(zip(NAMES, told.standard_error.tolist(), strict=True)),
        width=width,
        training_error=rms(errors.reshape(-1, 2)),
        held_out=task.kept,
        held_out_error=error,
        held_out_fraction=error / size if size else math.nan,
        chosen_on_held_out=task.widths > 1 and bool(wrong),
        constant_stiffness_error=constant_stiffness_error(points, task.training, task.tested),
        singular_values=told.singular_values,
        condition=told.condition,
        unidentified=told.unidentified,
        rest_stiffness=field.rest_stiffness,
        constraints_active=solution.active,
        solver=solution.solver,
        residual=solution.residual,
        seconds=time.perf_counter() - begun,
    )
    return field


def _along_path(task: Task, paths: Sequence[SampledPath], width: float) -> Array:
    """(m, 3) [N] tangential force at each of the m samples, one column per unit of each parameter of `NAMES`."""
    points = np.concatenate([path.points for path in paths])
    tangents = np.concatenate([path.tangents for path in paths])
    ends = np.array([path.points[-1] for path in paths])
    spread = float(np.linalg.norm(ends - ends.mean(axis=0), axis=1).max())
    counted = np.flatnonzero(np.linalg.norm(points - ends.mean(axis=0), axis=1) > spread + 1e-9)
    if not len(counted):
        return np.zeros((0, len(NAMES)))
    chosen = counted[np.unique(np.linspace(0, len(counted) - 1, min(len(counted), MAX_ROWS)).astype(int))]
    columns = force_columns(paths, width, points[chosen], rest_on_target=task.rest_on_target)
    rows: Array = np.einsum("ki,kin->kn", tangents[chosen], columns)
    return rows


def _held_out(held_out: Sequence[int] | None, count: int) -> tuple[int, ...]:
    if held_out is None:
        return tuple(range(4, count, 5)) if count >= 5 else ((count - 1,) if count > 1 else ())
    numbers = list(held_out) if isinstance(held_out, Iterable) else [math.nan]
    known = all(is_real(i) and i in range(count) for i in numbers)
    kept = tuple(sorted({int(i) for i in numbers})) if known else ()
    if not known or len(kept) >= count:
        raise ConfigurationError("held_out", held_out, f"numbers from 0 to {count - 1}, and not all of them")
    return kept
