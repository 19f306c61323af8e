"""Sticks and gamepads as Linux reports them: `/dev/input/js0`; as a program, a process that reads one."""

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
"""Of the kernel's joystick interface (Documentation/input/joydev/joystick-api): time [ms], value, kind, number."""
BUTTON, AXIS, AT_OPENING = 0x01, 0x02, 0x80
LARGEST = 32767
POLL = 0.01
"""[s] between two heartbeats."""
MOST = 32
"""Axes and buttons that are looked at."""


class PadState(NamedTuple):
    """What a gamepad is like."""

    axes: tuple[float, ...]
    """Deflections, -1 to 1, as the kernel counts them: of most sticks 0 is to the right, 1 to the back."""
    buttons: int
    """A bit each."""
    held: bool
    """The dead man's switch: its button is pressed, and was let go of once since the gamepad was opened."""

    @property
    def forward_left(self) -> tuple[float, float]:
        """Of the first stick, as `Joystick` takes it."""
        x, y = (*self.axes, 0.0, 0.0)[:2]
        return (-y + 0.0, -x + 0.0)


class Gamepad:
    """Reads one without ever waiting.

    A gamepad that is unplugged raises; one by radio that is out of reach may look to the kernel as it was last, its
    button pressed: for a dead man's switch take one with a cable.

    Parameters
    ----------
    source : the device's path, or a descriptor that gives the same bytes.
    dead_man : number of the button that has to be held.

    Raises
    ------
    ConfigurationError : it cannot be opened; a button that is none.
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
        """What it is like now.

        Raises
        ------
        DeviceLostError : it is gone.
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
        """Let go of it."""
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
    """Write what a gamepad is like to a ring of `operator_layout`, for a loop, a hundred times a second.

    For a process or thread of its own: where it ends, or is killed, heartbeats end and the robot brakes.

    Raises
    ------
    DeviceLostError : the gamepad is gone; it is written first that the switch is not held.
    """
    size = ring.layout["stick"].shape[0]
    ring.record["target"][...] = math.nan  # a stick points nowhere
    try:
        while not until():
            state = pad.read()
            stick = (*state.forward_left, *state.axes[2:], *[0.0] * size)[:size]
            ring.write(stick=stick, buttons=state.buttons, heartbeat=time.monotonic() if state.held else float("nan"))
            time.sleep(POLL)
    finally:
        ring.write(stick=0.0, heartbeat=float("nan"))


def main() -> None:
    """By orders on standard input, until that ends or the gamepad is gone."""
    orders = json.loads(sys.stdin.buffer.readline())
    ring = SharedRing.attach(orders["ring"])
    with Gamepad(orders["source"]) as pad:
        try:
            operate(pad, ring, until=lambda: bool(select.select([sys.stdin], [], [], 0)[0]))
        except DeviceLostError as gone:
            print(printable(str(gone)), file=sys.stderr)


if __name__ == "__main__":
    main()
