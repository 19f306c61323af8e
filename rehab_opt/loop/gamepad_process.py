"""The process that reads a gamepad: `python -m rehab_opt.loop.gamepad_process`, its orders on standard input."""

from __future__ import annotations

import json
import select
import sys

from rehab_opt.errors import DeviceLostError, printable
from rehab_opt.loop.gamepad import Gamepad, operate
from rehab_opt.loop.shared_ring import SharedRing

__all__ = ["main"]


def main() -> None:
    """Read until standard input ends, or the gamepad is gone."""
    orders = json.loads(sys.stdin.buffer.readline())
    ring = SharedRing.attach(orders["ring"])
    with Gamepad(orders["source"]) as pad:
        try:
            operate(pad, ring, until=lambda: bool(select.select([sys.stdin], [], [], 0)[0]))
        except DeviceLostError as gone:
            print(printable(str(gone)), file=sys.stderr)


if __name__ == "__main__":
    main()
