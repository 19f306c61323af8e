"""Objects that a scenario's trials need from its problem file: workspaces, reference, fields, and intention."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from rehab_opt.control.gate import Mode
from rehab_opt.errors import ConfigurationError, ProblemFileError
from rehab_opt.field.demonstration import Demonstration
from rehab_opt.field.potential import PotentialField
from rehab_opt.measures.path import path_length
from rehab_opt.plants.intention import Intention, held, nearest_next, reached, traced
from rehab_opt.recordings.recording import size_note
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.outcome import Array, Progress, with_progress
from rehab_opt.session.participant import placed_recording
from rehab_opt.session.refusals import refused_as
from rehab_opt.session.scenario.demonstrated import learnt
from rehab_opt.session.scenario.problem import THERAPY, ScenarioProblem
from rehab_opt.session.systems import NotMet
from rehab_opt.session.workspaces import reached as sets
from rehab_opt.workspace.controller_map import ControllerMap
from rehab_opt.workspace.mapping import WorkspaceMap
from rehab_opt.workspace.region import Workspace

SHORTEST = 1e-3
"""[m] Least length of a path."""


def _given_path(config: ProblemFile[ScenarioProblem]) -> tuple[Array | None, list[str]]:
    """The task's points (N, 2) [m] in the robot's frame (None if demonstrations define them), and notes."""
    task, arm = config.problem.task, config.problem.arm
    if task.points_m is not None:
        points, notes = np.array(task.points_m), []
    elif task.recording is None:
        return None, []
    else:
        assert task.placement is not None
        recording, placed = placed_recording(
            config, task.recording, task.placement, side=arm.side, rate=task.record_rate_hz, keys="task."
        )
        points = placed[:, :2]
        notes = [f"{recording.file}: {note}" for note in (*recording.notes, size_note(recording))]
    if config.problem.mode != "hold" and not (length := path_length(points)) >= SHORTEST:
        key, value = _path_key(config.problem), f"a path of {1e3 * length:.3g} mm"
        raise ProblemFileError(config.file, key, value, "1 mm or more")
    return sets.placement_of(arm).to_robot(points), notes


def refuse_outside(config: ProblemFile[ScenarioProblem], path: Array, where: Workspace) -> None:
    """Refuse a path (N, 2) [m], in the robot's frame, that leaves the workspace `where`: the arm cannot follow it."""
    away = np.asarray(where.distance(path))
    worst = int(np.argmax(away))
    if not away[worst] <= where.accuracy:
        key = _path_key(config.problem)
        value = f"a point {1e3 * away[worst]:.1f} mm outside, at {np.round(path[worst], 4).tolist()} m (robot's frame)"
        low_x, low_y, high_x, high_y = where.polygon.bounds
        expected = (
            f"points that the arm reaches: between {low_x:.3f} and {high_x:.3f} m along x, {low_y:.3f} and "
            f"{high_y:.3f} m along y, within the outline"
        )
        raise ProblemFileError(config.file, key, value, expected)


def _path_key(problem: ScenarioProblem) -> str:
    task = problem.task
    if task.points_m is not None:
        return "task.points_m"
    return "task.demonstrations" if task.recording is None else "task.placement"


@dataclass(frozen=True, eq=False)
class Precomputed:
    """Workspaces, reference, fields and intention of a problem file; all positions are in the robot's frame.

    Parameters
    ----------
    comfortable, reachable : W_c and W_r.
    reference : (N, 2) [m] path, or points in the order in which they are held.
    demonstrated, workspace_map : (N, 2) [m] path in W_r that was mapped to the reference, and the map; or None.
    fields : fields of the assistance: one, or one for each point to hold.
    numbers : stiffness S [N/m], width sigma [m] and damping D [N s/m], from the file or learnt. drag : k1 [N/m].
    shown : the demonstrations that the field was learnt from.
    """

    config: ProblemFile[ScenarioProblem]
    comfortable: Workspace
    reachable: Workspace
    reference: Array
    demonstrated: Array | None
    workspace_map: ControllerMap | None
    fields: tuple[PotentialField, ...]
    numbers: Mapping[str, Any]
    drag: float
    shown: tuple[Demonstration, ...]
    intention: Intention
    notes: tuple[str, ...]

    @property
    def problem(self) -> ScenarioProblem:
        """The content of the file."""
        return self.config.problem

    @property
    def mode(self) -> Mode:
        """The mode of the scenario, such as "follow"."""
        return self.config.problem.mode

    @property
    def follows_path(self) -> bool:
        """Whether the assistance is `PathAssistance`, not a field."""
        return self.mode == "follow" and not self.drag


def precompute(config: ProblemFile[ScenarioProblem], *, progress: Progress) -> Precomputed:
    """Compute workspaces, map, field and intention."""
    problem = config.problem
    path, notes = _given_path(config)
    led = learnt(config, path)
    if led is not None:
        path = led.field.paths[0].points
        notes += led.notes
    assert path is not None
    there: dict[str, Workspace] = {}
    for name in with_progress(progress, "workspaces", ("comfortable", "reachable")):
        found = sets.reached(problem.arm, getattr(problem.arm, name), file=config.file, key="arm").workspace
        if found.empty:
            raise ProblemFileError(config.file, f"arm.{name}", "an empty workspace", found.reason)
        there[name] = found
    comfortable, reachable = there["comfortable"], there["reachable"]
    refuse_outside(config, path, reachable)
    robot, (low, high) = problem.robot, np.array(comfortable.polygon.bounds).reshape(2, 2)
    if not (np.all(low >= robot.lower_m) and np.all(high <= robot.upper_m)):  # the shoulder is placed wrongly
        value = f"comfortable workspace from {np.round(low, 3).tolist()} to {np.round(high, 3).tolist()} m"
        expected = f"within the robot's stops {robot.lower_m} to {robot.upper_m}"
        raise ProblemFileError(config.file, "arm.shoulder_m", value, expected)
    demonstrated = workspace_map = None
    if problem.mode not in THERAPY and problem.task.mapped:
        progress("map", 0, 1)
        workspace_map = _safe_map(config, reachable, comfortable)
        demonstrated, path = path, np.array([workspace_map.image(point) for point in path])
        progress("map", 1, 1)
    elif problem.mode not in THERAPY:
        refuse_outside(config, path, comfortable)
    if problem.mode == "hold":
        path = nearest_next(path)
    if led is None:
        numbers, drag = problem.field.arguments("stiffness_N_m", "width_mm", "damping_Ns_m"), problem.field.drag_N_m
        with refused_as(config.file, "field, {}".format):
            fields = _fields(problem, path, numbers)
    else:
        fields, drag = (led.field,), led.fit.parameters["drag"]
        numbers = {name: led.fit.parameters[name] for name in ("stiffness", "damping")} | {"width": led.field.width}
    intention = _intention(problem, path)
    if problem.mode in THERAPY and np.all(comfortable.contains(intention.places)):
        notes.append(NotMet("the whole intended motion is within W_c (arm.comfortable), where the force is zero"))
    return Precomputed(
        config=config,
        comfortable=comfortable,
        reachable=reachable,
        reference=path,
        demonstrated=demonstrated,
        workspace_map=workspace_map,
        fields=fields,
        numbers=numbers,
        drag=drag,
        shown=() if led is None else led.shown,
        intention=intention,
        notes=tuple(notes),
    )


def _safe_map(config: ProblemFile[ScenarioProblem], source: Workspace, target: Workspace) -> ControllerMap:
    try:
        return WorkspaceMap.between(source, target).for_controller()
    except ConfigurationError as refused:
        value, expected = f"{refused.argument}: {refused.value}", refused.expected
        raise ProblemFileError(config.file, "task.mapped", value, expected) from refused


def _fields(problem: ScenarioProblem, path: Array, numbers: Mapping[str, Any]) -> tuple[PotentialField, ...]:
    if problem.mode == "hold":
        return tuple(PotentialField(point[None, :], **numbers) for point in path)
    if problem.mode == "resist":
        drag = problem.field.resistance_N / (2 * path_length(path))  # resistance_N is the force at the path's end
        return (PotentialField(path, drag=drag, drag_along="travelled", **numbers),)
    rests = problem.mode == "assist"  # in the other modes, the hand does not come to rest at the path's end
    return (PotentialField(path, drag=problem.field.drag_N_m, rest_on_target=rests, **numbers),)


def _intention(problem: ScenarioProblem, path: Array) -> Intention:
    task, dt = problem.task, 1 / problem.run.rate_hz
    if problem.mode == "hold":
        return held(path, move=task.movement_s, dwell=task.dwell_s, dt=dt)
    if problem.mode == "follow":
        return traced(path, seconds=task.movement_s, rest=task.rest_s, dt=dt)
    if task.start_m is not None:
        start = sets.placement_of(problem.arm).to_robot(np.array(task.start_m))
        path = np.vstack((start, path))
    return reached(path, seconds=task.movement_s, rest=task.rest_s, dt=dt)
