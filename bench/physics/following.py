"""A controller in closed loop on a plant, tick by tick, and what was true meanwhile."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.physics.geometry import frames, jacobians
from rehab_opt import Command, SerialChain, Status
from rehab_opt.plants.plant import Measurement, Plant

__all__ = ["ASKED_BACKUP", "Run", "follow"]

Array = NDArray[np.float64]

ASKED_BACKUP = (Status.BACKUP, Status.BRAKING, Status.HOLDING)
"""Statuses of ticks that the primary solver did not answer."""

Step = Callable[[int, Measurement], Command]
"""The number of the tick and what is seen -> a command."""


@dataclass
class Run:
    """N ticks on one plant."""

    chain: SerialChain
    dt: float
    q: Array
    """(N, n) true positions at the beginning of each tick."""
    velocity: Array
    """(N, n) true."""
    force: Array
    """(N, 3) [N] on the hand, true."""
    status: list[Status]
    reason: list[str]

    def until(self, ticks: int) -> Run:
        """Its first ticks."""
        of_each = (self.q, self.velocity, self.force, self.status, self.reason)
        return Run(self.chain, self.dt, *(each[:ticks] for each in of_each))  # type: ignore[arg-type]

    @property
    def hand(self) -> Array:
        """(N, 3) [m] true places of the hand."""
        places: Array = frames(self.chain, self.q)[:, -1, :3, 3]
        return places

    def hand_speed(self, ticks: slice = slice(None)) -> Array:
        """(K,) [m/s] true speeds of the hand."""
        moves = jacobians(self.chain, self.q[ticks])[:, :3] @ self.velocity[ticks, :, None]
        return np.asarray(np.linalg.norm(moves[..., 0], axis=1))

    def fraction(self, *of: Status) -> float:
        """Of the ticks, with one of these statuses."""
        return sum(each in of for each in self.status) / len(self.status)


def follow(
    plant: Plant,
    chain: SerialChain,
    start: Array,
    ticks: int,
    step: Step,
    *,
    each: Callable[[int, Plant], Array | None] = lambda *_: None,
) -> Run:
    """Run `ticks` ticks from rest at `start` (n,).

    Parameters
    ----------
    step : the controller. each : called before every tick's command is sent; the push (3,) [N] on the hand, or None.
    """
    seen = plant.reset(start)
    rows: list[tuple[Any, ...]] = []
    for k in range(ticks):
        truth = plant.truth
        command = step(k, seen)
        rows.append((truth.position, truth.velocity, truth.force, command.status, command.reason))
        seen = plant.step(command.value, each(k, plant))
    q, velocity, force, status, reason = zip(*rows, strict=True)
    return Run(chain, plant.dt, np.array(q), np.array(velocity), np.array(force), list(status), list(reason))
