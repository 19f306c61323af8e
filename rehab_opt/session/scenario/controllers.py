"""The controllers of a scenario, with the parameters of its file, and the objects that its trials share."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from rehab_opt.control.assistance import Assistance
from rehab_opt.control.bilateral import Bilateral
from rehab_opt.control.path_assistance import PathAssistance
from rehab_opt.control.smoother import Smoother
from rehab_opt.published.field_law import FieldLaw
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.outcome import Progress
from rehab_opt.session.scenario.laws import Assisted, ForceLaw, Published, bounds_of, bounds_refusals, check_bounds
from rehab_opt.session.scenario.loop import Scene, hand_robot_of, person_of, robot_model_of
from rehab_opt.session.scenario.pair import sides_of, together_of
from rehab_opt.session.scenario.precomputed import Precomputed, precompute
from rehab_opt.session.scenario.problem import REACHES, THERAPY, ScenarioProblem
from rehab_opt.session.scenario.trials import Law

SHORTEST_WAY = 1e-3
"""[m] Least distance that is assumed between points, so that a single point gives speed limits above zero, too."""


def scene_of(context: Precomputed) -> Scene:
    """The simulated person, robot and intention, which all trials share."""
    problem = context.problem
    return Scene(
        comfortable=context.comfortable,
        person=person_of(problem),
        robot=hand_robot_of(context.config),
        intention=context.intention,
        within=1e-3 * problem.task.within_mm if problem.mode in REACHES else None,
        dt=1 / problem.run.rate_hz,
    )


def law_of(name: Law, context: Precomputed, *, solver: str | None = None) -> ForceLaw:
    """The controller `name` as a `ForceLaw`, which the closed loop calls."""
    problem = context.problem
    if name == "unassisted":
        return ForceLaw()
    if name == "published":
        return Published(_field_law(context), dt=1 / problem.run.rate_hz)
    if name in ("together", "delayed"):
        delay = problem.helper.delay_s if name == "delayed" else 0.0
        return together_of(Bilateral(*sides_of(context, solver=solver), delay=delay), context)
    with bounds_refusals(context.config, solver=solver, section="assistance"):
        assistance = assistance_of(context, solver=solver)
    return assisted_law(context, assistance)


def assisted_law(context: Precomputed, assistance: Assistance | PathAssistance) -> Assisted:
    """Our controller as a `ForceLaw`; its field is fixed, or in "hold" moves from point to point."""
    problem, points = context.problem, context.reference
    if problem.mode != "hold":
        return Assisted(assistance)
    way = max(float(np.abs(np.diff(points, axis=0)).max(initial=0.0)), SHORTEST_WAY)
    seconds = problem.task.movement_s
    # The largest speed, acceleration and jerk of the minimum-jerk motion over the longest distance in `movement_s`.
    pace = Smoother(
        velocity=1.875 * way / seconds,
        acceleration=5.7735 * way / seconds**2,
        jerk=60.0 * way / seconds**3,
        axes=2,
        dt=1 / problem.run.rate_hz,
    )
    return Assisted(assistance, points, pace)


def assistance_of(
    context: Precomputed, *, solver: str | None = None, backup: str | None = None
) -> Assistance | PathAssistance:
    """Our controller: `Assistance` with a field, or `PathAssistance` along a path that may cross itself."""
    problem, comfortable = context.problem, context.comfortable
    bounds = bounds_of(problem, solver=solver, backup=backup)
    if context.follows_path:
        return PathAssistance(context.reference, comfortable=comfortable, **context.numbers, **bounds)
    onset = 1e-3 * problem.assistance.onset_mm
    return Assistance(context.fields[0], comfortable=comfortable, mode=problem.mode, onset=onset, **bounds)


def _field_law(context: Precomputed) -> FieldLaw:
    """The paper's controller with the same parameters; in "resist", k1 < 0 gives the same force at the path's start."""
    problem, field = context.problem, context.fields[0]
    return FieldLaw(
        path=context.reference if problem.mode == "hold" else field.paths[0].points,
        drag=-field.drag if problem.mode == "resist" else context.drag,
        released=(lambda x: bool(context.comfortable.contains(x))) if problem.mode in THERAPY else None,
        force_limit=problem.assistance.force_limit_N,
        **context.numbers,
    )


class Task:
    """Controllers, person and robot that the trials of a file share; each is built when first needed."""

    progress: Progress = staticmethod(lambda *_: None)

    def __init__(self, config: ProblemFile[ScenarioProblem], solver: str | None) -> None:
        robot_model_of(config)  # raises before seconds are spent on workspaces
        check_bounds(config, solver=solver)
        self.config, self.solver, self.problem = config, solver, config.problem

    @cached_property
    def context(self) -> Precomputed:
        """Workspaces, fields and the person's intention."""
        return precompute(self.config, progress=self.progress)

    @cached_property
    def laws(self) -> dict[Law, ForceLaw]:
        """The controllers of the file."""
        return {name: law_of(name, self.context, solver=self.solver) for name in self.problem.run.laws}

    @cached_property
    def scene(self) -> Scene:
        """The simulated person and robot."""
        return scene_of(self.context)
