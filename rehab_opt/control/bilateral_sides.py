"""The helper's and the participant's side of a shared task: bounded forces, and messages between the sides."""

from __future__ import annotations

import math
from threading import get_ident
from typing import NamedTuple, Unpack, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.control.assistance import Assistance
from rehab_opt.control.bounded_force import BoundedForce, ForceBounds
from rehab_opt.control.command import Command
from rehab_opt.control.force_tick import BEYOND, NUMBERS, hear, say
from rehab_opt.control.gate import PULL_BACK, reflected_force
from rehab_opt.control.thread_owner import OneThread
from rehab_opt.control.velocity_controller import checked_number
from rehab_opt.errors import ConfigurationError
from rehab_opt.field.potential import PotentialField
from rehab_opt.kinematics.real_array import float_or_nan
from rehab_opt.symbolic import BufferedFunction
from rehab_opt.workspace.controller_map import ControllerMap
from rehab_opt.workspace.edge_distance import edge_columns
from rehab_opt.workspace.region import Workspace

__all__ = ["FromHelper", "FromParticipant", "HelperSide", "ParticipantSide"]

Array = NDArray[np.float64]
NO_FORCE = (math.nan, math.nan)
POINT = 0.01
"""[m] Width of a potential field with a single point; its value has no effect."""


class FromHelper(NamedTuple):
    """Message of the helper's side: hand position [m], energy sent [J], serial number."""

    x: float
    y: float
    energy: float
    serial: int


class FromParticipant(NamedTuple):
    """Message of the participant's side: hand position [m], force on the hand [N], energy sent [J], serial number."""

    x: float
    y: float
    force_x: float
    force_y: float
    energy: float
    serial: int


class _Messages:
    """Received and sent messages of a side; `reset` does not reset the serial numbers."""

    def __init__(self, force: BoundedForce, exchange: float) -> None:
        self._force = force
        self.fraction = min(checked_number("exchange", exchange, above=-1e-12, below=1e4) * force.dt, 1.0)
        """Fraction of the tank's energy that each message transfers."""
        self.numbers: Array = np.zeros(NUMBERS.size)
        self._hear, self._say = (BufferedFunction(part(force.slots)) for part in (hear, say))

    def hear(self, *message: float) -> Array:
        """Process a message (energy, serial number, two values) and return its two values, see `force_tick.hear`."""
        force = self._force
        if force._owner != get_ident():
            force._refuse_others()
        heard = [float_or_nan(each) for each in message]
        force._watched[:] = self._hear.of(force.model, force._watched, self.numbers, heard)
        _, self.numbers[:], told = self._hear.outputs
        return told

    def say(self) -> list[float]:
        force = self._force
        given = force.model, force._watched, force._force, self.fraction, force._view, self.numbers
        force._watched[:] = self._say.of(*given)
        _, self.numbers[:], message = self._say.outputs
        return cast("list[float]", message.tolist())


class ParticipantSide(OneThread):
    """Pull the participant's hand to the position that the map assigns to the helper's hand.

    The pull acts inside the participant's comfortable workspace.

    Parameters
    ----------
    workspace_map : map from the helper's workspace to the participant's.
    comfortable : workspace of the participant; outside it a bounded force pulls the hand back, see `Assistance`.
    stiffness, damping : [N/m], [N s/m] of the spring.
    exchange : [1/s] fraction of the tank's free energy that is sent per second.
    force_limit : [N]. bounds : see `BoundedForce`.
    """

    def __init__(
        self,
        workspace_map: ControllerMap,
        *,
        comfortable: Workspace,
        stiffness: float = 400.0,
        damping: float = 20.0,
        exchange: float = 5.0,
        force_limit: float = 30.0,
        **bounds: Unpack[ForceBounds],
    ) -> None:
        self.workspace_map = _checked_map(workspace_map)
        spring = PotentialField(
            np.zeros((1, 2)),
            stiffness=checked_number("stiffness", stiffness, above=0.0),
            damping=checked_number("damping", damping, above=-1e-12),
            width=POINT,
        )
        self.force = Assistance(spring, comfortable=comfortable, mode="hold", force_limit=force_limit, **bounds)
        self._messages = _Messages(self.force, exchange)
        self.reset()

    def reset(self) -> None:
        """Set the force to zero, fill the tank and forget all messages.

        Serial numbers restart only with a new object: if one side is a new object, replace the other, too.
        """
        self._claim()
        self.force.reset()
        self.force.shift(*NO_FORCE)
        self._give_away()

    def step(
        self,
        x: ArrayLike,
        received: FromHelper | None,
        v: ArrayLike | None = None,
        *,
        enable: object = True,
        stamp: float | None = None,
    ) -> tuple[Command, FromParticipant]:
        """Compute the force on the participant's hand at x (2,) [m], and the message to the helper.

        Without a new message the force is released.
        """
        if self._owner != get_ident():
            self._claim()
        target: tuple[float, ...] = NO_FORCE
        if received is not None:
            told = self._messages.hear(received.energy, received.serial, received.x, received.y)
            target = tuple(self.workspace_map.image(told).tolist())
        self.force.shift(*target)
        command = self.force.step(x, v, enable=enable, stamp=stamp)
        *said, serial = self._messages.say()
        return command, FromParticipant._make((*said, int(serial)))


class HelperSide(OneThread):
    """Render the participant's force to the helper by the transposed Jacobian of the workspace map.

    Outside the map's source workspace a bounded force pulls the helper's hand back.

    Parameters
    ----------
    workspace_map, exchange, force_limit, bounds : as in `ParticipantSide`.
    damping : [N s/m] damping of the helper's hand.
    return_stiffness, return_force : [N/m, N] stiffness and limit of the pull back into the map's source workspace.
    """

    def __init__(
        self,
        workspace_map: ControllerMap,
        *,
        damping: float = 2.0,
        exchange: float = 5.0,
        force_limit: float = 30.0,
        return_stiffness: float = 500.0,
        return_force: float = 10.0,
        **bounds: Unpack[ForceBounds],
    ) -> None:
        self.workspace_map = _checked_map(workspace_map)
        self.damping = checked_number("damping", damping, above=-1e-12)
        self._partner = NO_FORCE
        self.back = PULL_BACK.numbers(
            stiffness=checked_number("return_stiffness", return_stiffness, above=0.0),
            force=checked_number("return_force", return_force, above=0.0),
        )
        edges = edge_columns(workspace_map.source.polygon)
        function = BufferedFunction(reflected_force(len(edges)), compile=bounds.get("compile"))
        self._hand, self._jacobian, self._felt, *held = function.inputs
        held[0][:], held[1][:], held[2][:] = self.damping, self.back, edges
        self._felt[:] = math.nan
        self._reflected = function
        self.force = BoundedForce(self._desired, force_limit=force_limit, **bounds)
        self._messages = _Messages(self.force, exchange)

    def reset(self) -> None:
        """Set the force to zero, fill the tank and forget all messages; see `ParticipantSide.reset`."""
        self._claim()
        self.force.reset()
        self._felt[:] = math.nan
        self._partner = NO_FORCE
        self._give_away()

    @property
    def partner(self) -> Array:
        """Participant's last received hand position (2,) [m] in the helper's workspace; NaN before any message."""
        return self.workspace_map.preimage(_floats(*self._partner))

    def step(
        self,
        x: ArrayLike,
        received: FromParticipant | None,
        v: ArrayLike | None = None,
        *,
        enable: object = True,
        stamp: float | None = None,
    ) -> tuple[Command, FromHelper]:
        """Compute the force on the helper's hand at x (2,) [m], and the message to the participant.

        Without a new message the force is released.
        """
        if self._owner != get_ident():
            self._claim()
        self._felt[:] = math.nan
        if received is not None:
            numbers = self._messages.numbers
            newest = float(numbers[NUMBERS["newest"]])
            self._felt[:] = self._messages.hear(received.energy, received.serial, received.force_x, received.force_y)
            if numbers[NUMBERS["newest"]] != newest:
                self._partner = float_or_nan(received.x), float_or_nan(received.y)
        command = self.force.step(x, v, enable=enable, stamp=stamp)
        at_x, at_y, _, _, given, serial = self._messages.say()
        return command, FromHelper(at_x, at_y, given, int(serial))

    def _desired(self, *hand: float) -> tuple[float, float]:
        self._hand[:] = hand
        self._jacobian[...] = self.workspace_map.spline.value_and_jacobian(self._hand[:2])[1]
        self._reflected.evaluate()
        x, y = self._reflected.outputs[0].tolist()
        return x, y


def _floats(x: float, y: float) -> Array:
    return np.array((x, y) if -BEYOND < x < BEYOND and -BEYOND < y < BEYOND else NO_FORCE)


def _checked_map(workspace_map: object) -> ControllerMap:
    if not isinstance(workspace_map, ControllerMap):
        raise ConfigurationError("workspace_map", workspace_map, "a ControllerMap, from WorkspaceMap.for_controller()")
    return workspace_map
