"""What a judge found: ticks, broken claims, the worst of each bound, and which situations there were, for how long."""

from __future__ import annotations

import importlib
import math
import pkgutil
import re
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt import Command, Relaxed

ROOT = Path(__file__).resolve().parents[2]
NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*(?:e[-+]?\d+)?|\binf\b|\bnan\b)", re.IGNORECASE)
SPARE, COMMON = 36, 100
"""Runs that chance may take, see `Verdict.asked`; what a slice should have this many ticks of must be there at all."""
BY_ACTIVE_SETS = ("solver closed form", "solver active set", "solver dual active set")
"""Situations in which one of these methods answered."""
FEW = 5000
"""Ticks of a slice that is too short for a thousandth."""
MOST_SHOWN = 5
"""Broken claims of one kind that are kept with their numbers; all are counted."""


class Broken(NamedTuple):
    """One claim that did not hold, the numbers that show it, and the command that shows it again."""

    claim: str
    numbers: str
    again: str


@dataclass
class Seen:
    """How often and how long one situation lasted."""

    ticks: int = 0
    seconds: float = 0.0
    longest: float = 0.0

    def add(self, other: Seen) -> None:
        """The same, seen elsewhere."""
        self.ticks, self.seconds = self.ticks + other.ticks, self.seconds + other.seconds
        self.longest = max(self.longest, other.longest)


@dataclass
class Verdict:
    """All that one promise's runs showed. A claim is `holds`, a number within its bound is `within`."""

    name: str
    seed: int
    least: Mapping[str, float] = field(default_factory=dict)
    """Situation -> least ticks per 10^6."""
    ticks: int = 0
    runs: int = 0
    took: float = 0.0
    """[s]"""
    kinds: dict[str, int] = field(default_factory=dict)
    """Broken claim -> how often."""
    broken: list[Broken] = field(default_factory=list)
    worst: dict[str, tuple[float, float]] = field(default_factory=dict)
    """Claim -> the largest value seen, and its bound there."""
    seen: dict[str, Seen] = field(default_factory=dict)
    run: int = 0
    """Number of the run being judged."""
    where: str = ""
    """What that run is, in words."""

    def begin(self, run: int, where: str) -> None:
        """What follows is of this run."""
        self.run, self.where = run, where
        self.runs += 1

    # ------------------------------------------------------------------------------------------------- claims
    def breaks(self, claim: str, numbers: str) -> None:
        """One more broken claim."""
        self.kinds[claim] = self.kinds.get(claim, 0) + 1
        if self.kinds[claim] <= MOST_SHOWN:
            again = f"python -m tests.judge --only {self.name} --seed {self.seed} --run {self.run}"
            self.broken.append(Broken(claim, f"{numbers} [{self.where}]", again))

    def holds(self, claim: str, held: ArrayLike, numbers: str = "") -> None:
        """The claim held wherever `held` is true; broken at most once a run, at its first tick."""
        held = np.atleast_1d(np.asarray(held, dtype=bool))
        if not held.all():
            off = np.flatnonzero(~held.reshape(len(held), -1).all(axis=1))
            self.breaks(claim, f"{len(off)} of {len(held)}, first {off[0]}{'; ' if numbers else ''}{numbers}")

    def within(self, claim: str, values: ArrayLike, bound: ArrayLike, numbers: str = "") -> None:
        """values <= bound everywhere, ticks first; NaN breaks it. The worst is kept, and broken at most once a run."""
        values, bound = np.broadcast_arrays(np.asarray(values, dtype=float), np.asarray(bound, dtype=float))
        if not values.size:
            return
        over = np.where(np.isnan(values - bound) & ~(values == bound), math.inf, values - bound)
        at = np.unravel_index(int(np.argmax(over)), over.shape)
        value, limit = float(values[at]), float(bound[at])
        known = self.worst.get(claim)
        if known is None or not value - limit <= known[0] - known[1]:
            self.worst[claim] = value, limit
        if over[at] > 0:
            ticks = np.flatnonzero((over > 0).reshape(len(over), -1).any(axis=1)) if over.ndim else [0]
            text = (
                f"{value:.6g} > {limit:.6g} at {tuple(map(int, at))}; {len(ticks)} of {len(values) if over.ndim else 1}"
            )
            self.breaks(claim, f"{text}, first {ticks[0]}{'; ' if numbers else ''}{numbers}")

    # --------------------------------------------------------------------------------------------- situations
    def during(self, situation: str, mask: ArrayLike, dt: ArrayLike) -> None:
        """Count the ticks in which a situation was, the seconds, and its longest stretch; dt [s] one or one a tick."""
        mask = np.asarray(mask, dtype=bool)
        if not mask.any():
            return
        time = np.where(mask, np.broadcast_to(np.asarray(dt, dtype=float), mask.shape), 0.0)
        total = np.cumsum(time)
        starts = np.flatnonzero(mask & ~np.r_[False, mask[:-1]])
        ends = np.flatnonzero(mask & ~np.r_[mask[1:], False])
        longest = np.max(total[ends] - total[starts] + time[starts])
        found = Seen(int(mask.sum()), float(total[-1]), float(longest))
        self.seen.setdefault(situation, Seen()).add(found)

    def answers(self, commands: Sequence[Command], dt: ArrayLike) -> Answers:
        """Count status, solver, reason and what was relaxed of a run's commands; they come back as arrays."""
        found = Answers.of(commands)
        self.ticks += len(commands)
        for label, values in (("status", found.status), ("solver", found.solver), ("reason", found.reason)):
            for each in np.unique(values):
                if each:
                    self.during(f"{label} {each}", values == each, dt)
        self.during("relaxed nothing", found.relaxed == 0, dt)
        for bound in Relaxed:
            if bound:
                self.during(f"relaxed {str(bound.name).lower()}", found.relaxed & bound.value != 0, dt)
        return found

    def count(self, situation: str) -> int:
        """Ticks in which a situation was."""
        return self.seen[situation].ticks if situation in self.seen else 0

    def seldom_by_backup(self) -> None:
        """The solver that was chosen fails in a fiftieth of the ticks at most; there a backup answers."""
        self.within("ticks answered by the backup, of all", self.count("status backup") / max(self.ticks, 1), 0.02)

    def seldom_beyond_the_dual_method(self) -> None:
        """What the closed form and the last active set do not answer, the dual method does, which cannot cycle."""
        usual = sum(map(self.count, BY_ACTIVE_SETS))
        solved = sum(seen.ticks for name, seen in self.seen.items() if name.startswith("solver "))
        self.within("ticks that no active set method answers, of all", (solved - usual) / max(self.ticks, FEW), 1e-3)

    @property
    def asked(self) -> dict[str, int]:
        """Situation -> least ticks of so many: 1 - sqrt(SPARE / runs) of what `least` says of them, rounded down.

        Many situations last for all of a run, or are in none of its ticks: by so much of their mean they are seldomer
        in R runs, by chance. Of SPARE runs or fewer only what is common is asked: once,
        where so many ticks would fill a run.
        """
        sure = max(0.0, 1.0 - math.sqrt(SPARE / max(self.runs, 1)))
        least = {name: per_million * self.ticks / 1e6 for name, per_million in self.least.items()}
        common = {name: each >= COMMON and each * self.runs >= self.ticks for name, each in least.items()}
        return {name: max(int(each * sure), int(common[name])) for name, each in least.items()}

    @property
    def missed(self) -> dict[str, tuple[int, int]]:
        """Situation -> ticks seen, ticks asked, where these are more."""
        counts = {name: self.seen[name].ticks if name in self.seen else 0 for name in self.least}
        return {name: (counts[name], asked) for name, asked in self.asked.items() if counts[name] < asked}

    def add(self, other: Verdict) -> None:
        """What another process found for the same promise."""
        self.ticks, self.runs, self.took = self.ticks + other.ticks, self.runs + other.runs, self.took + other.took
        for claim, count in other.kinds.items():
            self.kinds[claim] = self.kinds.get(claim, 0) + count
        self.broken += other.broken
        for claim, (value, bound) in other.worst.items():
            known = self.worst.get(claim)
            if known is None or not value - bound <= known[0] - known[1]:
                self.worst[claim] = value, bound
        for name, seen in other.seen.items():
            self.seen.setdefault(name, Seen()).add(seen)


class Answers(NamedTuple):
    """Commands of a run as arrays, one row a tick."""

    value: NDArray[np.float64]
    status: NDArray[np.str_]
    solver: NDArray[np.str_]
    reason: NDArray[np.str_]
    """Numbers are written as #."""
    relaxed: NDArray[np.int64]
    scale: NDArray[np.float64]
    residual: NDArray[np.float64]
    wheels: NDArray[np.float64] | None

    @staticmethod
    def of(commands: Sequence[Command]) -> Answers:
        """The arrays of these commands."""
        value, status, solver, residual, _, reason, relaxed, scale, wheels = zip(*commands, strict=True)
        names = {each: str(each.value) for each in set(status)}
        plain = {each: NUMBER.sub("#", each) for each in set(reason)}
        return Answers(
            np.array(value, dtype=float),
            np.array([names[each] for each in status]),
            np.array(solver),
            np.array([plain[each] for each in reason]),
            np.array(relaxed, dtype=np.int64),
            np.array(scale, dtype=float),
            np.array(residual, dtype=float),
            None if wheels[0] is None else np.array(wheels, dtype=float),
        )


def judges(names: Iterable[str] | None = None) -> dict[str, ModuleType]:
    """Modules of `tests.judge` that judge guarantees, by name; only these names where some are given."""
    package = importlib.import_module("tests.judge")
    found = {}
    for each in pkgutil.iter_modules(package.__path__):
        if each.name.startswith(("test_", "__")):
            continue
        module = importlib.import_module(f"tests.judge.{each.name}")
        if hasattr(module, "GUARANTEES"):
            found[each.name] = module
    chosen = list(found) if names is None else list(names)
    unknown = [name for name in chosen if name not in found]
    if unknown:
        raise SystemExit(f"no judge of {', '.join(unknown)}; there are {', '.join(found)}")
    return {name: found[name] for name in chosen}


def hearing(name: str, ticks: int, seed: int, only: int | None) -> Verdict:
    """One promise's runs of one seed; here, and not in `__main__`, so that a spawned process finds it."""
    begun = time.perf_counter()
    verdict: Verdict = judges([name])[name].run(ticks, seed, only=only)
    verdict.took = time.perf_counter() - begun
    return verdict
