"""A problem file run in time, and run again from the log that it left."""

from __future__ import annotations

import tempfile
import tomllib
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

import numpy as np

from rehab_opt.control.command import Command
from rehab_opt.errors import ConfigurationError, ProblemFileError
from rehab_opt.loop.log import DEPTH, Log
from rehab_opt.loop.logged import Logged
from rehab_opt.loop.loop import Loop
from rehab_opt.loop.records import state_layout
from rehab_opt.loop.replay import Replay, replayed
from rehab_opt.loop.report import LoopReport
from rehab_opt.loop.shared_ring import SharedRing
from rehab_opt.loop.tick import Decide, Tick
from rehab_opt.plants.plant import Plant
from rehab_opt.session.files import ProblemFile, load_problem, recording_path
from rehab_opt.session.pose_tracking.problem import PoseTracking
from rehab_opt.session.systems import system_named

__all__ = ["LoopedProblem", "files_of", "looped_problem", "replay_problem", "run_in_time"]

TEXT = "problem.toml"
"""What a problem's own text is called in a log."""


class LoopedProblem(NamedTuple):
    """What a loop needs of a problem."""

    plant: Plant
    """At rest where the problem starts."""
    decide: Decide
    """Its controller, following the problem's reference, or the operator's target where there is one."""
    names: tuple[str, ...]
    """Of the joints."""


def looped_problem(loaded: ProblemFile[Any], *, plant: str | None = None, solver: str | None = None) -> LoopedProblem:
    """Controller and plant of `rehab-opt run`, new.

    Raises
    ------
    ConfigurationError : problems of this kind do not run in time yet; an option that cannot be used.
    ProblemFileError : a value of the file cannot be used.
    """
    from rehab_opt.session.plant.making import joint_plant, on_plant  # noqa: PLC0415  (loads solvers)
    from rehab_opt.session.pose_tracking.robot import circle_reference, robot_at_start, tracker_of  # noqa: PLC0415

    if not isinstance(loaded.problem, PoseTracking):
        expected = "a problem of system 'pose_tracking', the only ones that run in time so far"
        raise ConfigurationError("FILE", loaded.name, expected)
    problem: PoseTracking = on_plant(loaded, plant).problem
    robot, start = robot_at_start(loaded)
    tracker = tracker_of(problem, robot, file=loaded.file, solver=solver)
    dt, still = 1 / problem.tracker.rate_hz, np.zeros(6)
    times = np.arange(0.0, problem.circle.duration_s, dt)
    poses, twists = circle_reference(robot.pose(start), problem.circle, times)

    def decide(tick: Tick) -> Command:
        at, pose = tick.number % len(times), None if tick.operator is None else tick.operator["target"][0]
        if pose is None or not np.isfinite(pose).all():
            return tracker.step(tick.seen.position, poses[at], twists[at], enable=tick.enabled, stamp=tick.seen.stamp)
        return tracker.step(tick.seen.position, pose, still, enable=tick.enabled, stamp=tick.seen.stamp)

    moved = joint_plant(problem.plant, robot, dt)
    moved.reset(start)
    return LoopedProblem(moved, decide, tuple(robot.names))


def run_in_time(
    loaded: ProblemFile[Any],
    *,
    seconds: float,
    plant: str | None = None,
    solver: str | None = None,
    log: Path | None = None,
    fifo: int | None = None,
) -> tuple[LoopReport, int]:
    """Run a problem at its rate, on a simulated robot, with nobody at it.

    Parameters
    ----------
    seconds : how long. plant, solver : as of `rehab-opt run`. log : file of the log, None for none. fifo : see `Loop`.

    Returns
    -------
    How it went, and how many records the log lost.
    """
    looped = looped_problem(loaded, plant=plant, solver=solver)
    n, force = len(looped.names), looped.plant.measured.force.size
    if log is None:
        return Loop(looped.plant, looped.decide, fifo=fifo).run(seconds=seconds), 0
    options = {name: value for name, value in (("plant", plant), ("solver", solver)) if value is not None}
    with SharedRing.create(state_layout(n, force=force), depth=DEPTH) as ring:
        written = Log(ring, log, names=looped.names, problem=loaded.name, files=files_of(loaded), about=options)
        with written:
            report = Loop(looped.plant, looped.decide, state=ring, watches=(written.watch,), fifo=fifo).run(
                seconds=seconds
            )
        return report, written.lost


def replay_problem(logged: Logged) -> Replay:
    """Compute the session of a problem again.

    Raises
    ------
    ConfigurationError : the log is of a program of its own, whose controller only that program has: see `replayed`.
    ProblemFileError : what the log holds of the problem cannot be used.
    """
    if TEXT not in logged.files:
        raise ConfigurationError(
            "LOG", logged.about.get("problem", ""), "the log of a problem file, by `rehab-opt loop`"
        )
    with tempfile.TemporaryDirectory() as folder:
        for name, data in logged.files.items():
            place = PurePosixPath(name)
            if place.is_absolute() or ".." in place.parts:  # a log may come from anybody
                raise ProblemFileError("the log", "attachment", name, "the name of a file beside the problem's")
            path = Path(folder) / place
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)
        loaded = load_problem(str(Path(folder) / TEXT))
        # The plant is not asked: what it measured is in the log.
        return replayed(logged.records, looped_problem(loaded, plant="ideal", solver=logged.about.get("solver")).decide)


def files_of(loaded: ProblemFile[Any]) -> dict[str, bytes]:
    """The problem's text, and the robot file, URDF or MJCF that it names, by names relative to it."""
    files = {TEXT: loaded.path.read_bytes()}
    for needed in system_named(loaded.problem.system).recordings(loaded.problem):
        path = recording_path(loaded, needed.reference, key=needed.key)
        files[needed.reference] = path.read_bytes()
        told = tomllib.loads(path.read_text(encoding="utf-8"))
        for key in ("urdf", "mjcf"):
            if key in told:
                beside = PurePosixPath(needed.reference).parent / told[key]
                files[str(beside)] = (path.parent / told[key]).read_bytes()
    return files
