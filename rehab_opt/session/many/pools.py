"""Tasks on every core, a process each: one that dies or hangs takes down no task but its own."""

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

__all__ = ["WorkerDiedError", "answers", "cores"]

T = TypeVar("T")
A = TypeVar("A")

DIED = "its worker process died (killed, out of memory, crashed), or sent what cannot be read"
HANDED = 256
"""Tasks that an executor is given at once: enough for so many cores, and what as many answers take in memory."""
BLAS_THREADS = "OPENBLAS_NUM_THREADS"
"""Of numpy and scipy; read when a process loads them."""
PRELOADED = (
    "casadi", "matplotlib.figure", "matplotlib.backends.backend_agg", "mpl_toolkits.mplot3d", "PIL.JpegImagePlugin",
    "scipy.interpolate", "scipy.optimize", "scipy.stats", "shapely", "skimage.measure",
)  # fmt: skip
"""What runs load, 2 s of processor time and more: a server loads it once, and each process is a fork of it."""


class WorkerDiedError(Exception):
    """The process that worked on a task ended without an answer: killed, out of memory, or crashed."""


def cores() -> int:
    """How many this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def answers(
    tasks: Sequence[T],
    work: Callable[[T], A],
    *,
    executor: Executor | None,
    workers: int | None,
    timeout_s: float | None = None,
) -> Iterator[tuple[T, A | BaseException]]:
    """Each task with its answer, or with the exception that it ended in, as they come.

    Parameters
    ----------
    work : must be found by its name in another process, and its answers be picklable.
    executor : where to work; processes of this machine without one. One that breaks fails all tasks it had left.
    workers : processes, as many as `cores` by default; tasks that an executor is given at once, `HANDED` by default.
    timeout_s : [s] after which a task's process is killed, without an executor; TimeoutError is then its answer.
    """
    if executor is not None:
        yield from _by(executor, tasks, work, workers or HANDED)
    else:
        yield from _by_processes(deque(tasks), work, workers or cores(), timeout_s)


def _by(
    executor: Executor, tasks: Sequence[T], work: Callable[[T], A], handed: int
) -> Iterator[tuple[T, A | BaseException]]:
    """Tasks given to an executor; what it gave up with a worker that was lost is at last given to it alone."""
    suspects = []
    for task, answer in _given(executor, tasks, work, handed):
        if _lost_with_worker(answer):
            suspects.append(task)
        else:
            yield task, answer
    for task in suspects:
        yield from _given(executor, [task], partial(work), 1)  # dask has an answer to `work` itself: it gave up


def _lost_with_worker(answer: object) -> bool:
    """Whether dask gave a task up because it waited or ran where workers were lost: the fault may be another's."""
    dask = sys.modules.get("distributed")
    return dask is not None and isinstance(answer, dask.KilledWorker)


def _given(
    executor: Executor, tasks: Sequence[T], work: Callable[[T], A], handed: int
) -> Iterator[tuple[T, A | BaseException]]:
    """Tasks given to an executor, `handed` at once: answers that wait to be taken are not to fill the memory."""
    waiting, running = deque(tasks), dict[Future[A], T]()
    try:
        while waiting or running:
            while waiting and len(running) < handed:
                task = waiting.popleft()
                try:
                    running[executor.submit(work, task)] = task
                except (BrokenExecutor, RuntimeError) as refused:  # broken, or shut down
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
    """Tasks in a process each, `workers` of them at once; whatever ends this, no process stays."""
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
    """Forks of a server that has loaded what runs need; on systems without forks, new processes."""
    if "forkserver" not in multiprocessing.get_all_start_methods():  # Windows
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    ours = [name for name in sys.modules if name.startswith("rehab_opt.") and not name.endswith("__main__")]
    context.set_forkserver_preload([*ours, *PRELOADED, module])
    return context


def _answer_into(send: Connection, work: Callable[[T], A], task: T) -> None:
    """What a process does; Ctrl-C is for the one that started it, with which it ends, however that ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with ThreadPoolExecutor(1) as one:  # whatever it raises is an answer
        send.send(_answer(one.submit(work, task)))


def _received(answer: Connection) -> Any:
    """An answer; what was cut off, or cannot be made again from its pickle, is `WorkerDiedError`."""
    try:
        return answer.recv()
    except (ArithmeticError, AttributeError, EOFError, ImportError, LookupError, OSError, TypeError, ValueError):
        return WorkerDiedError(DIED)
    finally:
        answer.close()


@contextmanager
def _one_thread() -> Iterator[None]:
    """Processes that start meanwhile compute in one thread each, unless the user says otherwise: there is one a core.

    On cores that are all busy a second thread of OpenBLAS waits at full speed for its turn: a map cost 4.3 s for 1.9 s.
    """
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
