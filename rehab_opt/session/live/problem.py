"""What a kind of problem tells of itself so that it runs live: how it is controlled, and how it looks."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.control.command import Command
from rehab_opt.plants.plant import Measurement
from rehab_opt.plants.touched import TouchedPlant
from rehab_opt.session.live.inputs import LiveInputs

__all__ = ["LiveControl", "LiveProblem"]

Array = NDArray[np.float64]


class LiveControl(ABC):
    """A controller with its plant, for a loop: the very ones that `rehab-opt run` uses.

    Parameters
    ----------
    plant : whose sensors can be spoilt through the page. start : (n,) [rad, m] where it begins, at rest.
    """

    mode = ""
    """Of a stick; empty where there is none."""

    def __init__(self, plant: TouchedPlant, start: Array) -> None:
        self.plant, self.start = plant, start

    @abstractmethod
    def step(self, inputs: LiveInputs, seen: Measurement) -> Command:
        """The command of a tick, of what is done at the page and what the sensors say."""

    def sent(self, command: Command) -> Array:
        """What the plant takes of a command."""
        return command.value

    @abstractmethod
    def shown(self) -> Mapping[str, ArrayLike]:
        """What the page draws of this tick, by the names of `LiveProblem.layout`."""


class LiveProblem(ABC):
    """A problem that runs live. One process calls `control`, another draws: nothing is kept here but the problem.

    Attributes
    ----------
    title : of the page. dt : [s] of a tick. names : of the joints, or coordinates, that are measured and commanded.
    force : size of a force on the hand.
    layout : names and sizes of the numbers that go from the controller to the page.
    """

    controls: ClassVar[frozenset[str]] = frozenset()
    """Of "target", "push", "stick", "faults": what of the page does something here."""
    title: str
    dt: float
    names: tuple[str, ...]
    force: int = 3
    layout: Mapping[str, int]

    @property
    def encoders(self) -> int:
        """How many positions the plant measures."""
        return len(self.names)

    @abstractmethod
    def control(self) -> LiveControl:
        """Controller and plant, made anew."""

    def untouched(self, time: float) -> LiveInputs:
        """What is done at the page in a film: nothing, but the dead-man is held; `time` [s] since the beginning."""
        return LiveInputs(enable=True)

    @abstractmethod
    def scene(self) -> dict[str, Any]:
        """What the page is told once: see `rehab_opt.live.page`; here what all problems tell it."""
        encoders = [name.replace("_", " ") for name in self.names]
        return {"title": self.title, "controls": sorted(self.controls), "encoders": encoders}

    @abstractmethod
    def frame(self, shown: Mapping[str, Array]) -> dict[str, Any]:
        """What the page is told again and again, of numbers that `LiveControl.shown` gave."""
