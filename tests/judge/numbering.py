"""Runs by number: each has random numbers of its own, so that one of them can be seen again."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator

import numpy as np

from tests.judge.verdict import ROOT, Verdict

FIXED_SEED = 20
"""Of one of the two slices in CI; the other is new each time."""
MOST = 1_000_000
"""Runs of one sort."""


def seed_of_the_code() -> int:
    """Another one after every change of the library, and the same wherever that is judged."""
    files = sorted((ROOT / "rehab_opt").rglob("*.py"))
    return int.from_bytes(hashlib.sha256(b"".join(file.read_bytes() for file in files)).digest()[:4], "big")


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


def run_length(rng: np.random.Generator, number: int, dt: float, *, seconds: float = 30.0) -> int:
    """Ticks of one run: short, so that there are many; every fortieth up to 30 000, none longer than so many s."""
    ticks = 30_000 if number % 40 == 39 else 4000 if number % 20 == 19 else int(rng.choice([300, 300, 500, 1500]))
    return min(ticks, round(seconds / dt))
