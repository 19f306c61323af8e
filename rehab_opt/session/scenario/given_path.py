"""The path or the points that a problem file gives, and where they may lie."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rehab_opt.errors import ProblemFileError
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.placed_recording import placed_recording
from rehab_opt.session.scenario.problem import ScenarioProblem
from rehab_opt.session.workspaces import reached as sets
from rehab_opt.workspace.region import Workspace

__all__ = ["given_path", "refuse_outside"]

Array = NDArray[np.float64]

SHORTEST = 1e-3
"""[m] A path is longer."""


def given_path(loaded: ProblemFile[ScenarioProblem]) -> tuple[Array | None, list[str]]:
    """The task's points (N, 2) [m] in the robot's frame, and what was noticed; None where demonstrations show them.

    Raises
    ------
    ProblemFileError : the recording cannot be used, a path is none.
    """
    task, arm = loaded.problem.task, loaded.problem.arm
    if task.points_m is not None:
        points, notes = np.array(task.points_m), []
    elif task.recording is None:
        return None, []
    else:
        assert task.placement is not None
        recording, placed = placed_recording(
            loaded, task.recording, task.placement, side=arm.side, rate=task.record_rate_hz, keys="task."
        )
        points, notes = placed[:, :2], [f"{recording.file}: {note}" for note in recording.notes]
    length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    if loaded.problem.mode != "hold" and not length >= SHORTEST:
        key, value = _path_key(loaded.problem), f"a path of {1e3 * length:.3g} mm"
        raise ProblemFileError(loaded.file, key, value, "1 mm or more")
    return sets.placement_of(arm).to_robot(points), notes


def refuse_outside(loaded: ProblemFile[ScenarioProblem], path: Array, where: Workspace) -> None:
    """A person is led nowhere where the arm does not go: a path (N, 2) [m], robot's frame, leaves `where`.

    Raises
    ------
    ProblemFileError : a point lies outside.
    """
    away = np.asarray(where.distance(path))
    worst = int(np.argmax(away))
    if not away[worst] <= where.accuracy:
        key = _path_key(loaded.problem)
        value = f"a point {1e3 * away[worst]:.1f} mm outside, at {np.round(path[worst], 4).tolist()} m (robot's frame)"
        low_x, low_y, high_x, high_y = where.polygon.bounds
        expected = (
            f"points that the arm reaches: between {low_x:.3f} and {high_x:.3f} m along x, {low_y:.3f} and "
            f"{high_y:.3f} m along y, within the outline"
        )
        raise ProblemFileError(loaded.file, key, value, expected)


def _path_key(problem: ScenarioProblem) -> str:
    """The key that says where the path lies."""
    task = problem.task
    if task.points_m is not None:
        return "task.points_m"
    return "task.demonstrations" if task.recording is None else "task.placement"
