"""The controllers of `system = "scenario"`, with the hand of their first trial."""

from __future__ import annotations

from collections.abc import Sequence

from rehab_opt.control.assistance import Assistance
from rehab_opt.export.controllers.assistance import exported_assistance
from rehab_opt.export.exported import ExportedController
from rehab_opt.optim.ladder import FUSED
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.outcome import Progress
from rehab_opt.session.scenario.laws import Answer, ForceLaw
from rehab_opt.session.scenario.loop import ran
from rehab_opt.session.scenario.prepared import Prepared, prepared
from rehab_opt.session.scenario.problem import ScenarioProblem
from rehab_opt.session.scenario.run import assistance_of, assisted_law, scene_of

__all__ = ["exported_scenario"]


class Listening(ForceLaw):
    """An assisting law, and how far it let the field be carried in each tick."""

    def __init__(self, law: ForceLaw, assistance: Assistance) -> None:
        self._law, self._assistance = law, assistance
        self.start, self.aim = law.start, law.aim  # type: ignore[method-assign]
        self.carried: list[tuple[float, float]] = []

    def answer(self, x: float, y: float) -> Answer:
        """Its answer."""
        answer = self._law.answer(x, y)
        self.carried.append(self._assistance.carried)
        return answer


def exported_scenario(loaded: ProblemFile[ScenarioProblem], *, progress: Progress) -> Sequence[ExportedController]:
    """The controllers of a scenario.

    Raises
    ------
    ProblemFileError : a value of the file that cannot be used.
    """
    ready = prepared(loaded, progress=progress)
    return (_assistance(loaded, ready),)


def _assistance(loaded: ProblemFile[ScenarioProblem], ready: Prepared) -> ExportedController:
    problem = loaded.problem
    helper = assistance_of(problem, ready, solver=FUSED, backup=FUSED)
    law = Listening(assisted_law(problem, ready, helper), helper)
    trial = ran(scene_of(loaded, ready), law, name="assisted", number=0, seed=problem.task.seed)
    return exported_assistance(
        helper, trial.position, title=problem.title, fields=ready.fields[1:], carried=law.carried
    )
