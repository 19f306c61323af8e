"""A helper process of the loop, which reads its settings from standard input and ends when the input closes."""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
from collections.abc import Mapping
from typing import Any

__all__ = ["Companion"]


class Companion:
    """A child process `python -m module` that gets its settings as one line of JSON on standard input.

    The child ends when its input closes, also if the parent is killed. Ctrl-C does not reach the child, which must run
    until the parent has stopped the robot.

    Parameters
    ----------
    module : name of a module with a function `main`. orders : settings of the child.
    """

    def __init__(self, module: str, orders: Mapping[str, Any]) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", module], stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, process_group=0
        )
        with contextlib.suppress(BrokenPipeError):  # the child failed to start, which `ended` reports
            assert self._process.stdin is not None
            self._process.stdin.write(json.dumps(orders).encode() + b"\n")
            self._process.stdin.flush()

    @property
    def id(self) -> int:
        """Process id of the child."""
        return self._process.pid

    @property
    def ended(self) -> int | None:
        """Exit code of the child; None while the child runs."""
        return self._process.poll()

    def end(self, patience: float) -> None:
        """Close the child's input, wait up to `patience` [s] for the child to end, then kill it."""
        if self._process.stdin is not None:
            with contextlib.suppress(BrokenPipeError):
                self._process.stdin.close()
        try:
            self._process.wait(patience)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
