"""`rehab-opt live`: starts the controller in a process of its own and serves the page."""

from __future__ import annotations

import asyncio
import ipaddress
import multiprocessing
import signal
from collections.abc import Callable
from pathlib import Path

from rehab_opt.errors import ConfigurationError
from rehab_opt.live.control import control_live, live_or_logged, live_rings
from rehab_opt.live.server import LivePage
from rehab_opt.loop.log import DEPTH
from rehab_opt.session.live.problem import Watching

__all__ = ["show_live"]

PATIENT = 10.0
"""Longest time [s] for the controller's process to brake, to disconnect a device and to end its log."""


def show_live(
    file: str,
    *,
    host: str = "127.0.0.1",
    port: int = 0,
    plant: str | None = None,
    solver: str | None = None,
    again: bool = False,
    log: Path | None = None,
    fifo: int | None = None,
    ready: Callable[[str, str], None],
    watching: Watching | None = None,
) -> None:
    """Run a problem in real time with an interactive page, until interrupted.

    Parameters
    ----------
    file : path of a problem file, or the name of a shipped problem. plant, solver : as in `rehab-opt run`.
    again : whether `file` is a log, which is then shown repeatedly at its own speed.
    log : path of a log of every tick, for `rehab-opt replay`, or None.
    fifo : SCHED_FIFO priority of the controller's and the device's process, as for `Loop`, or None.
    host, port : address and port of the page; port 0 means any free port.
    ready : function that is called with the addresses of the page and of the participant's page.
    watching : object that gets the plotted values, or None.

    Raises
    ------
    ConfigurationError : problems of this kind do not run live, or an option or address is invalid.
    ProblemFileError : a value in the file is invalid.
    """
    _refuse_wildcard(host)
    options = {"plant": plant, "solver": solver}
    context = multiprocessing.get_context("spawn")
    with (
        live_or_logged(file, options, again=again) as (problem, _),
        live_rings(problem, depth=4 if log is None else DEPTH) as rings,
    ):
        scene, told = context.Pipe(duplex=False)
        control = context.Process(
            target=control_live, args=(file, options, rings, told), daemon=True,
            kwargs={"again": again, "log": log, "fifo": fifo},
        )  # fmt: skip
        control.start()
        told.close()
        try:
            page = LivePage(problem, rings, scene, alive=control.is_alive, watching=watching)
            asyncio.run(_until_stopped(page, host, port, ready))
        finally:
            control.terminate()
            control.join(PATIENT)
            if control.is_alive():
                control.kill()


async def _until_stopped(page: LivePage, host: str, port: int, ready: Callable[[str, str], None]) -> None:
    task = asyncio.current_task()
    assert task is not None
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, task.cancel)
    try:
        await page.serve(host, port, ready=ready)
    except asyncio.CancelledError:
        return


def _refuse_wildcard(host: str) -> None:
    try:
        unsaid = ipaddress.ip_address(host).is_unspecified
    except ValueError:
        unsaid = not host
    if unsaid:
        expected = "one address or name of this machine, by which browsers call it: others are refused"
        raise ConfigurationError("--host", host, expected)
