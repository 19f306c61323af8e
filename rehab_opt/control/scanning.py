"""Single-switch or sip-and-puff control instead of a stick: options light up in turn, and a press selects one."""

from __future__ import annotations

import math
from collections.abc import Sequence
from threading import get_ident
from typing import NamedTuple

import numpy as np

from rehab_opt.control.joystick import STICK_MODES, Button, StickCommand, StickMode, checked_modes, stepped_towards
from rehab_opt.control.thread_owner import OneThread
from rehab_opt.control.velocity_controller import checked_number
from rehab_opt.errors import ConfigurationError

__all__ = ["ScanOption", "Scanning"]


HELD = 0.7
"""Fraction of the threshold below which a press ends, since breath pressure wavers."""


class ScanOption(NamedTuple):
    """An option that lights up in the scan."""

    name: str
    mode: StickMode | None
    """Mode of the stick, or None for the gripper."""
    deflection: tuple[float, float]
    """Equivalent deflection of the stick."""


class Scanning(OneThread):
    """Convert presses on lit options to hand velocities.

    Each option is lit for `dwell` seconds. While a press lasts, the option stays lit and the hand moves; after release
    the scan continues. With a sip-and-puff straw a puff moves one way and a sip the other; a single switch scans both
    directions in turn.

    Parameters
    ----------
    modes : as in `Joystick`; every row is scanned once. dt : tick [s].
    dwell : [s] for which an option is lit. sip : whether a straw allows sips, too.
    threshold : pressure, 0 to 1, at which a press starts; it ends below `HELD` times this.
    rate : [1/s] rate at which the speed grows.
    """

    def __init__(
        self,
        modes: Sequence[StickMode] = STICK_MODES,
        *,
        dt: float = 0.01,
        dwell: float = 1.0,
        sip: bool = False,
        threshold: float = 0.3,
        rate: float = 3.0,
    ) -> None:
        self.options = _options(checked_modes(modes), both_ways=not sip)
        self._dt = checked_number("dt", dt, above=0.0, below=1.0)
        self._dwell = math.ceil(checked_number("dwell", dwell, above=0.0, below=1e3) / dt)
        if not isinstance(sip, bool):
            raise ConfigurationError("sip", sip, "True or False")
        self._sip, self._rate = sip, checked_number("rate", rate, above=0.0)
        self._threshold = checked_number("threshold", threshold, above=0.0, below=1.0)
        self.reset()

    @property
    def lit(self) -> ScanOption:
        """Option that a press would select now."""
        return self.options[self._lit]

    def reset(self) -> None:
        """Reset to the first option, gripper open, no press."""
        self._claim()
        self._lit, self._ticks, self._closed = 0, 0, False
        self._way, self._free = 0, False
        self._puff, self._sipped = Button(self._dt), Button(self._dt)
        self._deflection = np.zeros(2)
        self._give_away()

    def step(self, pressure: float) -> StickCommand:
        """The user's command at a pressure: 0 to 1 for a puff or switch, 0 to -1 for a sip; NaN counts as no press."""
        if self._owner != get_ident():
            self._claim()
        way, reason = self._pressed(pressure)
        if way == 0:
            self._free = not reason
            self._ticks += 1
            if self._ticks >= self._dwell:
                self._lit, self._ticks = (self._lit + 1) % len(self.options), 0
        elif not self._free:
            way, reason = 0, "the switch must be let go first"
        else:
            self._ticks = 0
        option, begun = self.lit, (self._puff.press(way > 0), self._sipped.press(way < 0))
        if any(begun) and option.mode is None:
            self._closed = not self._closed
        target = way * np.array(option.deflection)
        self._deflection = stepped_towards(self._deflection, target, self._rate * self._dt)
        mode = option.mode or next(each.mode for each in self.options if each.mode)
        twist = self._deflection * mode.speeds + 0.0
        twist.flags.writeable = False
        return StickCommand(twist, mode.rows, "chassis", self._closed, reason)

    def _pressed(self, pressure: object) -> tuple[int, str]:
        try:
            value = math.nan if isinstance(pressure, (str, bytes)) else float(pressure)  # type: ignore[arg-type]
        except (TypeError, ValueError, OverflowError):
            value = math.nan
        if not math.isfinite(value):
            self._way = 0
            return 0, "pressure is not finite"
        way, size = (-1, -value) if self._sip and value < 0 else (1, value)
        enough = self._threshold * (HELD if way == self._way else 1.0)
        self._way = way if size >= enough else 0
        return self._way, ""


def _options(modes: tuple[StickMode, ...], *, both_ways: bool) -> tuple[ScanOption, ...]:
    options, seen = [], set()
    for mode in modes:
        for axis, row in enumerate(mode.rows):
            if row in seen:
                continue
            seen.add(row)
            for sign, suffix in ((1.0, "+"), (-1.0, "-")) if both_ways else ((1.0, ""),):
                deflection = (sign, 0.0) if axis == 0 else (0.0, sign)
                options.append(ScanOption(row + suffix, mode, deflection))
    return (*options, ScanOption("gripper", None, (0.0, 0.0)))
