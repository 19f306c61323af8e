"""Base classes of live runs: the control of a problem, and the data that the page of `rehab-opt live` draws."""

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

Triple = tuple[float, float, float]

NOWHERE = (math.nan, math.nan, math.nan)


class LiveInputs(NamedTuple):
    """State of the page's controls; positions and forces are in the base frame."""

    enable: bool = False
    """Whether the dead man's switch is held."""
    target: Triple = NOWHERE
    """Position [m] to which the user drags the hand's target; NaN for none. Without a dragged target, the controller
    follows the problem's own reference."""
    helper: Triple = NOWHERE
    """Target [m] of the helper's hand, in problems with two hands; NaN for none."""
    push: Triple = (0.0, 0.0, 0.0)
    """Force [N] on the hand."""
    stick: tuple[float, float] = (0.0, 0.0)
    """Deflections of the stick forward and to the left, -1 to 1."""
    switch: bool = False
    """Whether the button that changes the stick's mode is pressed."""
    gripper: bool = False
    """Whether the gripper's button is pressed."""
    frozen: int = -1
    """Number of the encoder that repeats its last value; -1 for none."""
    noise: float = 0.0
    """Standard deviation [rad, m] of noise that is added to every position."""
    delay: float = 0.0
    """Delay [s] of measurements that is added to the plant's own delay."""

    @property
    def dragged(self) -> bool:
        """Whether the user drags the target."""
        return all(map(math.isfinite, self.target))


AT_REST = LiveInputs()
"""Inputs without a user: the dead man's switch is released, and no other control is used."""


class LiveControl(ABC):
    """A controller with its plant, as run by `rehab-opt run`, `loop` and `live`.

    Parameters
    ----------
    plant : plant of the controller; the page can add sensor faults to a `TouchedPlant`.
    start : positions (n,) [rad, m] of the plant at the start, at rest.

    Attributes
    ----------
    timed : whether the controller gets time stamps of measurements, as in real time.
    """

    mode = ""
    """Mode of the stick; empty for problems without a stick."""

    def __init__(self, plant: Plant, start: Array) -> None:
        self.plant, self.start, self.timed = plant, start, True

    def stamp(self, seen: Measurement) -> float | None:
        """Time stamp [s] of a measurement, for the controller's watchdog; None if `timed` is false."""
        return seen.stamp if self.timed else None

    @abstractmethod
    def step(self, inputs: LiveInputs, seen: Measurement) -> Command:
        """Command of a tick, from the page's inputs and the measurement."""

    def untouched(self, time: float) -> LiveInputs:
        """Inputs at `time` [s] since the start without a user: only the dead man's switch is held."""
        return LiveInputs(enable=True)

    def plant_command(self, command: Command) -> Array:
        """Input of the plant for a command."""
        return command.value

    @abstractmethod
    def shown(self) -> Mapping[str, ArrayLike]:
        """Numbers that the page draws for this tick, by the names of `LiveProblem.layout`."""


class Tracker(Protocol):
    """Interface of controllers that track a tool pose, such as `PoseTracker` and `MirrorTracker`."""

    def step(self, q: Array, pose: Array, twist: Array, *, enable: object, stamp: float | None) -> Command:
        """Command of joint velocities at positions q (n,) for the tool's reference `pose` (4, 4) and `twist` (6,)."""
        ...


class Following(LiveControl):
    """Control that tracks a reference with a `Tracker`.

    While the dead man's switch is released, the reference waits. A target that the user drags replaces the reference.

    Parameters
    ----------
    tracker : controller. plant, start : as for `LiveControl`.
    poses, twists : reference poses (N, 4, 4) and twists (N, 6), one for each tick.
    then : after the last pose, the reference restarts ("again"), runs backwards ("back"), or stays ("stay").
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
        """Command of the tracker for the dragged target or the next reference pose."""
        twist = self._still
        if inputs.dragged:
            self.target[:3, 3] = inputs.target
        elif inputs.enable:
            self.target, twist = self._next()
            self._passed += 1
        return self.track(seen, twist, enable=inputs.enable)

    def track(self, seen: Measurement, twist: Array, *, enable: bool) -> Command:
        """Command of the tracker for the pose `target` and a reference `twist` (6,)."""
        return self._tracker.step(seen.position, self.target, twist, enable=enable, stamp=self.stamp(seen))

    def shown(self) -> dict[str, ArrayLike]:
        """Joint positions, position of the target, and force on the hand."""
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
    """Kind and network address of a real robot."""

    kind: str
    """Kind of robot, as in the table `[plant]`: "ur", "franka" or "ros2"."""
    address: str


class LiveProblem(ABC):
    """A problem that can run in real time.

    The controller's process calls `control`, and the page's process draws; so the object stores no state of a run.

    Attributes
    ----------
    title : title of the page. dt : duration of a tick [s]. names : names of the measured joints or coordinates.
    force : number of components of a force on the hand.
    layout : names and sizes of the numbers that the controller sends to the page.
    """

    logged = False
    """Whether a log is shown, for which the page has no controls."""
    hands = 1
    """Number of hands. With 2 hands, the page moves the helper's target, and the participant's page moves the
    participant's target."""
    device: DeviceAddress | None = None
    """Address of a real robot, or None; the page cannot push a real robot or disturb its sensors."""
    controls: ClassVar[frozenset[str]] = frozenset()
    """Controls of the page that have an effect: any of "target", "push", "stick", "faults"."""
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
        """The `controls` that have an effect on the current robot or log."""
        return frozenset() if self.logged else self.controls - ({"push", "faults"} if self.device else set())

    @abstractmethod
    def control(self, plant: Plant | None = None) -> LiveControl:
        """New control of the problem; `plant` replaces the problem's own plant, for example by a device.

        Raises
        ------
        ConfigurationError : `plant` is None and the problem's own plant is a device.
        """

    @abstractmethod
    def scene(self) -> dict[str, Any]:
        """Data that the page gets once; this method returns the part that all problems share."""
        encoders = [name.replace("_", " ") for name in self.names]
        controls = sorted(self.touchable)
        return {"title": self.title, "controls": controls, "encoders": encoders, "logged": self.logged}

    @abstractmethod
    def frame(self, shown: Mapping[str, Array]) -> dict[str, Any]:
        """Data that the page gets 30 times a second, from the numbers of `LiveControl.shown`."""


class Seen(NamedTuple):
    """Numbers of one frame of the page."""

    time: float
    """Time [s] since the loop's start."""
    held: bool
    """Whether the controller was enabled."""
    status: str
    reason: str
    missed: int
    """Number of skipped ticks so far."""
    stale: int
    """Number of commands withheld so far because the robot's state was stale."""
    hand: tuple[float, float, float] | None
    """Position [m] of the hand; None if the page draws no hand."""
    numbers: tuple[float, ...]
    """Plotted numbers, in the order of the plots."""


class Watching(Protocol):
    """Interface of an object that gets the numbers of each frame of the page."""

    def begin(self, plots: Sequence[Mapping[str, Any]]) -> None:
        """Set the plots of the page, each with `name`, `unit`, and `line` if the number has a limit."""

    def see(self, seen: Seen) -> None:
        """Receive the numbers of one frame."""
