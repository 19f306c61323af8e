"""What goes wrong on the way to a controller: numbers that are none, stamps, the dead-man switch; and when."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

NOT_TRUE: tuple[Any, ...] = (False, 0, None, math.nan, 2, -1, "yes", "", [True], 0.5)
"""Dead-man inputs that are not given."""
NO_NUMBERS = (math.nan, math.inf, -math.inf, 1e300, -1e300)
STAMPS = ("repeated", "backwards", "gap", "stamp nan", "stamp missing", "stamp text")


class Schedule(NamedTuple):
    """Which fault there is in each tick; "" for none."""

    kind: NDArray[np.str_]
    number: Array
    """(N,) what stands where a number is spoilt."""
    index: NDArray[np.int64]
    """(N,) which of the numbers."""
    enable: list[Any]
    stamp: list[Any]


def schedule(
    rng: np.random.Generator, ticks: int, dt: float, kinds: tuple[str, ...], *, every: float, longest: float = 0.3,
    gap: float = 2.0,
) -> Schedule:  # fmt: skip
    """Faults of one tick to `longest` s, one each `every` seconds on average, never in the first tick.

    A gap in stamps is one of `gap` s.
    """
    kind = np.full(ticks, "", dtype="U16")
    k = 1 + int(rng.exponential(every) / dt) if math.isfinite(every) else ticks
    while k < ticks:
        lasts = 1 if rng.random() < 0.5 else max(int(rng.uniform(0.0, longest) / dt), 1)
        kind[k : k + lasts] = rng.choice(kinds)
        k += lasts + 1 + int(rng.exponential(every) / dt)
    number, index = rng.choice(NO_NUMBERS, ticks), rng.integers(0, 1000, ticks)
    enable: list[Any] = [True] * ticks
    for k in np.flatnonzero(kind == "disabled").tolist():
        enable[k] = NOT_TRUE[int(index[k]) % len(NOT_TRUE)]
    return Schedule(kind, number, index, enable, _stamps(kind, dt, gap))


def _stamps(kind: NDArray[np.str_], dt: float, gap: float) -> list[Any]:
    """True time, but for the faults of stamps."""
    ticks = len(kind)
    found: list[Any] = (dt * np.arange(1, ticks + 1)).tolist()
    shift = 0.0
    for k in range(ticks):
        true = found[k] + shift
        if kind[k] == "gap" and (k == 0 or kind[k - 1] != "gap"):
            shift += gap
            true += gap
        found[k] = true
        if kind[k] == "repeated":
            found[k] = found[k - 1]
        elif kind[k] == "backwards":
            found[k] = found[k - 1] - 0.3 * dt if isinstance(found[k - 1], float) else true - 5 * dt
        elif kind[k] == "stamp nan":
            found[k] = math.nan
        elif kind[k] == "stamp missing":
            found[k] = None
        elif kind[k] == "stamp text":
            found[k] = "now"
    return found


def expected(schedule: Schedule) -> NDArray[np.bool_]:
    """(N,) whether this tick's input must not be acted on: of a gap in stamps the first tick alone, of a
    frozen sensor, which looks like a hand at rest, none."""
    kind = schedule.kind
    first = np.r_[True, kind[1:] != kind[:-1]]
    return np.asarray((kind != "") & (kind != "frozen") & ((kind != "gap") | first))


def gaps(schedule: Schedule, longest: float) -> NDArray[np.bool_]:
    """(N,) whether a stamp is more than so many s after the last one before it that was a number."""
    stamps = np.array([each if isinstance(each, float) else math.nan for each in schedule.stamp])
    newest = np.maximum.accumulate(np.where(np.isnan(stamps), 0, np.arange(len(stamps))))
    return np.r_[False, stamps[1:] - stamps[newest[:-1]] > longest]


def spoilt(wrong: Schedule, k: int, q: Array, pose: Array, twist: Array) -> tuple[Array, Array, Array]:
    """What an arm's tracker is given in tick k of a schedule."""
    q, pose, twist = q.copy(), pose.copy(), twist.copy()
    kind, at, number = wrong.kind[k], int(wrong.index[k]), wrong.number[k]
    if kind == "q":
        q[at % 6] = number
    elif kind == "pose":
        pose[at % 3, at // 3 % 4] = number
    elif kind == "twist":
        twist[at % 6] = number
    elif kind == "all":
        q[:], pose[:], twist[:] = number, number, number
    elif kind == "not rigid":
        pose[:3, :3] = (-pose[:3, :3], 1.1 * pose[:3, :3], 0 * pose[:3, :3])[at % 3]
    return q, pose, twist
