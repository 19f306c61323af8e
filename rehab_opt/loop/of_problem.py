"""Run the problem of a problem file in real time, and replay the log of such a run."""

from __future__ import annotations

import math
import posixpath
import tempfile
import tomllib
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, nullcontext
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.control.command import Command
from rehab_opt.errors import ConfigurationError, ProblemFileError
from rehab_opt.loop import franka, ros2, ur
from rehab_opt.loop.companion import Companion
from rehab_opt.loop.delay import measured_delay
from rehab_opt.loop.gamepad import Gamepad
from rehab_opt.loop.log import DEPTH, Log
from rehab_opt.loop.logged import Logged
from rehab_opt.loop.loop import Loop
from rehab_opt.loop.records import Decide, Tick, operator_layout, state_layout
from rehab_opt.loop.remote import RemoteDevice
from rehab_opt.loop.replay import Replay, replayed
from rehab_opt.loop.report import LoopReport
from rehab_opt.loop.shared_ring import SharedRing
from rehab_opt.plants.plant import Measurement, Truth
from rehab_opt.plants.touched import TouchedPlant
from rehab_opt.recordings.data_folder import PREFIX
from rehab_opt.session.files import ProblemFile, load_problem, recording_path
from rehab_opt.session.live.problem import AT_REST, NOWHERE, LiveControl, LiveInputs, LiveProblem
from rehab_opt.session.run import live_problem
from rehab_opt.session.systems import needed_files

__all__ = [
    "BUTTONS",
    "connected",
    "control_again",
    "control_of",
    "decide_of",
    "delay_of",
    "files_of",
    "log_of",
    "logged_problem",
    "replay_problem",
    "run_in_time",
]

TEXT = "problem.toml"
"""Name of the problem file in a log."""
HOME = "folder"
"""Metadata key of a log; its value is the problem file's folder, relative to the folder of all files in the log."""
BUTTONS = {"switch": 1, "gripper": 2}
"""Bit of each button in the field `buttons` of an operator's record."""
PATIENCE = 2.0
"""Longest time [s] for a gamepad's process to end."""


def decide_of(control: LiveControl, *, then: Callable[[Tick, Command], None] = lambda *_: None) -> Decide:
    """Controller of a problem as a function of a tick; without an operator it follows the problem's own reference.

    `then` is called with each tick and its command.
    """
    plant = control.plant

    def decide(tick: Tick) -> Command:
        if tick.operator is not None:
            inputs = _inputs_of(tick.operator, enable=tick.enabled)
        else:
            inputs = control.untouched(tick.time) if tick.enabled else AT_REST
        if isinstance(plant, TouchedPlant):
            plant.frozen, plant.noise, plant.delay = inputs.frozen, inputs.noise, inputs.delay
        command = control.step(inputs, tick.seen)
        then(tick, command)
        return command

    return decide


def _inputs_of(record: np.void, *, enable: bool) -> LiveInputs:
    """Inputs in an operator's record; `enable` comes from the loop, which checks the dead man's switch."""
    frozen, buttons = np.flatnonzero(record["frozen"]), int(record["buttons"])
    target, helper = (*(_place(each) for each in record["target"]), NOWHERE)[:2]
    return LiveInputs(
        enable=enable,
        target=target,
        helper=helper,
        push=tuple(record["push"].tolist()),
        stick=tuple(record["stick"].tolist()),
        switch=bool(buttons & BUTTONS["switch"]),
        gripper=bool(buttons & BUTTONS["gripper"]),
        frozen=int(frozen[0]) if frozen.size else -1,
        noise=float(record["noise"]),
        delay=float(record["delay"]),
    )


def _place(pose: NDArray[np.float64]) -> tuple[float, float, float]:
    x, y, z = pose[:3, 3].tolist()
    return NOWHERE if math.isnan(x) else (x, y, z)


def run_in_time(
    config: ProblemFile[Any],
    *,
    seconds: float,
    log: Path | None = None,
    fifo: int | None = None,
    gamepad: Path | None = None,
    **options: str | None,
) -> tuple[LoopReport, int]:
    """Run a problem in real time on its simulated robot or device, optionally operated by a gamepad.

    Parameters
    ----------
    seconds : duration [s]. log : path of the log, or None. fifo : as for `Loop`. options : as for `live_problem`.
    gamepad : path of a gamepad, or None. The robot moves while button 4 is held; the stick and the first two buttons
        act as on the page of `rehab-opt live`.

    Returns
    -------
    The loop's report, and the number of records that the log lost.

    Raises
    ------
    ConfigurationError, ProblemFileError : as `live_problem`, or the device is not at the problem's start position.
    DeviceLostError : the device cannot be connected.
    """
    problem = live_problem(config, **options)
    with ExitStack() as stack:
        control, ring, written = stack.enter_context(control_of(problem, fifo=fifo)), None, None
        operator = None if gamepad is None else stack.enter_context(_operated_by(gamepad, problem))
        if log is not None:
            given = None if operator is None else operator.layout
            layout = state_layout(problem.encoders, given, force=problem.force)
            ring = stack.enter_context(SharedRing.create(layout, depth=DEPTH))
            written = stack.enter_context(log_of(config, problem, ring, log, options))
        watches = () if written is None else (written.watch,)
        loop = Loop(
            control.plant, decide_of(control), state=ring, operator=operator, watches=watches,
            plant_command=control.plant_command, fifo=fifo,
        )  # fmt: skip
        report = loop.run(seconds=seconds)
    return report, 0 if written is None else written.lost


@contextmanager
def _operated_by(gamepad: Path, problem: LiveProblem) -> Iterator[SharedRing]:
    """Ring of a gamepad's inputs, which a separate process reads from the gamepad; raises as `Gamepad`."""
    Gamepad(gamepad).close()
    with SharedRing.create(operator_layout(problem.encoders, axes=2, force=problem.force)) as ring:
        reader = Companion("rehab_opt.loop.gamepad", {"source": str(gamepad), "ring": ring.name})
        try:
            yield ring
        finally:
            reader.end(PATIENCE)


def delay_of(config: ProblemFile[Any], *, joint: int, fifo: int | None = None, **options: str | None) -> float:
    """Delay [s] of a problem's robot, measured by `measured_delay`.

    Raises
    ------
    ConfigurationError, ProblemFileError, DeviceLostError : as `run_in_time` and `measured_delay`, or the robot does
        not take joint velocities.
    """
    problem = live_problem(config, **options)
    if problem.force != 3 or "stick" in problem.controls:
        raise ConfigurationError("FILE", config.name, "a problem whose robot takes joint velocities")
    if problem.device is not None:
        with connected(problem, fifo=fifo) as device:
            return measured_delay(device, joint=joint, fifo=fifo)
    with control_of(problem) as control:
        return measured_delay(control.plant, joint=joint, fifo=fifo)


def log_of(
    config: ProblemFile[Any], problem: LiveProblem, ring: SharedRing, path: Path, options: Mapping[str, str | None]
) -> Log:
    """Log of a problem's loop, with the files that a replay needs; raises as `Log`."""
    about = {name: value for name, value in options.items() if value is not None} | {HOME: str(_home(config))}
    return Log(ring, path, names=problem.names, problem=config.name, files=files_of(config), about=about)


@contextmanager
def control_of(problem: LiveProblem, *, fifo: int | None = None) -> Iterator[LiveControl]:
    """Context with a problem's control on its simulated robot or device; the device is disconnected at the end.

    Raises
    ------
    ConfigurationError : the device is not at the problem's start position, or does not fit the problem.
    DeviceLostError : the device cannot be connected.
    """
    with nullcontext() if problem.device is None else connected(problem, fifo=fifo) as plant:
        control = problem.control(plant)
        control.plant.reset(control.start)
        yield control


def connected(problem: LiveProblem, *, fifo: int | None = None) -> RemoteDevice:
    """Connect to the device of a problem; raises as `control_of`."""
    assert problem.device is not None
    kind, address = problem.device
    if kind == "ros2":
        return ros2.connect_ros2(problem.names, rate_hz=1 / problem.dt, locator=address, fifo=fifo)
    joints, connect = {"ur": (ur.JOINTS, ur.connect_ur), "franka": (franka.JOINTS, franka.connect_franka)}[kind]
    if problem.encoders != joints:
        raise ConfigurationError("plant.kind", kind, f"a robot of {problem.encoders} joints, as the problem's")
    return connect(address, rate_hz=1 / problem.dt, fifo=fifo)


class _LoggedRobot:
    """A robot whose states come from a log; commands have no effect."""

    def __init__(self, dt: float) -> None:
        self.dt = dt

    def show(self, record: np.void) -> None:
        """Set the measured and the true state from a tick's record."""
        stamp, time = float(record["stamp"]), float(record["time"])
        self.measured = Measurement(stamp, *(record[each].copy() for each in ("position", "velocity", "force")))
        true = (record[each].copy() for each in ("true_position", "true_velocity", "effort", "true_force"))
        self.truth = Truth(time, *true)

    def reset(self, position: ArrayLike) -> Measurement:
        """Return the logged measurement; `position` is ignored."""
        return self.measured

    def step(self, command: ArrayLike, push: ArrayLike | None = None) -> Measurement:
        """Return the logged measurement; `command` and `push` are ignored."""
        return self.measured


def logged_problem(logged: Logged, folder: Path) -> LiveProblem:
    """The problem of a log; the problem's files are written to `folder`, which must be empty.

    Raises
    ------
    ConfigurationError : the log is not of a problem file. The program that wrote it can replay it with `replayed`.
    ProblemFileError : the problem in the log is invalid.
    """
    if TEXT not in logged.files:
        raise ConfigurationError(
            "LOG", logged.about.get("problem", ""), "the log of a problem file, by `rehab-opt loop`"
        )
    home = PurePosixPath(logged.about.get(HOME, ""))
    for name, data in logged.files.items():
        place = home / name if name == TEXT else PurePosixPath(name)
        if place.is_absolute() or ".." in place.parts:  # a log from another person may be malicious
            raise ProblemFileError("the log", "attachment", name, "the name of a file beside the problem's")
        path = folder / place
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    config = load_problem(str(folder / home / TEXT))
    return live_problem(config, **{name: logged.about.get(name) for name in ("plant", "solver")})


def control_again(
    problem: LiveProblem, *, then: Callable[[Tick, Command], None] = lambda *_: None
) -> tuple[LiveControl, Decide, Callable[[np.void], None]]:
    """Three results: a problem's control on a logged robot, its controller, and a function that loads a record."""
    robot = _LoggedRobot(problem.dt)
    control = problem.control(robot)
    return control, decide_of(control, then=then), robot.show


def replay_problem(logged: Logged) -> Replay:
    """Replay the log of a problem; raises as `logged_problem`."""
    with tempfile.TemporaryDirectory() as folder:
        _, decide, show = control_again(logged_problem(logged, Path(folder)))
        return replayed(logged.records, decide, before=show)


def files_of(config: ProblemFile[Any]) -> dict[str, bytes]:
    """Contents by path: the problem file, and the recordings and robot files (TOML, URDF, MJCF) that it names.

    Files in the data folder are left out, because their licences may forbid copies.
    """
    files, home = {TEXT: config.path.read_bytes()}, _home(config)
    for needed in needed_files(config.problem):
        if needed.reference.startswith(PREFIX):
            continue
        path = recording_path(config, needed.reference, key=needed.key)
        place = home / needed.reference
        named = {place: path}
        if path.suffix == ".toml":
            told = tomllib.loads(path.read_text(encoding="utf-8"))
            named |= {place.parent / told[key]: path.parent / told[key] for key in ("urdf", "mjcf") if key in told}
        files |= {posixpath.normpath(each): file.read_bytes() for each, file in named.items()}
    return files


def _home(config: ProblemFile[Any]) -> PurePosixPath:
    """The problem file's folder, relative to the folder that contains all files that the problem names."""
    references = (PurePosixPath(each.reference) for each in needed_files(config.problem))
    above = max((each.parts.count("..") for each in references), default=0)
    return PurePosixPath(*config.path.resolve().parent.parts[-above:]) if above else PurePosixPath()
