"""Where times were measured."""

from __future__ import annotations

import math
import os
import platform
import sys
from pathlib import Path

__all__ = ["load_now", "machine"]


def machine() -> dict[str, str]:
    """Processor, cores, load and interpreter."""
    load = load_now()
    return {
        "processor": _processor(),
        "cores": str(os.cpu_count()),
        "load": "unknown" if math.isnan(load) else f"{load:.2f}",
        "system": f"{platform.system()} {platform.machine()}",
        "python": sys.version.split()[0],
    }


def load_now() -> float:
    """Processes that want a core, a mean of the last minute; NaN where the system does not tell."""
    return os.getloadavg()[0] if hasattr(os, "getloadavg") else math.nan


def _processor() -> str:
    information = Path("/proc/cpuinfo")
    if information.exists():
        for line in information.read_text().splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()
