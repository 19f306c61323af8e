"""A run that C repeats: inputs of each tick, and Python's commands."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.command import NUMBERED, Command
from rehab_opt.control.reasons import notes_of, reason_number
from rehab_opt.export.c_text import indented, initialiser, number

__all__ = [
    "MAX_TICKS",
    "NO_ITERATIONS",
    "STAMPED",
    "Joints",
    "Run",
    "RunTick",
    "about_run",
    "encoders",
    "recorded",
    "standing",
    "thinned",
    "with_faults",
]

Array = NDArray[np.float64]
RunTick = dict[str, Any]
"""Inputs of a tick by name: arrays, whole numbers (int), and `enable` (int) and `stamp` (float) [s]."""

STAMPED = "A stamp is always required and checked. In Python it may be left out."
NO_ITERATIONS = "`iterations` of Python's command is not there."
MAX_TICKS = 4000
"""Largest number of ticks; a longer run is thinned, because the compilation of its header would take minutes."""
STANDS = 0.6
"""[s] Duration of frozen encoders, long enough to detect that joints do not follow if the hand moves at 5 cm/s."""
NOISE = 1e-4
"""[rad or m] Standard deviation of the encoders' noise in a recorded run."""
STATUSES = {status: number for number, status in enumerate(NUMBERED)}
"""Values of `enum rehab_status`."""


@dataclass(frozen=True, eq=False)
class Run:
    """A run of N ticks.

    Parameters
    ----------
    ticks : inputs of the controller, with the same names and sizes in every tick.
    commands : Python's commands, computed without the stages that C lacks.
    about : description of the run.
    more : further outputs of the controller with each command; the same number in every tick.
    """

    ticks: Sequence[RunTick]
    commands: Sequence[Command]
    about: str
    more: Sequence[Sequence[float]]

    def fields(self) -> str:
        """Members of the C struct that holds one recorded tick."""
        lines = []
        for name, value in self.ticks[0].items():
            kind = "int" if isinstance(value, int) else "double"
            lines.append(f"{kind} {name}{f'[{value.size}]' if isinstance(value, np.ndarray) else ''};")
        first = self.commands[0]
        lines += [f"double more[{max(1, len(self.more[0]))}];", f"double value[{first.value.size}];"]
        lines.append(f"double wheels[{max(1, _wheels(first).size)}];")
        return indented([*lines, "double scale;", "int status, relaxed, reason, notes;"])

    def initialisers(self) -> Iterator[str]:
        """C initialiser of each tick."""
        for tick, command, more in zip(self.ticks, self.commands, self.more, strict=True):
            parts = [_c(value) for value in tick.values()]
            wheels = _wheels(command)
            parts += [initialiser(more or [0.0]), initialiser(command.value)]
            parts += [initialiser(wheels if wheels.size else [0.0]), number(command.scale)]
            yield "    {" + ", ".join([*parts, *(str(each) for each in _said(command))]) + "}"

    def csv(self) -> str:
        """The run as a table, each array spread over columns."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        header: list[str] = []
        for name, value in self.ticks[0].items():
            header += [f"{name}_{i}" for i in range(value.size)] if isinstance(value, np.ndarray) else [name]
        first = self.commands[0]
        header += [f"value_{i}" for i in range(first.value.size)] + [f"wheel_{i}" for i in range(_wheels(first).size)]
        header += [f"more_{i}" for i in range(len(self.more[0]))]
        writer.writerow([*header, "scale", "status", "relaxed", "reason", "notes"])
        for tick, command, more in zip(self.ticks, self.commands, self.more, strict=True):
            row: list[Any] = []
            for value in tick.values():
                row += value.reshape(-1).tolist() if isinstance(value, np.ndarray) else [value]
            wheels = _wheels(command).tolist()
            writer.writerow([*row, *command.value.tolist(), *wheels, *more, command.scale, *_said(command)])
        return text.getvalue()


class Joints:
    """A robot's joints in a recorded run: they move as commanded, and their encoders have `encoder_noise`.

    Parameters
    ----------
    start : (n,) [rad or m] positions at the start, at rest. dt : [s] of a tick.
    ticks : number of ticks, after which the encoders are frozen.
    """

    def __init__(self, start: Array, *, dt: float, ticks: int) -> None:
        self.start, self._dt, self._tick = start, dt, 0
        self._noise, self._q, self._seen = encoder_noise(ticks, start.size), start.copy(), start.copy()

    def seen(self, told: Array) -> Array:
        """Joint positions `told` (n,), in which this tick's encoder values replace the entries equal to `start`."""
        if self._tick < len(self._noise):
            self._seen = self._q + self._noise[self._tick]
        return np.where(told == self.start, self._seen, told)

    def go(self, command: Array) -> None:
        """Move for one tick at the velocities `command` (n,)."""
        self._q += self._dt * command
        self._tick += 1


def recorded(
    step: Callable[[RunTick], Command],
    ticks: Sequence[RunTick],
    about: str,
    *,
    joints: Joints | None = None,
    more: Callable[[], Sequence[float]] = tuple,
    progress: Callable[[int], None] = lambda _: None,
) -> Run:
    """Call `step` in every tick and record its command; `more` gives further outputs to record after each tick.

    In ticks whose q is the start of `joints`, the encoder values of `joints` replace q.
    """
    told, commands, besides = [], [], []
    for k, each in enumerate(ticks):
        tick = each if joints is None else {**each, "q": joints.seen(each["q"])}
        commands.append(step(tick))
        if joints is not None:
            joints.go(commands[-1].value)
        told.append(tick)
        besides.append(tuple(more()))
        progress(k)
    return Run(told, commands, about, besides)


def thinned(count: int) -> NDArray[np.intp]:
    """Indices of the ticks that a recorded run keeps out of `count`: all of them, or every second, third and so on."""
    return np.arange(0, count, -(-count // MAX_TICKS))


def encoder_noise(ticks: int, joints: int) -> Array:
    """(ticks, joints) [rad or m] noise of positions in the second half of a run, zero in the first."""
    noise = NOISE * np.random.default_rng(0).normal(size=(ticks, joints))
    noise[: ticks // 2] = 0.0
    return np.asarray(noise)


def encoders(run: Sequence[RunTick], *, dt: float) -> tuple[list[RunTick], Joints, RunTick]:
    """Three results: a run whose ticks all have the first tick's q; its `Joints`; the tick with the fastest joint.

    The joints move as commanded, and `recorded` replaces each q by their encoder values.
    """
    fastest = run[int(np.argmax(np.abs(np.diff([each["q"] for each in run], axis=0)).max(axis=1)))]
    start = run[0]["q"]
    joints = Joints(start, dt=dt, ticks=len(run))
    return [{**tick, "q": start} for tick in run], joints, {**fastest, "q": start}


def with_faults(
    ticks: Sequence[RunTick], *, dt: float, max_age: float, more: Sequence[Callable[[RunTick], RunTick]] = ()
) -> list[RunTick]:
    """The given ticks with generated stamps, some of them with a fault of each kind.

    Parameters
    ----------
    ticks : valid ticks without `enable` and `stamp`.
    dt, max_age : [s] of the watchdog.
    more : further functions that put a fault into a valid tick.
    """
    arrays = [name for name, value in ticks[0].items() if isinstance(value, np.ndarray) and value.size]
    faults: list[Callable[[RunTick], RunTick]] = [
        lambda tick: {**tick, "enable": 0},
        lambda tick: {**tick, "enable": 2},
    ]
    for name in arrays:
        faults += [_element(name, 0, np.nan), _element(name, -1, np.inf), _element(name, -1, -1.1e6)]
    # Impossible positions would be reported first, so they are left out.
    faults.append(lambda tick: {**tick, **{name: np.full_like(tick[name], 9e5) for name in arrays if name != "q"}})
    faults += more
    stale, jump = (int(max_age / (0.9 * dt)) + 10, 1.0 + max_age) if max_age < 10.0 else (0, 1.0)
    # Faults of the stamps; the last one, a stream that starts anew, ends the accumulated lag.
    late = [0.0, -dt, -jump, jump, *([0.1 * dt] * stale), -jump]
    spread = np.linspace(0, len(ticks), len(faults) + 3).astype(int)[1:-1]
    at = dict(zip(spread[:-1].tolist(), faults, strict=True))
    result, clock = [], 0.0
    for i, tick in enumerate(ticks):
        clock += late[i - spread[-1]] if 0 <= i - spread[-1] < len(late) else dt
        stamp = np.nan if i == spread[0] - 1 else clock
        result.append(at.get(i, dict)({**tick, "enable": 1, "stamp": float(stamp)}))
    return result


def standing(ticks: Sequence[RunTick], moving: RunTick, *, dt: float) -> list[RunTick]:
    """Ticks that follow `ticks`: the tick `moving` with frozen encoders for `STANDS`, then with `enable` released."""
    last, count = ticks[-1]["stamp"], math.ceil(STANDS / dt)
    return [{**moving, "enable": int(k <= count), "stamp": float(last + k * dt)} for k in range(1, count + count // 2)]


def about_run(ticks: int, of: str) -> str:
    """Text on a run's origin and on the faults from `with_faults` and `standing`."""
    return (
        f"{ticks} ticks of {of}, with faults among them: numbers that are none, stamps that are wrong, the enable "
        "input released, encoders that stand still; encoders with noise of 0.1 mrad in the second half"
    )


def _element(name: str, index: int, value: float) -> Callable[[RunTick], RunTick]:
    def replaced(tick: RunTick) -> RunTick:
        array = np.array(tick[name])
        array.flat[index] = value
        return {**tick, name: array}

    return replaced


def _wheels(command: Command) -> Array:
    return np.empty(0) if command.wheels is None else command.wheels


def _said(command: Command) -> tuple[int, ...]:
    """Status, relaxed bounds, reason and notes of a command, as the numbers that C uses."""
    reason = command.reason
    return STATUSES[command.status], int(command.relaxed), reason_number(reason), notes_of(reason)


def _c(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return initialiser(value.reshape(-1).tolist())
    return str(value) if isinstance(value, int) else number(value)
