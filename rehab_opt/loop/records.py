"""Inputs of a controller in a tick; records of a loop's ticks and of its operator's inputs."""

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
    """All inputs of a controller in one tick; a log of them can be replayed."""

    number: int
    """Number from 0; skipped ticks count."""
    time: float
    """[s] deadline since the loop's start: `number` times dt."""
    seen: Measurement
    """Measurement of the sensors."""
    operator: np.void | None
    """The operator's inputs, see `operator_layout`; None before the first record."""
    enabled: bool
    """The `enable` input of `step`."""


Decide: TypeAlias = Callable[[Tick], Command]
"""A controller as a function of a tick: `lambda tick: tracker.step(tick.seen.position, pose, twist,
enable=tick.enabled)`. It must not read a clock or anything else that changes between runs, or its log cannot be
replayed."""


STATUS, REASON = 16, 240
"""Bytes of a status and of a reason; longer ones are truncated."""


def operator_layout(joints: int, *, axes: int = 4, targets: int = 1, force: int = 3) -> np.dtype[Any]:
    """Layout of an operator's inputs from a page, a stick or a program.

    Fields
    ------
    heartbeat : [s] `time.monotonic` when the dead man's switch was last reported as held; NaN if it is not held.
    stick (axes,) : deflections, -1 to 1. buttons : one bit each. target (targets, 4, 4) : poses in the base frame [m],
    the tool's first; twist (targets, 6) their twists [m/s, rad/s]. For hands in a plane, column 3 has their positions.
    push (force,) : [N] on the hand of a simulated robot. frozen (joints,) : 1 for a frozen encoder; noise [rad, m] of
    the encoders, delay [s] of measurements: faults of a simulated robot.

    Parameters
    ----------
    joints : of the plant. axes : of the stick. targets : number of hands. force : components, 2 or 3.
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
    """Layout of one tick: the controller's inputs and command, the true state, and timing.

    Numbers of 8 bytes come first, then texts, as `rehab_opt.loop.cdr` requires.

    Fields
    ------
    record : number of the record, from 1. tick : number of the tick, from 0, skipped ones included. time : [s] deadline
        since the loop's start. clock : [s] deadline on `time.monotonic`.
    stamp : [s] of the measurement, on the plant's clock. position, velocity (joints,), force (force,) : measured.
    enabled : 1 if the controller was enabled. age : [s] of the measurement when the command was sent.
    asked_before : 0 if the controller was called once; if twice, 2 if the first call was enabled, else 1.
    held : 1 while the dead man's switch is held. operated : 1 after the operator's first record. Then all fields of
        `operator` with the prefix `operator_`.
    command (command,) : the command, and wheels (wheels,). scale, residual, relaxed : see `Command`. true_position,
    true_velocity, effort (joints,), true_force (force,) : the plant's truth; for a device its measurement.
    lateness : [s] from the deadline to the start of the tick. tick_time : [s] from the start until the command was
        sent.
    missed : ticks skipped so far. stale : commands withheld so far because the robot's state was stale.
    status, reason : texts.
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
    """The fields of `state_layout` in a ring, looked up once, because look-up by name is slow.

    Parameters
    ----------
    ring : the ring to write. operator : layout of the operator's inputs, or None.

    Raises
    ------
    ConfigurationError : a ring with other records, or of another operator layout.
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
        """Publish one tick; `others` are further fields of the record by name."""
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
