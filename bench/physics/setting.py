"""Where a task is done: the cell of the grid, the arm, its plant, and the controllers that are tried."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.physics.arms import ARMS, Arm
from rehab_opt.plants.channel import Channel
from rehab_opt.plants.contacts import Contact
from rehab_opt.plants.drives import Drive
from rehab_opt.plants.ideal import IdealJoints
from rehab_opt.plants.mujoco_arm import MujocoArm
from rehab_opt.plants.plant import Plant

__all__ = ["CELLS", "Cell", "Numbers", "Setting", "Task", "setting_of"]

Array = NDArray[np.float64]
Numbers = dict[str, float]
"""What a task measured, by the name that its rows know."""

FORCE_NOISE = 2.0
"""[N]"""
MISTOLD = (0.0, 0.003, -0.003)
"""[s] By so much another delay than the true one is told, in turn; none is below zero."""


class Cell(NamedTuple):
    """One cell of the grid."""

    delay: float
    """[s] of command and measurement together, half of it each way."""
    noise: float
    """[rad] of the encoders."""
    rate: float
    """[Hz]"""


CELLS = tuple(Cell(*each) for each in product((0.0, 0.002, 0.005, 0.008), (0.0, 1e-4, 2e-4), (500.0, 1000.0)))


@dataclass
class Setting:
    """One task's surroundings. Everything random in it comes of `rng`.

    A controller is told what it can be told: constructor arguments `actuation_delay` and `position_noise` are given
    where its class has them.
    """

    cell: Cell
    arm: Arm
    rng: np.random.Generator
    mistold: float = 0.0
    """[s] that are told of the delay besides."""
    ideal: bool = False
    kept: dict[Any, Any] = field(default_factory=dict)
    """Controllers that were built before: they take seconds."""

    @property
    def dt(self) -> float:
        """[s] of a tick."""
        return 1.0 / self.cell.rate

    def plant(self, *, drive: Drive | None = None, contacts: tuple[Contact, ...] = ()) -> Plant:
        """The arm with a velocity servo by default, or joints that move as commanded."""
        if self.ideal:
            return IdealJoints(self.dt)
        return MujocoArm(
            self.arm.model, dt=self.dt, drive=drive, channel=self.channel, contacts=contacts, seed=self.rng
        )

    @property
    def channel(self) -> Channel:
        """Half of the delay each way."""
        half = self.cell.delay / 2
        return Channel(
            command_delay=half,
            measurement_delay=half,
            position_noise=self.cell.noise,
            force_noise=FORCE_NOISE,
        )

    def told(self, kind: Callable[..., Any]) -> dict[str, Any]:
        """What a class of controllers can be told of this cell, by the names of its arguments."""
        known = _arguments(kind)
        delay = max(self.cell.delay + self.mistold, 0.0)
        all_of_it: Mapping[str, Any] = {
            "actuation_delay": delay,
            "position_noise": self.cell.noise,
        }
        return {name: value for name, value in all_of_it.items() if name in known}

    def controller(self, kind: Callable[..., Any], *own: Any, **options: Any) -> Any:
        """A controller of a class, told what it can be told of this cell; built once, and reset.

        Parameters
        ----------
        own : positional arguments. options : further ones; both are part of what it is kept by.
        """
        given = self.told(kind)
        key = (kind, tuple(map(id, own)), repr(sorted(options.items())), self.dt, repr(given))
        if key not in self.kept:
            self.kept[key] = (own, kind(*own, dt=self.dt, **options, **given))
        controller = self.kept[key][1]
        if hasattr(controller, "reset"):
            controller.reset()
        return controller


Task = Callable[[Setting], Numbers]
"""Something that is done once in a setting, and what was measured."""


def setting_of(number: int, row: str, *, seed: int, ideal: bool = False, kept: dict[Any, Any]) -> Setting:
    """The setting of task `number`: cells in turn, arms like the fields of a chessboard, the other way each round.

    Random by seed, row and number alone. Ideal joints have the first cell, the arms in turn.
    """
    round_, place = divmod(number, len(CELLS))
    cell = CELLS[0] if ideal else CELLS[place]
    field = number if ideal else place // 6 + place % 6 // 2 + place % 2 + round_
    arm = list(ARMS.values())[field % len(ARMS)]()
    rng = np.random.default_rng([seed, number, *row.encode()])
    mistold = 0.0 if ideal else MISTOLD[(round_ + place) % len(MISTOLD)]
    return Setting(cell, arm, rng, mistold, ideal=ideal, kept=kept)


def _arguments(kind: Callable[..., Any]) -> set[str]:
    """Names of the arguments of a class and of the classes it is built on, which may hand options through."""
    if not inspect.isclass(kind):
        return set(inspect.signature(kind).parameters)
    own = [vars(each)["__init__"] for each in kind.__mro__ if "__init__" in vars(each) and each is not object]
    return {name for init in own for name in inspect.signature(init).parameters}
