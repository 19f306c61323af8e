"""Fields learnt from a therapist's demonstrations: the recordings that a problem file names, and the result."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from rehab_opt.errors import ConfigurationError, ProblemFileError, RehabOptError
from rehab_opt.field.demonstration import Demonstration
from rehab_opt.field.fit import Fit
from rehab_opt.field.potential import PotentialField
from rehab_opt.recordings.reading import read_recording
from rehab_opt.session.files import ProblemFile, recording_path
from rehab_opt.session.outcome import Array, finite
from rehab_opt.session.participant import projected
from rehab_opt.session.refusals import refused_as
from rehab_opt.session.scenario.problem import ScenarioProblem

KEY = "task.demonstrations"
MOST = {"stiffness": 1e5, "drag": 1e5, "damping": 1e4}
"""Largest accepted parameters of a learnt field, the same as for values in a file."""


class Learnt(NamedTuple):
    """A field, its fit, the demonstrations that it was learnt from (in the robot's frame), and notes on them."""

    field: PotentialField
    fit: Fit
    shown: tuple[Demonstration, ...]
    notes: tuple[str, ...]


def learnt(config: ProblemFile[ScenarioProblem], path: Array | None) -> Learnt | None:
    """The field learnt from the demonstrations, around `path` (N, 2) [m] or, without a path, around their mean.

    None if there are no demonstrations.
    """
    if config.problem.task.demonstrations is None:
        return None
    shown, notes = _shown(config)
    field = _field(config, shown, path, rests=config.problem.mode == "assist")
    assert field.fit is not None
    said = *_fit_notes(field.fit, len(shown)), *_data_notes(config.problem, shown)
    return Learnt(field, field.fit, shown, (*notes, *said))


def fit_metrics(fit: Fit) -> dict[str, Any]:
    """Numbers for metrics.json: keys end in their unit; None for a missing number."""
    names = (("stiffness", "stiffness_N_m"), ("drag", "drag_N_m"), ("damping", "damping_Ns_m"))
    return {
        **{key: fit.parameters[name] for name, key in names},
        **{f"{key}_standard_error": finite(fit.standard_error[name]) for name, key in names},
        "width_m": fit.width,
        "training_error_N": fit.training_error,
        "held_out": [1 + number for number in fit.held_out],
        "held_out_error_N": finite(fit.held_out_error),
        "held_out_fraction": finite(fit.held_out_fraction),
        "width_chosen_on_held_out": fit.chosen_on_held_out,
        "constant_stiffness_error_N": finite(fit.constant_stiffness_error),
        "condition": finite(fit.condition),
        "unidentified": list(fit.unidentified),
        "rest_stiffness_N_m": finite(fit.rest_stiffness),
        "constraints_active": fit.constraints_active,
        "solver": fit.solver,
        "residual": fit.residual,
        "learning_s": fit.seconds,
    }


def _shown(config: ProblemFile[ScenarioProblem]) -> tuple[tuple[Demonstration, ...], list[str]]:
    shown, notes = [], []
    told = config.problem.task.demonstrations
    for i, file in enumerate(() if told is None else told.files):
        recording = read_recording(recording_path(config, file, key=f"{KEY}.files.{i}"), name=file)
        if not recording.forces.size:
            raise ProblemFileError(file, "columns", "no forces", "fx_N and fy_N beside t, x and y")
        notes += [f"{file}: {note}" for note in (*recording.notes, *projected(recording.points, recording.forces))]
        with refused_as(file):
            shown.append(
                Demonstration(positions=recording.points[:, :2], forces=recording.forces[:, :2], times=recording.time)
            )
    return tuple(shown), notes


def _field(
    config: ProblemFile[ScenarioProblem], shown: tuple[Demonstration, ...], path: Array | None, *, rests: bool
) -> PotentialField:
    widths = [1e-3 * width for width in config.problem.field.widths_mm or ()]
    try:
        field = PotentialField.learn(shown, width=widths, path=path, rest_on_target=rests)
    except ConfigurationError as refused:
        raise _as_key(config, refused) from refused
    except RehabOptError as refused:
        raise ProblemFileError(config.file, KEY, str(refused), "forces that a field can be fitted to") from refused
    assert field.fit is not None
    said = field.fit.parameters
    for name, key, unit in (("stiffness", "S", "N/m"), ("drag", "k1", "N/m"), ("damping", "D", "N s/m")):
        if not said[name] <= MOST[name]:
            raise ProblemFileError(
                config.file, KEY, f"{key} = {said[name]:.3g} {unit}", f"at most {MOST[name]:g} {unit}"
            )
    if rests and not field.rests:
        value = f"a field that curves by {field.rest_stiffness:.3g} N/m at the end"
        raise ProblemFileError(config.file, KEY, value, "movements that come to rest at their end")
    return field


def _as_key(config: ProblemFile[ScenarioProblem], refused: ConfigurationError) -> ProblemFileError:
    """Convert an error about the demonstrations to one that names the problem file's key and the recording."""
    number = re.fullmatch(r"demonstrations\[(\d+)\]", refused.argument)
    if number is None:
        keys = {"width": "field.widths_mm", "demonstrations": KEY}
        key = keys.get(refused.argument, f"{KEY}, {refused.argument}")
        return ProblemFileError(config.file, key, refused.value, refused.expected)
    assert config.problem.task.demonstrations is not None
    files = config.problem.task.demonstrations.files
    value, expected = (
        re.sub(r"demonstrations\[(\d+)\]", lambda found: files[int(found[1])], str(text))
        for text in (refused.value, refused.expected)
    )
    return ProblemFileError(config.file, f"{KEY}.files", f"{files[int(number[1])]}: {value}", expected)


RESTING, MOSTLY = 0.005, 0.6
"""[m/s] A slower hand is at rest; a note warns if more than the fraction `MOSTLY` of the samples is at rest."""
CLEARLY = 2.0
"""A stiffness less than this many standard errors above zero is reported as uncertain."""
WORST = 0.5
"""A field's error is reported as large above this fraction of the held-out forces."""


def _data_notes(problem: ScenarioProblem, shown: tuple[Demonstration, ...]) -> Iterator[str]:
    slow = [float(np.mean(np.linalg.norm(each.velocities, axis=1) < RESTING)) for each in shown]
    if max(slow) > MOSTLY:
        assert problem.task.demonstrations is not None
        file = problem.task.demonstrations.files[int(np.argmax(slow))]
        yield (
            f"{file}: the hand rests in {100 * max(slow):.0f} % of the samples, which count like the others: S and D "
            "mostly describe the rests, unless these are cut off"
        )
    largest, limit = max(float(np.linalg.norm(each.forces, axis=1).max()) for each in shown), problem.assistance
    if largest > 2 * limit.force_limit_N:
        yield (
            f"the recorded forces reach {largest:.3g} N: the field is stiffer than assistance.force_limit_N = "
            f"{limit.force_limit_N:g} lets it be"
        )


def _fit_notes(fit: Fit, shown: int) -> Iterator[str]:
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
        flattered = ", by which sigma was chosen" if fit.chosen_on_held_out else ""
        bad = ": it does not reproduce them well" if not fit.held_out_fraction <= WORST else ""
        yield (
            f"of the {held} held out{flattered}, its forces are {fit.held_out_error:.2g} N off, "
            f"{100 * fit.held_out_fraction:.0f} % of what was recorded (a constant stiffness: "
            f"{fit.constant_stiffness_error:.2g} N){bad}"
        )
    if not said["stiffness"] > CLEARLY * spread["stiffness"]:
        yield "the demonstrations hardly determine S: add more, or some that deviate further from the path"
    if fit.unidentified:
        yield f"the demonstrations leave {', '.join(fit.unidentified)} open: its value means nothing"
