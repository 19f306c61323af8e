"""A problem file run in time, and run again from the log that it left."""

from __future__ import annotations

import math
import posixpath
import tempfile
import tomllib
from collections.abc import Callable
from pathlib import Path, PurePosixPath
from typing import Any, cast

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
from rehab_opt.plants.plant import Measurement, Truth
from rehab_opt.plants.touched import TouchedPlant
from rehab_opt.recordings.data_folder import PREFIX
from rehab_opt.session.files import ProblemFile, load_problem, recording_path
from rehab_opt.session.live.problem import AT_REST, NOWHERE, LiveControl, LiveInputs, LiveProblem
from rehab_opt.session.run import live_problem
from rehab_opt.session.systems import system_named

__all__ = ["BUTTONS", "control_again", "decide_of", "files_of", "logged_problem", "replay_problem", "run_in_time"]

TEXT = "problem.toml"
"""What a problem's own text is called in a log."""
HOME = "folder"
"""Of what is said about a log: where the problem's text lies among its other files."""
BUTTONS = {"switch": 1, "gripper": 2}


def decide_of(
    problem: LiveProblem, control: LiveControl, *, then: Callable[[Tick, Command], None] = lambda *_: None
) -> Decide:
    """The controller of a problem as a loop calls it, following the problem's own reference where nobody operates.

    `then` is told each tick and its command.
    """
    plant = control.plant

    def decide(tick: Tick) -> Command:
        if tick.operator is not None:
            inputs = _inputs_of(tick.operator, enable=tick.enabled)
        else:
            inputs = problem.untouched(tick.time) if tick.enabled else AT_REST
        plant.frozen, plant.noise, plant.delay = inputs.frozen, inputs.noise, inputs.delay
        command = control.step(inputs, tick.seen)
        then(tick, command)
        return command

    return decide


def _inputs_of(record: np.void, *, enable: bool) -> LiveInputs:
    """What the operator wants; whether the dead-man is held is the loop's to say."""
    target, frozen, buttons = record["target"][0, :3, 3], np.flatnonzero(record["frozen"]), int(record["buttons"])
    return LiveInputs(
        enable=enable,
        target=NOWHERE if math.isnan(target[0]) else tuple(target.tolist()),
        push=tuple(record["push"].tolist()),
        stick=tuple(record["stick"].tolist()),
        switch=bool(buttons & BUTTONS["switch"]),
        gripper=bool(buttons & BUTTONS["gripper"]),
        frozen=int(frozen[0]) if frozen.size else -1,
        noise=float(record["noise"]),
        delay=float(record["delay"]),
    )


def run_in_time(
    loaded: ProblemFile[Any], *, seconds: float, log: Path | None = None, fifo: int | None = None, **options: str | None
) -> tuple[LoopReport, int]:
    """Run a problem at its rate, on a simulated robot, with nobody at it.

    Parameters
    ----------
    seconds : how long. log : file of the log, None for none. fifo : see `Loop`. options : as of `live_problem`.

    Returns
    -------
    How it went, and how many records the log lost.

    Raises
    ------
    ConfigurationError, ProblemFileError : as `live_problem`.
    """
    problem = live_problem(loaded, **options)
    control = problem.control()
    control.plant.reset(control.start)
    decide = decide_of(problem, control)
    if log is None:
        return Loop(control.plant, decide, sent=control.sent, fifo=fifo).run(seconds=seconds), 0
    about = {name: value for name, value in options.items() if value is not None} | {HOME: str(_home(loaded))}
    with SharedRing.create(state_layout(problem.encoders, force=problem.force), depth=DEPTH) as ring:
        written = Log(ring, log, names=problem.names, problem=loaded.name, files=files_of(loaded), about=about)
        with written:
            loop = Loop(control.plant, decide, state=ring, watches=(written.watch,), sent=control.sent, fifo=fifo)
            report = loop.run(seconds=seconds)
        return report, written.lost


class _LoggedRobot:
    """A robot that was where a log says; nothing moves it."""

    def __init__(self, dt: float) -> None:
        self.dt, self.frozen, self.noise, self.delay = dt, -1, 0.0, 0.0

    def show(self, record: np.void) -> None:
        """A tick."""
        stamp, time = float(record["stamp"]), float(record["time"])
        self.measured = Measurement(stamp, *(record[each].copy() for each in ("position", "velocity", "force")))
        true = (record[each].copy() for each in ("true_position", "true_velocity", "effort", "true_force"))
        self.truth = Truth(time, *true)


def logged_problem(logged: Logged, folder: Path) -> LiveProblem:
    """The problem that a log is of, its files written into an empty folder.

    Raises
    ------
    ConfigurationError : the log is of a program of its own, whose controller only that program has: see `replayed`.
    ProblemFileError : what the log holds of the problem cannot be used.
    """
    if TEXT not in logged.files:
        raise ConfigurationError(
            "LOG", logged.about.get("problem", ""), "the log of a problem file, by `rehab-opt loop`"
        )
    home = PurePosixPath(logged.about.get(HOME, ""))
    for name, data in logged.files.items():
        place = home / name if name == TEXT else PurePosixPath(name)
        if place.is_absolute() or ".." in place.parts:  # a log may come from anybody
            raise ProblemFileError("the log", "attachment", name, "the name of a file beside the problem's")
        path = folder / place
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    loaded = load_problem(str(folder / home / TEXT))
    return live_problem(loaded, **{name: logged.about.get(name) for name in ("plant", "solver")})


def control_again(
    problem: LiveProblem, *, then: Callable[[Tick, Command], None] = lambda *_: None
) -> tuple[LiveControl, Decide, Callable[[np.void], None]]:
    """A problem's control on a robot that is where a log says: it, how it is asked, and what is told each record."""
    control, robot = problem.control(), _LoggedRobot(problem.dt)
    decide = decide_of(problem, control, then=then)
    control.plant = cast(TouchedPlant, robot)
    return control, decide, robot.show


def replay_problem(logged: Logged) -> Replay:
    """Compute the session of a problem again; raises as `logged_problem`."""
    with tempfile.TemporaryDirectory() as folder:
        _, decide, show = control_again(logged_problem(logged, Path(folder)))
        return replayed(logged.records, decide, before=show)


def files_of(loaded: ProblemFile[Any]) -> dict[str, bytes]:
    """The problem's text, and the recordings, robot files, URDF or MJCF beside it that it names, by their places.

    What lies in the data folder stays there: it is other people's.
    """
    files, home = {TEXT: loaded.path.read_bytes()}, _home(loaded)
    for needed in system_named(loaded.problem.system).recordings(loaded.problem):
        if needed.reference.startswith(PREFIX):
            continue
        path = recording_path(loaded, needed.reference, key=needed.key)
        place = home / needed.reference
        named = {place: path}
        if path.suffix == ".toml":
            told = tomllib.loads(path.read_text(encoding="utf-8"))
            named |= {place.parent / told[key]: path.parent / told[key] for key in ("urdf", "mjcf") if key in told}
        files |= {posixpath.normpath(each): file.read_bytes() for each, file in named.items()}
    return files


def _home(loaded: ProblemFile[Any]) -> PurePosixPath:
    """The problem's own folder below the one in which all of its files are."""
    needed = system_named(loaded.problem.system).recordings(loaded.problem)
    above = max((PurePosixPath(each.reference).parts.count("..") for each in needed), default=0)
    return PurePosixPath(*loaded.path.resolve().parent.parts[-above:]) if above else PurePosixPath()
