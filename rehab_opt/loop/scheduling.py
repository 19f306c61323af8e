"""Real-time settings of this process: what is requested of the operating system, and what it refuses."""

from __future__ import annotations

import ctypes
import gc
import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

from rehab_opt.errors import ConfigurationError

__all__ = ["in_time", "sleep_overshoot"]

_SET_TIMER_SLACK, _GET_TIMER_SLACK = 29, 30
"""Of Linux' prctl."""


@contextmanager
def in_time(fifo: int | None) -> Iterator[str]:
    """Have the calling thread woken in time while the body runs; the value says what was permitted.

    The garbage collector is off, with all that lives at the beginning left out of it for as long: its full collections
    take tens of milliseconds. Sleeps end within a microsecond of their time rather than 50 (Linux' timer slack).

    Parameters
    ----------
    fifo : priority 1 to 99 among threads that run before all usual ones (SCHED_FIFO); None to be a usual one. Where
        it is not permitted the thread stays a usual one.

    Raises
    ------
    ConfigurationError : a priority out of range.
    """
    if fifo is not None and not (isinstance(fifo, int) and 1 <= fifo <= 99):
        raise ConfigurationError("fifo", fifo, "a priority from 1 to 99, or None")
    usual = _made_fifo(fifo)
    slack = _timer_slack(1)
    collects = gc.isenabled()
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        yield "SCHED_OTHER" if fifo is None else usual if isinstance(usual, str) else f"SCHED_FIFO {fifo}"
    finally:
        gc.unfreeze()
        if collects:
            gc.enable()
        if slack is not None:
            _timer_slack(slack)
        if isinstance(usual, tuple):
            os.sched_setscheduler(0, usual[0], usual[1])


def _made_fifo(priority: int | None) -> tuple[int, os.sched_param] | str | None:
    """What the thread was before; why it is that still; None if nothing was requested."""
    if priority is None:
        return None
    if not hasattr(os, "sched_setscheduler"):
        return f"SCHED_OTHER: {sys.platform} has no SCHED_FIFO"
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except PermissionError:
        return (
            f"SCHED_OTHER: SCHED_FIFO {priority} is not permitted; `ulimit -r` says up to which priority it is, "
            "rtprio in /etc/security/limits.conf changes that"
        )
    return before


def _timer_slack(nanoseconds: int) -> int | None:
    """Set it; what it was, None where it cannot be set."""
    if not sys.platform.startswith("linux"):
        return None
    prctl = ctypes.CDLL(None).prctl
    before = int(prctl(_GET_TIMER_SLACK, 0, 0, 0, 0))
    return before if before > 0 and prctl(_SET_TIMER_SLACK, ctypes.c_ulong(nanoseconds), 0, 0, 0) == 0 else None


def sleep_overshoot(dt: float, *, count: int = 20) -> float:
    """[s] by which a sleep of a fifth of `dt` ends too late, twice the median, at most 0.2 ms and a third of `dt`."""
    late = []
    for _ in range(count):
        until = time.monotonic() + dt / 5
        time.sleep(dt / 5)
        late.append(time.monotonic() - until)
    return min(2 * sorted(late)[count // 2], 2e-4, dt / 3)
