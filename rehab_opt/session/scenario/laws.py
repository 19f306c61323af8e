"""The three laws of a trial, as a loop calls them: none, ours, the paper's."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np

from rehab_opt.control.assistance import Assistance
from rehab_opt.control.command import Status
from rehab_opt.field.potential import PotentialField
from rehab_opt.published.field_law import FieldLaw

__all__ = ["Answer", "Assisted", "ForceLaw", "Published", "Unassisted"]

NONE = (0.0, 0.0)
INDEX = {status: i for i, status in enumerate(Status)}


class Answer(NamedTuple):
    """Force wanted and commanded [N], index of the status, `Bound` flags, energy left [J]."""

    wanted: tuple[float, float]
    force: tuple[float, float]
    status: int = 0
    yielded: int = 0
    energy_left: float = math.nan


class ForceLaw(Protocol):
    """Positions in, forces out."""

    def start(self) -> None:
        """A trial begins."""

    def aim(self, goal: int) -> None:
        """The goal has changed."""

    def answer(self, x: float, y: float) -> Answer:
        """The force for a hand at (x, y) [m]."""
        ...


class Unassisted:
    """The robot follows the hand without a force of its own."""

    def start(self) -> None:
        """Nothing to forget."""

    def aim(self, goal: int) -> None:
        """Nothing to aim."""

    def answer(self, x: float, y: float) -> Answer:
        """No force."""
        return Answer(NONE, NONE)


class Assisted:
    """`Assistance`, which estimates the velocity from the positions; aims at one field after the other."""

    def __init__(self, assistance: Assistance, fields: Sequence[PotentialField]) -> None:
        self._assistance, self._fields = assistance, fields

    def start(self) -> None:
        """No force yet, and a full tank."""
        self._assistance.aim(self._fields[0])
        self._assistance.reset()

    def aim(self, goal: int) -> None:
        """The field of that goal, where there is one for each."""
        if len(self._fields) > 1:
            self._assistance.aim(self._fields[goal])

    def answer(self, x: float, y: float) -> Answer:
        """The certified force."""
        command = self._assistance.step((x, y))
        force_x, force_y = command.value.tolist()
        wanted = self._assistance.wanted
        return Answer(
            wanted, (force_x, force_y), INDEX[command.status], command.yielded._value_, self._assistance.energy_left
        )


class Published:
    """Eq. (20) with a hard gate and a clip; velocities by differences of positions, `dt` [s] apart."""

    def __init__(self, law: FieldLaw, *, dt: float) -> None:
        self._law, self._dt = law, dt
        self.start()

    def start(self) -> None:
        """Nothing is known of the velocity."""
        self._last: tuple[float, float] | None = None

    def aim(self, goal: int) -> None:
        """The published field is of all points at once."""

    def answer(self, x: float, y: float) -> Answer:
        """The clipped force."""
        before = self._last or (x, y)
        self._last = (x, y)
        velocity = ((x - before[0]) / self._dt, (y - before[1]) / self._dt)
        force_x, force_y = self._law.force(np.array((x, y)), np.array(velocity)).tolist()
        return Answer((force_x, force_y), (force_x, force_y))
