"""A log of a loop, written by a separate process so that the loop never waits for the disk."""

from __future__ import annotations

import base64
import platform
import time
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any, Self

import numpy as np

from rehab_opt.errors import ConfigurationError
from rehab_opt.loop.companion import Companion
from rehab_opt.loop.log_file import mcap_module
from rehab_opt.loop.shared_ring import SharedRing
from rehab_opt.version import __version__

__all__ = ["DEPTH", "Log"]

DEPTH = 8192
"""Number of records in the ring of a logged loop; at 1 kHz the log may lag by 8 s."""
SILENT = 2.0
"""Time [s] without a report after which the writing process counts as failed."""
PATIENCE = 30.0
"""Longest time [s] for the writing process to start, and to end."""
PROGRESS = np.dtype([("alive", "<f8"), ("written", "<u8"), ("lost", "<u8"), ("failure", "S240")])


class Log:
    """Writes all records of a loop's ring to an MCAP file, in a separate process.

    Pass `watch` to the loop's `watches`: then the robot brakes if logging fails, for example on a full disk. The
    records written before the failure stay readable. `lost` counts records that the writer missed.

    Parameters
    ----------
    ring : ring of `state_layout` records, with depth `DEPTH`.
    path : path of the file, which is overwritten. names : names of the joints.
    problem : name of the problem. files : contents of the problem's files by name, for `rehab-opt replay`.
    about : further metadata for the file.

    Raises
    ------
    ConfigurationError : mcap is not installed (extra `log`), or the file cannot be written.
    """

    def __init__(
        self,
        ring: SharedRing,
        path: Path | str,
        *,
        names: Sequence[str],
        problem: str = "",
        files: Mapping[str, bytes] | None = None,
        about: Mapping[str, str] | None = None,
    ) -> None:
        mcap_module("writer")
        self._last: np.void | None = None
        self._progress = SharedRing.create(PROGRESS)
        told = {"problem": problem, **_versions(), **(about or {})}
        orders = {
            "ring": ring.name, "path": str(Path(path).absolute()), "names": list(names), "about": told,
            "progress": self._progress.name,
            "files": {name: base64.b64encode(data).decode() for name, data in (files or {}).items()},
        }  # fmt: skip
        self._writer = Companion("rehab_opt.loop.log_process", orders)
        until = time.monotonic() + PATIENCE
        while not self._alive and not self.failure and self._writer.ended is None and time.monotonic() < until:
            time.sleep(0.005)
        if not self._alive or self.failure:
            self.close()
            raise ConfigurationError("log", str(path), f"a log that can be written ({self.failure or 'no answer'})")

    @property
    def process_id(self) -> int:
        """Process id of the writing process."""
        return self._writer.id

    @property
    def failure(self) -> str:
        """Reason why logging failed; empty while logging works."""
        return bytes(self._said("failure")).decode(errors="replace")

    @property
    def written(self) -> int:
        """Number of records in the file."""
        return int(self._said("written"))

    @property
    def lost(self) -> int:
        """Number of records that the writer missed."""
        return int(self._said("lost"))

    def watch(self) -> str:
        """Reason to stop the loop because logging failed; empty while logging works."""
        newest = self._progress.latest()
        if newest is None or newest.record["failure"]:
            return f"the log has ended: {self.failure}"
        if self._writer.ended is not None:
            return f"the log has ended: its process is gone (code {self._writer.ended})"
        silent = time.monotonic() - newest.time
        return f"the log has been silent for {silent:.1f} s" if silent > SILENT else ""

    def close(self) -> None:
        """Write the remaining records and end the writing process, within half a minute."""
        self._writer.end(PATIENCE)
        newest = self._progress.latest()
        self._last = np.zeros(1, PROGRESS)[0] if newest is None else newest.record
        self._progress.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def _alive(self) -> bool:
        return bool(self._said("alive"))

    def _said(self, name: str) -> Any:
        newest = None if self._last is not None else self._progress.latest()
        record = self._last if newest is None else newest.record
        return PROGRESS[name].type() if record is None else record[name]


def _versions() -> dict[str, str]:
    packages = {name: version(name) for name in ("numpy", "casadi", "scipy")}
    return {"rehab_opt": __version__, **packages, "python": platform.python_version(), "machine": platform.platform()}
