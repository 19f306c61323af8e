"""Long background work beside a control loop: one thread, one child process at a time, at idle priority."""

from __future__ import annotations

import atexit
import os
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from queue import SimpleQueue

__all__ = ["finished", "idle", "later"]


TURN = 2e-4
"""[s] Switch interval of Python's threads while background work runs."""


class _Background:
    """Queue of background work and the thread that does it."""

    def __init__(self) -> None:
        self.work: SimpleQueue[Callable[[], None]] = SimpleQueue()
        self.lock = threading.Lock()
        self.none_open = threading.Condition(self.lock)
        self.open = 0
        """Number of pieces of work that are not finished."""
        self.worker: threading.Thread | None = None
        self.child: subprocess.Popen[bytes] | None = None

    def go_on(self) -> None:
        """Work through the queue, forever."""
        while True:
            work, raised = self.work.get(), True
            usual = sys.getswitchinterval()
            # A short switch interval lets this thread run between the ticks of a loop; with the default interval a
            # mirror's code was ready in 155 s instead of 13.
            sys.setswitchinterval(min(usual, TURN))
            try:
                work()
                raised = False
            finally:
                sys.setswitchinterval(usual)
                with self.none_open:
                    self.open -= 1
                    self.none_open.notify_all()
                    if raised:  # this thread ends; another one does the rest
                        self.begin()
            del work

    def begin(self) -> None:
        """Start the worker thread; called with the lock held."""
        self.worker = threading.Thread(target=self.go_on, name="rehab_opt-background", daemon=True)
        self.worker.start()


_now = _Background()


def later(work: Callable[[], None]) -> None:
    """Call `work` in the background thread, after all earlier work.

    If this process is killed, a compiler that `work` started ends within a minute.
    """
    with _now.lock:
        _now.open += 1
        _now.work.put(work)
        if _now.worker is None:
            _now.begin()


def finished(seconds: float | None = None) -> bool:
    """Wait at most `seconds` until all work is done; return whether it is."""
    with _now.none_open:
        return _now.none_open.wait_for(lambda: _now.open == 0, seconds)


def idle(command: Sequence[str], *, environment: Mapping[str, str], seconds: float) -> None:
    """Run a command at idle priority.

    Raises
    ------
    subprocess.SubprocessError : the command failed, or took longer than `seconds`.
    OSError : there is no such command.
    """
    nice = shutil.which("nice")
    first = [nice, "-n", "19"] if nice else []
    child = subprocess.Popen([*first, *command], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                             stdin=subprocess.DEVNULL, env=environment, start_new_session=True)  # fmt: skip
    _now.child = child
    try:
        status = child.wait(seconds)
    except subprocess.TimeoutExpired:
        _end(child)
        raise
    if status:
        raise subprocess.CalledProcessError(status, list(command))


def _end(child: subprocess.Popen[bytes]) -> None:
    """End a child process and its own children: a compiler's driver starts the compiler as a child."""
    if child.poll() is None:
        try:
            os.killpg(child.pid, signal.SIGKILL)
        except (AttributeError, ProcessLookupError):  # a system without process groups; it has just ended
            child.kill()
        child.wait()


@atexit.register
def _end_child() -> None:
    if _now.child is not None:
        _end(_now.child)


def _begin_anew() -> None:
    """Clear the state in a forked process, which has none of the parent's threads and work."""
    global _now  # noqa: PLW0603
    _now = _Background()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_begin_anew)
