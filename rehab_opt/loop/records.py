"""Inputs of a controller in a tick (`Tick`), and layouts of the records of ticks and of operators."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from rehab_opt.control.command import Command
from rehab_opt.errors import ConfigurationError
from rehab_opt.loop.shared_ring import SharedRing, shortened
from rehab_opt.plants.plant import Measurement, Truth

__all__ = ["Decide", "StateRecord", "Tick", "operator_layout", "state_layout"]


class Tick(NamedTuple):
    """All inputs of a controller in one tick; logged ticks can be replayed."""

    number: int
    """Number of the tick, from 0; skipped ticks count."""
    time: float
    """Deadline [s] of the tick since the loop's start: `number` times dt."""
    seen: Measurement
    """Newest measurement of the robot."""
    operator: np.void | None
    """The operator's inputs, with the fields of `operator_layout`; None before the operator's first record."""
    enabled: bool
    """The `enable` input of the controller's `step`."""


Decide: TypeAlias = Callable[[Tick], Command]
"""A controller as a function of a tick: `lambda tick: tracker.step(tick.seen.position, pose, twist,
enable=tick.enabled)`. The function may depend on the ticks alone, not on a clock; otherwise logs cannot be replayed."""


STATUS, REASON = 16, 240
"""Largest sizes [byte] of a status and of a reason; longer texts are truncated."""


def operator_layout(joints: int, *, axes: int = 4, targets: int = 1, force: int = 3) -> np.dtype[Any]:
    """Layout of an operator's inputs from a page, a stick or a program.

    Fields
    ------
    heartbeat : `time.monotonic` [s] when the dead man's switch was last reported as held; NaN if it is released.
    stick (axes,) : deflections, -1 to 1. buttons : one bit per button.
    target (targets, 4, 4) : poses in the base frame [m]; the first is the tool's.
    twist (targets, 6) : twists of the targets [m/s, rad/s]. For hands in a plane, the last column of a
    pose has the position.
    push (force,) : force [N] on the hand of a simulated robot.
    frozen (joints,) : 1 for a frozen encoder. noise : encoder noise [rad, m]. delay : delay of measurements [s]. These
    three fields are faults of a simulated robot.

    Parameters
    ----------
    joints : number of the plant's joints. axes : number of the stick's axes. targets : number of hands.
    force : number of components of the force, 2 or 3.
    """
    return np.dtype(
        [
            ("heartbeat", "<f8"),
            ("stick", "<f8", (axes,)),
            ("buttons", "<u8"),
            ("target", "<f8", (targets, 4, 4)),
            ("twist", "<f8", (targets, 6)),
            ("push", "<f8", (force,)),
            ("frozen", "<u8", (joints,)),
            ("noise", "<f8"),
            ("delay", "<f8"),
        ]
    )


def state_layout(
    joints: int, operator: np.dtype[Any] | None = None, *, command: int | None = None, wheels: int = 0, force: int = 3
) -> np.dtype[Any]:
    """Layout of the record of one tick: the controller's inputs and command, the true state, and timing.

    Numbers of 8 bytes come first, then texts, as `rehab_opt.loop.cdr` requires.

    Fields
    ------
    record : number of the record, from 1. tick : number of the tick, from 0, skipped ticks included.
    time : deadline of the tick since the loop's start [s]. clock : `time.monotonic` at the tick's start [s].
    stamp : time of the measurement on the plant's clock [s]. position, velocity (joints,), force (force,) : measured
        values [rad, m], [rad/s, m/s], [N].
    enabled : 1 if the controller was enabled. age : age of the measurement when the command was sent [s].
    asked_before : 0 if the controller was called once; if it was called twice, 2 if the first call was enabled, else 1.
    held : 1 while the dead man's switch is held. operated : 1 after the operator's first record.
    operator_... : all fields of `operator`, with this prefix.
    command (command,), wheels (wheels,) : the command. scale, residual, relaxed : as in `Command`.
    true_position, true_velocity, effort (joints,), true_force (force,) : true state of the plant; for a device, the
        measured state.
    lateness : time from the deadline to the start of the tick [s].
    tick_time : time from the start of the tick until the command was sent [s].
    missed : number of ticks skipped so far. stale : number of commands withheld so far because the state was stale.
    status, reason : texts of the command.

    Parameters
    ----------
    joints : number of the plant's joints. operator : layout of the operator's inputs, or None.
    command : number of the command's components, by default `joints`. wheels : number of wheels.
    force : number of components of the force, 2 or 3.
    """
    size = joints if command is None else command
    fields: list[tuple[Any, ...]] = [
        ("record", "<u8"),
        ("tick", "<u8"),
        ("time", "<f8"),
        ("clock", "<f8"),
        ("stamp", "<f8"),
        ("position", "<f8", (joints,)),
        ("velocity", "<f8", (joints,)),
        ("force", "<f8", (force,)),
        ("enabled", "<u8"),
        ("asked_before", "<u8"),
        ("held", "<u8"),
        ("operated", "<u8"),
        ("age", "<f8"),
    ]
    for name, (each, *_) in ({} if operator is None else dict(operator.fields or {})).items():
        fields.append((f"operator_{name}", each.base, each.shape) if each.shape else (f"operator_{name}", each))
    fields += [
        ("command", "<f8", (size,)),
        ("wheels", "<f8", (wheels,)),
        ("scale", "<f8"),
        ("residual", "<f8"),
        ("relaxed", "<u8"),
        ("true_position", "<f8", (joints,)),
        ("true_velocity", "<f8", (joints,)),
        ("effort", "<f8", (joints,)),
        ("true_force", "<f8", (force,)),
        ("lateness", "<f8"),
        ("tick_time", "<f8"),
        ("missed", "<u8"),
        ("stale", "<u8"),
        ("status", f"S{STATUS}"),
        ("reason", f"S{REASON}"),
    ]
    return np.dtype([each for each in fields if len(each) < 3 or math.prod(each[2])])


class StateRecord:
    """Writes ticks to a ring of `state_layout` records.

    Parameters
    ----------
    ring : ring of `state_layout` records. operator : layout of the operator's inputs, or None.

    Raises
    ------
    ConfigurationError : the ring's records lack a field of `state_layout` or of `operator`.
    """

    def __init__(self, ring: SharedRing, operator: np.dtype[Any] | None) -> None:
        own, theirs = dict(state_layout(1).fields or {}), dict((operator and operator.fields) or {})
        needed = [name for name in own if name != "wheels"] + [f"operator_{name}" for name in theirs]
        there = ring.layout.names or ()
        if absent := [name for name in needed if name not in there]:
            raise ConfigurationError("state", ring.name, f"records of state_layout, with {', '.join(absent)}")
        self._ring = ring
        self._fields = {name: ring.record[name] for name in there}
        self._operator = [(self._fields[f"operator_{name}"], name) for name in theirs]
        self._reason, self._status = b"", b""

    def write(self, tick: Tick, truth: Truth, command: Command, **others: float) -> None:
        """Publish the record of one tick; `others` are further fields of the record by name."""
        fields, (_, position, velocity, force) = self._fields, tick.seen
        fields["tick"][()], fields["time"][()], fields["enabled"][()] = tick.number, tick.time, tick.enabled
        fields["stamp"][()] = tick.seen.stamp
        fields["position"][:], fields["velocity"][:], fields["force"][:] = position, velocity, force
        fields["operated"][()] = tick.operator is not None
        for field, name in self._operator:
            field[()] = 0 if tick.operator is None else tick.operator[name]
        fields["command"][:] = command.value
        if command.wheels is not None and "wheels" in fields:
            fields["wheels"][:] = command.wheels
        fields["scale"][()], fields["residual"][()] = command.scale, command.residual
        fields["relaxed"][()] = command.relaxed.value
        fields["true_position"][:], fields["true_velocity"][:] = truth.position, truth.velocity
        fields["effort"][:], fields["true_force"][:] = truth.effort, truth.force
        for name, number in others.items():
            fields[name][()] = number
        fields["status"][()] = command.status.value
        fields["reason"][()] = shortened(command.reason, fields["reason"].dtype.itemsize)
        fields["record"][()] += 1
        self._ring.publish()
