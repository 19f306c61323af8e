"""The closed loop of a run, as live, without waiting; its commands and true motion."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from rehab_opt.control.command import Command, Relaxed
from rehab_opt.plants.ideal import IdealJoints
from rehab_opt.plants.plant import Measurement, Truth
from rehab_opt.plants.touched import TouchedPlant
from rehab_opt.session.live.problem import LiveControl, LiveInputs
from rehab_opt.session.outcome import Array

__all__ = ["ClosedLoopRun", "JointMotion", "relaxed_words", "simulate"]

TICKS_A_REPORT = 100


class JointMotion(NamedTuple):
    """N ticks; everything holds at the beginning of its tick, commands are held during it."""

    time: Array
    """(N,) [s]"""
    commanded: Array
    """(N, n) velocities [rad/s, m/s]"""
    velocity: Array
    """(N, n) true ones"""
    measured: Array
    """(N, n) [rad, m] positions as the controller saw them"""
    effort: Array
    """(N, n) [N m, N] of the drives in the tick before"""


class ClosedLoopRun(NamedTuple):
    """A run of N ticks; everything holds at the beginning of its tick, commands are held during it."""

    q: Array
    """(N, n) [rad, m] true positions"""
    commands: tuple[Command, ...]
    seconds: Array
    """(N,) [s] that the controller took."""
    motion: JointMotion | None
    """Commanded and true motion; None of an ideal plant."""
    force: Array
    """(N, 2) or (N, 3) [N] on the hand during each tick."""

    @property
    def values(self) -> Array:
        """(N, n) what was commanded."""
        return np.array([command.value for command in self.commands])

    @property
    def scales(self) -> Array:
        """(N,) fraction of the commanded motion that was delivered."""
        return np.array([command.scale for command in self.commands])

    @property
    def status(self) -> tuple[str, ...]:
        """(N,) of each command."""
        return tuple(command.status.value for command in self.commands)

    @property
    def relaxed(self) -> tuple[str, ...]:
        """(N,) what gave way, in words; empty where nothing did."""
        return tuple(relaxed_words(command.relaxed) for command in self.commands)


def relaxed_words(relaxed: Relaxed, *, between: str = ", ") -> str:
    """What gave way, in words; empty where nothing did."""
    return str(relaxed.name).lower().replace("|", between) if relaxed else ""


def simulate(
    control: LiveControl,
    inputs: Callable[[int], LiveInputs | None],
    *,
    ticks: int,
    note: Callable[[int, Command], None] = lambda *_: None,
    progress: Callable[[int, int], None] = lambda *_: None,
) -> ClosedLoopRun:
    """Run until `inputs` gives None, or for so many ticks, from the control's start at rest.

    Parameters
    ----------
    inputs : the tick's number -> what is done to the robot. It may look at `control.plant.truth`, which no controller
        can. note : told the tick's number and its command before that is sent. progress : told the tick and how many
        there may be.
    """
    plant, rows, seconds = control.plant, list[tuple[Truth, Measurement, Command]](), list[float]()
    control.timed, seen = False, plant.reset(control.start)
    truth = plant.truth
    for k in range(ticks):
        given = inputs(k)
        if given is None:
            break
        began = time.perf_counter()
        command = control.step(given, seen)
        seconds.append(time.perf_counter() - began)
        rows.append((truth, seen, command))
        note(k, command)
        seen = plant.step(control.plant_command(command))
        truth = plant.truth
        if k % TICKS_A_REPORT == 0:
            progress(k, ticks)
    progress(ticks, ticks)
    truths, measured, commands = zip(*rows, strict=True)
    motion = None
    if not (isinstance(plant, TouchedPlant) and isinstance(plant.plant, IdealJoints)):
        motion = JointMotion(
            time=np.array([each.time for each in truths]),
            commanded=np.array([command.value for command in commands]),
            velocity=np.array([each.velocity for each in truths]),
            measured=np.array([each.position for each in measured]),
            effort=np.array([each.effort for each in truths]),
        )
    force = np.array([*(each.force for each in truths[1:]), truth.force])
    return ClosedLoopRun(np.array([each.position for each in truths]), commands, np.array(seconds), motion, force)
