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
    step : (rounds, ticks) from the state to the command [us].
    tick : (rounds, ticks) the same and the integration [us].
    q : (rounds, ticks + 1, n) joint angles before the first and after every timed tick [rad].
    sample : (rounds,) path sample the first of them belongs to.
    """

    name: str
    step: Array
    tick: Array
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
        Record(
            one.name,
            step=np.empty((rounds, ticks)),
            tick=np.empty((rounds, ticks)),
            q=np.empty((rounds, ticks + 1, n)),
            sample=np.empty(rounds, dtype=np.int64),
        )
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
            times, visited = _timed(contenders[i], q, targets[i][first + settle : first + settle + ticks])
            begun, solved, moved = np.array(times).T / 1e3
            records[i].step[this] = solved - begun
            records[i].tick[this] = moved - begun
            records[i].q[this] = visited
            records[i].sample[this] = first + settle
            states[i] = visited[-1]
        order.append(order.pop(0))
    return records


def _untimed(contender: Contender, q: Array, targets: Sequence[object]) -> Array:
    for target in targets:
        q = contender.integrated(q, contender.command(q, target))
    return q


def _timed(contender: Contender, q: Array, targets: Sequence[object]) -> tuple[list[tuple[int, int, int]], list[Array]]:
    """Clock [ns] at the begin, after the step and after the integration of each tick; joint angles on the way."""
    clock, step, integrated = time.perf_counter_ns, contender.command, contender.integrated
    times, visited = [], [q]
    for target in targets:
        begun = clock()
        command = step(q, target)
        solved = clock()
        q = integrated(q, command)
        moved = clock()
        times.append((begun, solved, moved))
        visited.append(q)
    return times, visited
