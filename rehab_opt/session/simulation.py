"""Simulate a controller and its plant in closed loop, and return a trace."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from rehab_opt.control.command import Command, Relaxed
from rehab_opt.plants.ideal import IdealJoints
from rehab_opt.plants.touched import TouchedPlant
from rehab_opt.session.live.problem import LiveControl, LiveInputs
from rehab_opt.session.trace import Trace

TICKS_A_REPORT = 100


def relaxed_words(relaxed: Relaxed) -> str:
    """Names of the relaxed bounds, separated by commas; empty if no bound is relaxed."""
    return str(relaxed.name).lower().replace("|", ", ") if relaxed else ""


def simulate(
    control: LiveControl,
    inputs: Callable[[int], LiveInputs | None],
    *,
    ticks: int,
    also: Callable[[int, Command], Mapping[str, Any]] = lambda *_: {},
    progress: Callable[[int, int], None] = lambda *_: None,
) -> Trace:
    """Simulate from rest until `inputs` returns None or `ticks` have passed.

    A row of the trace has values at the beginning of its tick; the command acts during the tick. `joint` (N, n) are the
    true positions [rad, m], `command` (N, n) the commanded velocities [rad/s, m/s], `_force` (N, 2) or (N, 3) the force
    on the hand during the tick [N], and `_seconds` the controller's computing times. For all plants but ideal joints,
    the trace also has `measured` positions, the true `velocity`, and the drives' `_effort` [N m, N].

    Parameters
    ----------
    control : controller and plant.
    inputs : function from the number of a tick to its inputs; it may read the true state `control.plant.truth`.
    ticks : largest number of ticks.
    also : function from the number of a tick and its command to further columns, called before the command is sent.
    progress : callback with the number of the tick and the largest number of ticks.
    """
    plant, rows, more = control.plant, list[tuple[Any, ...]](), list[Mapping[str, Any]]()
    control.timed, seen = False, plant.reset(control.start)
    truth = plant.truth
    for k in range(ticks):
        given = inputs(k)
        if given is None:
            break
        began = time.perf_counter()
        command = control.step(given, seen)
        rows.append((truth, seen, command, time.perf_counter() - began))
        more.append(also(k, command))
        seen = plant.step(control.plant_command(command))
        truth = plant.truth
        if k % TICKS_A_REPORT == 0:
            progress(k, ticks)
    progress(ticks, ticks)
    truths, measured, commands, seconds = zip(*rows, strict=True)
    trace = Trace(
        {
            "t_s": plant.dt * np.arange(len(rows), dtype=np.float64),
            "joint": [each.position for each in truths],
            "command": [each.value for each in commands],
            "status": [each.status.value for each in commands],
            "relaxed": [relaxed_words(each.relaxed) for each in commands],
            "reason": [each.reason for each in commands],
            "scale": [each.scale for each in commands],
            "_force": [each.force for each in (*truths[1:], truth)],
            "_seconds": seconds,
        }
    )
    if not (isinstance(plant, TouchedPlant) and isinstance(plant.plant, IdealJoints)):
        trace["measured"] = np.array([each.position for each in measured])
        trace["velocity"] = np.array([each.velocity for each in truths])
        trace["_effort"] = np.array([each.effort for each in truths])
    trace |= {name: np.array([each[name] for each in more]) for name in more[0]}
    return trace
