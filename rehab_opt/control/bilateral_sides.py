"""One side of helper and participant at one task: its bounded force, and its messages to the other side."""

from __future__ import annotations

import math
from threading import get_ident
from typing import NamedTuple, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.control.assistance import Assistance
from rehab_opt.control.bounded_force import BoundedForce, ForceBounds
from rehab_opt.control.command import Command
from rehab_opt.control.gate import PULL_BACK, reflected_force
from rehab_opt.control.thread_owner import OneThread
from rehab_opt.control.velocity_controller import checked_number
from rehab_opt.errors import ConfigurationError
from rehab_opt.field.potential import PotentialField
from rehab_opt.symbolic import BufferedFunction
from rehab_opt.workspace.controller_map import ControllerMap
from rehab_opt.workspace.edge_distance import edge_columns
from rehab_opt.workspace.region import Workspace

__all__ = ["FromHelper", "FromParticipant", "HelperSide", "ParticipantSide"]

Array = NDArray[np.float64]
NO_FORCE = (math.nan, math.nan)
BEYOND = 1e6
"""[m, N] A message with such a number is broken."""
POINT = 0.01
"""[m] Width of a field of one point: it has no meaning there."""


class FromHelper(NamedTuple):
    """Message of the helper's side: where the hand is [m], energy given [J], and a number."""

    x: float
    y: float
    energy: float
    serial: int


class FromParticipant(NamedTuple):
    """Message of the participant's side: where the hand is [m], force on it [N], energy given [J], and a number."""

    x: float
    y: float
    force_x: float
    force_y: float
    energy: float
    serial: int


class _Serials:
    """Numbers a side's messages, and recognises received ones that are new.

    `reset` leaves the numbers: with new ones, a message from before it could be taken twice.
    """

    def __init__(self) -> None:
        self._said = 0
        self._newest: float = 0

    def next(self) -> int:
        """The number of the next message, from 1."""
        self._said += 1
        return self._said

    def fresh(self, serial: float) -> bool:
        """Whether a message is newer than all received before."""
        if not serial > self._newest:  # NaN fails
            return False
        self._newest = serial
        return True


class ParticipantSide(OneThread):
    """Draws the participant's hand to the image of the helper's, inside the participant's comfortable workspace.

    An object belongs to one thread, see `OneThread`; the other side may run in another one, with the same map.

    Parameters
    ----------
    workspace_map : from the helper's workspace to the participant's.
    comfortable : of the participant; outside it there is a bounded pull back, see `Assistance`.
    stiffness, damping : [N/m], [N s/m] of the spring.
    exchange : [1/s] fraction of the tank's energy, beyond what its force may still draw, that is given away a second.
    force_limit : [N]. bounds : see `BoundedForce`.

    Raises
    ------
    ConfigurationError : an argument that cannot be used.
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
        self._fraction = _checked_fraction(exchange, self.force.dt)
        self._serials = _Serials()
        self.reset()

    def reset(self) -> None:
        """No force, a full tank, no message received.

        The numbers of messages go on; where the other side is made anew, whose count begins again, make this one anew.
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
        """Force on the participant's hand at x (2,) [m], and what the helper is to hear; see `BoundedForce.step`.

        Without a new message the force is released, inside the workspace and outside it.
        """
        if self._owner != get_ident():
            self._claim()
        target: tuple[float, ...] = NO_FORCE
        if received is not None and self._serials.fresh(received.serial):
            self.force.take_energy(received.energy)
            target = tuple(self.workspace_map.image(_floats(received.x, received.y)).tolist())
        self.force.shift(*target)
        command = self.force.step(x, v, enable=enable, stamp=stamp)
        force_x, force_y = command.value.tolist()
        given = self.force.give_energy(self._fraction)
        return command, FromParticipant(*_place(x, self.force), force_x, force_y, given, self._serials.next())


class HelperSide(OneThread):
    """Lets the helper feel the participant's force, by J(x_h)' of the map; inside the map's source.

    An object belongs to one thread, see `OneThread`.

    Parameters
    ----------
    workspace_map, exchange, force_limit, bounds : as `ParticipantSide`.
    damping : [N s/m] of the helper's hand.
    return_stiffness, return_force : [N/m, N] outside the map's source.

    Raises
    ------
    ConfigurationError : an argument that cannot be used.
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
        """`PULL_BACK` outside the map's source."""
        edges = edge_columns(workspace_map.source.polygon)
        function = BufferedFunction(reflected_force(len(edges)), compile=bounds.get("compile"))
        self._hand, self._jacobian, self._felt, *held = function.inputs
        held[0][:], held[1][:], held[2][:] = self.damping, self.back, edges
        self._felt[:] = math.nan
        self._reflected = function
        self.force = BoundedForce(self._desired, force_limit=force_limit, **bounds)
        self._fraction = _checked_fraction(exchange, self.force.dt)
        self._serials = _Serials()

    def reset(self) -> None:
        """No force, a full tank, no message received; see `ParticipantSide.reset`."""
        self._claim()
        self.force.reset()
        self._felt[:] = math.nan
        self._partner = NO_FORCE
        self._give_away()

    @property
    def partner(self) -> Array:
        """(2,) [m] the participant's hand, as last received, in the helper's workspace: g inverse; NaN where it is not.

        For a display: a Newton solve.
        """
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
        """Force on the helper's hand at x (2,) [m], and what the participant's side is to hear.

        Without a new message the force is released, inside the workspace and outside it.
        """
        if self._owner != get_ident():
            self._claim()
        if received is None or not self._serials.fresh(received.serial):
            self._felt[:] = math.nan
        else:
            self.force.take_energy(received.energy)
            self._felt[:] = _floats(received.force_x, received.force_y)
            self._partner = (received.x, received.y)
        command = self.force.step(x, v, enable=enable, stamp=stamp)
        given = self.force.give_energy(self._fraction)
        return command, FromHelper(*_place(x, self.force), given, self._serials.next())

    def _desired(self, *hand: float) -> tuple[float, float]:
        self._hand[:] = hand
        self._jacobian[...] = self.workspace_map.spline.value_and_jacobian(self._hand[:2])[1]
        self._reflected.evaluate()
        x, y = self._reflected.outputs[0].tolist()
        return x, y


def _place(x: ArrayLike, force: BoundedForce) -> tuple[float, float]:
    """Position of a hand; NaN when its side had to let go, so that the other side does too."""
    if not force.valid:
        return NO_FORCE
    at_x, at_y = np.asarray(x, dtype=np.float64).tolist()
    return at_x, at_y


def _floats(x: float, y: float) -> Array:
    """Two numbers of a message, NaN where one is out of range."""
    return np.array((x, y) if -BEYOND < x < BEYOND and -BEYOND < y < BEYOND else NO_FORCE)


def _checked_map(workspace_map: object) -> ControllerMap:
    if not isinstance(workspace_map, ControllerMap):
        raise ConfigurationError("workspace_map", workspace_map, "a ControllerMap, from WorkspaceMap.for_controller()")
    return workspace_map


def _checked_fraction(exchange: float, dt: float) -> float:
    return min(checked_number("exchange", exchange, above=-1e-12, below=1e4) * dt, 1.0)
