"""Fields learnt from what a therapist showed: the recordings that a problem file names, and what was learnt of them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rehab_opt.errors import ConfigurationError, ProblemFileError, RehabOptError
from rehab_opt.field.demonstration import Demonstration
from rehab_opt.field.fit import Fit
from rehab_opt.field.potential import PotentialField
from rehab_opt.session.files import ProblemFile, recording_path
from rehab_opt.session.recordings import read_recording
from rehab_opt.session.scenario.problem import ScenarioProblem
from rehab_opt.session.systems import Needed

__all__ = ["Learnt", "fit_metrics", "learnt", "needed_demonstrations"]

Array = NDArray[np.float64]

KEY = "task.demonstrations"
WORST = 0.5
"""Share of the held-out forces from which on a field reproduces them badly."""


class Learnt(NamedTuple):
    """A field, what it was learnt from (in the robot's frame), and what was noticed."""

    field: PotentialField
    shown: tuple[Demonstration, ...]
    notes: tuple[str, ...]


def needed_demonstrations(problem: ScenarioProblem) -> tuple[Needed, ...]:
    """The recordings of the therapist."""
    told = problem.task.demonstrations
    return () if told is None else tuple(Needed(f"{KEY}.files", file) for file in told.files)


def learnt(loaded: ProblemFile[ScenarioProblem], path: Array | None) -> Learnt | None:
    """The field of the demonstrations around `path` (N, 2) [m] or, without one, their mean; None if none is named.

    Raises
    ------
    ProblemFileError : a recording is absent, cannot be used, or has no forces; they cannot be learnt from, or what they
        show has no rest at its end.
    """
    if loaded.problem.task.demonstrations is None:
        return None
    shown, notes = _shown(loaded)
    field = _field(loaded, shown, path, rests=loaded.problem.mode == "assist")
    assert field.fit is not None
    return Learnt(field, shown, (*notes, *_fit_notes(field.fit, len(shown))))


def fit_metrics(fit: Fit) -> dict[str, Any]:
    """For metrics.json: keys that end in their unit, None where there is no number."""
    names = (("stiffness", "stiffness_N_m"), ("drag", "drag_N_m"), ("damping", "damping_Ns_m"))
    return {
        **{key: fit.parameters[name] for name, key in names},
        **{f"{key}_standard_error": _finite(fit.standard_error[name]) for name, key in names},
        "width_m": fit.width,
        "training_error_N": fit.training_error,
        "held_out": [1 + number for number in fit.held_out],
        "held_out_error_N": _finite(fit.held_out_error),
        "held_out_share": _finite(fit.held_out_share),
        "constant_stiffness_error_N": _finite(fit.constant_stiffness_error),
        "condition": _finite(fit.condition),
        "unidentified": list(fit.unidentified),
        "rest_stiffness_N_m": _finite(fit.rest_stiffness),
        "constraints_active": fit.constraints_active,
        "solver": fit.solver,
        "residual": fit.residual,
        "learning_s": fit.seconds,
    }


def _shown(loaded: ProblemFile[ScenarioProblem]) -> tuple[tuple[Demonstration, ...], list[str]]:
    shown, notes = [], []
    for needed in needed_demonstrations(loaded.problem):
        file = needed.reference
        recording = read_recording(recording_path(loaded, file, key=needed.key), name=file)
        if not recording.forces.size:
            raise ProblemFileError(file, "columns", "no forces", "fx_N and fy_N beside t, x and y")
        notes += [f"{file}: {note}" for note in recording.notes]
        try:
            shown.append(
                Demonstration(positions=recording.points[:, :2], forces=recording.forces[:, :2], times=recording.time)
            )
        except ConfigurationError as refused:
            raise ProblemFileError(file, refused.argument, refused.value, refused.expected) from refused
    return tuple(shown), notes


def _field(
    loaded: ProblemFile[ScenarioProblem], shown: tuple[Demonstration, ...], path: Array | None, *, rests: bool
) -> PotentialField:
    widths = [1e-3 * width for width in loaded.problem.field.widths_mm or ()]
    try:
        field = PotentialField.learn(shown, width=widths, path=path, rest_on_target=rests)
    except ConfigurationError as refused:
        key = "field.widths_mm" if refused.argument == "width" else f"{KEY}, {refused.argument}"
        raise ProblemFileError(loaded.file, key, refused.value, refused.expected) from refused
    except RehabOptError as refused:
        raise ProblemFileError(loaded.file, KEY, str(refused), "forces that a field can be fitted to") from refused
    assert field.fit is not None
    if not field.fit.parameters["stiffness"] > 0.0:
        value = "forces that hold no hand on a path (a stiffness of zero)"
        raise ProblemFileError(loaded.file, KEY, value, "movements that were led, and strayed from the path a little")
    if rests and not field.rests:
        value = f"a field that curves by {field.rest_stiffness:.3g} N/m at the end"
        raise ProblemFileError(loaded.file, KEY, value, "movements that come to rest at their end")
    return field


def _fit_notes(fit: Fit, shown: int) -> Iterator[str]:
    """What was learnt, in sentences."""
    said, spread = fit.parameters, fit.standard_error
    numbers = ", ".join(
        f"{symbol} = {said[name]:.3g} +- {spread[name]:.2g} {unit}"
        for symbol, name, unit in (("S", "stiffness", "N/m"), ("k1", "drag", "N/m"), ("D", "damping", "N s/m"))
    )
    held = len(fit.held_out)
    yield (
        f"the field was learnt from {shown - held} of {shown} demonstrations: {numbers}, "
        f"sigma = {1e3 * fit.width:g} mm; {fit.training_error:.2g} N are left"
    )
    if held:
        bad = ": it does not reproduce them well" if not fit.held_out_share <= WORST else ""
        yield (
            f"of the {held} held out its forces are {fit.held_out_error:.2g} N off, {100 * fit.held_out_share:.0f} % "
            f"of what was recorded (a constant stiffness: {fit.constant_stiffness_error:.2g} N){bad}"
        )
    if fit.unidentified:
        yield f"the demonstrations do not tell {', '.join(fit.unidentified)}: the regularisation chose"


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
