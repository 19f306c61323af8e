"""What a device has besides what every plant has: it can be stopped, and let go."""

from __future__ import annotations

from typing import Protocol

from rehab_opt.plants.plant import Plant

__all__ = ["Device"]


class Device(Plant, Protocol):
    """A robot that is there, as a `Plant`; `step` sends the command and returns at once.

    `measured` is what arrived last, its stamp and `truth.time` on one clock, that of `time.monotonic`; `truth` repeats
    what was measured, since nobody knows better. All of them raise a `DeviceLostError` where the device is gone.
    `reset` moves nothing: it refuses a position that the device is not at.
    """

    def stop(self) -> None:
        """Have it come to rest by its own means; no error where it is gone."""
        ...

    def close(self) -> None:
        """The same, and let go of it: the object is of no use any more."""
        ...
