"""The process that runs the controller and plant of `rehab-opt live`; another process serves the page."""

from __future__ import annotations

import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np

from rehab_opt.control.command import Command, Status
from rehab_opt.errors import ConfigurationError, RehabOptError
from rehab_opt.loop.logged import Logged, operator_of, read_log
from rehab_opt.loop.loop import Loop
from rehab_opt.loop.of_problem import control_again, control_of, decide_of, log_of, logged_problem
from rehab_opt.loop.records import Tick, operator_layout, state_layout
from rehab_opt.loop.replay import replayed_command
from rehab_opt.loop.shared_ring import SharedRing
from rehab_opt.session.files import load_problem
from rehab_opt.session.live.problem import LiveProblem
from rehab_opt.session.run import live_problem

__all__ = ["Rings", "control_live", "live_or_logged", "live_rings"]

SHOWN_HZ = 60.0
"""Rate [Hz] at which the controller's process writes the values to plot; the page's process reads them at 30 Hz."""


class Rings(NamedTuple):
    """Rings between the controller's process and the page's process."""

    given: SharedRing
    """Inputs from the page."""
    state: SharedRing
    """Records of the loop's ticks."""
    shown: SharedRing
    """Plotted values by name, and the mode of the stick."""


@contextmanager
def live_or_logged(
    file: str, options: dict[str, str | None], *, again: bool
) -> Iterator[tuple[LiveProblem, Logged | None]]:
    """Context with a live problem and its log; with `again`, `file` is this log, otherwise the log is None."""
    if not again:
        yield live_problem(load_problem(file), **options), None
        return
    logged = read_log(file)
    if not len(logged.records):
        raise ConfigurationError("--replay", file, "a log with a tick in it")
    with TemporaryDirectory() as folder:
        problem = logged_problem(logged, Path(folder))
        problem.title, problem.logged = f"{problem.title} (a log)", True
        yield problem, logged


@contextmanager
def live_rings(problem: LiveProblem, *, depth: int) -> Iterator[Rings]:
    """Context with the rings of a problem; a reader of `state` may lag by up to `depth` ticks."""
    n, force = problem.encoders, problem.force
    given = operator_layout(n, axes=2, targets=problem.hands, force=force)
    state = state_layout(n, given, force=force)
    numbers = [(name, "<f8", (size,)) for name, size in problem.layout.items()]
    shown = np.dtype([*numbers, ("mode", "S32")])
    with (
        SharedRing.create(given) as one,
        SharedRing.create(state, depth=depth) as two,
        SharedRing.create(shown) as three,
    ):
        yield Rings(one, two, three)


def control_live(
    file: str,
    options: dict[str, str | None],
    rings: Rings,
    page: Connection,
    *,
    again: bool,
    log: Path | None = None,
    fifo: int | None = None,
) -> None:
    """Run a live problem until the parent process ends.

    The function sends `LiveProblem.scene` to `page`, or the error message if the problem is invalid. With `again`,
    `file` is a log, which is shown repeatedly. `log` and `fifo` are as in `run_in_time`.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the page's process handles Ctrl-C and ends this process
    with suppress(BrokenPipeError):  # the page's process has ended
        try:
            with live_or_logged(file, options, again=again) as (problem, logged):
                page.send(problem.scene())
                if logged is not None:
                    _run_again(problem, logged, rings)
                    return
                config, state = load_problem(file), rings.state
                with nullcontext() if log is None else log_of(config, problem, state, log, options) as written:
                    _run(problem, rings, fifo=fifo, watches=() if written is None else (written.watch,))
        except RehabOptError as refused:
            page.send(str(refused))


def _run(problem: LiveProblem, rings: Rings, *, fifo: int | None, watches: Sequence[Callable[[], str]]) -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    every = max(1, round(1 / (SHOWN_HZ * problem.dt)))
    drawn: tuple[int, Status] | None = None

    def show(tick: Tick, command: Command) -> None:
        nonlocal drawn
        # Each change of the status is drawn, too, so that the status and the drawn position match.
        now = tick.number // every, command.status
        if now != drawn:
            drawn = now
            rings.shown.write(mode=control.mode, **control.shown())

    with control_of(problem, fifo=fifo) as control:
        loop = Loop(
            control.plant, decide_of(control, then=show), state=rings.state, operator=rings.given,
            watches=watches, plant_command=control.plant_command, fifo=fifo,
        )  # fmt: skip
        loop.run(until=lambda: "the page's process is gone" if os.getppid() != parent.pid else "")


def _run_again(problem: LiveProblem, logged: Logged, rings: Rings) -> None:
    """Show a log at its own speed; the controller computes the plotted values again."""
    operator, parent, state = operator_of(logged.records.dtype), multiprocessing.parent_process(), rings.state
    assert parent is not None
    names = set(state.layout.names or ()) & set(logged.records.dtype.names or ())
    every = max(1, round(1 / (SHOWN_HZ * problem.dt)))
    while True:
        control, decide, show = control_again(problem)
        begun, first = time.monotonic(), float(logged.records["time"][0])
        for record in logged.records:
            time.sleep(max(0.0, begun + float(record["time"]) - first - time.monotonic()))
            if os.getppid() != parent.pid:
                return
            show(record)
            replayed_command(record, operator, decide)
            if record["tick"] % every == 0:
                rings.shown.write(mode=control.mode, **control.shown())
            state.write(**{name: record[name] for name in names})
