"""What a kind of problem provides to run live: how it is controlled, and how it looks."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from rehab_opt.control.command import Command
from rehab_opt.plants.plant import Measurement, Plant
from rehab_opt.session.outcome import Array

__all__ = ["AT_REST", "DeviceAddress", "LiveControl", "LiveInputs", "LiveProblem", "Seen", "Watching"]


Triple = tuple[float, float, float]

NOWHERE = (math.nan, math.nan, math.nan)


class LiveInputs(NamedTuple):
    """One state of the page's controls; places and forces in the base frame."""

    enable: bool = False
    """The dead-man."""
    target: Triple = NOWHERE
    """[m] where the hand, or its target, is dragged to; NaN where nobody drags: the problem's own reference."""
    helper: Triple = NOWHERE
    """[m] where the hand of who does it along is led to, where two hands do; NaN where nobody leads it."""
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
    plant : it acts on; the sensors of a `TouchedPlant` can be spoilt through the page.
    start : (n,) [rad, m] where it begins, at rest.

    Attributes
    ----------
    timed : whether the controller gets stamps; a run without real time has none.
    """

    mode = ""
    """Of a stick; empty where there is none."""

    def __init__(self, plant: Plant, start: Array) -> None:
        self.plant, self.start, self.timed = plant, start, True

    def stamp(self, seen: Measurement) -> float | None:
        """[s] when something was seen, for the controller's watchdog; None while `timed` is false."""
        return seen.stamp if self.timed else None

    @abstractmethod
    def step(self, inputs: LiveInputs, seen: Measurement) -> Command:
        """The command of a tick, of what is done at the page and what the sensors say."""

    def untouched(self, time: float) -> LiveInputs:
        """What is done where nobody operates: nothing, but the dead-man is held; `time` [s] since the beginning."""
        return LiveInputs(enable=True)

    def plant_command(self, command: Command) -> Array:
        """What the plant takes of a command."""
        return command.value

    @abstractmethod
    def shown(self) -> Mapping[str, ArrayLike]:
        """What the page draws of this tick, by the names of `LiveProblem.layout`."""


class Tracker(Protocol):
    """Something that leads a tool along poses, as `PoseTracker` and `MirrorTracker` do."""

    def step(self, q: Array, pose: Array, twist: Array, *, enable: object, stamp: float | None) -> Command:
        """Joint velocities (n,) of a tool that should now be at `pose` (4, 4) and move at `twist` (6,)."""
        ...


class Following(LiveControl):
    """A tracker along a reference, which waits for whoever lets go, until somebody drags the target.

    Parameters
    ----------
    poses, twists : (N, 4, 4), (N, 6) of the reference, a row a tick.
    then : at its end it begins again, goes back, or the tool stays at the last pose that is known.
    """

    def __init__(
        self,
        tracker: Tracker,
        plant: Plant,
        start: Array,
        poses: Array,
        twists: Array,
        *,
        then: Literal["again", "back", "stay"],
    ) -> None:
        super().__init__(plant, start)
        self._tracker, self._poses, self._twists, self._then = tracker, poses, twists, then
        self._passed, self._still = 0, np.zeros(6)
        self.target: Array = poses[0].copy()

    def step(self, inputs: LiveInputs, seen: Measurement) -> Command:
        """The tracker's."""
        twist = self._still
        if inputs.dragged:
            self.target[:3, 3] = inputs.target
        elif inputs.enable:
            self.target, twist = self._next()
            self._passed += 1
        return self.track(seen, twist, enable=inputs.enable)

    def track(self, seen: Measurement, twist: Array, *, enable: bool) -> Command:
        """The tracker's, towards `target`."""
        return self._tracker.step(seen.position, self.target, twist, enable=enable, stamp=self.stamp(seen))

    def shown(self) -> dict[str, ArrayLike]:
        """Where the robot is, its target, the push."""
        truth = self.plant.truth
        return {"q": truth.position, "target": self.target[:3, 3], "force": truth.force}

    def _next(self) -> tuple[Array, Array]:
        n = len(self._poses)
        if self._then == "stay" and self._passed >= n:
            return self._poses[np.isfinite(self._poses[:, 0, 3])][-1], self._still
        if self._then == "back" and n > 1:
            at = self._passed % (2 * n - 2)
            back = at >= n
            at = 2 * n - 2 - at if back else at
            return self._poses[at].copy(), -self._twists[at] if back else self._twists[at]
        at = self._passed % n
        return self._poses[at].copy(), self._twists[at]


class DeviceAddress(NamedTuple):
    """A robot that is there."""

    kind: str
    """As of `[plant]`."""
    address: str


class LiveProblem(ABC):
    """A problem that runs live. One process calls `control`, another draws: nothing is kept here but the problem.

    Attributes
    ----------
    title : of the page. dt : [s] of a tick. names : of the joints, or coordinates, that are measured and commanded.
    force : size of a force on the hand.
    layout : names and sizes of the numbers that go from the controller to the page.
    """

    logged = False
    """Whether it is a log that is shown, at which nothing can be touched."""
    hands = 1
    """Of 2, the page leads the helper's, and the participant's screen the participant's."""
    device: DeviceAddress | None = None
    """Where its robot is, if it is there: nobody pushes that through the page, or spoils its sensors."""
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

    @property
    def touchable(self) -> frozenset[str]:
        """What of `controls` does something here and now."""
        return frozenset() if self.logged else self.controls - ({"push", "faults"} if self.device else set())

    @abstractmethod
    def control(self, plant: Plant | None = None) -> LiveControl:
        """Controller and plant, made anew; `plant` goes before the problem's own, as that of a log or a device does.

        Raises
        ------
        ConfigurationError : the problem's own is a device.
        """

    @abstractmethod
    def scene(self) -> dict[str, Any]:
        """What the page gets once: see `rehab_opt.live.page`; here what all problems send."""
        encoders = [name.replace("_", " ") for name in self.names]
        controls = sorted(self.touchable)
        return {"title": self.title, "controls": controls, "encoders": encoders, "logged": self.logged}

    @abstractmethod
    def frame(self, shown: Mapping[str, Array]) -> dict[str, Any]:
        """What the page gets again and again, of numbers that `LiveControl.shown` gave."""


class Seen(NamedTuple):
    """One picture of the page."""

    time: float
    """[s] of the loop."""
    held: bool
    """Whether the controller was enabled."""
    status: str
    reason: str
    missed: int
    """Ticks left out so far."""
    stale: int
    """Commands not sent so far."""
    hand: tuple[float, float, float] | None
    """[m] where the page draws one."""
    numbers: tuple[float, ...]
    """What it plots."""


class Watching(Protocol):
    """Gets what the page draws."""

    def begin(self, plots: Sequence[Mapping[str, Any]]) -> None:
        """What the page plots: name, unit, and `line` where it has a limit."""

    def see(self, seen: Seen) -> None:
        """One picture."""
