"""Under a stick held still the arm's joints are not shaken, also where bounds are met.

A joint is shaken in a tick where it turns from speeding up to slowing down, or back, both by a twentieth of its largest
acceleration or more. Short commands, since what meets bounds does so soon, and then rests: longer ones of an arm on a
chair that stands, which can do no more in the end, look at that, and at an arm that swings for good.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from rehab_opt import RedundancyResolver
from tests.judge.chair_claims import judge_ticks
from tests.judge.chair_moved import PLACES
from tests.judge.chair_robot import Array, Chair
from tests.judge.chair_runs import SETS, Part, Run, command, held, posture, record, resolver
from tests.judge.numbering import Runs, judging
from tests.judge.verdict import Verdict

GUARANTEES = ("G12",)
LEAST = {"solver active set": 200_000, "an arm that can do no more": 5_000}
CI_TICKS = 9000
SHARE = 0.5
DT = 0.01
SHAKE, OFTEN = 0.05, 4
"""Of the largest acceleration; ticks of a run from which on it is a shaken one."""
STANDS = 0.2
"""[rad/s] Largest joint speed of an arm that can do no more."""
RATE, SPARE = 0.1, 3.0
"""Of all runs, and besides, as many may be: in a few postures what is best turns with the bounds from tick to tick."""
RUN = 3.0
"""[s]"""
STANDING, LONG, TICKS = 6, 10.0, (0.005, 0.01, 0.02)
"""One run in so many is of a chair that stands, for so long [s], at one of these ticks [s]."""
LATE, SWINGS, SLOW, SWUNG = 4.0, 4, 0.05, 0.01
"""[s] at the end of it in which a joint that turns back so often, each time faster than that [rad/s], is one that
swings; of such runs so many may be, and one."""


def one_run(verdict: Verdict, number: int, rng: np.random.Generator) -> None:
    """A stick that is held; one run in `STANDING` is of an arm on a chair that stands."""
    if number % STANDING == STANDING - 1:
        at_rest(verdict, number, rng)
        return
    rows = SETS[number % 5 % 2]
    chair, made = resolver(("differential", "mecanum")[number // 2 % 2], SETS, DT, PLACES)
    q = posture(chair, rng, ready=0.5)
    parts = [Part(rows, "chassis", held(command(rng, rows, 0.05, 0.3), RUN, DT), obstacles=())]
    recorded = record(made, Run(chair, DT, np.zeros(7), parts, arcs=False), q)
    verdict.begin(number, f"{chair.drive} {rows} {np.round(parts[0].twist[0], 4)}")
    _, u = judge_ticks(recorded, verdict)
    turns = shaken_ticks(chair, u, DT)
    verdict.during("an arm joint shaken", turns, DT)
    verdict.during("a run in which the arm is shaken", [turns.sum() > OFTEN], DT)


def at_rest(verdict: Verdict, number: int, rng: np.random.Generator) -> None:
    """An arm that is led to where it can no more: whether it swings there.

    Where for the last second the bounds leave nothing of the command, its joints move no faster than `STANDS`.
    """
    dt, rows = float(rng.choice(TICKS)), SETS[rng.integers(len(SETS))]
    chair, made = on_standing_chair(dt)
    q = posture(chair, rng, ready=0.5)
    parts = [Part(rows, "chassis", held(command(rng, rows, 0.05, 0.3), LONG, dt))]
    recorded = record(made, Run(chair, dt, np.zeros(7), parts, arcs=False), q)
    verdict.begin(number, f"fixed {rows} dt {dt:g} {np.round(parts[0].twist[0], 4)}")
    found, u = judge_ticks(recorded, verdict)
    last = slice(-round(1.0 / dt), None)
    if np.all(found.status[last] == "blocked"):
        speeds = np.abs(u[last, 3:])
        verdict.during("an arm that can do no more", np.ones(len(speeds), dtype=bool), dt)
        verdict.during("an arm that can do no more, shaken", shaken_ticks(chair, u[last], dt), dt)
        verdict.within("joint speed of an arm that can do no more [rad/s]", speeds, STANDS)
    swings = max(turned_back(speeds[np.abs(speeds) > SLOW]) for speeds in u[-round(LATE / dt) :, 3:].T) >= SWINGS
    verdict.during("a run on a chair that stands", [True], dt)
    verdict.during("a run on a chair that stands, in which the arm swings", [swings], dt)


def seldom_shaken(verdict: Verdict) -> None:
    """Of all runs."""
    shaken, standing = verdict.count("a run in which the arm is shaken"), verdict.count("a run on a chair that stands")
    swinging = verdict.count("a run on a chair that stands, in which the arm swings")
    verdict.within("runs in which the arm is shaken", shaken, RATE * verdict.runs + SPARE)
    verdict.within("runs in which an arm on a chair that stands swings", swinging, SWUNG * standing + 1)


def turned_back(speeds: Array) -> int:
    """How often one of these (n,) has another sign than the one before."""
    return int(np.count_nonzero(speeds[1:] * speeds[:-1] < 0))


@lru_cache(maxsize=len(TICKS))
def on_standing_chair(dt: float) -> tuple[Chair, RedundancyResolver]:
    """Not compiled: three more would take a minute."""
    chair = Chair("fixed")
    return chair, RedundancyResolver(chair.robot(), drive="fixed", row_sets=SETS, dt=dt, compile=False)


def shaken_ticks(chair: Chair, u: Array, dt: float) -> NDArray[np.bool_]:
    """(n - 2,) where a joint of the arm turns round; u (n, 7)."""
    fraction = np.diff(u[:, 3:], axis=0) / (chair.acceleration[3:] * dt)
    turns = (fraction[1:] * fraction[:-1] < 0) & (np.minimum(np.abs(fraction[1:]), np.abs(fraction[:-1])) > SHAKE)
    return np.asarray(turns.any(axis=1))


run = judging(__name__, LEAST, Runs(one_run), finish=(seldom_shaken,))
