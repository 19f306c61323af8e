"""Contenders on one path in alternating rounds, so that a drift of the machine hits all of them equally."""

from __future__ import annotations

import gc
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bench.peers.contender import Array, Contender
from bench.peers.path import HandPath

__all__ = ["Record", "alternate"]


@dataclass(frozen=True)
class Record:
    """What one contender did.

    Attributes
    ----------
    microseconds : (rounds, ticks) of one tick.
    q : (rounds, ticks + 1, n) joint angles before the first and after every timed tick [rad].
    sample : (rounds,) path sample the first of them belongs to.
    """

    name: str
    microseconds: Array
    q: Array
    sample: Array

    def velocity(self, dt: float) -> Array:
        """(rounds, ticks, n) joint velocity delivered [rad/s]."""
        return np.diff(self.q, axis=1) / dt


def alternate(
    contenders: Sequence[Contender],
    path: HandPath,
    start: Array,
    *,
    rounds: int,
    ticks: int,
    settle: int = 10,
    lead_in: int = 500,
) -> list[Record]:
    """Run every contender `rounds` x `ticks` timed ticks, the order rotated each round.

    Each keeps its own state and place on the path between its rounds. The `lead_in` ticks at the very beginning and the
    `settle` ticks after each change of contender (cold caches) are run but not recorded. Garbage is collected before a
    round, and collection stays on during it, as it does in use.
    """
    needed = lead_in + rounds * (settle + ticks) + 1
    if len(path.poses) < needed:
        raise ValueError(f"path of {len(path.poses)} samples: {needed} needed")
    n = len(start)
    records = [
        Record(one.name, np.empty((rounds, ticks)), np.empty((rounds, ticks + 1, n)), np.empty(rounds, dtype=np.int64))
        for one in contenders
    ]
    targets = [[one.target(path, k) for k in range(needed - 1)] for one in contenders]
    states = [_untimed(one, start, some[:lead_in]) for one, some in zip(contenders, targets, strict=True)]
    order = list(range(len(contenders)))
    for this in range(rounds):
        first = lead_in + this * (settle + ticks)
        for i in order:
            gc.collect()
            q = _untimed(contenders[i], states[i], targets[i][first : first + settle])
            nanoseconds, visited = _timed(contenders[i], q, targets[i][first + settle : first + settle + ticks])
            records[i].microseconds[this] = np.array(nanoseconds) / 1e3
            records[i].q[this] = visited
            records[i].sample[this] = first + settle
            states[i] = visited[-1]
        order.append(order.pop(0))
    return records


def _untimed(contender: Contender, q: Array, targets: Sequence[object]) -> Array:
    for target in targets:
        q = contender.tick(q, target)
    return q


def _timed(contender: Contender, q: Array, targets: Sequence[object]) -> tuple[list[int], list[Array]]:
    clock, tick = time.perf_counter_ns, contender.tick
    nanoseconds, visited = [], [q]
    for target in targets:
        begun = clock()
        q = tick(q, target)
        nanoseconds.append(clock() - begun)
        visited.append(q)
    return nanoseconds, visited
