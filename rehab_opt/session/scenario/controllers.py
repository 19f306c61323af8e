"""The controllers of a scenario with the numbers of its file, and the parts that its trials share."""

from __future__ import annotations

import numpy as np

from rehab_opt.control.assistance import Assistance
from rehab_opt.control.path_assistance import PathAssistance
from rehab_opt.control.smoother import Smoother
from rehab_opt.published.field_law import FieldLaw
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.outcome import Array
from rehab_opt.session.scenario.laws import (
    Assisted,
    AssistedAtPoints,
    ForceLaw,
    Published,
    Unassisted,
    bounds_of,
    bounds_refusals,
)
from rehab_opt.session.scenario.loop import Arrival, Scene, hand_robot_of, person_of
from rehab_opt.session.scenario.pair import pair_of
from rehab_opt.session.scenario.precomputed import Precomputed
from rehab_opt.session.scenario.problem import REACHES, THERAPY, ScenarioProblem
from rehab_opt.session.scenario.trials import Law

__all__ = ["assistance_of", "assisted_law", "follows_path", "law_of", "scene_of"]

SHORTEST_WAY = 1e-3
"""[m] Least distance between points; a single point needs no time scaling."""
REST = 0.5
"""[s] A reach is over when the hand has been at its goal for this time."""


def scene_of(config: ProblemFile[ScenarioProblem], context: Precomputed) -> Scene:
    """The parts that all trials share."""
    problem = config.problem
    arrival = Arrival(1e-3 * problem.task.within_mm, REST) if problem.mode in REACHES else None
    return Scene(
        comfortable=context.comfortable,
        person=person_of(problem),
        robot=hand_robot_of(config),
        intention=context.intention,
        arrival=arrival,
        dt=1 / problem.run.rate_hz,
    )


def law_of(
    name: Law, config: ProblemFile[ScenarioProblem], context: Precomputed, *, solver: str | None = None
) -> ForceLaw:
    """A controller in the interface of the loop.

    Raises
    ------
    ProblemFileError : a value of the file is not valid.
    ConfigurationError : `solver` is not valid.
    """
    problem = config.problem
    dt = 1 / problem.run.rate_hz
    if name == "unassisted":
        return Unassisted()
    if name == "published":
        return Published(_field_law(problem, context), dt=dt)
    if name in ("together", "delayed"):
        return pair_of(config, context, delay=problem.helper.delay_s if name == "delayed" else 0.0, solver=solver)
    with bounds_refusals(config, solver=solver, section="assistance"):
        assistance = assistance_of(problem, context, solver=solver)
    return assisted_law(problem, context, assistance)


def assisted_law(problem: ScenarioProblem, context: Precomputed, assistance: Assistance | PathAssistance) -> Assisted:
    """Our controller in the interface of the loop, with a fixed field or one that moves from point to point."""
    if problem.mode != "hold" or isinstance(assistance, PathAssistance):
        return Assisted(assistance)
    return AssistedAtPoints(assistance, context.reference, _pace(problem, context.reference))


def assistance_of(
    problem: ScenarioProblem, context: Precomputed, *, solver: str | None = None, backup: str | None = None
) -> Assistance | PathAssistance:
    """Our controller with the whole field; along a path that may cross itself, with progress along the path.

    Raises
    ------
    ConfigurationError : a value that is not valid.
    """
    said, numbers = problem.assistance, context.numbers
    bounds = bounds_of(problem, solver=solver)
    bounds["backup"] = backup
    if follows_path(problem, context):
        return PathAssistance(
            context.reference,
            stiffness=numbers.stiffness,
            width=numbers.width,
            damping=numbers.damping,
            comfortable=context.comfortable,
            force_limit=said.force_limit_N,
            **bounds,
        )
    return Assistance(
        context.fields[0],
        comfortable=context.comfortable,
        mode=problem.mode,
        **said.arguments("force_limit_N", "onset_mm"),
        **bounds,
    )


def follows_path(problem: ScenarioProblem, context: Precomputed) -> bool:
    """Whether the assistance is `PathAssistance`, not a field."""
    return problem.mode == "follow" and not context.numbers.drag


def _pace(problem: ScenarioProblem, points: Array) -> Smoother:
    """Limits per axis with which the longest distance between points takes about `movement_s`."""
    way = max(float(np.abs(np.diff(points, axis=0)).max(initial=0.0)), SHORTEST_WAY)
    seconds = problem.task.movement_s
    # The largest speed, acceleration and jerk of the minimum-jerk motion of that length and time.
    return Smoother(
        velocity=1.875 * way / seconds,
        acceleration=5.7735 * way / seconds**2,
        jerk=60.0 * way / seconds**3,
        axes=2,
        dt=1 / problem.run.rate_hz,
    )


def _field_law(problem: ScenarioProblem, context: Precomputed) -> FieldLaw:
    """The paper's field with the same numbers; in "resist", k1 < 0 gives the same force at the start of the path."""
    field, numbers = context.fields[0], context.numbers
    drag = -field.drag if problem.mode == "resist" else numbers.drag
    return FieldLaw(
        path=context.reference if problem.mode == "hold" else field.paths[0].points,
        stiffness=numbers.stiffness,
        drag=drag,
        width=numbers.width,
        damping=numbers.damping,
        released=(lambda x: bool(context.comfortable.contains(x))) if problem.mode in THERAPY else None,
        force_limit=problem.assistance.force_limit_N,
    )
