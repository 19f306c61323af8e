"""Real-time settings of this process, with a report of those that the operating system refuses."""

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
"""Constants of Linux's prctl."""


@contextmanager
def in_time(fifo: int | None) -> Iterator[str]:
    """Context with real-time settings for the calling thread; yields a text on the granted settings.

    The garbage collector is off and existing objects are frozen, because full collections take tens of milliseconds.
    Sleeps end within 1 us of their time instead of 50 us (Linux's timer slack).

    Parameters
    ----------
    fifo : priority 1 to 99 of SCHED_FIFO, which runs before all normal threads; None for a normal thread. Without
        permission the thread stays normal.

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
    """The previous scheduling; a text if the change failed; None if nothing was requested."""
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
    """Set the timer slack; returns the previous value, or None if it cannot be set."""
    if not sys.platform.startswith("linux"):
        return None
    prctl = ctypes.CDLL(None).prctl
    before = int(prctl(_GET_TIMER_SLACK, 0, 0, 0, 0))
    return before if before > 0 and prctl(_SET_TIMER_SLACK, ctypes.c_ulong(nanoseconds), 0, 0, 0) == 0 else None


def sleep_overshoot(dt: float, *, count: int = 20) -> float:
    """[s] twice the median overshoot of sleeps of `dt` / 5, at most 0.2 ms and `dt` / 3."""
    late = []
    for _ in range(count):
        until = time.monotonic() + dt / 5
        time.sleep(dt / 5)
        late.append(time.monotonic() - until)
    return min(2 * sorted(late)[count // 2], 2e-4, dt / 3)
