"""Live runs of `system = "scenario"`, in which the user may point at the goal."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from rehab_opt.control.arm_ik import ArmIK
from rehab_opt.errors import ProblemFileError
from rehab_opt.plants.plant import Plant
from rehab_opt.session.live.bodies import BLUE, GREEN, GREY, ORANGE, PURPLE, ArmBodies, joint_rows, near_limit, screen
from rehab_opt.session.live.problem import LiveControl, LiveProblem
from rehab_opt.session.outcome import Array
from rehab_opt.session.participant import arm_of
from rehab_opt.session.scenario.controllers import Task, law_of
from rehab_opt.session.scenario.loop import Helping
from rehab_opt.session.scenario.precomputed import Precomputed
from rehab_opt.session.scenario.trials import Law
from rehab_opt.session.workspaces.reached import placement_of, tilt_of
from rehab_opt.workspace.region import Workspace

LIVE: tuple[Law, ...] = ("assisted", "together", "delayed")
"""The live run uses the first of these controllers that the file names."""
ARROWS = 15
"""Number of arrows across the picture."""
THIN = 0.006
"""[m] Radius of the person's arm in the picture."""
WEAK = 0.02
"""Fraction of the field's largest force below which no arrow is drawn."""


class LiveScenario(LiveProblem):
    """`Assistance` or `PathAssistance` with the file's field, person and robot; or a `Bilateral` pair."""

    controls = frozenset({"target", "push", "faults"})

    def __init__(self, task: Task) -> None:
        problem = task.problem
        able = [law for law in LIVE if law in problem.run.laws]
        if not able:
            expected = f"one of {', '.join(LIVE)} among them"
            raise ProblemFileError(task.config.file, "run.laws", problem.run.laws, expected)
        self.task, self._law = task, able[0]
        self.hands = 1 if self._law == "assisted" else 2
        self.title, self.dt = problem.title, 1 / problem.run.rate_hz
        self.names, self.force = ("x", "y"), 2
        self._q: Array | None = None
        self.layout = {"hand": 2, "meant": 2, "force": 2, "desired": 2, "exerted": 2, "energy": 1, "along": 4}

    def control(self, plant: Plant | None = None) -> LiveControl:
        """Closed loop with the file's person and robot, and the controller "assisted" or, without it, a pair."""
        task = self.task
        law, seed = law_of(self._law, task.context, solver=task.solver), task.problem.task.seed
        return Helping(law, task.scene, number=0, seed=seed, endless=True, plant=plant)

    @cached_property
    def _person(self) -> tuple[ArmBodies, ArmIK]:
        """Two results: the arm to draw, in the robot's frame at height zero, and its inverse kinematics."""
        section = self.task.problem.arm
        arm = arm_of(section.side, section.segments, section.reachable, file=self.task.config.file)
        place = placement_of(section).pose
        place[2, 3] = -section.plane_height_m
        arm = replace(arm, base=place @ arm.base)
        return ArmBodies(arm, radius=THIN), ArmIK(arm, handle_tilt=tilt_of(section), compile=False)

    def scene(self) -> dict[str, Any]:
        """W_c, W_r, the reference, and the field's force on a hand at rest."""
        context, said = self.task.context, self.task.problem.assistance
        reference = _flat(context.reference)
        pair, holds = self.hands == 2, context.mode == "hold"
        shown = [] if context.demonstrated is None or not pair else [_flat(context.demonstrated).tolist()]
        wide = context.reachable if pair else context.comfortable
        around = np.vstack([reference, _flat(np.array(wide.polygon.bounds).reshape(2, 2))])
        low, high = around.min(axis=0), around.max(axis=0)
        reach = 1.15 * float((high - low).max())
        return {
            **super().scene(),
            "planar": True,
            "springy": True,
            "handled": True,
            "lines": [
                *({"points": each, "colour": GREEN} for each in _outlines(context.comfortable)),
                *({"points": each, "colour": GREY} for each in _outlines(context.reachable)),
                *([] if holds else [{"points": reference.tolist(), "colour": BLUE}]),
                *({"points": each, "colour": GREY} for each in shown),
            ],
            "capsules": [[*each, *each, 0.004, BLUE] for each in reference.tolist()] if holds else [],
            "arrows": [] if pair else _arrows(context, low, high, reach),
            "led": "the helper's hand" if pair else "the hand",
            "arrow": 0.3 * reach / said.force_limit_N,
            "legend": [
                [GREEN, "comfortable"], [GREY, "reachable"], [PURPLE, "the robot's force"], [ORANGE, "the person's"],
                [GREEN, "the person's arm, red near a limit"],
            ],
            "joints": joint_rows(self._person[0].chain),
            "jointtitle": "The person's joints within their range",
            "noise": "mm",
            "plots": [
                {"name": "the robot's force", "unit": "N", "line": said.force_limit_N},
                {"name": "the helper's robot's force" if pair else "desired force", "unit": "N", "least": 1.0},
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
        """Hand, intended position, both forces, and the person's arm."""
        hand, target = [*shown["hand"].tolist(), 0.0], [*shown["meant"].tolist(), 0.0]
        arrows = [
            [*hand, *shown[name].tolist(), 0.0, colour] for name, colour in (("force", PURPLE), ("exerted", ORANGE))
        ]
        second, goal = shown["desired"], {}
        if self.hands == 2:
            workspace_map, along = self.task.context.workspace_map, shown["along"]
            assert workspace_map is not None
            second, target = along[2:], [*along[:2].tolist(), 0.0]
            goal = {"goal": [*workspace_map.image(along[:2]).tolist(), 0.0]}
            arrows.append([*target, *second.tolist(), 0.0, PURPLE])
        sizes = [float(np.linalg.norm(each)) for each in (shown["force"], second, shown["exerted"])]
        bodies, postures = self._person
        self._q = q = postures.solve(hand, self._q).q
        margins = np.minimum(q - bodies.chain.lower, bodies.chain.upper - q)
        away = 1e3 * float(np.linalg.norm(shown["hand"] - (goal["goal"][:2] if goal else shown["meant"])))
        return {
            "handles": {"target": target, "hand": hand},
            **goal,
            "arrows": arrows,
            "capsules": bodies.capsules(q, [near_limit(each) for each in margins]),
            "joints": q.round(4).tolist(),
            "numbers": [*sizes, away, float(shown["energy"][0])],
        }


def _flat(points: Array) -> Array:
    """Points (N, 3) at height zero from points (N, 2)."""
    return np.column_stack([points, np.zeros(len(points))]).round(5)


def _outlines(workspace: Workspace) -> list[list[list[float]]]:
    polygon = workspace.polygon.simplify(1e-3)
    rings = [ring for each in getattr(polygon, "geoms", [polygon]) for ring in (each.exterior, *each.interiors)]
    return [_flat(np.array(ring.coords)[:, :2]).tolist() for ring in rings]


def _arrows(context: Precomputed, low: Array, high: Array, reach: float) -> list[list[Any]]:
    """Arrows of the first field's force on a hand at rest, without the gate."""
    middle, half = 0.5 * (low + high)[:2], 0.5 * reach
    axis = np.linspace(-half, half, ARROWS)
    places = [middle + np.array((x, y)) for x in axis for y in axis]
    forces = [np.array(context.fields[0].pull(*place.tolist())) for place in places]
    largest = max(float(np.linalg.norm(force)) for force in forces) or 1.0
    return [
        [*place.round(5).tolist(), 0.0, *(0.06 * reach * force / largest).round(5).tolist(), 0.0, "#a9b8c6"]
        for place, force in zip(places, forces, strict=True)
        if np.linalg.norm(force) > WEAK * largest
    ]
