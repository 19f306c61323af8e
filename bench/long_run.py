"""PoseTracker.step for 10^6 ticks, times and memory: `python -m bench.long_run`.

A controller that runs for 17 minutes at 1 kHz must show neither rare long ticks of its own making nor growing memory.
"""

from __future__ import annotations

import argparse
import gc
import itertools
import sys
import time
import tracemalloc
from collections import Counter
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from bench.machine import machine, resident_megabytes
from bench.peers.path import START, HandPath, circle
from bench.verdict import Verdict, all_met, print_verdicts
from rehab_opt import PoseTracker, SerialChain, ur5

__all__ = ["main"]

DT = 0.001
ROUND = 2000
"""Ticks of one round of the circle; the path is repeated, so that no list of targets grows."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run, print the table and the verdict on memory."""
    options = _options(arguments)
    console = Console()
    console.print("  ".join(f"{key}: {value}" for key, value in machine().items()), highlight=False)
    chain = ur5(velocity=options.limit) if options.limit else ur5()
    tracker = PoseTracker(chain, dt=DT, compile=False if options.virtual else "wait")
    if options.tracemalloc:
        tracemalloc.start()
    nanoseconds, statuses, memory = run(tracker, round_trip(chain), options.ticks)
    microseconds = nanoseconds / 1e3
    table = Table(title=f"PoseTracker.step, {options.ticks} ticks")
    names = ("median", "p99", "p99.9", "p99.99", "max")
    for name in names:
        table.add_column(f"{name} us", justify="right")
    table.add_row(*(f"{value:.1f}" for value in np.percentile(microseconds, (50, 99, 99.9, 99.99, 100))))
    console.print(table)
    console.print("status: " + ", ".join(f"{status} {count}" for status, count in statuses.items()), highlight=False)
    console.print("memory MB, start and after each tenth: " + " ".join(f"{value:.2f}" for value in memory))
    if options.tracemalloc:
        console.print("traced by Python now, most: {} and {} bytes".format(*tracemalloc.get_traced_memory()))
    # The first tenth fills caches of the allocator; from there on the line must be flat.
    verdicts = [Verdict("memory gained after the first tenth", memory[-1] - memory[1], "<=", 0.5, "MB")]
    print_verdicts(console, verdicts)
    return 0 if all_met(verdicts) else 1


def round_trip(chain: SerialChain) -> HandPath:
    """One round of the circle at full speed, closing on itself."""
    path = circle(chain, 3 * ROUND, dt=DT, onset=1e-9)
    return HandPath(path.poses[ROUND : 2 * ROUND], path.twists[ROUND : 2 * ROUND])


def run(tracker: PoseTracker, path: HandPath, ticks: int) -> tuple[NDArray[np.int64], Counter[str], list[float]]:
    """Nanoseconds of each tick (ticks,), how often each status came, resident MB at start and after each tenth."""
    nanoseconds = np.ones(ticks, dtype=np.int64)  # zeros would take their memory page by page during the run
    statuses: Counter[str] = Counter()
    targets = [(pose.copy(), twist.copy()) for pose, twist in zip(path.poses, path.twists, strict=True)]
    q = START.copy()
    for pose, twist in targets:  # warm-up: the first round
        q = q + DT * tracker.step(q, pose, twist).value
    gc.collect()
    memory = [resident_megabytes()]
    tenth = max(ticks // 10, 1)
    clock = time.perf_counter_ns
    for k, (pose, twist) in zip(range(ticks), itertools.cycle(targets)):
        begun = clock()
        command = tracker.step(q, pose, twist)
        nanoseconds[k] = clock() - begun
        q = q + DT * command.value
        statuses[command.status.value] += 1
        if (k + 1) % tenth == 0:
            memory.append(resident_megabytes())
    return nanoseconds, statuses, memory


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m bench.long_run", description=__doc__)
    parser.add_argument("--ticks", type=int, default=1_000_000)
    parser.add_argument("--limit", type=float, help="joint speed limit [rad/s]; 0.35 keeps several joints at it")
    parser.add_argument("--virtual", action="store_true", help="CasADi's virtual machine instead of machine code")
    parser.add_argument("--tracemalloc", action="store_true", help="trace Python's allocations; slows every tick")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())
