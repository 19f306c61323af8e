"""A log that the loop never waits for: a process of its own writes it, and this end says whether it still does."""

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
"""Records of a loop's ring that is logged: at 1 kHz the log may be late by 8 s."""
SILENT = 2.0
"""[s] A process that has not reported for so long no longer writes."""
PATIENCE = 30.0
"""[s] for it to begin and to end."""
PROGRESS = np.dtype([("alive", "<f8"), ("written", "<u8"), ("lost", "<u8"), ("failure", "S240")])


class Log:
    """Writes the records of a loop's ring to an MCAP file, from the first one on, in a process of its own.

    With `watch` among the loop's `watches` the robot brakes where the log ends: a full disk, a killed process. What was
    logged by then stays readable. Records that the writer missed are counted in `lost`.

    Parameters
    ----------
    ring : of `state_layout`, as deep as `DEPTH`.
    path : of the file, which is replaced. names : of the joints.
    problem : name of the problem, and `files` what it needs, the problem's own text first, for `rehab-opt replay`.
    about : more that shall stand in the file.

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
        """Of the process that writes."""
        return self._writer.id

    @property
    def failure(self) -> str:
        """Why nothing more is written; empty while it is."""
        return bytes(self._said("failure")).decode(errors="replace")

    @property
    def written(self) -> int:
        """Records that are in the file."""
        return int(self._said("written"))

    @property
    def lost(self) -> int:
        """Records that the writer was too late for."""
        return int(self._said("lost"))

    def watch(self) -> str:
        """Why the loop should end: nothing is logged any more. Empty while it is."""
        newest = self._progress.latest()
        if newest is None or newest.record["failure"]:
            return f"the log has ended: {self.failure}"
        if self._writer.ended is not None:
            return f"the log has ended: its process is gone (code {self._writer.ended})"
        silent = time.monotonic() - newest.time
        return f"the log has been silent for {silent:.1f} s" if silent > SILENT else ""

    def close(self) -> None:
        """Let it write the rest and end; within half a minute."""
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
    """Of what computes the commands."""
    packages = {name: version(name) for name in ("numpy", "casadi", "scipy")}
    return {"rehab_opt": __version__, **packages, "python": platform.python_version(), "machine": platform.platform()}
