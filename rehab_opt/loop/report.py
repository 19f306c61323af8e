"""Report of a loop: the reason why it ended, and its timing."""

from __future__ import annotations

import math
from dataclasses import dataclass

__all__ = ["LoopReport", "Times"]


FIRST, FINENESS, OCTAVES = 1e-6, 32, 26
"""Bins of the histogram: upper end of the first bin [s], bins per octave, number of octaves (up to one minute)."""


class Times:
    """A histogram of times; its percentiles are at most 2.2 % too large.

    Attributes
    ----------
    count : number of times. worst : largest time [s]; 0 before the first one.
    """

    def __init__(self) -> None:
        self._bins = [0] * (FINENESS * OCTAVES)
        self.count, self.worst = 0, 0.0

    def add(self, seconds: float) -> None:
        """Add a time [s]; a negative time counts as zero."""
        self.count += 1
        self.worst = max(self.worst, seconds)
        place = 0 if seconds <= FIRST else int(math.log2(seconds / FIRST) * FINENESS) + 1
        self._bins[min(place, len(self._bins) - 1)] += 1

    def percentile(self, percent: float) -> float:
        """Percentile [s] of the times, such as the median for `percent` = 50; 0 if there are no times."""
        needed, seen = percent / 100 * self.count, 0
        for place, count in enumerate(self._bins):
            seen += count
            if count and seen >= needed:
                return float(min(FIRST * 2 ** (place / FINENESS), self.worst))
        return self.worst


@dataclass(frozen=True)
class LoopReport:
    """Result of `Loop.run`.

    Parameters
    ----------
    ticks : number of ticks. missed : number of ticks that were skipped after a late one.
    late : number of ticks that started more than half a tick after their deadline.
    stale : number of commands withheld because the robot's state was stale.
    lateness : times from the deadline to the start of a tick.
    tick_time : times from the start of a tick until its command was sent.
    scheduling : scheduling of the thread; if SCHED_FIFO was not granted, the reason.
    reason : reason why the loop ended. lost : whether the device was lost.
    scaling : smallest fraction of the commanded speed at which the device ran, as the device reports it.
    """

    ticks: int
    missed: int
    late: int
    stale: int
    lateness: Times
    tick_time: Times
    scheduling: str
    reason: str
    lost: bool
    scaling: float = 1.0

    def __str__(self) -> str:
        """Summary in a few lines for a terminal."""
        return "\n".join(
            (
                f"ended: {self.reason}",
                f"{self.ticks} ticks, {self.missed} missed, {self.late} late by more than half a tick, {self.stale} "
                "commands withheld because the robot's state was stale",
                *(f"{name}: {_shown(times)}" for name, times in (("late by", self.lateness), ("took", self.tick_time))),
                f"scheduling: {self.scheduling}",
                *self._slowed(),
            )
        )

    def _slowed(self) -> tuple[str, ...]:
        if self.scaling >= 1.0:
            return ()
        return (f"the robot ran at {100 * self.scaling:.0f} % of the commanded speed at times (its speed slider?)",)


def _shown(times: Times) -> str:
    p50, p99, p999 = (1e3 * times.percentile(each) for each in (50, 99, 99.9))
    return f"{p50:.3f} ms in the median, p99 {p99:.3f}, p99.9 {p999:.3f}, worst {1e3 * times.worst:.3f} ms"
