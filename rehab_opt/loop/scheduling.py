"""Real-time settings of a thread, with a report of settings that the operating system refuses."""

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
"""Operation codes of Linux's prctl."""


@contextmanager
def in_time(fifo: int | None) -> Iterator[str]:
    """Context with real-time settings for the calling thread; yields a text on the granted scheduling.

    Inside, the garbage collector is off, because full collections take tens of milliseconds. Linux's timer slack, which
    delays the end of each sleep, is 1 ns instead of 50 us.

    Parameters
    ----------
    fifo : SCHED_FIFO priority, 1 to 99; None for a normal thread. A FIFO thread runs before all normal threads. Without
        permission, the thread stays normal.

    Raises
    ------
    ConfigurationError : the priority is out of range.
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
    """Request SCHED_FIFO; return the previous scheduling, or the reason of a refusal; None without a priority."""
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
    """Set the timer slack; return the previous value [ns], or None if the slack cannot be set."""
    if not sys.platform.startswith("linux"):
        return None
    prctl = ctypes.CDLL(None).prctl
    before = int(prctl(_GET_TIMER_SLACK, 0, 0, 0, 0))
    return before if before > 0 and prctl(_SET_TIMER_SLACK, ctypes.c_ulong(nanoseconds), 0, 0, 0) == 0 else None


def sleep_overshoot(dt: float, *, count: int = 20) -> float:
    """Twice the median overshoot [s] of `count` sleeps of `dt` / 5; at most 0.2 ms and at most `dt` / 3."""
    late = []
    for _ in range(count):
        until = time.monotonic() + dt / 5
        time.sleep(dt / 5)
        late.append(time.monotonic() - until)
    return min(2 * sorted(late)[count // 2], 2e-4, dt / 3)
