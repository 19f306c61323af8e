"""Whether our solves have become slower, in ratios of one run: `python -m bench.compare`.

Each solver of ours goes along one recorded sequence of every family, in turn with one reference solver; the median over
rounds of the ratio of medians is compared with `bench/baseline.json`. Seconds change from machine to machine, these
ratios little: a ratio worse than the stored one by more than `--factor` fails, with exit code 1; so does a solver that
certifies fewer of the ticks than it did, which may well have become quicker by that. `--write` stores what is measured
now instead.
"""

from __future__ import annotations

import argparse
import json
import math
import statistics
import sys
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from rich.console import Console
from rich.table import Table

from bench.corpus import along, quality, read, representatives
from bench.machine import machine
from bench.solvers.entrants import entrants
from bench.solvers.record import versions_of

__all__ = ["Change", "changes", "main"]

BASELINE = Path(__file__).with_name("baseline.json")
REFERENCE = "proxqp"
"""Through qpsolvers, a fresh call each time: none of it is our code, and every installation has it."""
WATCHED = ("qrqp-fused", "qrqp-virtual", "proxqp-kept", "osqp-kept")
FACTOR = 1.4
"""Two runs of the same code were seen apart by 2 to 5 %, once by a fifth, on a machine with five other jobs."""
ROUNDS, SOLVES = 15, 60

Ratios = Mapping[str, Mapping[str, float]]


class Change(NamedTuple):
    """One solver on one sequence."""

    sequence: str
    solver: str
    before: float
    """Of the baseline, NaN where it has none."""
    now: float
    """NaN where it was not measured."""
    certified_before: float = 0.0
    """Share of the ticks."""
    certified_now: float = 1.0

    def worse(self, factor: float) -> bool:
        """Whether it fails: slower by more than the factor, no longer there, or certified less often."""
        return bool(self.verdict(factor))

    def verdict(self, factor: float) -> str:
        """Why it fails, or nothing."""
        if math.isnan(self.before):
            return ""
        if math.isnan(self.now):
            return "not measured"
        if not self.certified_now >= self.certified_before:
            return f"certifies {self.certified_now:.2%}"
        return "" if self.now <= factor * self.before else "slower"


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, and compare or store."""
    parser = argparse.ArgumentParser(prog="python -m bench.compare", description=__doc__)
    parser.add_argument("--factor", type=float, default=FACTOR, help="how much worse a ratio may be")
    parser.add_argument("--rounds", type=int, default=ROUNDS, choices=range(1, 1000), metavar="N")
    parser.add_argument("--write", action="store_true", help="store the ratios of this run as the baseline")
    options = parser.parse_args(arguments)
    console = Console(width=max(Console().width, 110))
    console.print("  ".join(f"{key}: {value}" for key, value in machine().items()), highlight=False)
    measured = {name: _ratios(name, options.rounds) for name in representatives()}
    certified = {name: _certified(name) for name in measured}
    if not measured:
        console.print("no recorded sequences here", style="bold red")
        return 1
    if options.write:
        _store(measured, certified)
        console.print(f"written: {BASELINE.name}")
        return 0
    stored = json.loads(BASELINE.read_text())
    found = changes(stored["ratios"], measured, certified_before=stored["certified"], certified_now=certified)
    table = Table("sequence", "solver", f"time / {REFERENCE}'s", "baseline", "change", "verdict")
    for each in found:
        verdict = f"[bold red]{each.verdict(options.factor)}" if each.worse(options.factor) else "ok"
        change = f"{each.now / each.before:.2f}"
        table.add_row(each.sequence, each.solver, f"{each.now:.3f}", f"{each.before:.3f}", change, verdict)
    console.print(table)
    failed = [each for each in found if each.worse(options.factor)]
    word = f"FAIL: {len(failed)} of" if failed else "PASS:"
    console.print(f"{word} {len(found)} ratios; each may be {options.factor:g} times the baseline's", highlight=False)
    return 1 if failed else 0


def changes(
    before: Ratios, now: Ratios, *, certified_before: Ratios | None = None, certified_now: Ratios | None = None
) -> list[Change]:
    """Every pair of sequence and solver that stands on either side, with the shares of ticks that it certifies."""
    absent = math.nan

    def fraction(side: Ratios | None, name: str, solver: str, unknown: float) -> float:
        return (side or {}).get(name, {}).get(solver, unknown)

    pairs = {(name, solver): None for side in (before, now) for name, each in side.items() for solver in each}
    return [
        Change(
            name, solver, before.get(name, {}).get(solver, absent), now.get(name, {}).get(solver, absent),
            fraction(certified_before, name, solver, 0.0), fraction(certified_now, name, solver, 1.0),
        )
        for name, solver in pairs
    ]  # fmt: skip


def _certified(name: str) -> dict[str, float]:
    """Of each watched solver: the share of the sequence's ticks that it certifies, warm."""
    by_name = {entrant.name: entrant for entrant in entrants()}
    return {solver: round(quality(by_name[solver], read(name)).certified, 4) for solver in WATCHED}


def _ratios(name: str, rounds: int) -> dict[str, float]:
    """Of each watched solver on one sequence: the median over rounds of its median time beside the reference's."""
    by_name = {entrant.name: entrant for entrant in entrants()}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # solvers warn of what they are given
        calls = {solver: along(by_name[solver], read(name)) for solver in (REFERENCE, *WATCHED)}
        times: dict[str, list[float]] = {solver: [] for solver in calls}
        for each in range(-1, rounds):  # the first round warms up
            for solver, call in calls.items():
                median = _median_time(call)
                if each >= 0:
                    times[solver].append(median)
    return {
        solver: statistics.median(own / other for own, other in zip(times[solver], times[REFERENCE], strict=True))
        for solver in WATCHED
    }


def _median_time(call: Callable[[], Any]) -> float:
    clock, spent = time.perf_counter, []
    for _ in range(SOLVES):
        began = clock()
        call()
        spent.append(clock() - began)
    return statistics.median(spent)


def _store(measured: Ratios, certified: Ratios) -> None:
    taking_part = [entrant for entrant in entrants() if entrant.name in (REFERENCE, *WATCHED)]
    rounded = {name: {solver: round(ratio, 4) for solver, ratio in each.items()} for name, each in measured.items()}
    content = {
        "reference": REFERENCE,
        "machine": machine(),
        "versions": {name: text for entrant in taking_part for name, text in versions_of(entrant).items()},
        "ratios": rounded,
        "certified": certified,
    }
    BASELINE.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
