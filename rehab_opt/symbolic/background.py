"""Work of minutes beside a control loop: one thread of this process, one child at a time, at idle priority."""

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
"""[s] after which the thread that works asks a loop for its turn, and gives it back."""


class _Background:
    """What is to be done, and who does it."""

    def __init__(self) -> None:
        self.work: SimpleQueue[Callable[[], None]] = SimpleQueue()
        self.lock = threading.Lock()
        self.none_open = threading.Condition(self.lock)
        self.open = 0
        """Pieces of work that are not done."""
        self.worker: threading.Thread | None = None
        self.child: subprocess.Popen[bytes] | None = None

    def go_on(self) -> None:
        """Do what there is to do, for ever."""
        while True:
            work, raised = self.work.get(), True
            usual = sys.getswitchinterval()
            # A loop whose ticks let other threads run for a moment each is never asked to do so for longer, where they
            # come within this interval: a mirror's code was ready in 155 s instead of 13.
            sys.setswitchinterval(min(usual, TURN))
            try:
                work()
                raised = False
            finally:
                sys.setswitchinterval(usual)
                with self.none_open:
                    self.open -= 1
                    self.none_open.notify_all()
                    if raised:  # this thread ends: another one does the rest
                        self.begin()
            del work

    def begin(self) -> None:
        """Let a thread work; called with the lock held."""
        self.worker = threading.Thread(target=self.go_on, name="rehab_opt-background", daemon=True)
        self.worker.start()


_now = _Background()


def later(work: Callable[[], None]) -> None:
    """Call `work` in the background thread, after what it was given before.

    Its child ends when this process ends by itself; one that is killed leaves a compiler that ends within a minute.
    """
    with _now.lock:
        _now.open += 1
        _now.work.put(work)
        if _now.worker is None:
            _now.begin()


def finished(seconds: float | None = None) -> bool:
    """Wait for so long at most until nothing is left to do; whether that is so."""
    with _now.none_open:
        return _now.none_open.wait_for(lambda: _now.open == 0, seconds)


def idle(command: Sequence[str], *, environment: Mapping[str, str], seconds: float) -> None:
    """Run a command that takes no time from others.

    Raises
    ------
    subprocess.SubprocessError : it failed, or took longer. OSError : there is none.
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
    """End a child and what it has begun: a compiler's driver is not who works."""
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
    """A forked process has none of the parent's threads, and none of its work."""
    global _now  # noqa: PLW0603
    _now = _Background()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_begin_anew)
