"""What one trial leaves behind, tick by tick."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.command import Bound, Status

__all__ = ["LAWS", "HelperTrace", "Law", "Trial"]

Array = NDArray[np.float64]
Law = Literal["unassisted", "assisted", "published", "together", "delayed"]
LAWS: tuple[Law, ...] = ("unassisted", "assisted", "published", "together", "delayed")
"""No force wanted; `Assistance`; the paper's field with a hard gate and a clip (`FieldLaw`), certified by nobody;
`Bilateral`, drawn along by a helper, without and with a delay."""


@dataclass(frozen=True, eq=False)
class HelperTrace:
    """The helper's side of a trial, in the same frame; a row for each tick.

    Attributes
    ----------
    position, intended : (N, 2) [m] of the helper's hand.
    commanded : (N, 2) [N] what the helper is to feel.
    energy_left : (N,) [J] in the helper's tank.
    """

    position: Array
    intended: Array
    commanded: Array
    energy_left: Array


@dataclass(frozen=True, eq=False)
class Trial:
    """One trial; every array has a row for each of its N ticks, in the robot's frame.

    Attributes
    ----------
    law, number : which law, and which trial from 0; the same numbers have the same person in the same mood (seed).
    time : (N,) [s] from the start.
    position, velocity : (N, 2) [m], [m/s] of the hand.
    intended : (N, 2) [m] where the person means to be.
    wanted, commanded, measured : (N, 2) [N] the law's force before bounds (zero where nothing is wanted), the force
        given to the robot's loop, and the force on the hand by the sensor.
    inside : (N,) whether the hand is in the comfortable workspace.
    status, yielded : (N,) index into `tuple(Status)`, and `Bound` flags; 0 for laws that have none.
    energy_left : (N,) [J] in the tank; NaN for laws that have none.
    goal : (N, 2) [m] the point that was to be reached or held; NaN where there is none.
    seen, acting : (N, 2) [m] where the law saw the hand, [N] the motors' force when the tick began; None where the hand
        is seen where it is, and the motors give what they are told.
    helper : who did it along with the participant; None where there is nobody.
    ended : "done" where the task was finished, "late" where its time was over.
    """

    law: Law
    number: int
    time: Array
    position: Array
    velocity: Array
    intended: Array
    wanted: Array
    commanded: Array
    measured: Array
    inside: NDArray[np.bool_]
    status: NDArray[np.uint8]
    yielded: NDArray[np.uint8]
    energy_left: Array
    goal: Array
    ended: Literal["done", "late"]
    helper: HelperTrace | None = None
    seen: Array | None = None
    acting: Array | None = None

    @property
    def statuses(self) -> list[Status]:
        """(N,) as `Status`."""
        members = tuple(Status)
        return [members[i] for i in self.status]

    def flagged(self, bound: Bound) -> NDArray[np.bool_]:
        """(N,) where the bound gave way."""
        gave: NDArray[np.bool_] = (self.yielded & int(bound)) != 0
        return gave
