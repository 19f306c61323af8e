"""Tasks on every core, where a worker that dies takes down no task but its own."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, ProcessPoolExecutor, wait
from typing import TypeVar

__all__ = ["WorkerDiedError", "answers", "cores"]

T = TypeVar("T")
A = TypeVar("A")


class WorkerDiedError(Exception):
    """The process that worked on a task ended without an answer: killed, out of memory, or crashed."""


def cores() -> int:
    """How many this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def answers(
    tasks: Sequence[T], work: Callable[[T], A], *, executor: Executor | None, workers: int | None
) -> Iterator[tuple[T, A | BaseException]]:
    """Each task with its answer, or with the exception that it ended in, as they come.

    Parameters
    ----------
    work : must be found by its name in another process, and its answers be picklable.
    executor : where to work; processes of this machine without one. One that breaks fails all tasks it had left.
    workers : processes, without an executor; as many as `cores` by default.
    """
    if executor is not None:
        yield from _by(executor, tasks, work)
        return
    waiting: deque[T] = deque(tasks)
    suspects: deque[T] = deque()
    while waiting or suspects:
        # A broken pool does not tell whose process died: those it was working on are tried again, one by one.
        alone = bool(suspects)
        queue = deque([suspects.popleft()]) if alone else waiting
        for task, answer in _in_one_pool(queue, work, 1 if alone else min(workers or cores(), len(queue))):
            if not isinstance(answer, BrokenExecutor):
                yield task, answer
            elif alone:
                yield (
                    task,
                    WorkerDiedError(
                        "its worker process died (killed, out of memory, crashed), or sent what cannot be read"
                    ),
                )
            else:
                suspects.append(task)


def _by(executor: Executor, tasks: Sequence[T], work: Callable[[T], A]) -> Iterator[tuple[T, A | BaseException]]:
    running: dict[Future[A], T] = {}
    try:
        for task in tasks:
            try:
                running[executor.submit(work, task)] = task
            except (BrokenExecutor, RuntimeError) as refused:  # broken, or shut down
                yield task, refused
        while running:
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                answer: A | BaseException = _answer(future)
                yield running.pop(future), answer
    finally:
        for future in running:
            future.cancel()


def _in_one_pool(waiting: deque[T], work: Callable[[T], A], workers: int) -> Iterator[tuple[T, A | BaseException]]:
    """Tasks taken from `waiting` until none is left or the pool breaks; those it then had in hand come as broken."""
    pool = ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), initializer=_end_with_parent)
    running: dict[Future[A], T] = {}
    broken = False
    try:
        while running or (waiting and not broken):
            while waiting and not broken and len(running) < workers:  # no more: each is a suspect if one breaks
                try:
                    running[_submitted(pool, work, waiting[0])] = waiting[0]
                    waiting.popleft()
                except BrokenExecutor:
                    broken = True
            for future in wait(running, return_when=FIRST_COMPLETED).done if running else ():
                answer: A | BaseException = _answer(future)
                broken = broken or isinstance(answer, BrokenExecutor)
                yield running.pop(future), answer
    finally:
        if running:  # interrupted: nobody waits for these
            for process in list((getattr(pool, "_processes", None) or {}).values()):  # public from Python 3.14 on
                process.terminate()
        pool.shutdown(cancel_futures=True)


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
