"""Where a number was measured: printed with every table, since times mean nothing without it."""

from __future__ import annotations

import os
from pathlib import Path

from bench.solvers.machine import machine

__all__ = ["machine", "resident_megabytes"]


def resident_megabytes() -> float:
    """Memory of this process in RAM [MB]; NaN where the system does not tell."""
    status = Path("/proc/self/statm")
    if not status.exists():
        return float("nan")
    return int(status.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6
