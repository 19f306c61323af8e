"""RedundancyResolver.step for 10^6 ticks among obstacles: `python -m bench.redundancy_run`.

A stick that wanders between standing still and more than the chair can do, in a room; the state is integrated.
"""

from __future__ import annotations

import argparse
import gc
import sys
import time
from collections import Counter
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from bench.machine import machine
from bench.test_bench_control import ROOM
from rehab_opt import RedundancyResolver, ardis
from rehab_opt.kinematics.ardis import ARDIS_READY
from rehab_opt.symbolic import Compile

__all__ = ["main", "run"]

HOLD = 100
"""Ticks for which the stick is held."""
AGAIN = 4000
"""Ticks after which the robot begins in the middle of the room again."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run both drives and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--ticks", type=int, default=1_000_000)
    parser.add_argument("--virtual", action="store_true", help="CasADi's virtual machine instead of compiled code")
    parser.add_argument(
        "--cpu", action="store_true", help="processor time of the thread: what a busy machine adds is out"
    )
    options = parser.parse_args(arguments)
    console = Console()
    console.print("  ".join(f"{key}: {value}" for key, value in machine().items()), highlight=False)
    table = Table(title=f"RedundancyResolver.step, {options.ticks} ticks, {len(ROOM)} obstacles, 6 keep-out pairs")
    table.add_column("drive")
    told: list[str] = []
    for name in ("median", "p99", "p99.9", "p99.99", "max"):
        table.add_column(f"{name} us", justify="right")
    for drive in ("mecanum", "differential"):
        clock = time.thread_time_ns if options.cpu else time.perf_counter_ns
        nanoseconds, answers = run(drive, options.ticks, clock=clock, compile=False if options.virtual else "wait")
        percentiles = np.percentile(nanoseconds / 1e3, (50, 99, 99.9, 99.99, 100))
        table.add_row(drive, *(f"{value:.1f}" for value in percentiles))
        told.append(f"{drive}: " + ", ".join(f"{name or 'safe'} {count}" for name, count in answers.most_common()))
    console.print(table)
    console.print(*told, sep="\n", highlight=False)
    return 0


def run(
    drive: str, ticks: int, *, clock: Callable[[], int], compile: Compile
) -> tuple[NDArray[np.int64], Counter[str]]:
    """Time of each tick [ns], and who answered."""
    resolver = RedundancyResolver(
        ardis(),
        drive=drive,
        row_sets=[("x", "y", "z")],
        obstacles=ROOM,
        compile=compile,  # type: ignore[arg-type]
    )
    rng, q = np.random.default_rng(0), ARDIS_READY.copy()
    nanoseconds, answers = np.empty(ticks, dtype=np.int64), Counter[str]()
    step, dt, stick = resolver.step, resolver.dt, np.zeros(3)
    gc.collect()
    for k in range(ticks):
        if k % HOLD == 0:
            stick = rng.choice([0.0, 0.1, 0.3, 1.0]) * rng.standard_normal(3) * [1.0, 1.0, 0.3]
        if k % AGAIN == 0:
            q = ARDIS_READY.copy()
            resolver.reset()
        begun = clock()
        command = step(q, stick)
        nanoseconds[k] = clock() - begun
        answers[command.solver] += 1
        q += dt * command.value
    return nanoseconds, answers


if __name__ == "__main__":
    sys.exit(main())
