"""The live run of a kind of problem: its control and its appearance."""

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
    """The state of the page's controls; positions and forces in the base frame."""

    enable: bool = False
    """State of the dead-man switch."""
    target: Triple = NOWHERE
    """[m] Position to which the hand, or its target, is dragged; NaN if it is not dragged: the problem's own reference
    holds."""
    helper: Triple = NOWHERE
    """[m] Position to which the helper's hand is led, if there are two hands; NaN if it is not led."""
    push: Triple = (0.0, 0.0, 0.0)
    """[N] Force on the hand."""
    stick: tuple[float, float] = (0.0, 0.0)
    """Deflections forward and to the left, -1 to 1."""
    switch: bool = False
    gripper: bool = False
    frozen: int = -1
    """Encoder that repeats its last value; -1 for none."""
    noise: float = 0.0
    """[rad, m] Standard deviation of noise that is added to every position."""
    delay: float = 0.0
    """[s] Extra delay of measurements, besides the plant's own."""

    @property
    def dragged(self) -> bool:
        """Whether there is a target."""
        return all(map(math.isfinite, self.target))


AT_REST = LiveInputs()
"""No user: the dead-man switch is released, no control is touched."""


class LiveControl(ABC):
    """A controller with its plant, for a loop; the same objects as in `rehab-opt run`.

    Parameters
    ----------
    plant : its plant; the page can disturb the sensors of a `TouchedPlant`.
    start : (n,) [rad, m] starting position, at rest.

    Attributes
    ----------
    timed : whether the controller gets stamps; only a run in real time has them.
    """

    mode = ""
    """Mode of the stick; empty without one."""

    def __init__(self, plant: Plant, start: Array) -> None:
        self.plant, self.start, self.timed = plant, start, True

    def stamp(self, seen: Measurement) -> float | None:
        """[s] Stamp of a measurement, for the controller's watchdog; None while `timed` is false."""
        return seen.stamp if self.timed else None

    @abstractmethod
    def step(self, inputs: LiveInputs, seen: Measurement) -> Command:
        """The command of a tick, from the page's inputs and the measurements."""

    def untouched(self, time: float) -> LiveInputs:
        """Inputs without a live user: no touch, and the dead-man switch is held; `time` [s] since the start."""
        return LiveInputs(enable=True)

    def plant_command(self, command: Command) -> Array:
        """The part of a command that the plant takes."""
        return command.value

    @abstractmethod
    def shown(self) -> Mapping[str, ArrayLike]:
        """Numbers that the page draws for this tick, by the names of `LiveProblem.layout`."""


class Tracker(Protocol):
    """A controller that moves a tool along poses, as `PoseTracker` and `MirrorTracker` do."""

    def step(self, q: Array, pose: Array, twist: Array, *, enable: object, stamp: float | None) -> Command:
        """Joint velocities (n,) for a tool that should be at `pose` (4, 4) and move with `twist` (6,)."""
        ...


class Following(LiveControl):
    """A tracker along a reference, which waits while the dead-man switch is released; a drag of the target replaces the
    reference.

    Parameters
    ----------
    poses, twists : (N, 4, 4), (N, 6) of the reference, one row for each tick.
    then : at its end the reference restarts, reverses, or stays at its last known pose.
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
        """The tracker's command."""
        twist = self._still
        if inputs.dragged:
            self.target[:3, 3] = inputs.target
        elif inputs.enable:
            self.target, twist = self._next()
            self._passed += 1
        return self.track(seen, twist, enable=inputs.enable)

    def track(self, seen: Measurement, twist: Array, *, enable: bool) -> Command:
        """The tracker's command towards `target`."""
        return self._tracker.step(seen.position, self.target, twist, enable=enable, stamp=self.stamp(seen))

    def shown(self) -> dict[str, ArrayLike]:
        """Pose of the robot, its target, and the push."""
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
    """Address of a real robot."""

    kind: str
    """Kind, as in `[plant]`."""
    address: str


class LiveProblem(ABC):
    """A problem with a live run. One process calls `control` and another draws, so the object holds only the problem.

    Attributes
    ----------
    title : of the page. dt : [s] of a tick. names : of the measured and commanded joints or coordinates.
    force : dimension of a force on the hand.
    layout : names and sizes of the numbers that the controller sends to the page.
    """

    logged = False
    """Whether a log is shown, which cannot be touched."""
    hands = 1
    """With 2 hands, the page leads the helper's, and the participant's screen the participant's."""
    device: DeviceAddress | None = None
    """Address of a real robot, if any: the page cannot push it or disturb its sensors."""
    controls: ClassVar[frozenset[str]] = frozenset()
    """Controls of the page that have an effect: of "target", "push", "stick", "faults"."""
    title: str
    dt: float
    names: tuple[str, ...]
    force: int = 3
    layout: Mapping[str, int]

    @property
    def encoders(self) -> int:
        """Number of positions that the plant measures."""
        return len(self.names)

    @property
    def touchable(self) -> frozenset[str]:
        """The `controls` that have an effect now."""
        return frozenset() if self.logged else self.controls - ({"push", "faults"} if self.device else set())

    @abstractmethod
    def control(self, plant: Plant | None = None) -> LiveControl:
        """New controller and plant; `plant` replaces the problem's own, for example by one of a log or a device.

        Raises
        ------
        ConfigurationError : the problem's own plant is a device.
        """

    @abstractmethod
    def scene(self) -> dict[str, Any]:
        """Data that the page gets once: see `rehab_opt.live.page`; here the part common to all problems."""
        encoders = [name.replace("_", " ") for name in self.names]
        controls = sorted(self.touchable)
        return {"title": self.title, "controls": controls, "encoders": encoders, "logged": self.logged}

    @abstractmethod
    def frame(self, shown: Mapping[str, Array]) -> dict[str, Any]:
        """Data that the page gets repeatedly, from the numbers of `LiveControl.shown`."""


class Seen(NamedTuple):
    """One picture of the page."""

    time: float
    """Time of the loop [s]."""
    held: bool
    """Whether the controller was enabled."""
    status: str
    reason: str
    missed: int
    """Number of ticks left out so far."""
    stale: int
    """Number of commands withheld so far."""
    hand: tuple[float, float, float] | None
    """[m] Position of the hand, if the page draws one."""
    numbers: tuple[float, ...]
    """The plotted numbers."""


class Watching(Protocol):
    """Receives what the page draws."""

    def begin(self, plots: Sequence[Mapping[str, Any]]) -> None:
        """Plots of the page: name, unit, and `line` if there is a limit."""

    def see(self, seen: Seen) -> None:
        """Receive one picture."""
