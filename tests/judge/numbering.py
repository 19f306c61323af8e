"""Runs by number: each has random numbers of its own, so that one of them can be seen again."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, TypeAlias

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


OneRun: TypeAlias = Callable[[Verdict, int, np.random.Generator], None]
"""Runs and judges the run of a number, whose random numbers are given."""


class Runs(NamedTuple):
    """One sort of runs of a judge."""

    one_run: OneRun
    share: float = 1.0
    """Of the judge's ticks."""
    first: int = 0
    """Number of the first; of a sort there are at most `MOST`."""


def judging(
    module: str, least: Mapping[str, float], *sorts: Runs, finish: Sequence[Callable[[Verdict], None]] = ()
) -> Callable[..., Verdict]:
    """`run` of a judge: its sorts of runs, each up to its share of the ticks, or only the run of one number.

    `finish` judges what all runs showed together.
    """

    def run(ticks: int, seed: int, *, only: int | None = None) -> Verdict:
        verdict = Verdict(module.rpartition(".")[2], seed, least)
        for each in sorts:
            if only is not None and not each.first <= only < each.first + MOST:
                continue
            number, enough = each.first if only is None else only, verdict.ticks + int(each.share * ticks)
            while verdict.ticks < enough if only is None else number == only:
                each.one_run(verdict, number, np.random.default_rng([seed, number]))
                number += 1
        for judge in finish:
            judge(verdict)
        return verdict

    return run


def judged(follow: Callable[..., Any], judge: Callable[[Verdict, Any], None], **options: Any) -> OneRun:
    """A run that `follow` records with these options, and `judge` judges."""

    def one_run(verdict: Verdict, number: int, rng: np.random.Generator) -> None:
        run = follow(rng, number, **options)
        verdict.begin(number, run.where)
        judge(verdict, run)

    return one_run


def run_length(rng: np.random.Generator, number: int, dt: float, *, seconds: float = 30.0) -> int:
    """Ticks of one run: short, so that there are many; every fortieth up to 30 000, none longer than so many s."""
    ticks = 30_000 if number % 40 == 39 else 4000 if number % 20 == 19 else int(rng.choice([300, 300, 500, 1500]))
    return min(ticks, round(seconds / dt))
