"""Runs by number: each has random numbers of its own, so that one of them can be seen again."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tests.judge.verdict import Verdict

MOST = 1_000_000
"""Runs of one sort."""


def numbered(
    verdict: Verdict, ticks: int, only: int | None, *, first: int = 0
) -> Iterator[tuple[int, np.random.Generator]]:
    """Numbers from `first` until the verdict has so many more ticks; or the one that is asked for, if it is one."""
    if only is not None:
        if first <= only < first + MOST:
            yield only, np.random.default_rng([verdict.seed, only])
        return
    enough, number = verdict.ticks + ticks, first
    while verdict.ticks < enough:
        yield number, np.random.default_rng([verdict.seed, number])
        number += 1


def run_length(rng: np.random.Generator, dt: float, *, seconds: float = 30.0) -> int:
    """Ticks of one run: mostly short, so that there are many, some as long as 30 000, none longer than so many s."""
    ticks = int(rng.choice([300, 1000, 4000, 30_000], p=[0.55, 0.3, 0.13, 0.02]))
    return min(ticks, round(seconds / dt))
