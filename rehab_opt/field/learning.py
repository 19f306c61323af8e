"""Fields learnt from recorded forces: convex QPs, since given sigma the force is linear in what is learnt."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError, RehabOptError
from rehab_opt.field.demonstration import Demonstration
from rehab_opt.field.fit import Fit, constant_stiffness_error, identified, rms
from rehab_opt.field.force_model import ForceModel, shared_model, station_model
from rehab_opt.field.potential import SAMPLES_PER_WIDTH, PotentialField, positive
from rehab_opt.field.samples import SampledPath, checked_paths, resampled_path
from rehab_opt.optim.backends import backend
from rehab_opt.optim.certificate import certificate_function, is_certified
from rehab_opt.optim.qp import Instance

__all__ = ["learnt_field"]

Array = NDArray[np.float64]

TOLERANCE = 1e-6
"""Certificate residual of the scaled QP, whose numbers are about one."""
MOST_ROWS = 400
"""Samples of the path at which the force may not point backwards; evenly among more."""
RIDGE = 1e-12
"""Weight of the parameters, in units of their effect, against the data: it settles what nothing else does."""


class Solution(NamedTuple):
    """Of one QP."""

    parameters: Array
    solver: str
    residual: float
    active: int


def learnt_field(
    demonstrations: Sequence[Demonstration],
    *,
    width: float | Sequence[float],
    path: ArrayLike | Sequence[ArrayLike] | None = None,
    per_point: bool = False,
    stations: int = 12,
    regularisation: float = 1e-4,
    held_out: Sequence[int] | None = None,
    rest_on_target: bool = True,
    spacing: float | None = None,
    solvers: Sequence[str] = ("proxqp", "osqp"),
    compile: bool | None = None,
) -> PotentialField:
    """The field whose forces are nearest to the recorded ones; its `fit` says how near.

        min   mean |F(x, v) - F_recorded|^2 + regularisation
        s.t.  S >= 0, D >= 0, phi_0 never rising along the path, t_j . F(x_j) >= 0 at its samples x_j

    The last holds for the force itself: with a falling phi_0 alone the stiffness can still pull backwards. Samples as
    near to the target as the paths' ends lie from each other are left out: a path that ends beyond the target must be
    pulled back to it.

    Parameters
    ----------
    demonstrations : what was recorded.
    width : sigma [m]; of several the one with the least error on what is held out.
    path : what the field is built around, as in `PotentialField`; the positions of the demonstrations it learns from
        where None.
    per_point : phi_0 and S at `stations` along the way instead of one S and k1 for all of it. The stations are drawn
        to the shared solution, and to being smooth, by `regularisation` (relative to the mean square force).
    held_out : numbers of the demonstrations that are kept back to judge; every fifth by default, one of two to four.
    rest_on_target, spacing, compile : as in `PotentialField`.
    solvers : tried in turn until one gives a certified answer.

    Raises
    ------
    ConfigurationError : an argument that cannot be used. RehabOptError : no solver gave a certified answer.
    """
    demonstrations = list(demonstrations)
    if not demonstrations or not all(isinstance(each, Demonstration) for each in demonstrations):
        raise ConfigurationError("demonstrations", demonstrations, "at least one Demonstration")
    kept = _held_out(held_out, len(demonstrations))
    if not isinstance(stations, int) or not 2 <= stations <= 100:
        raise ConfigurationError("stations", stations, "an integer from 2 to 100")
    regularisation = positive("regularisation", regularisation)
    widths = [width] if np.ndim(width) == 0 else list(width)  # type: ignore[arg-type]
    training = [each for i, each in enumerate(demonstrations) if i not in kept]
    tested = [demonstrations[i] for i in kept]
    given = checked_paths([each.positions for each in training] if path is None else path)
    best: PotentialField | None = None
    for each in (positive("width", w) for w in widths):
        step = each / SAMPLES_PER_WIDTH if spacing is None else positive("spacing", spacing)
        paths = [resampled_path(points, step) for points in given]
        field = _learnt(
            training,
            tested,
            kept,
            paths,
            each,
            stations if per_point else 0,
            regularisation,
            rest_on_target,
            solvers,
            compile,
        )
        if best is None or _judged(field) < _judged(best):
            best = field
    assert best is not None
    return best


def _judged(field: PotentialField) -> float:
    assert field.fit is not None
    error = field.fit.held_out_error
    return error if error == error else field.fit.training_error


def _learnt(
    training: Sequence[Demonstration],
    tested: Sequence[Demonstration],
    kept: tuple[int, ...],
    paths: Sequence[SampledPath],
    width: float,
    stations: int,
    regularisation: float,
    rest_on_target: bool,
    solvers: Sequence[str],
    compile: bool | None,
) -> PotentialField:
    begun = time.perf_counter()
    x, v, forces = (
        np.concatenate([getattr(each, name) for each in training]) for name in ("positions", "velocities", "forces")
    )
    model = shared_model(paths, width, rest_on_target=rest_on_target)
    design = model.design(x, v).reshape(-1, len(model.names))
    along = _along_path(model)
    solution = _solved(design, forces.reshape(-1), along, np.zeros((3, 3)), np.zeros(3), solvers)
    if stations:
        shared = solution.parameters
        model = station_model(paths, width, stations, rest_on_target=rest_on_target)
        design = model.design(x, v).reshape(-1, len(model.names))
        along = _along_path(model)
        prior = _as_stations(shared, paths, stations)
        solution = _solved(
            design, forces.reshape(-1), along, _roughness(stations, prior, regularisation), prior, solvers
        )
    theta = solution.parameters
    options = {"width": width, "damping": theta[-1], "rest_on_target": rest_on_target, "compile": compile}
    field = PotentialField.of_samples(paths, *model.path_values(theta), **options)
    if not stations:
        field.drag = float(theta[1])
    left = (design @ theta - forces.reshape(-1)).reshape(-1, 2)
    told = identified(design, model.names, rms(left) / np.sqrt(2))
    wrong = [field.force(each.positions, each.velocities) - each.forces for each in tested]
    error = rms(np.concatenate(wrong)) if wrong else float("nan")
    size = rms(np.concatenate([each.forces for each in tested])) if wrong else float("nan")
    field.fit = Fit(
        parameters=dict(zip(model.names, theta.tolist(), strict=True)),
        standard_error=dict(zip(model.names, told.standard_error.tolist(), strict=True)),
        width=width,
        training_error=rms(left),
        held_out=kept,
        held_out_error=error,
        held_out_share=error / size if size else float("nan"),
        constant_stiffness_error=constant_stiffness_error(
            np.concatenate([path.points for path in paths]), training, tested
        ),
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


def _along_path(model: ForceModel) -> Array:
    """(m, n) force along the path at its samples, of each parameter."""
    points = np.concatenate([path.points for path in model.paths])
    tangents = np.concatenate([path.tangents for path in model.paths])
    ends = np.array([path.points[-1] for path in model.paths])
    target = ends.mean(axis=0)
    spread = float(np.linalg.norm(ends - target, axis=1).max())
    counted = np.linalg.norm(points - target, axis=1) > spread + 1e-9
    points, tangents = points[counted], tangents[counted]
    chosen = np.unique(np.linspace(0, len(points) - 1, min(len(points), MOST_ROWS)).astype(int)) if len(points) else []
    rows: Array = (
        np.einsum("ki,kin->kn", tangents[chosen], model.design(points[chosen]))
        if len(points)
        else np.zeros((0, len(model.names)))
    )
    return rows


def _as_stations(shared: Array, paths: Sequence[SampledPath], stations: int) -> Array:
    """The parameters of `station_model` that come nearest to the shared ones."""
    stiffness, drag, damping = shared
    length = float(np.mean([path.remaining[0] for path in paths]))
    offsets = drag * (length * np.linspace(0, 1, stations)) ** 2
    return np.concatenate((np.diff(offsets), np.full(stations, stiffness), [damping]))


def _roughness(stations: int, prior: Array, weight: float) -> Array:
    """(n, n) penalty on what differs from the prior, and on how unevenly it does so from station to station."""
    penalty = np.zeros((len(prior), len(prior)))
    for part in (slice(0, stations - 1), slice(stations - 1, 2 * stations - 1)):
        size = max(float(np.abs(prior[part]).mean()), 1e-3)
        count = part.stop - part.start
        bend = np.diff(np.eye(count), n=2, axis=0) if count > 2 else np.zeros((0, count))
        penalty[part, part] = (1e-2 * np.eye(count) + bend.T @ bend) * weight / size**2
    return penalty


def _solved(
    design: Array, forces: Array, along: Array, penalty: Array, prior: Array, solvers: Sequence[str]
) -> Solution:
    """Least squares with bounds and rows, in units that make its numbers about one."""
    mean_square = max(float((forces**2).mean()), 1e-12)
    size = np.sqrt((design**2).mean(axis=0) / mean_square)
    unit = 1 / np.where(size > 1e-12 * size.max(initial=1e-300), size, max(size.max(initial=0.0), 1e-12))
    columns = design * unit
    hessian = columns.T @ columns / len(forces) / mean_square + penalty * np.outer(unit, unit)
    hessian += RIDGE * np.eye(len(unit))
    gradient = -columns.T @ forces / len(forces) / mean_square - unit * (penalty @ prior)
    rows = along * unit
    rows = rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-12) if len(rows) else rows
    n, m = len(unit), len(rows)
    qp = Instance(
        (hessian + hessian.T) / 2, gradient, rows, np.zeros(m), np.full(m, np.inf), np.zeros(n), np.full(n, np.inf)
    )
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


def _held_out(held_out: Sequence[int] | None, count: int) -> tuple[int, ...]:
    if held_out is None:
        return tuple(range(4, count, 5)) if count >= 5 else ((count - 1,) if count > 1 else ())
    kept = tuple(sorted({int(i) for i in held_out}))
    if (kept and not (kept[0] >= 0 and kept[-1] < count)) or len(kept) >= count:
        raise ConfigurationError("held_out", held_out, f"numbers from 0 to {count - 1}, and not all of them")
    return kept
