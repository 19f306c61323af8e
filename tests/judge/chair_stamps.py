"""Stale, repeated, reversed and missing states are not acted on, and all others are.

Each bad stamp stands alone between good ones with jitter, so that exactly its tick gives the safe command. At the end
of a run the stamps fall behind the ticks, by a hundredth of each or by more, and the state is refused once they are
`MAX_AGE` behind, less `DRIFT` a second, and not long before. Rows change at good stamps, at bad ones, and meanwhile.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from tests.judge.chair_claims import judge_ticks
from tests.judge.chair_moved import PLACES
from tests.judge.chair_runs import READY, SETS, Part, Run, command, record, resolver
from tests.judge.verdict import Verdict

GUARANTEES = ("G05",)
KINDS = ("repeated", "reversed", "restarted", "nan", "inf", "missing", "after a gap")
LEAST = {f"a stamp {each}": 500.0 for each in KINDS} | {
    "stamps behind": 1e4,
    "stamps fell behind slowly": 50,
    "moving at a bad stamp": 1e3,
    "rows switched at a bad stamp": 1e3,
    "rows switched at a good stamp": 1e3,
}
CI_TICKS = 4_000
SHARE = 0.2
DT, MAX_AGE = 0.01, 0.05
DRIFT, SLOWLY = 1e-3, 0.1
"""Of a tick: what stamps may fall behind for ever; what is slow to fall behind."""


def run(ticks: int, seed: int, *, only: int | None = None) -> Verdict:
    """Runs of a thousand ticks."""
    verdict = Verdict("chair_stamps", seed, LEAST)
    number = 0 if only is None else only
    while verdict.ticks < ticks:
        one_run(verdict, number, np.random.default_rng([seed, number]))
        number += 1
        if only is not None:
            break
    return verdict


def one_run(verdict: Verdict, number: int, rng: np.random.Generator) -> None:
    """A stick that turns slowly, with a bad stamp each thirty ticks; then stamps that fall behind; rows change."""
    chair, made = resolver(("differential", "mecanum")[number % 2], SETS, DT, PLACES)
    loss = float(np.exp(rng.uniform(math.log(0.01), math.log(0.9))))
    n, behind = 900, math.ceil((MAX_AGE + 3 * DT) / (loss - DRIFT) / DT)
    time = np.arange(n) * DT
    clock = float(rng.choice([0.0, 1.7e9, -5.0])) + time + rng.uniform(-0.2, 0.2, n) * DT
    stamps: list[float | None] = list(clock)
    bad = np.zeros(n, dtype=bool)
    for k in range(30, n, 30):
        bad[k] = True
        kind = str(rng.choice(KINDS))
        if kind in ("restarted", "after a gap"):
            jump = -10.0 if kind == "restarted" else rng.uniform(0.1, 10.0)
            stamps[k:] = [float(each) + jump for each in stamps[k:] if each is not None]
        else:
            one = {"repeated": stamps[k - 1], "reversed": float(stamps[k - 1] or 0.0) - 1.5 * DT}
            stamps[k] = (one | {"nan": math.nan, "inf": math.inf, "missing": None})[kind]
        verdict.during(f"a stamp {kind}", np.array([True]), DT)
    last = float(stamps[-1] or 0.0)
    stamps += [last + (1 - loss) * DT * (i + 1) for i in range(behind)]
    switches = {0, n, *np.flatnonzero(bad & (rng.random(n) < 0.5)).tolist(), *rng.integers(1, n + behind, 8).tolist()}
    parts: list[Part] = []
    rows = SETS[0]
    for begin, end in pairwise([*sorted(switches), n + behind]):
        rows = SETS[(SETS.index(rows) + int(rng.integers(1, len(SETS)))) % len(SETS)]
        turn = DT * np.arange(begin, end)[:, None]
        twist = np.cos(turn) * command(rng, rows) + np.sin(turn) * command(rng, rows)
        parts.append(Part(rows, "chassis", twist, obstacles=(), stamps=stamps[begin:end]))
    recorded = record(made, Run(chair, DT, np.zeros(7), parts, arcs=False), READY.copy())
    verdict.begin(number, f"{chair.drive}, {loss:.3g} of a tick behind")
    found, u = judge_ticks(recorded, verdict)
    certified = np.isin(found.status, ("ok", "backup", "blocked"))
    verdict.holds("a bad stamp gives the safe command", ~bad | ~certified[:n])
    verdict.holds("a good stamp is acted on", bad | certified[:n])
    verdict.during("moving at a bad stamp", bad & np.any(u[:n], axis=1), DT)
    switched = np.isin(np.arange(n), list(switches - {0}))
    verdict.during("rows switched at a bad stamp", switched & bad, DT)
    verdict.during("rows switched at a good stamp", switched & ~bad, DT)
    lag = np.arange(1, behind + 1) * (loss - DRIFT) * DT
    verdict.holds("a state too old is not acted on", (lag < MAX_AGE + 1.5 * DT) | ~certified[n:])
    verdict.holds("a state of some age is acted on", (lag > MAX_AGE - 1.5 * DT) | certified[n:])
    verdict.during("stamps behind", lag > MAX_AGE, DT)
    verdict.during("stamps fell behind slowly", (lag > MAX_AGE + 1.5 * DT) & (loss < SLOWLY), DT)
