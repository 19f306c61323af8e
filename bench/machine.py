"""Where a number was measured: printed with every table, since times mean nothing without it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from bench.solvers.machine import machine

__all__ = ["empty_loop", "machine", "resident_megabytes"]

EMPTY = """
import gc, os, sys, time
fifo, ticks = int(sys.argv[1]), int(sys.argv[2])
if fifo:
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(fifo))
gc.disable()
late, due = [0.0] * ticks, time.perf_counter()
for k in range(ticks):
    due += 0.001
    time.sleep(max(due - time.perf_counter(), 0.0))
    late[k] = time.perf_counter() - due
late.sort()
print(1e3 * late[int(0.999 * ticks)], 1e3 * late[-1])
"""


def empty_loop(fifo: int | None, seconds: float = 20.0) -> str:
    """How late a loop at 1 kHz that does nothing wakes on this machine now, in words: what no loop of ours can better.

    Parameters
    ----------
    fifo : priority of SCHED_FIFO; None for a usual process.
    """
    command = [sys.executable, "-c", EMPTY, str(fifo or 0), str(round(1000 * seconds))]
    ran = subprocess.run(command, capture_output=True, text=True, check=False)
    if ran.returncode:
        return f"an empty loop, just before: {ran.stderr.splitlines()[-1]}"
    p999, worst = map(float, ran.stdout.split())
    return f"an empty loop, just before: p99.9 {p999:.3f} ms, worst {worst:.3f} ms of {seconds:g} s"


def resident_megabytes() -> float:
    """Memory of this process in RAM [MB]; NaN where the system does not tell."""
    status = Path("/proc/self/statm")
    if not status.exists():
        return float("nan")
    return int(status.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6
