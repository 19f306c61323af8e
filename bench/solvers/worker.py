"""A process that solves for another one: it may hang, crash or be killed, and nothing but its own solve is lost."""

from __future__ import annotations

import faulthandler
import multiprocessing
import os
import signal
import time
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

from bench.solvers.entrant import Claim, Entrant
from bench.solvers.instances import Instances

__all__ = ["THREADS", "Timed", "TooLateError", "Worker", "WorkerDiedError"]

THREADS: Mapping[str, str] = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS", "RAYON_NUM_THREADS"), "1"
)
"""Environment of a worker: a QP of this size gains nothing from threads, and their wake-up would be measured."""
RAISED = (ArithmeticError, AssertionError, AttributeError, LookupError, MemoryError, OSError, RuntimeError, TypeError,
          ValueError)  # fmt: skip
"""What a solver's exception is reported as; one of any other kind ends the worker, which is reported too."""
LONGEST = 300
"""Characters of what a solver said."""
TRANSPORT = 0.25
"""[s] beyond the limit until a worker is killed: question and answer are on their way, and the system has other work.
Whether a solve kept to its limit is judged by its own clock."""
LIFETIME = 300.0
"""[s] after which a worker that hangs ends by itself: nobody else would end it once its parent was killed."""


class TooLateError(Exception):
    """No answer within the limit; the worker was killed."""


class WorkerDiedError(Exception):
    """The worker ended by itself: a crash, or an exception of a kind that nobody expects of a solver."""


class Timed(NamedTuple):
    """One solve."""

    seconds: float
    claim: Claim | None
    """None where it raised."""
    raised: str = ""


class Worker:
    """One child process at a time, started when it is needed."""

    def __init__(self) -> None:
        self._process: Any = None
        self._pipe: Any = None

    def begin(self, entrant: Entrant, sequence: Instances, *, warm: bool, limit: float) -> str:
        """Make the solver, which pays for imports and compilation; "" or why it cannot be made."""
        return str(self._asked(("begin", entrant, sequence, warm), limit))

    def warm_up(self, tick: int, *, limit: float) -> str:
        """Solve a tick, whatever comes of it, and make the solver again; "" or why it cannot be made."""
        return str(self._asked(("warm up", tick), limit))

    def solved(self, first: int, last: int, *, limit: float) -> list[Timed]:
        """The ticks first to last - 1 of what was begun, all together within the limit."""
        answer: list[Timed] = self._asked(("solve", first, last), limit + TRANSPORT)
        return answer

    def stop(self) -> None:
        """Kill the process, if there is one."""
        if self._process is not None:
            self._process.kill()
            self._process.join()
            self._pipe.close()
            self._process = None

    def _asked(self, question: tuple[Any, ...], limit: float) -> Any:
        """The worker's answer.

        Raises
        ------
        TooLateError, WorkerDiedError : there is none, and no process any more.
        """
        if self._process is None:
            self._start()
        try:
            self._pipe.send(question)
            if not self._pipe.poll(limit):
                self.stop()
                raise TooLateError
            return self._pipe.recv()
        except (EOFError, BrokenPipeError, ConnectionResetError) as problem:
            self._process.join(5.0)
            code = self._process.exitcode
            self.stop()
            raise WorkerDiedError(f"its process ended with code {code}") from problem

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=serve, args=(theirs,), daemon=True)
        with _environment(THREADS), _deaf_to_interrupts():
            self._process.start()
        theirs.close()


def serve(pipe: Connection) -> None:
    """Answer until the other end is closed. Solvers write to the standard output even when asked not to."""
    silence = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silence, 1)
    os.dup2(silence, 2)
    warnings.simplefilter("ignore")
    work: _Work | None = None
    while True:
        try:
            kind, *what = pipe.recv()
        except EOFError:
            return
        faulthandler.dump_traceback_later(LIFETIME, exit=True, file=silence)  # needs no turn of the interpreter
        if kind == "begin":
            work, refusal = _made(*what)
            pipe.send(refusal)
        elif work is None:
            pipe.send("nothing was begun")
        elif kind == "warm up":
            work.solved(*what)
            work, refusal = _made(*work.what)
            pipe.send(refusal)
        else:
            pipe.send([work.solved(tick) for tick in range(*what)])
        faulthandler.cancel_dump_traceback_later()


class _Work:
    """A solver at its sequence."""

    def __init__(self, entrant: Entrant, sequence: Instances, warm: bool) -> None:
        self.what = entrant, sequence, warm
        self.sequence, self.warm = sequence, warm
        self.solver = entrant.make(sequence, entrant.solver)

    def solved(self, tick: int) -> Timed:
        qp, solver, warm = self.sequence[tick], self.solver, self.warm
        clock = time.perf_counter
        began = clock()
        try:
            given = solver.prepared(qp)
            began = clock()
            answered = solver.solve(given, warm=warm)
            seconds = clock() - began
            claim = solver.claim(qp, answered)
        except RAISED as problem:
            return Timed(clock() - began, None, f"{type(problem).__name__}: {problem}"[:LONGEST])
        return Timed(seconds, claim)


def _made(entrant: Entrant, sequence: Instances, warm: bool) -> tuple[_Work | None, str]:
    """A solver at its sequence, or why there is none."""
    try:
        return _Work(entrant, sequence, warm), ""
    except RAISED as problem:
        return None, f"{type(problem).__name__}: {problem}"[:LONGEST]


@contextmanager
def _environment(values: Mapping[str, str]) -> Iterator[None]:
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


@contextmanager
def _deaf_to_interrupts() -> Iterator[None]:
    """A process that starts meanwhile never sees Ctrl-C, which is for the one that starts it."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
