"""Helper and participant that go into C, with little energy and two small workspaces of other shapes."""

from __future__ import annotations

from collections import deque
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from shapely import Polygon

from rehab_opt.control.bilateral_sides import FromHelper, FromParticipant, HelperSide, ParticipantSide
from rehab_opt.export.controllers.bilateral_sides import exported_helper_side, exported_participant_side
from rehab_opt.export.export_c import written_files
from rehab_opt.plants.intention import traced
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.scenario.precomputed import Precomputed
from rehab_opt.session.scenario.problem import ScenarioProblem
from rehab_opt.workspace.controller_map import ControllerMap
from rehab_opt.workspace.mapping import WorkspaceMap
from rehab_opt.workspace.region import Workspace
from tests.workspace.mapped import shape

DT = 1e-3
SIDES = ("helper_side", "participant_side")
HELPER = np.array([0.50, 0.20])
"""In the helper's workspace."""
TURN = np.linspace(0.0, 2 * np.pi, 61)[:-1]
EGG = np.array([-0.1, 0.4]) + np.column_stack([0.04 * np.cos(TURN) * (1 + 0.1 * np.cos(2 * TURN)), 0.03 * np.sin(TURN)])
BOUNDS: dict[str, Any] = {
    "dt": DT, "energy_budget": 0.2, "slew_limit": 400.0, "velocity_lag": 0.02, "exchange": 50.0, "backup": "qrqp",
}  # fmt: skip


@cache
def participants() -> Workspace:
    return Workspace(Polygon(EGG), accuracy=0.0)


@cache
def workspace_map() -> ControllerMap:
    return WorkspaceMap.between(shape("blob"), participants()).for_controller()


def sides() -> tuple[HelperSide, ParticipantSide]:
    """Made new, with the stages that C has."""
    return (
        HelperSide(workspace_map(), return_stiffness=300.0, **BOUNDS),
        ParticipantSide(workspace_map(), comfortable=participants(), stiffness=1500.0, **BOUNDS),
    )


def exported_side_to(folder: Path, name: str) -> Path:
    """Folder of the C files of a side, which repeats its part of what both do for three seconds."""
    sent, said, answered = sides(), deque([None] * 11), deque([None] * 11)  # a message takes 0.01 s and a tick
    received: list[tuple[FromParticipant | None, FromHelper | None]] = []
    t = np.minimum(DT * np.arange(3000), 2.5)  # at rest where the stamps have a gap, which energy must last for
    hands = HELPER + np.column_stack([0.05 * np.sin(3 * t), 0.06 * np.cos(4 * t)])  # and out of it
    drawn = np.array([workspace_map().image(hand) for hand in hands]) + 0.004 * np.sin(4 * np.pi * t)[:, None]
    for hand, other in zip(hands, drawn, strict=True):
        received.append((answered.popleft(), said.popleft()))
        for side, x, hears, says in zip(sent, (hand, other), received[-1], (said, answered), strict=True):
            says.append(side.step(x, hears)[1])
    helper, participant = sides()
    if name == "helper_side":
        controller = exported_helper_side(helper, hands, [each[0] for each in received], title="a pair")
    else:
        controller = exported_participant_side(participant, drawn, [each[1] for each in received], title="a pair")
    written_files({folder: controller}, folder, problem="a library call")
    return folder


def broken(message: FromHelper | FromParticipant, rng: np.random.Generator) -> FromHelper | FromParticipant:
    """The same with a number that cannot be meant."""
    numbers = list(message)
    numbers[rng.integers(len(numbers) - 1)] = float(rng.choice([np.nan, np.inf, -np.inf, 1e6, -3.0, 1e9]))
    return type(message)(*numbers)  # type: ignore[arg-type]


def ready_for(config: ProblemFile[ScenarioProblem]) -> Precomputed:
    """A scenario of these workspaces: a helper who goes round in theirs."""
    problem, turn = config.problem, np.linspace(0.0, 2 * np.pi, 100)
    there = HELPER + 0.03 * np.column_stack([np.cos(turn), np.sin(turn)])
    path, task = np.array([workspace_map().image(point) for point in there]), problem.task
    intention = traced(path, seconds=task.movement_s, rest=task.rest_s, dt=1 / problem.run.rate_hz)
    return Precomputed(
        config=config,
        comfortable=participants(), reachable=shape("blob"), reference=path, demonstrated=there,
        workspace_map=workspace_map(),
        fields=(), numbers={"stiffness": 1500.0, "width": 0.01, "damping": 10.0}, drag=0.0, shown=(),
        intention=intention, notes=(),
    )  # fmt: skip
