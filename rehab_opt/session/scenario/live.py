"""A scenario of therapy or help, live: the person means what the file says, or what somebody points at."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.control.command import Command
from rehab_opt.errors import ProblemFileError
from rehab_opt.plants.plant import Measurement
from rehab_opt.plants.touched import TouchedPlant
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.live.bodies import BLUE, GREEN, GREY, ORANGE, PURPLE, screen
from rehab_opt.session.live.problem import LiveControl, LiveInputs, LiveProblem
from rehab_opt.session.scenario.intention import Pace
from rehab_opt.session.scenario.laws import Assisted
from rehab_opt.session.scenario.prepared import Prepared, prepared
from rehab_opt.session.scenario.problem import ScenarioProblem
from rehab_opt.session.scenario.run import law_of, scene_of
from rehab_opt.session.scenario.simulated_person import PersonAtRobot
from rehab_opt.workspace.region import Workspace

__all__ = ["LiveScenario"]

Array = NDArray[np.float64]

ARROWS = 15
"""Of the field across the picture."""
WEAK = 0.02
"""Share of the largest force of the field below which no arrow is drawn."""


class LiveScenario(LiveProblem):
    """`Assistance` or `PathAssistance` with the file's field, person and robot."""

    controls = frozenset({"target", "push", "faults"})

    def __init__(self, loaded: ProblemFile[ScenarioProblem], *, solver: str | None) -> None:
        problem = loaded.problem
        if "assisted" not in problem.run.laws:
            expected = 'a file whose laws have "assisted": a helper\'s hand does not go live yet'
            raise ProblemFileError(loaded.file, "run.laws", problem.run.laws, expected)
        self._loaded, self._solver = loaded, solver
        self.title, self.dt = problem.title, 1 / problem.run.rate_hz
        self.names, self.force = ("x", "y"), 2
        self.layout = {"hand": 2, "meant": 2, "force": 2, "wanted": 2, "exerted": 2, "energy": 1}

    @cached_property
    def ready(self) -> Prepared:
        """Workspaces, fields and the person's intention."""
        return prepared(self._loaded, progress=lambda *_: None)

    def control(self) -> LiveControl:
        """The law "assisted" of `rehab-opt run` at the person and robot of its trials."""
        ready, problem = self.ready, self._loaded.problem
        law = law_of("assisted", self._loaded, ready, solver=self._solver)
        assert isinstance(law, Assisted)
        scene = scene_of(self._loaded, ready)
        plant = PersonAtRobot(scene.person, ready.comfortable, scene.robot, dt=self.dt, seed=problem.task.seed)
        return _Helping(law, plant, ready)

    def scene(self) -> dict[str, Any]:
        """W_c, W_r, the reference, the field's pull on a hand at rest."""
        ready, said = self.ready, self._loaded.problem.assistance
        reference = _flat(ready.reference)
        around = np.vstack([reference, _flat(np.array(ready.comfortable.polygon.bounds).reshape(2, 2))])
        low, high = around.min(axis=0), around.max(axis=0)
        reach = 1.15 * float((high - low).max())
        return {
            **super().scene(),
            "planar": True,
            "springy": True,
            "handled": True,
            "lines": [
                *({"points": each, "colour": GREEN} for each in _outlines(ready.comfortable)),
                *({"points": each, "colour": GREY} for each in _outlines(ready.reachable)),
                *([] if self._loaded.problem.mode == "hold" else [{"points": reference.tolist(), "colour": BLUE}]),
            ],
            "capsules": [[*each, *each, 0.004, BLUE] for each in reference.tolist()]
            if self._loaded.problem.mode == "hold"
            else [],
            "arrows": _arrows(ready, low, high, reach),
            "arrow": 0.3 * reach / said.force_limit_N,
            "legend": [
                [GREEN, "comfortable"], [GREY, "reachable"], [PURPLE, "the robot's force"], [ORANGE, "the person's"],
            ],
            "noise": "mm",
            "plots": [
                {"name": "the robot's force", "unit": "N", "line": said.force_limit_N},
                {"name": "desired force", "unit": "N", "least": 1.0},
                {"name": "the person's force", "unit": "N", "least": 10.0},
                {"name": "hand from the task", "unit": "mm", "least": 5.0},
                {"name": "energy left", "unit": "J"},
            ],
            "centre": (0.5 * (low + high)).tolist(),
            "reach": reach,
            "spring": 400.0,
            "push": 25.0,
            "screen": screen(reference),
        }  # fmt: skip

    def frame(self, shown: Mapping[str, Array]) -> dict[str, Any]:
        """Hand, what is meant, both forces."""
        hand = [*shown["hand"].tolist(), 0.0]
        sizes = [float(np.linalg.norm(shown[name])) for name in ("force", "wanted", "exerted")]
        away = 1e3 * float(np.linalg.norm(shown["hand"] - shown["meant"]))
        forces = ((shown["force"], PURPLE), (shown["exerted"], ORANGE))
        return {
            "handles": {"target": [*shown["meant"].tolist(), 0.0], "hand": hand},
            "arrows": [[*hand, *force.tolist(), 0.0, colour] for force, colour in forces],
            "numbers": [*sizes, away, float(shown["energy"][0])],
        }


class _Helping(LiveControl):
    def __init__(self, law: Assisted, person: PersonAtRobot, ready: Prepared) -> None:
        super().__init__(TouchedPlant(person), ready.intention.places[0])
        self._law, self._person, self._ready = law, person, ready
        self._meant: Array = ready.intention.places[0]
        self._told, self._force = np.zeros(2), np.zeros(2)
        self._trial, self._aimed = 0, -1
        self._begin()

    def step(self, inputs: LiveInputs, seen: Measurement) -> Command:
        intention, truth = self._ready.intention, self.plant.truth
        self._person.aim = (*inputs.target[:2], 0.0, 0.0) if inputs.dragged else None
        if inputs.enable:
            now, goes_on = self._pace.meant(*truth.position.tolist())
            self._meant = intention.places[now]
            if not inputs.dragged:
                velocity = intention.velocities[now] if goes_on else np.zeros(2)
                self._person.aim = (*self._meant.tolist(), *velocity.tolist())
            if intention.goal[now] != self._aimed:
                self._aimed = int(intention.goal[now])
                self._law.aim(self._aimed)
            if self._pace.over:
                self._begin()
        command = self._law.command(*seen.position.tolist(), enable=inputs.enable, stamp=self.stamp(seen))
        self._force = command.value
        return command

    def shown(self) -> dict[str, ArrayLike]:
        return {
            "hand": self.plant.truth.position, "meant": self._meant, "force": self._force, "wanted": self._law.wanted,
            "exerted": self._person.exerted, "energy": self._law.energy_left,
        }  # fmt: skip

    def _begin(self) -> None:
        """The next trial, from where the hand is: its tank is not filled up before it is due."""
        person = self._person.person
        self._pace, self._aimed = Pace(self._ready.intention, person.aims, ahead=person.ahead), -1
        if self._trial == 0:
            self._law.start(0)
        self._trial += 1


def _flat(points: Array) -> Array:
    """(N, 3) of places (N, 2) in the plane."""
    return np.column_stack([points, np.zeros(len(points))]).round(5)


def _outlines(workspace: Workspace) -> list[list[list[float]]]:
    polygon = workspace.polygon.simplify(1e-3)
    rings = [ring for each in getattr(polygon, "geoms", [polygon]) for ring in (each.exterior, *each.interiors)]
    return [_flat(np.array(ring.coords)[:, :2]).tolist() for ring in rings]


def _arrows(ready: Prepared, low: Array, high: Array, reach: float) -> list[list[Any]]:
    """The pull of the field (its first, where there are many) on a hand at rest; not gated."""
    middle, half = 0.5 * (low + high)[:2], 0.5 * reach
    axis = np.linspace(-half, half, ARROWS)
    places = [middle + np.array((x, y)) for x in axis for y in axis]
    forces = [np.array(ready.fields[0].pull(*place.tolist())) for place in places]
    largest = max(float(np.linalg.norm(force)) for force in forces) or 1.0
    return [
        [*place.round(5).tolist(), 0.0, *(0.06 * reach * force / largest).round(5).tolist(), 0.0, "#a9b8c6"]
        for place, force in zip(places, forces, strict=True)
        if np.linalg.norm(force) > WEAK * largest
    ]
