"""The controllers of `system = "scenario"`, with the hands of their first trial."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rehab_opt.control.assistance import Assistance
from rehab_opt.control.bilateral import Bilateral, BilateralCommand
from rehab_opt.control.bilateral_sides import FromHelper, FromParticipant
from rehab_opt.control.command import Command
from rehab_opt.control.path_assistance import PathAssistance
from rehab_opt.errors import ProblemFileError
from rehab_opt.export.controllers.assistance import exported_assistance
from rehab_opt.export.controllers.bilateral_sides import exported_helper_side, exported_participant_side
from rehab_opt.export.controllers.path_assistance import exported_path_assistance
from rehab_opt.export.exported import ExportedController
from rehab_opt.optim.fallback_chain import FUSED
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.outcome import Progress
from rehab_opt.session.scenario.laws import Assisted, ForceLaw
from rehab_opt.session.scenario.loop import ran
from rehab_opt.session.scenario.pair import sides_of, together_of
from rehab_opt.session.scenario.precomputed import Precomputed, precompute
from rehab_opt.session.scenario.problem import ScenarioProblem
from rehab_opt.session.scenario.run import assistance_of, assisted_law, scene_of

__all__ = ["exported_scenario"]


class Listening(ForceLaw):
    """An assisting law, and how far it let the field be carried in each tick."""

    def __init__(self, law: ForceLaw, assistance: Assistance) -> None:
        self._law, self._assistance = law, assistance
        self.carried: list[tuple[float, float]] = []

    def start(self, number: int) -> None:
        """A trial begins."""
        self._law.start(number)
        self.carried.clear()

    def aim(self, goal: int) -> None:
        """The goal has changed."""
        self._law.aim(goal)

    def command(self, x: float, y: float, *, enable: object = True, stamp: float | None = None) -> Command:
        """Its command."""
        command = self._law.command(x, y, enable=enable, stamp=stamp)
        self.carried.append(self._assistance.carried)
        return command


class Overheard(Bilateral):
    """A pair, and what each side was told in each tick: where its hand is, and the message of the other side."""

    def reset(self) -> None:
        """Nothing is under way, and nothing was said."""
        super().reset()
        self.hands: list[tuple[ArrayLike, ArrayLike]] = []
        self.heard: list[tuple[FromParticipant | None, FromHelper | None]] = []

    def step(self, helper: ArrayLike, participant: ArrayLike, *rest: Any, **options: Any) -> BilateralCommand:
        """Its forces."""
        self.hands.append((helper, participant))
        self.heard.append(self.under_way)
        return super().step(helper, participant, *rest, **options)


def exported_scenario(loaded: ProblemFile[ScenarioProblem], *, progress: Progress) -> Sequence[ExportedController]:
    """The controllers of a scenario.

    Raises
    ------
    ProblemFileError : a solver that does not generate C, or a value of the file that cannot be used.
    """
    solver = loaded.problem.run.solver
    if solver not in (None, FUSED):
        raise ProblemFileError(loaded.file, "run.solver", solver, f"{FUSED}, which can become C")
    ready = precompute(loaded, progress=progress)
    laws = loaded.problem.run.laws
    pairs = [law for law in laws if law in ("together", "delayed")]
    helpers = [_assistance(loaded, ready)] if "assisted" in laws or not pairs else []
    return [*helpers, *(_sides(loaded, ready, delayed="delayed" in pairs) if pairs else ())]


def _assistance(loaded: ProblemFile[ScenarioProblem], ready: Precomputed) -> ExportedController:
    problem = loaded.problem
    helper = assistance_of(problem, ready, solver=FUSED, backup=FUSED)
    if isinstance(helper, PathAssistance):
        trial = ran(scene_of(loaded, ready), Assisted(helper), name="assisted", number=0, seed=problem.task.seed)
        return exported_path_assistance(helper, trial.position, title=problem.title)
    law = Listening(assisted_law(problem, ready, helper), helper)
    trial = ran(scene_of(loaded, ready), law, name="assisted", number=0, seed=problem.task.seed)
    carried = law.carried if problem.mode == "hold" else None
    return exported_assistance(helper, trial.position, title=problem.title, fields=ready.fields[1:], carried=carried)


def _sides(loaded: ProblemFile[ScenarioProblem], ready: Precomputed, *, delayed: bool) -> Sequence[ExportedController]:
    problem = loaded.problem
    delay = problem.helper.delay_s if delayed else 0.0
    both = Overheard(*sides_of(loaded, ready, solver=FUSED), delay=delay)
    law = together_of(both, loaded, ready)
    ran(scene_of(loaded, ready), law, name="together", number=0, seed=problem.task.seed)
    hands, heard = np.array(both.hands), list(zip(*both.heard, strict=True))
    assert ready.carry is not None  # the schema refuses a pair without a map
    alike = ready._replace(carry=ready.carry.summed())  # rounding may decide whether a solver gives up
    helper, participant = sides_of(loaded, alike, solver=FUSED, backup=FUSED)
    return (
        exported_helper_side(helper, hands[:, 0], heard[0], title=problem.title),
        exported_participant_side(participant, hands[:, 1], heard[1], title=problem.title),
    )
