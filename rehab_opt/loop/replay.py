"""Replay a log: compute every command again from the logged inputs and compare it with the logged command."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.command import Command
from rehab_opt.loop.logged import operator_of
from rehab_opt.loop.records import Decide, Tick
from rehab_opt.plants.plant import Measurement

__all__ = ["SAME", "Replay", "replayed", "replayed_command", "tick_of"]

SAME = 1e-12
"""Largest difference of two commands that count as equal, in the commands' units."""


@dataclass(frozen=True)
class Replay:
    """Result of a replay, which ends at the first different command.

    Parameters
    ----------
    same : number of equal commands. ticks : number of ticks in the log.
    worst : largest difference between equal commands.
    first : description of the first different command or of missing records; empty if all commands are equal.
    """

    same: int
    ticks: int
    worst: float
    first: str


def replayed(
    records: NDArray[np.void], decide: Decide, *, before: Callable[[np.void], None] = lambda _: None
) -> Replay:
    """Call a new controller with the inputs of a log and compare its commands with the logged ones.

    Parameters
    ----------
    records : records (N,) of a log from its first tick. decide : the new controller.
    before : function that is called with each record before the controller.
    """
    operator, worst = operator_of(records.dtype), 0.0
    for i, record in enumerate(records):
        if gap := _gap(records, i):
            return Replay(i, len(records), worst, gap)
        before(record)
        command = replayed_command(record, operator, decide)
        apart = _apart(command, record)
        if not apart <= SAME or command.status.value != record["status"].decode():
            return Replay(i, len(records), worst, _words(record, command, apart))
        worst = max(worst, apart)
    return Replay(len(records), len(records), worst, "")


def replayed_command(record: np.void, operator: np.dtype[np.void], decide: Decide) -> Command:
    """Command of a controller for the inputs of a logged tick; `operator` is the layout that `operator_of` returns."""
    tick = tick_of(record, operator)
    if record["asked_before"]:
        decide(tick._replace(enabled=record["asked_before"] == 2))
    return decide(tick)


def tick_of(record: np.void, operator: np.dtype[np.void]) -> Tick:
    """Inputs of the controller in a logged tick; `operator` is the layout that `operator_of` returns."""
    wants = None
    if operator.names and record["operated"]:
        row: np.void = np.zeros(1, dtype=operator)[0]
        for name in operator.names:
            row[name] = record[f"operator_{name}"]
        wants = row
    seen = Measurement(
        float(record["stamp"]), record["position"].copy(), record["velocity"].copy(), record["force"].copy()
    )
    return Tick(int(record["tick"]), float(record["time"]), seen, wants, bool(record["enabled"]))


def _gap(records: NDArray[np.void], i: int) -> str:
    number = int(records["record"][i])
    if number == i + 1:
        return ""
    at = f"tick {int(records['tick'][i])}"
    lost = number - i - 1
    return f"{lost} records before {at} are not in the log: what the controller remembered then is not known"


def _apart(command: Command, record: np.void) -> float:
    apart = [float(np.abs(command.value - record["command"]).max(initial=0.0))]
    if command.wheels is not None and "wheels" in (record.dtype.names or ()):
        apart.append(float(np.abs(command.wheels - record["wheels"]).max(initial=0.0)))
    return float(np.max(apart))  # NaN if a difference is NaN


def _words(record: np.void, command: Command, apart: float) -> str:
    at = f"tick {int(record['tick'])}, {float(record['time']):.3f} s after the beginning"
    was, now = record["status"].decode(), command.status.value
    if was != now:
        return f"{at}: the status was {was!r} and is {now!r} ({command.reason or 'no reason'})"
    return f"{at}: the command differs by {apart:.3g}"
