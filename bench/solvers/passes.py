"""One solver's way through one sequence, cold or warm, with a hard limit on every solve."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from bench.solvers.entrant import Entrant
from bench.solvers.instances import Instances
from bench.solvers.judgement import Judge, Judged, Outcome
from bench.solvers.machine import load_now
from bench.solvers.worker import Timed, TooLateError, Worker, WorkerDiedError

__all__ = ["MODES", "Pass", "Rules", "passed"]

MODES = {"qp": ("cold", "warm"), "nlp": ("cold",)}
"""Of each kind of instances; programmes are no run in time, and start where their capability starts them."""
BLOCKS = (250, 25, 1)
"""Ticks a worker does before it reports, since a report between two solves cools the processor's caches. All of them
share one limit: where it is passed, the next smaller number shows whether a tick hangs or all of them are slow."""
SMALL = 20
"""Variables above which every tick reports: it takes milliseconds, and many of them would not keep to one limit."""
MAX_TOO_LATE = 3
"""Ticks of a pass that may be too late before the rest is not tried."""
SETUP_SECONDS = 120.0
"""Limit of making a solver: its imports, and a compiler."""
FIRST_SECONDS = 10.0
"""Limit of a first solve beyond that of any other: what a solver loads when it is used."""


class Rules(NamedTuple):
    """What holds for every pass."""

    limit: float
    """[s] of one solve."""
    repeats: int = 3
    """Times a pass is made: the smallest time of each tick counts, since what disturbs only adds."""
    patience: float = 2.0
    """[s] of a pass from which it is not repeated."""
    setup: float = SETUP_SECONDS


class Pass(NamedTuple):
    """What became of every tick."""

    solver: str
    sequence: str
    mode: str
    ticks: tuple[Judged, ...]
    load: float = math.nan
    """Of the machine when it was done."""


def passed(
    worker: Worker,
    entrant: Entrant,
    sequence: Instances,
    *,
    mode: str,
    judge: Judge,
    rules: Rules,
    told: Callable[[int], None] = lambda _: None,
) -> Pass:
    """Solve every tick of `sequence`; a worker that hangs or dies is replaced.

    Parameters
    ----------
    told : called with how many ticks are done.
    """
    best: list[Judged] = []
    for _ in range(rules.repeats):
        ticks = _once(worker, entrant, sequence, warm=mode == "warm", judge=judge, rules=rules, told=told)
        best = [_better(*each) for each in zip(best, ticks, strict=True)] if best else ticks
        spent = sum(tick.seconds for tick in ticks)
        cut_off = any(tick.outcome is Outcome.TOO_LATE or not math.isfinite(tick.seconds) for tick in ticks)
        if cut_off or spent > rules.patience:
            break
    return Pass(entrant.name, sequence.name, mode, tuple(best), load_now())


def _once(
    worker: Worker,
    entrant: Entrant,
    sequence: Instances,
    *,
    warm: bool,
    judge: Judge,
    rules: Rules,
    told: Callable[[int], None],
) -> list[Judged]:
    tame = _tame_ticks(judge, len(sequence))
    whole = len(sequence)
    done: list[Judged] = []
    begun, blocks, late = False, list(BLOCKS if sequence.sizes[0] <= SMALL else BLOCKS[-1:]), 0
    while len(done) < whole:
        if late >= MAX_TOO_LATE:
            why = f"{late} ticks before it were too late"
            done += [Judged(Outcome.NOT_TRIED, math.inf, math.inf, math.nan, why)] * (whole - len(done))
            break
        if not begun:
            refusal = _begun(worker, entrant, sequence, warm=warm, rules=rules, tame=tame)
            if refusal:
                done += [Judged(Outcome.RAISED, math.inf, math.inf, math.nan, refusal)] * (whole - len(done))
                break
            begun = True
        first = len(done)
        # An instance without an answer is where solvers hang: it goes alone.
        last = first + 1
        while last < min(first + blocks[0], whole) and not (judge.hopeless(last) or judge.hopeless(first)):
            last += 1
        answers: list[Timed] | None = None
        try:
            answers = worker.solved(first, last, limit=rules.limit)
        except TooLateError:
            ended = judge.too_late(first)
        except WorkerDiedError as death:
            blocks = [1]
            ended = Judged(Outcome.RAISED, math.nan, math.inf, math.nan, str(death))
        if answers is not None:
            done += [judge.judged(first + i, timed) for i, timed in enumerate(answers)]
        else:
            begun = False
            if last - first == 1:
                late += 1
                done.append(ended)
            else:
                blocks = [each for each in blocks if each < last - first] or [1]
        told(len(done))
    return done


def _tame_ticks(judge: Judge, whole: int) -> list[int]:
    """Ticks that a first solve may be of: the first and the last one that have an answer."""
    fair = [tick for tick in range(whole) if not judge.hopeless(tick)]
    return list(dict.fromkeys((*fair[:1], *fair[-1:])))


def _begun(worker: Worker, entrant: Entrant, sequence: Instances, *, warm: bool, rules: Rules, tame: list[int]) -> str:
    """Why the solver cannot be made, or nothing: then it is, and has solved the first of `tame`.

    A tick that it hangs or dies at leaves `tame`: what becomes of that tick is found out in its own turn.
    """
    while True:
        try:
            refusal = worker.begin(entrant, sequence, warm=warm, limit=rules.setup)
        except TooLateError:
            return f"not ready after {rules.setup:g} s"
        except WorkerDiedError as death:
            return str(death)
        if refusal or not tame:
            return refusal
        try:
            return worker.warm_up(tame[0], limit=rules.limit + FIRST_SECONDS)
        except (TooLateError, WorkerDiedError):
            del tame[0]


def _better(one: Judged, other: Judged) -> Judged:
    """The faster of two solves of the same tick; an answer that is not the same each time counts as its worse one."""
    if one.outcome is not other.outcome:
        return one if one.outcome not in (Outcome.SOLVED, Outcome.SAID_NO) else other
    return one if one.seconds <= other.seconds else other
