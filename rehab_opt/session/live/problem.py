"""What a kind of problem tells of itself so that it runs live: how it is controlled, and how it looks."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.control.command import Command
from rehab_opt.plants.plant import Measurement
from rehab_opt.plants.touched import TouchedPlant

__all__ = ["AT_REST", "LiveControl", "LiveInputs", "LiveProblem"]

Array = NDArray[np.float64]


Triple = tuple[float, float, float]

NOWHERE = (math.nan, math.nan, math.nan)


class LiveInputs(NamedTuple):
    """One state of the page's controls; places and forces in the base frame."""

    enable: bool = False
    """The dead-man."""
    target: Triple = NOWHERE
    """[m] where the hand, or its target, is dragged to; NaN where nobody drags: the problem's own reference."""
    push: Triple = (0.0, 0.0, 0.0)
    """[N] on the hand."""
    stick: tuple[float, float] = (0.0, 0.0)
    """Deflection forward and to the left, -1 to 1."""
    switch: bool = False
    gripper: bool = False
    frozen: int = -1
    """Encoder that repeats its last value; -1 for none."""
    noise: float = 0.0
    """[rad, m] standard deviation that is added to every position."""
    delay: float = 0.0
    """[s] by which measurements are late, besides the plant's own delay."""

    @property
    def dragged(self) -> bool:
        """Whether there is a target."""
        return all(map(math.isfinite, self.target))


AT_REST = LiveInputs()
"""Nobody there: the dead-man released, nothing touched."""


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
