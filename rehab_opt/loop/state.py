"""A loop's tick as a record."""

from __future__ import annotations

from typing import Any

import numpy as np

from rehab_opt.control.command import Command
from rehab_opt.errors import ConfigurationError
from rehab_opt.loop.records import state_layout
from rehab_opt.loop.shared_ring import SharedRing, shortened
from rehab_opt.loop.tick import Tick
from rehab_opt.plants.plant import Truth

__all__ = ["StateRecord"]


class StateRecord:
    """The fields of `state_layout` in a ring, found once: to find one by its name costs more than to fill it.

    Parameters
    ----------
    ring : whose records are written. operator : layout of what the operator writes, None where nobody operates.

    Raises
    ------
    ConfigurationError : a ring whose records are not a loop's, or not of this operator.
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
        """Publish one tick; `others` are the fields of these names."""
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
        fields["yielded"][()] = command.yielded.value
        fields["true_position"][:], fields["true_velocity"][:] = truth.position, truth.velocity
        fields["effort"][:], fields["true_force"][:] = truth.effort, truth.force
        for name, number in others.items():
            fields[name][()] = number
        fields["status"][()] = command.status.value
        fields["reason"][()] = shortened(command.reason, fields["reason"].dtype.itemsize)
        fields["record"][()] += 1
        self._ring.publish()
