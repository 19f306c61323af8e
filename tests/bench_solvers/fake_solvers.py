"""Solvers of boxes that are honest, or fail in one known way; importable by name in another process."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Any

import numpy as np

from bench.qp_recording.sequence import QPSequence, sequence_of
from bench.solvers.entrant import Claim, Entrant
from bench.solvers.instances import RecordedQPs
from rehab_opt.optim.backends import Answer
from rehab_opt.optim.rows import Instance

SLEEP = 300.0
DAWDLE = 0.1
TRAP = 2
"""The tick in which they fail, where nothing else is said."""


def boxes(ticks: int = 6, *, marks: tuple[tuple[str, ...], ...] = ((),), name: str = "box/plain") -> QPSequence:
    """min 1/2 x'Dx + g'x in a box, D diagonal: the answer is -g/d moved into the box."""
    random = np.random.default_rng(0)
    infinite = np.full(2, np.inf)
    instances = [
        Instance(np.diag([1.0, 4.0]), random.normal(size=2), np.zeros((0, 2)), np.zeros(0), np.zeros(0),
                 -0.3 * np.ones(2), infinite)
        for _ in range(ticks)
    ]  # fmt: skip
    for tick, marked in enumerate(marks):
        if "nan" in marked:
            instances[tick] = instances[tick]._replace(g=np.array([np.nan, 1.0]))
        if "infeasible" in marked:
            instances[tick] = instances[tick]._replace(lower=np.ones(2), upper=-np.ones(2))
    return sequence_of(name, instances, dt=0.01, tolerance=1e-8, command="a test", about="boxes", marks=marks)


def exact(qp: Instance) -> Answer:
    """The closed form."""
    free = -qp.g / np.diag(qp.H)
    x = np.clip(free, qp.lower, qp.upper)
    return Answer(x, -(np.diag(qp.H) * x + qp.g), np.zeros(0), 1)


class Fake:
    """Answers exactly but in one tick, where it fails in its own way: "dies", or "dies at 0"."""

    def __init__(self, sequence: RecordedQPs, how: str) -> None:
        self.how, _, trap = how.partition(" at ")
        self.trap = exact(sequence[int(trap or TRAP)]).x.tobytes()

    def prepared(self, qp: Instance) -> Instance:
        return qp

    def solve(self, given: Instance, *, warm: bool) -> Any:
        answer = exact(given)
        if answer.x.tobytes() != self.trap:
            return True, answer
        if self.how == "raises":
            raise ZeroDivisionError("one over nothing")
        if self.how == "sleeps":
            time.sleep(SLEEP)
        if self.how == "dawdles":
            time.sleep(DAWDLE)
        if self.how == "dies":
            os._exit(9)
        if self.how == "gives NaN":
            return True, answer._replace(x=np.full(2, np.nan))
        if self.how == "lies":
            return True, answer._replace(x=answer.x + 1e-3)
        if self.how == "gives up":
            return False, answer._replace(x=np.full(2, np.nan))
        if self.how == "is modest":
            return False, answer
        return True, answer

    def claim(self, qp: Instance, answered: Any) -> Claim:
        word, answer = answered
        return Claim(word, answer)


class Gullible(Fake):
    """Claims an answer to whatever it is given."""

    def solve(self, given: Instance, *, warm: bool) -> Any:
        return True, Answer(np.zeros(2), np.zeros(2), np.zeros(0), 1)


class Wary(Fake):
    """Says no to what has no answer; sleeps on NaN where told so."""

    def solve(self, given: Instance, *, warm: bool) -> Any:
        if self.how == "always sleeps" or (np.isnan(given.g).any() and self.how == "sleeps"):
            time.sleep(SLEEP)
        return bool((given.lower <= given.upper).all() and np.isfinite(given.g).all()), exact(given)


class Talkative(Fake):
    """Solves at once, and takes its time to say so."""

    def claim(self, qp: Instance, answered: Any) -> Claim:
        time.sleep(DAWDLE)
        return super().claim(qp, answered)


class Counted(Fake):
    """Leaves a mark in a file each time it is made."""

    def __init__(self, sequence: RecordedQPs, file: str) -> None:
        super().__init__(sequence, "")
        with Path(file).open("a") as marks:
            marks.write("x")


def unmakeable(_: RecordedQPs, why: str) -> Fake:
    raise ValueError(why)


def entrant(how: str) -> Entrant:
    return Entrant(how, Fake, how)
