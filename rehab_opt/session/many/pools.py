"""Run tasks on all cores, each in a process of its own, so that a process that dies affects only its own task."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from functools import partial
from multiprocessing.connection import Connection
from multiprocessing.connection import wait as wait_for
from typing import Any, TypeVar

T = TypeVar("T")
A = TypeVar("A")

DIED = "its worker process died (killed, out of memory, crashed), or sent what cannot be read"
HANDED = 256
"""Largest number of tasks that are given to an executor at once, which limits the memory of waiting answers."""
BLAS_THREADS = "OPENBLAS_NUM_THREADS"
"""Environment variable with the number of threads of numpy and scipy; a process reads it when it loads them."""
PRELOADED = (
    "casadi", "matplotlib.figure", "matplotlib.backends.backend_agg", "mpl_toolkits.mplot3d", "PIL.JpegImagePlugin",
    "scipy.interpolate", "scipy.optimize", "scipy.stats", "shapely", "skimage.measure",
)  # fmt: skip
"""Modules that runs need and that take over 2 s to load; a server process loads them once and is then forked."""


class WorkerDiedError(Exception):
    """The process of a task ended without an answer, for example because it was killed or crashed."""


def cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def answers(
    tasks: Sequence[T],
    work: Callable[[T], A],
    *,
    executor: Executor | None,
    workers: int | None,
    timeout_s: float | None = None,
) -> Iterator[tuple[T, A | BaseException]]:
    """Each task with its answer, or with the exception that ended the task, in the order of completion.

    Parameters
    ----------
    tasks : inputs of `work`.
    work : function that another process can import by name; its answers must be picklable.
    executor : executor that runs the tasks, or None for processes of this machine. If an executor breaks, all its
        remaining tasks fail.
    workers : number of processes, by default `cores`. With an executor, number of tasks that are given to it at once,
        by default `HANDED`.
    timeout_s : time [s] after which a task's process is killed, without an executor. The answer is then a TimeoutError.
    """
    if executor is not None:
        yield from _by(executor, tasks, work, workers or HANDED)
    else:
        yield from _by_processes(deque(tasks), work, workers or cores(), timeout_s)


def _by(
    executor: Executor, tasks: Sequence[T], work: Callable[[T], A], handed: int
) -> Iterator[tuple[T, A | BaseException]]:
    """Run tasks with an executor; tasks that were lost with a worker run again at the end, one at a time."""
    suspects = []
    for task, answer in _given(executor, tasks, work, handed):
        if _lost_with_worker(answer):
            suspects.append(task)
        else:
            yield task, answer
    for task in suspects:
        yield from _given(executor, [task], partial(work), 1)  # `partial`, since dask remembers the failure of `work`


def _lost_with_worker(answer: object) -> bool:
    """Whether dask gave up a task because its worker was lost, possibly because of another task."""
    dask = sys.modules.get("distributed")
    return dask is not None and isinstance(answer, dask.KilledWorker)


def _given(
    executor: Executor, tasks: Sequence[T], work: Callable[[T], A], handed: int
) -> Iterator[tuple[T, A | BaseException]]:
    """Run tasks with an executor, `handed` at a time, so that waiting answers do not fill the memory."""
    waiting, running = deque(tasks), dict[Future[A], T]()
    try:
        while waiting or running:
            while waiting and len(running) < handed:
                task = waiting.popleft()
                try:
                    running[executor.submit(work, task)] = task
                except (BrokenExecutor, RuntimeError) as refused:  # the executor is broken or was shut down
                    yield task, refused
            for future in wait(running, return_when=FIRST_COMPLETED).done if running else ():
                answer: A | BaseException = _answer(future)
                yield running.pop(future), answer
                del future, answer
    finally:
        for future in running:
            future.cancel()


def _by_processes(
    waiting: deque[T], work: Callable[[T], A], workers: int, timeout_s: float | None
) -> Iterator[tuple[T, A | BaseException]]:
    """Run each task in its own process, `workers` at a time; no process outlives this generator."""
    context = _context(work.__module__)
    running: dict[Any, tuple[Any, T, float]] = {}
    try:
        while waiting or running:
            while waiting and len(running) < workers:
                answer, send = context.Pipe(duplex=False)
                process = context.Process(target=_answer_into, args=(send, work, task := waiting.popleft()))
                with _one_thread():
                    process.start()
                send.close()
                running[answer] = process, task, time.monotonic() + (timeout_s or threading.TIMEOUT_MAX)
            pause = max(min(late for *_, late in running.values()) - time.monotonic(), 0.0)
            ready = wait_for([*running], None if timeout_s is None else pause)
            late = [each for each, (*_, until) in running.items() if until <= time.monotonic() and each not in ready]
            for each in (*ready, *late):
                process, task, _ = running.pop(each)
                result: Any = TimeoutError(f"not done after {timeout_s:g} s") if each in late else _received(each)
                process.kill()
                process.join()
                yield task, result
    finally:
        for process, *_ in running.values():
            process.kill()
            process.join()


def _context(module: str) -> Any:
    """Context that forks processes from a server with the needed modules; without fork, it starts new processes."""
    if "forkserver" not in multiprocessing.get_all_start_methods():  # Windows
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    ours = [name for name in sys.modules if name.startswith("rehab_opt.") and not name.endswith("__main__")]
    context.set_forkserver_preload([*ours, *PRELOADED, module])
    return context


def _answer_into(send: Connection, work: Callable[[T], A], task: T) -> None:
    """Main function of a process; it ignores Ctrl-C, because the parent process ends it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with ThreadPoolExecutor(1) as one:  # its future catches every exception of `work`
        send.send(_answer(one.submit(work, task)))


def _received(answer: Connection) -> Any:
    """The answer of a process; `WorkerDiedError` if the answer is truncated or cannot be unpickled."""
    try:
        return answer.recv()
    except (ArithmeticError, AttributeError, EOFError, ImportError, LookupError, OSError, TypeError, ValueError):
        return WorkerDiedError(DIED)
    finally:
        answer.close()


@contextmanager
def _one_thread() -> Iterator[None]:
    """Context in which started processes use one OpenBLAS thread; with a process per core, more threads are slower."""
    own = BLAS_THREADS not in os.environ
    if own:
        os.environ[BLAS_THREADS] = "1"
    try:
        yield
    finally:
        if own:
            del os.environ[BLAS_THREADS]


def _answer(future: Future[A]) -> A | BaseException:
    if future.cancelled():
        return RuntimeError("cancelled by its executor")
    return future.exception() or future.result()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
