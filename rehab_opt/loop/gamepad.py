"""Joysticks and gamepads on Linux (`/dev/input/js0`); run as a program, this module writes their state to a ring."""

from __future__ import annotations

import json
import math
import os
import select
import struct
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple, Self

from rehab_opt.errors import ConfigurationError, DeviceLostError, printable
from rehab_opt.loop.shared_ring import SharedRing

__all__ = ["Gamepad", "PadState", "operate"]

EVENT = struct.Struct("=IhBB")
"""Event of Linux's joystick interface (Documentation/input/joydev/joystick-api): time [ms], value, kind, number."""
BUTTON, AXIS, AT_OPENING = 0x01, 0x02, 0x80
LARGEST = 32767
POLL = 0.01
"""Time [s] between two heartbeats."""
MOST = 32
"""Largest number of axes and of buttons."""


class PadState(NamedTuple):
    """State of a gamepad."""

    axes: tuple[float, ...]
    """Deflections, -1 to 1, in Linux's order; for most sticks, axis 0 is to the right and axis 1 backwards."""
    buttons: int
    """One bit per button."""
    held: bool
    """Whether the dead man's button is pressed and was released at least once since the gamepad was opened."""

    @property
    def forward_left(self) -> tuple[float, float]:
        """Deflection (forward, left) of the first stick, as `Joystick` expects it."""
        x, y = (*self.axes, 0.0, 0.0)[:2]
        return (-y + 0.0, -x + 0.0)


class Gamepad:
    """A gamepad, read without waiting.

    Use a wired gamepad as a dead man's switch: if a wireless gamepad is out of range, Linux may keep its last state
    with the button pressed. An unplugged gamepad raises an error.

    Parameters
    ----------
    source : path of the device, or a file descriptor that yields the same bytes.
    dead_man : number of the dead man's button, from 0.

    Raises
    ------
    ConfigurationError : the device cannot be opened, or the button's number is invalid.
    """

    def __init__(self, source: str | Path | int, *, dead_man: int = 4) -> None:
        if not (isinstance(dead_man, int) and 0 <= dead_man < MOST):
            raise ConfigurationError("dead_man", dead_man, f"a button from 0 to {MOST - 1}")
        self._name, self._dead_man = str(source), dead_man
        try:
            self._descriptor = source if isinstance(source, int) else os.open(source, os.O_RDONLY)
            os.set_blocking(self._descriptor, False)
        except OSError as absent:
            raise ConfigurationError("source", str(source), f"a gamepad ({absent.strerror})") from absent
        self._axes, self._buttons, self._rest, self._free = dict[int, float](), 0, b"", False

    def read(self) -> PadState:
        """Current state of the gamepad.

        Raises
        ------
        DeviceLostError : the gamepad is unplugged.
        """
        while True:
            try:
                came = os.read(self._descriptor, 64 * EVENT.size)
            except BlockingIOError:
                break
            except OSError as gone:
                raise DeviceLostError(f"gamepad {self._name}: {gone.strerror}") from gone
            if not came:
                raise DeviceLostError(f"gamepad {self._name}: its stream has ended")
            self._take(self._rest + came)
        axes = tuple(self._axes.get(i, 0.0) for i in range(1 + max(self._axes, default=-1)))
        pressed = bool(self._buttons >> self._dead_man & 1)
        return PadState(axes, self._buttons, pressed and self._free)

    def close(self) -> None:
        """Close the device."""
        os.close(self._descriptor)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _take(self, data: bytes) -> None:
        whole = len(data) // EVENT.size * EVENT.size
        self._rest = data[whole:]
        for _, value, kind, number in EVENT.iter_unpack(data[:whole]):
            if number >= MOST:
                continue
            if kind & ~AT_OPENING == AXIS:
                self._axes[number] = max(-1.0, value / LARGEST)
            elif kind & ~AT_OPENING == BUTTON:
                self._buttons = self._buttons & ~(1 << number) | (bool(value) << number)
                self._free = self._free or (number == self._dead_man and not value)


def operate(pad: Gamepad, ring: SharedRing, *, until: Callable[[], bool] = lambda: False) -> None:
    """Write a gamepad's state at 100 Hz to a ring of `operator_layout` records, which a loop reads.

    Run this function in a process or thread of its own: if the process is killed, heartbeats stop and the robot brakes.

    Raises
    ------
    DeviceLostError : the gamepad is unplugged; before, a released dead man's switch is written to the ring.
    """
    size = ring.layout["stick"].shape[0]
    ring.record["target"][...] = math.nan  # a stick has no target position
    try:
        while not until():
            state = pad.read()
            stick = (*state.forward_left, *state.axes[2:], *[0.0] * size)[:size]
            ring.write(stick=stick, buttons=state.buttons, heartbeat=time.monotonic() if state.held else float("nan"))
            time.sleep(POLL)
    finally:
        ring.write(stick=0.0, heartbeat=float("nan"))


def main() -> None:
    """Write the state of a gamepad to a ring until standard input closes or the gamepad is unplugged."""
    orders = json.loads(sys.stdin.buffer.readline())
    ring = SharedRing.attach(orders["ring"])
    with Gamepad(orders["source"]) as pad:
        try:
            operate(pad, ring, until=lambda: bool(select.select([sys.stdin], [], [], 0)[0]))
        except DeviceLostError as gone:
            print(printable(str(gone)), file=sys.stderr)


if __name__ == "__main__":
    main()
