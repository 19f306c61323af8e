"""Two-axis stick that a button switches between pairs of task rows (Honzik, section 4)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from threading import get_ident
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.control.hand_task import ROWS, checked_rows
from rehab_opt.control.thread_owner import OneThread
from rehab_opt.control.velocity_controller import checked_number, real_numbers
from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.real_array import is_true
from rehab_opt.optim.rows import MAX_MAGNITUDE

__all__ = ["STICK_MODES", "Button", "Joystick", "StickCommand", "StickMode", "checked_modes"]

Array = NDArray[np.float64]

DEBOUNCE = 0.15
"""[s] Presses within this time count as one, since contacts bounce and hands tremble."""


class StickMode(NamedTuple):
    """Mode of the stick: the task rows that its two axes (forward, left) move."""

    name: str
    rows: tuple[str, str]
    speeds: tuple[float, float]
    """[m/s or rad/s] Hand speeds at full deflection; a negative value reverses an axis."""
    held: tuple[str, ...] = ()
    """Rows that stay at zero while the stick moves the others: ("rx", "ry") keep a cup level."""

    @property
    def task_rows(self) -> tuple[str, ...]:
        """The stick's two rows and the held rows; if any rows are held, in the order of `ROWS`."""
        return tuple(row for row in ROWS if row in (*self.rows, *self.held)) if self.held else self.rows


STICK_MODES = (StickMode("plane", ("x", "y"), (0.25, 0.25)), StickMode("lift", ("z", "roll7"), (0.15, 0.6)))
"""Modes of Honzik's paper; the speeds are our choices."""


class StickCommand(NamedTuple):
    """User's command, as arguments of `RedundancyResolver.step`."""

    twist: Array
    """(k,) [m/s or rad/s] hand velocity, read-only; zero without a command, and in held rows."""
    rows: tuple[str, ...]
    frame: str
    """Always the chair's frame, so that the stick keeps its meaning as the chair turns."""
    gripper_closed: bool
    reason: str
    """Reason for a zero command despite a deflection; empty otherwise."""


class Joystick(OneThread):
    """Convert stick deflections to hand velocities in one of several modes.

    A round dead zone suppresses tremor; beyond it the speed grows from zero. The deflection follows the stick at
    `rate`; a released stick stops the hand at once, within the resolver's accelerations. At the beginning, after a
    change of mode and after a fault, the stick must first return to the centre.

    Parameters
    ----------
    modes : at least one; the switch cycles through them. dt : tick [s].
    dead_zone : fraction of the deflection that counts as zero.
    rate : [1/s] largest rate of change of the deflection, whose full size is 1.
    """

    def __init__(
        self, modes: Sequence[StickMode] = STICK_MODES, *, dt: float = 0.01, dead_zone: float = 0.12, rate: float = 3.0
    ) -> None:
        self.modes = checked_modes(modes)
        self._rows = [mode.task_rows for mode in self.modes]
        self._places = [[mode.task_rows.index(row) for row in mode.rows] for mode in self.modes]
        self._dt = checked_number("dt", dt, above=0.0, below=1.0)
        self.dead_zone = 0.0 if dead_zone == 0 else checked_number("dead_zone", dead_zone, above=0.0, below=1.0)
        self._rate = checked_number("rate", rate, above=0.0)
        self.reset()

    @property
    def mode(self) -> StickMode:
        """Current mode."""
        return self.modes[self._mode]

    def reset(self) -> None:
        """Reset to the first mode and an open gripper; the stick must first return to the centre."""
        self._claim()
        self._mode, self._closed, self._free = 0, False, False
        self._deflection = np.zeros(2)
        self._switch, self._gripper = Button(self._dt), Button(self._dt)
        self._give_away()

    def step(self, axes: ArrayLike, *, switch: object = False, gripper: object = False) -> StickCommand:
        """User's current command; invalid numbers give a zero command with a reason.

        Parameters
        ----------
        axes : (2,) deflection forward and to the left, each -1 to 1; a wrong shape raises `ConfigurationError`.
        switch : button that changes the mode when pressed. gripper : button that opens and closes the gripper.
        """
        if self._owner != get_ident():
            self._claim()
        told = real_numbers("axes", axes, (2,))
        if self._switch.press(switch):
            self._mode, self._free = (self._mode + 1) % len(self.modes), False
        if self._gripper.press(gripper):
            self._closed = not self._closed
        reason = ""
        if not np.all(np.isfinite(told)):
            reason, self._free, told = "axes are not finite", False, np.zeros(2)
        else:
            told = self._beyond_dead_zone(np.clip(told, -1.0, 1.0))
            self._free = self._free or not told.any()
            if not self._free:
                reason, told = "the stick must be released first", np.zeros(2)
        self._deflection = stepped_towards(self._deflection, told, self._rate * self._dt)
        rows = self._rows[self._mode]
        twist = np.zeros(len(rows))
        twist[self._places[self._mode]] = self._deflection * self.mode.speeds + 0.0
        twist.flags.writeable = False
        return StickCommand(twist, rows, "chassis", self._closed, reason)

    def _beyond_dead_zone(self, axes: Array) -> Array:
        size = float(np.hypot(*axes))
        if not size > self.dead_zone:
            return np.zeros(2)
        return axes / size * min((size - self.dead_zone) / (1.0 - self.dead_zone), 1.0)


def stepped_towards(last: Array, target: Array, most: float) -> Array:
    """Point at most `most` away from `last` on the way to `target`; a zero target is reached at once."""
    way = target - last
    size = float(np.linalg.norm(way))
    if size <= most or not target.any():
        return target.copy()
    return np.asarray(last + way * (most / size))


class Button:
    """Detect presses of a button."""

    def __init__(self, dt: float) -> None:
        self._ticks = math.ceil(DEBOUNCE / dt)
        self._down: bool | None
        self._down, self._since = None, self._ticks

    def press(self, down: object) -> bool:
        """Whether a press begins in this tick; the method must be called in every tick."""
        now = is_true(down)
        if self._down is None:
            self._down = now  # a button that is down from the beginning is stuck
        begun = now and not self._down and self._since >= self._ticks
        self._since = 0 if now != self._down else self._since + 1
        self._down = now
        return begun


def checked_modes(modes: Sequence[StickMode]) -> tuple[StickMode, ...]:
    """Check that a `RedundancyResolver` can follow the modes."""
    if not isinstance(modes, (list, tuple)) or isinstance(modes, StickMode) or not modes:
        raise ConfigurationError("modes", modes, "a list or tuple of at least one StickMode")
    checked = tuple(_checked_mode(f"modes[{i}]", mode) for i, mode in enumerate(modes))
    if len({mode.name for mode in checked}) < len(checked):
        raise ConfigurationError("modes", [mode.name for mode in checked], "a name of its own for each")
    return checked


def _checked_mode(argument: str, mode: object) -> StickMode:
    if not (isinstance(mode, (list, tuple)) and 3 <= len(mode) <= len(StickMode._fields)):
        raise ConfigurationError(argument, mode, "a StickMode: name, two rows, two speeds, and rows that are held")
    name, rows, speeds, held = (*mode, ())[: len(StickMode._fields)]
    pair = tuple(rows) if isinstance(rows, (list, tuple)) else ()
    known = all(isinstance(row, str) and row in ROWS for row in pair)
    if len(pair) != 2 or not known or pair[0] == pair[1]:
        raise ConfigurationError(f"{argument}.rows", rows, f"two different ones of {', '.join(ROWS)}")
    sizes = tuple(speeds) if isinstance(speeds, (list, tuple, np.ndarray)) else ()
    if len(sizes) != 2:
        raise ConfigurationError(f"{argument}.speeds", speeds, "two numbers")
    one, two = (checked_number(f"{argument}.speeds", each, above=-MAX_MAGNITUDE, below=MAX_MAGNITUDE) for each in sizes)
    still = tuple(held) if isinstance(held, (list, tuple)) else (held,)
    if still:
        checked_rows((*pair, *still), f"{argument}.held")
    return StickMode(str(name), pair, (one, two), still)
