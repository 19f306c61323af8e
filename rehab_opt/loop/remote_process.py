"""The process of a device's driver: `python -m rehab_opt.loop.remote_process`, with settings on standard input."""

from __future__ import annotations

import json
import select
import sys
import time
from importlib import import_module
from typing import Any

from rehab_opt.errors import DeviceLostError
from rehab_opt.loop.remote import Driver
from rehab_opt.loop.scheduling import in_time
from rehab_opt.loop.shared_ring import SharedRing

__all__ = ["drive", "main"]

KEEP = 0.02
"""Time [s] without a command after which the driver resets the device's watchdog."""
LOOKS = 2e-4
"""Time [s] between two polls of the device and the loop."""


def main() -> None:
    """Run the driver until standard input closes."""
    orders = json.loads(sys.stdin.buffer.readline())
    sensed, commanded = SharedRing.attach(orders["sensed"]), SharedRing.attach(orders["commanded"])
    with in_time(orders["fifo"]):
        _drive_as_ordered(orders, sensed, commanded)


def _drive_as_ordered(orders: dict[str, Any], sensed: SharedRing, commanded: SharedRing) -> None:
    driver: Driver | None = None
    try:
        driver = import_module(f"rehab_opt.loop.{orders['driver']}").driver(**orders["options"])
        drive(driver, sensed, commanded, silent=orders["silent"])
    except DeviceLostError as gone:
        sensed.write(failure=str(gone))  # before `close`, which may take seconds
    finally:
        if driver is not None:
            driver.close()


def drive(driver: Driver, sensed: SharedRing, commanded: SharedRing, *, silent: float) -> None:
    """Pass readings and commands until standard input closes; brake after `silent` [s] without a command."""
    done, sent, moving, kept = commanded.latest(), 0, False, 0.0
    while not select.select([sys.stdin], [], [], LOOKS)[0]:
        reading = driver.read()
        if reading is not None:
            sensed.write(stamp=time.monotonic(), sent=sent, **reading._asdict())
        newest, now = commanded.latest(), time.monotonic()
        if newest is not None and (done is None or newest.number != done.number):
            driver.send(newest.record["velocity"].tolist())
            done, sent, moving, kept = newest, sent + 1, True, now
        elif moving and done is not None and now - done.time > silent:
            driver.brake()
            moving, kept = False, now
        elif now - kept > KEEP:
            driver.keep_alive()
            kept = now


if __name__ == "__main__":
    main()
