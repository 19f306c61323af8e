"""The rows of the table: which task measures what, in which unit, and the bound of issue 15."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from bench.physics.forces import BUDGET, CAP, delivered, needed, reached
from bench.physics.limits import hand_bounds, held_limit
from bench.physics.recordings import mirrored
from bench.physics.setting import Cell, Numbers, Task, setting_of
from bench.physics.touching import blocked, frozen, pushed
from bench.physics.tracking import GAINS, PEERS, tracked

__all__ = ["ROWS", "TASKS", "Done", "Measured", "Row", "done", "measured"]

TASKS: Mapping[str, Task] = MappingProxyType(
    {
        "limit": held_limit,
        "hand": hand_bounds,
        "tracking": tracked,
        "energy": delivered,
        "help": reached,
        "need": needed,
        "blocked": blocked,
        "frozen": frozen,
        "push": pushed,
        "mirror": mirrored,
    }
)
"""What can be done, by the name that `--only` takes."""


class Done(NamedTuple):
    """One task that was done."""

    cell: Cell
    numbers: Numbers


class Row(NamedTuple):
    """One line of the table."""

    what: str
    task: str
    of: Callable[[Sequence[Numbers]], float]
    """All tasks, or those of one delay -> the number."""
    at_most: float
    unit: str
    scale: float = 1.0
    at_least: float = -math.inf


def _worst(name: str) -> Callable[[Sequence[Numbers]], float]:
    return lambda all_of_it: max(each[name] for each in all_of_it)


def _least(name: str) -> Callable[[Sequence[Numbers]], float]:
    return lambda all_of_it: min(each[name] for each in all_of_it)


def _mean(name: str) -> Callable[[Sequence[Numbers]], float]:
    return lambda all_of_it: float(np.mean([each[name] for each in all_of_it]))


def _best(who: str, all_of_it: Sequence[Numbers]) -> float:
    """Mean over the tasks at the gain that makes it least."""
    return min(float(np.mean([each[f"{who} {gain:g}/s"] for each in all_of_it])) for gain in GAINS)


def _best_peer(name: str) -> Callable[[Sequence[Numbers]], float]:
    return lambda all_of_it: _best(name, all_of_it) if name in PEERS else math.nan


def _beside(all_of_it: Sequence[Numbers]) -> float:
    """Ours over the best peer's; 1 where they are the same within 0.01 mm. NaN unless all peers are there."""
    ours, theirs = _best("ours", all_of_it), float(np.min([_best_peer(name)(all_of_it) for name in ("pink", "placo")]))
    return 1.0 if abs(ours - theirs) <= 1e-5 else ours / theirs


def _arrive(all_of_it: Sequence[Numbers]) -> float:
    """How many arrive with late help, over how many arrive with help that is not late."""
    at_once = sum(each["helped at once"] for each in all_of_it)
    return sum(each["helped"] for each in all_of_it) / at_once if at_once else math.nan


ROWS = (
    Row("true joint beyond its limit, worst", "limit", _worst("beyond the limit"), 0.5, "mrad", 1e3),
    Row("pressed there with 30 N: beyond what a servo that stands still is, worst", "limit",
        _worst("beyond a bare servo"), 0.5, "mrad", 1e3),
    Row("limit held for 3 s: peak to peak, worst", "limit", _worst("limit: peak to peak"), 0.3, "mrad", 1e3),
    Row("limit held for 3 s: hand RMS, worst", "limit", _worst("limit: hand RMS"), 2.0, "mm/s", 1e3),
    Row("tasks in which a joint came to its limit", "limit", _mean("limit reached"), math.inf, "%", 100.0),
    Row("w / w_max below the floor, worst", "hand", _worst("below the floor"), 0.002, ""),
    Row("into a keep-out plane, worst", "hand", _worst("into keep-out"), 0.5, "mm", 1e3),
    Row("true hand speed / its bound, worst", "hand", _worst("hand speed"), 1.02, ""),
    Row("tracking RMS at its best gain", "tracking", lambda of: _best("ours", of), math.inf, "mm", 1e3),
    Row("tracking RMS of pink at its best gain", "tracking", _best_peer("pink"), math.inf, "mm", 1e3),
    Row("tracking RMS of placo at its best gain", "tracking", _best_peer("placo"), math.inf, "mm", 1e3),
    Row("ours / the better of them, paired tasks", "tracking", _beside, 1.05, ""),
    Row("ticks that ask the backup, mean", "tracking", _mean("backup"), 0.1, "%", 100.0),
    Row(f"work of the acting force ({BUDGET:g} J in the tank), worst", "energy", _worst("work"), math.inf, "J"),
    Row(f"the same, of hands below {CAP:g} m/s", "energy", _worst("work below the cap"), BUDGET, "J"),
    Row("help, from 1 s after arrival: speed RMS, worst", "help", _worst("help: speed at rest"), 0.05, "m/s"),
    Row("help: work of a 0.2 m reach, worst", "help", _worst("help: work of a reach"), 3.0, "J"),
    Row("people who need help: arrive within 4 s without it", "need", _mean("unaided"), 20.0, "%", 100.0),
    Row("people who need help: arrive with help that is not late", "need", _mean("helped at once"),
        math.inf, "%", 100.0),
    Row("people who need help: arrive with late help, of these", "need", _arrive, math.inf, "%", 100.0, at_least=95.0),
    Row("lag of a mirrored recording / allowed, worst", "mirror", _worst("mirror: lag"), 1.0, ""),
    Row("blocked hand at 0.25 m/s: peak force, worst", "blocked", _worst("blocked: peak"), 140.0, "N"),
    Row("the same of commands that end as it touches", "blocked", _worst("blocked: stopped at once"), math.inf, "N"),
    Row("blocked hand: force after 0.5 s, worst", "blocked", _worst("blocked: after 0.5 s"), 60.0, "N"),
    Row("speed on release, worst", "blocked", _worst("release"), 0.1, "m/s"),
    Row("frozen encoder, fresh stamps: braking after, worst", "frozen", _worst("frozen encoder"), 0.2, "s"),
    Row("blocked joint: braking after, worst", "frozen", _worst("blocked joint"), 0.2, "s"),
    Row("28 +- 2 N: gives way / (F/k) from 1 s on, least", "push", _least("push: gives way"), 1.2, "", at_least=0.8),
    Row("the same, most", "push", _worst("push: gives way, most"), 1.2, "", at_least=0.8),
    Row("28 +- 2 N: stiffness of the reply, largest", "push", _worst("push: stiffness"), 600.0, "N/m"),
    Row("28 +- 2 N: true hand speed, worst", "push", _worst("push: speed"), 0.25, "m/s"),
    Row("28 +- 2 N: from its place 2 s later, worst", "push", _worst("push: back"), 5.0, "mm", 1e3),
    Row("28 +- 2 N: changes of status, worst", "push", _worst("push: changes"), 4.0, ""),
)  # fmt: skip


def done(name: str, numbers: Sequence[int], seed: int, ideal: bool) -> list[Done]:
    """Tasks of one kind, by their numbers."""
    kept: dict[Any, Any] = {}
    found = []
    for number in numbers:
        setting = setting_of(number, name, seed=seed, ideal=ideal, kept=kept)
        found.append(Done(setting.cell, TASKS[name](setting)))
    return found


class Measured(NamedTuple):
    """A row with its numbers."""

    row: Row
    by_delay: dict[float, float]
    total: float
    tasks: int

    @property
    def verdict(self) -> str:
        """PASS or FAIL; nothing where nothing is asked. NaN fails."""
        row = self.row
        if row.at_least == -math.inf and row.at_most == math.inf:
            return ""
        if self.total == -math.inf:  # nobody whom it was asked of
            return ""
        return "PASS" if row.at_least <= self.total <= row.at_most else "FAIL"


def measured(done: Mapping[str, Sequence[Done]]) -> list[Measured]:
    """Every row whose task was done, with its number for each delay and over all."""
    found = []
    for row in ROWS:
        of = done.get(row.task, ())
        if not of:
            continue
        by_delay = {
            delay: row.scale * row.of([each.numbers for each in of if each.cell.delay == delay])
            for delay in sorted({each.cell.delay for each in of})
        }
        found.append(Measured(row, by_delay, row.scale * row.of([each.numbers for each in of]), len(of)))
    return found
