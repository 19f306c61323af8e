"""Under a stick held still the arm's joints are not shaken, also where bounds are met.

A joint is shaken in a tick where it turns from speeding up to slowing down, or back, both by a twentieth of its largest
acceleration or more. Short commands, since what meets bounds does so soon, and then rests.
"""

from __future__ import annotations

import numpy as np

from tests.judge.chair_claims import judge_ticks
from tests.judge.chair_moved import PLACES
from tests.judge.chair_runs import SETS, Part, Run, command, held, posture, record, resolver
from tests.judge.verdict import Promise, Verdict

PROMISES = (Promise("rehab_opt/control/chair_and_arm.py", "in between, between them: light joints stay calm."),)
LEAST = {"solver active set": 200_000}
CI_TICKS = 4800
SHARE = 0.5
DT = 0.01
SHAKE, OFTEN = 0.05, 4
"""Of the largest acceleration; ticks of a run from which on it is a shaken one."""
RATE, SPARE = 0.1, 3.0
"""Of all runs, and besides, as many may be: in a few postures what is best turns with the bounds from tick to tick."""
RUN = 3.0
"""[s]"""


def run(ticks: int, seed: int, *, only: int | None = None) -> Verdict:
    """Short runs until so many ticks are judged."""
    verdict = Verdict("chair_calm", seed, LEAST)
    number, shaken = 0 if only is None else only, 0
    while verdict.ticks < ticks:
        shaken += one_run(verdict, number, np.random.default_rng([seed, number]))
        number += 1
        if only is not None:
            break
    verdict.within("runs in which the arm is shaken", shaken, RATE * verdict.runs + SPARE)
    return verdict


def one_run(verdict: Verdict, number: int, rng: np.random.Generator) -> bool:
    """Whether the arm is shaken in a run."""
    rows = SETS[number % 5 % 2]
    chair, made = resolver(("differential", "mecanum")[number // 2 % 2], SETS, DT, PLACES)
    q = posture(chair, rng, ready=0.5)
    parts = [Part(rows, "chassis", held(command(rng, rows, 0.05, 0.3), RUN, DT), obstacles=())]
    recorded = record(made, Run(chair, DT, np.zeros(7), parts, arcs=False), q)
    verdict.begin(number, f"{chair.drive} {rows} {np.round(parts[0].twist[0], 4)}")
    _, u = judge_ticks(recorded, verdict)
    share = np.diff(u[:, 3:], axis=0) / (chair.acceleration[3:] * DT)
    turns = (share[1:] * share[:-1] < 0) & (np.minimum(np.abs(share[1:]), np.abs(share[:-1])) > SHAKE)
    verdict.during("an arm joint shaken", turns.any(axis=1), DT)
    return int(turns.any(axis=1).sum()) > OFTEN
