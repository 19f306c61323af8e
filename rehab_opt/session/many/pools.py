"""Tasks on every core, where a worker that dies takes down no task but its own."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, ProcessPoolExecutor, wait
from contextlib import contextmanager
from functools import partial
from typing import Generic, TypeVar

__all__ = ["WorkerDiedError", "answers", "cores"]

T = TypeVar("T")
A = TypeVar("A")

DIED = "its worker process died (killed, out of memory, crashed), or sent what cannot be read"
HANDED = 256
"""Tasks that an executor is given at once: enough for so many cores, and what as many answers take in memory."""
ASK_AGAIN = 0.2
"""[s]"""
BLAS_THREADS = "OPENBLAS_NUM_THREADS"
"""Of numpy and scipy; read when a process loads them."""


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
    elif tasks:
        yield from _by_processes(deque(tasks), work, min(workers or cores(), len(tasks)), timeout_s)


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
    """Tasks in pools of one process each, so that one that dies or is killed takes its own task alone."""
    idle = [_Worker(work) for _ in range(workers)]
    running: dict[Future[A], tuple[_Worker[T, A], T]] = {}
    try:
        while waiting or running:
            while waiting and idle:
                worker, task = idle.pop(), waiting.popleft()
                running[worker.begin(task)] = (worker, task)
            pause = None if timeout_s is None else min(worker.left(timeout_s) for worker, _ in running.values())
            for future in wait(running, timeout=pause, return_when=FIRST_COMPLETED).done:
                worker, task = running.pop(future)
                answer: A | BaseException = _answer(future)
                if isinstance(answer, BrokenExecutor):
                    worker.kill()
                    worker, answer = _Worker(work), WorkerDiedError(DIED)
                idle.append(worker)
                yield task, answer
            for future, (worker, task) in list(running.items()):
                if timeout_s is not None and worker.left(timeout_s) <= 0 and not future.done():
                    del running[future]
                    worker.kill()
                    idle.append(_Worker(work))
                    yield task, TimeoutError(f"not done after {timeout_s:g} s")
    finally:
        for worker, _ in running.values():  # interrupted: nobody waits for these
            worker.kill()
        for worker in idle:
            worker.pool.shutdown()


class _Worker(Generic[T, A]):
    """One process, and when its task began: once it has loaded what it needs, which is not the task's fault."""

    def __init__(self, work: Callable[[T], A]) -> None:
        self.pool = ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), initializer=_end_with_parent)
        self._work = work
        with _one_thread():
            self._config = _submitted(self.pool, callable, work)
        self._began: float | None = None

    def begin(self, task: T) -> Future[A]:
        self._began = None
        return _submitted(self.pool, self._work, task)

    def left(self, timeout_s: float) -> float:
        """[s] until the task is late, or until it is time to ask again."""
        if self._began is None and self._config.done():
            self._began = time.monotonic()
        return ASK_AGAIN if self._began is None else max(self._began + timeout_s - time.monotonic(), 0.0)

    def kill(self) -> None:
        for process in list((getattr(self.pool, "_processes", None) or {}).values()):  # public from Python 3.14 on
            process.kill()
        self.pool.shutdown(cancel_futures=True)


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


def _submitted(pool: ProcessPoolExecutor, work: Callable[[T], A], task: T) -> Future[A]:
    """Submit; processes that start meanwhile never see Ctrl-C, which is for the one that started them."""
    if not hasattr(signal, "pthread_sigmask"):
        return pool.submit(work, task)
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        return pool.submit(work, task)
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _answer(future: Future[A]) -> A | BaseException:
    if future.cancelled():
        return RuntimeError("cancelled by its executor")
    return future.exception() or future.result()


def _end_with_parent() -> None:
    """A killed parent leaves no workers behind."""
    parent = multiprocessing.parent_process()

    def watch() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
