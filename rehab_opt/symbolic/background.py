"""Work of minutes beside a control loop: one thread of this process, one child at a time, at idle priority."""

from __future__ import annotations

import atexit
import shutil
import subprocess
import threading
from collections.abc import Callable, Sequence
from queue import SimpleQueue

__all__ = ["finished", "idle", "later"]

_work: SimpleQueue[Callable[[], None]] = SimpleQueue()
_lock = threading.Lock()
_worker: threading.Thread | None = None
_child: subprocess.Popen[bytes] | None = None
_open = 0
"""Pieces of work that are not done."""
_none_open = threading.Condition(_lock)


def later(work: Callable[[], None]) -> None:
    """Call `work` in the background thread, after what it was given before; its children end with this process."""
    global _worker, _open  # noqa: PLW0603  (one worker of the process)
    with _lock:
        _open += 1
        _work.put(work)
        if _worker is None or not _worker.is_alive():  # a forked process has none
            _worker = threading.Thread(target=_go_on, name="rehab_opt-background", daemon=True)
            _worker.start()


def finished(seconds: float | None = None) -> bool:
    """Wait for so long at most until nothing is left to do; whether that is so."""
    with _none_open:
        return _none_open.wait_for(lambda: _open == 0, seconds)


def idle(command: Sequence[str]) -> None:
    """Run a command that takes no time from others.

    Raises
    ------
    subprocess.CalledProcessError : it failed. OSError : there is none.
    """
    global _child  # noqa: PLW0603  (ended at exit)
    nice = shutil.which("nice")
    first = [nice, "-n", "19"] if nice else []
    child = subprocess.Popen([*first, *command], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                             stdin=subprocess.DEVNULL, start_new_session=True)  # fmt: skip
    _child = child
    if child.wait():
        raise subprocess.CalledProcessError(child.returncode, list(command))


def _go_on() -> None:
    global _open  # noqa: PLW0603
    while True:
        work = _work.get()
        try:
            work()
        finally:
            with _none_open:
                _open -= 1
                _none_open.notify_all()
        del work


@atexit.register
def _end_child() -> None:
    if _child is not None and _child.poll() is None:
        _child.kill()
