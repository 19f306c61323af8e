"""A process beside the loop's process; it reads orders from standard input and ends when that closes."""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
from collections.abc import Mapping
from typing import Any

__all__ = ["Companion"]


class Companion:
    """`python -m module`, which reads one line of JSON and ends when its input closes, also if this process is killed.

    A terminal's Ctrl-C does not reach it, because it must continue until this process is at rest.

    Parameters
    ----------
    module : with a `main`. orders : content of the line.
    """

    def __init__(self, module: str, orders: Mapping[str, Any]) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", module], stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, process_group=0
        )
        with contextlib.suppress(BrokenPipeError):  # it could not begin, which `ended` tells
            assert self._process.stdin is not None
            self._process.stdin.write(json.dumps(orders).encode() + b"\n")
            self._process.stdin.flush()

    @property
    def id(self) -> int:
        """Process id."""
        return self._process.pid

    @property
    def ended(self) -> int | None:
        """Its exit code; None while it runs."""
        return self._process.poll()

    def end(self, patience: float) -> None:
        """Close its input and wait `patience` [s] for its end; then kill it."""
        if self._process.stdin is not None:
            with contextlib.suppress(BrokenPipeError):
                self._process.stdin.close()
        try:
            self._process.wait(patience)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
