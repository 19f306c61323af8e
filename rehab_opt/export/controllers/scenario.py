"""Export of the controllers of `system = "scenario"`, with recorded runs along the hand's motion in the first trial."""

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
from rehab_opt.export.controllers.assistance import exported_assistance
from rehab_opt.export.controllers.bilateral_sides import exported_helper_side, exported_participant_side
from rehab_opt.export.controllers.path_assistance import exported_path_assistance
from rehab_opt.export.exported import ExportedController, refuse_other_solvers
from rehab_opt.optim.fallback_chain import FUSED
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.outcome import Progress
from rehab_opt.session.scenario.controllers import assistance_of, assisted_law, scene_of
from rehab_opt.session.scenario.laws import Assisted, ForceLaw
from rehab_opt.session.scenario.loop import simulate_trial
from rehab_opt.session.scenario.pair import sides_of, together_of
from rehab_opt.session.scenario.precomputed import Precomputed, precompute
from rehab_opt.session.scenario.problem import ScenarioProblem

__all__ = ["exported_scenario"]


class Listening(ForceLaw):
    """An assisting controller that records the offset of its field in each tick."""

    def __init__(self, law: ForceLaw, assistance: Assistance) -> None:
        self._law, self._assistance = law, assistance
        self.offsets: list[tuple[float, float]] = []

    def start(self, number: int) -> None:
        """Start a trial."""
        self._law.start(number)
        self.offsets.clear()

    def set_goal(self, goal: int) -> None:
        """Set the goal."""
        self._law.set_goal(goal)

    def command(self, x: float, y: float, *, enable: object = True, stamp: float | None = None) -> Command:
        """The controller's command."""
        command = self._law.command(x, y, enable=enable, stamp=stamp)
        self.offsets.append(self._assistance.offset)
        return command


class Overheard(Bilateral):
    """A pair that records, in each tick, the position of each hand and the message that each side receives."""

    def reset(self) -> None:
        """Reset both sides; no force or message remains in transit."""
        super().reset()
        self.hands: list[tuple[ArrayLike, ArrayLike]] = []
        self.received: list[tuple[FromParticipant | None, FromHelper | None]] = []

    def step(self, helper: ArrayLike, participant: ArrayLike, *rest: Any, **options: Any) -> BilateralCommand:
        """Record each hand's position and each side's received message; return the pair's commands."""
        self.hands.append((helper, participant))
        self.received.append(self.under_way)
        return super().step(helper, participant, *rest, **options)


def exported_scenario(config: ProblemFile[ScenarioProblem], *, progress: Progress) -> Sequence[ExportedController]:
    """Prepare the controllers of a scenario for export, with their recorded runs.

    Raises
    ------
    ProblemFileError : a solver without C code, or an invalid value in the file.
    """
    refuse_other_solvers(config, "run.solver")
    context = precompute(config, progress=progress)
    laws = config.problem.run.laws
    pairs = [law for law in laws if law in ("together", "delayed")]
    helpers = [_assistance(context)] if "assisted" in laws or not pairs else []
    return [*helpers, *(_sides(context, delayed="delayed" in pairs) if pairs else ())]


def _assistance(context: Precomputed) -> ExportedController:
    problem = context.problem
    helper = assistance_of(context, solver=FUSED, backup=FUSED)
    if isinstance(helper, PathAssistance):
        trial = simulate_trial(scene_of(context), Assisted(helper), number=0, seed=problem.task.seed)
        return exported_path_assistance(helper, trial["_hand"], title=problem.title)
    law = Listening(assisted_law(context, helper), helper)
    trial = simulate_trial(scene_of(context), law, number=0, seed=problem.task.seed)
    offset = law.offsets if problem.mode == "hold" else None
    return exported_assistance(helper, trial["_hand"], title=problem.title, fields=context.fields[1:], offset=offset)


def _sides(context: Precomputed, *, delayed: bool) -> Sequence[ExportedController]:
    problem = context.problem
    delay = problem.helper.delay_s if delayed else 0.0
    both = Overheard(*sides_of(context, solver=FUSED), delay=delay)
    law = together_of(both, context)
    simulate_trial(scene_of(context), law, number=0, seed=problem.task.seed)
    hands, received = np.array(both.hands), list(zip(*both.received, strict=True))
    helper, participant = sides_of(context, solver=FUSED, backup=FUSED)
    return (
        exported_helper_side(helper, hands[:, 0], received[0], title=problem.title),
        exported_participant_side(participant, hands[:, 1], received[1], title=problem.title),
    )
