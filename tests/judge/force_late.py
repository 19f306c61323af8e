"""Forces that act later than they are commanded: what they deliver stays within the budget all the same.

Judged by the work of the force that acts, delayed and lagged by the judge, on hands that go with it, that oppose it for
a while to be paid back, that go their own way, and that draw what no force sent of late would give, and then all the
rest; positions are told late where that is part of the delay, and not at all while the sensor is frozen.
"""

from __future__ import annotations

import math

import numpy as np

from rehab_opt import BoundedForce
from tests.judge.force_runs import hand_path
from tests.judge.numbering import Runs, judging, run_length
from tests.judge.verdict import Verdict

GUARANTEES = ("G22",)
LEAST = {"half of the budget drawn": 20_000, "the acting force is another": 20_000, "hand greedy": 20_000,
         "hand shuttle": 20_000, "hand sly": 20_000, "hand hidden": 20_000, "told late": 20_000,
         "later than said": 20_000, "lags more": 20_000, "frozen": 20_000}  # fmt: skip
CI_TICKS = 3000
SHARE = 0.3
HANDS = ("greedy", "shuttle", "person", "sly", "hidden")
WAYS = np.stack([np.cos(np.linspace(0, 2 * math.pi, 17)[1:]), np.sin(np.linspace(0, 2 * math.pi, 17)[1:])])


def one_run(verdict: Verdict, number: int, rng: np.random.Generator) -> None:
    """One hand, one force that turns and changes its size."""
    hand = HANDS[number % len(HANDS)]
    sly = hand == "sly"  # who finds most where little time and a coarse count hide it
    dt = float(rng.choice([1e-3, 1e-3 if sly else 2e-3, 1e-3 if sly else 5e-3]))
    waits, told = (int(rng.integers(0, 1 + (0.006 if sly else most) // dt)) for most in (0.03, 0.02))
    lag, budget = (
        float(rng.choice([0.003 if sly else 0.0, 0.003, 0.005, 0.005 if sly else 0.02])),
        float(rng.choice([0.3, 1.0, 5.0])),
    )
    wanted, turning, swing = rng.uniform(5.0, 40.0), rng.uniform(-20.0, 20.0), rng.uniform(1.0, 30.0)
    late = (waits + told) * dt
    more = float(rng.choice([0.0, 0.003, 0.006]))
    said, lag_said = (max(true - float(rng.choice([0.0, more])), 0.0) for true in (late, lag))
    ticks = 3000 if sly else min(run_length(rng, number, dt), 4000)
    clock, frozen, every = [0.0], hand == "hidden" or (number // 5 % 2 == 1 and not sly), np.arange(ticks)
    half = max(round(rng.uniform(0.5, 4.0) * max(late + 5.0 * lag, 5 * dt) / dt), 1)
    first = (every // half % 2 == 0) | (every > ticks // 2)  # half a period, and all that comes in the second half
    seen = first if hand == "hidden" else _seen(rng, frozen, ticks)
    shown = np.maximum.accumulate(np.where(seen, every, 0))

    def asked(_x: float, _y: float, _vx: float, _vy: float) -> tuple[float, float]:
        if sly or hand == "hidden":
            return wanted * (1.0 if first[round(clock[0] / dt)] else -1.0 if sly else 0.0), 0.0
        size = wanted * (0.5 + 0.5 * math.sin(swing * clock[0]))
        return size * math.cos(turning * clock[0]), size * math.sin(turning * clock[0])

    control = BoundedForce(
        asked, force_limit=30.0, slew_limit=float(rng.choice([200.0, 1000.0])), energy_budget=budget, speed_cap=1.0,
        actuation_delay=said, actuation_lag=lag_said, actuation_uncertainty=more, dt=dt,
        trust_stillness=not frozen, compile=False,
    )  # fmt: skip
    verdict.begin(number, f"{hand}, {waits} and {told} ticks late, lag {lag:g}, {more:g} s unsure, dt {dt:g}")
    path, most, back = hand_path(rng, hand, ticks, dt), 0.99 * dt, waits + round(rng.choice([0.0, 0.0, 5.0]) * lag / dt)
    x, sent, acts, commands = np.repeat(path[:1], ticks + 1, axis=0), np.zeros((ticks, 2)), np.zeros((ticks, 2)), []
    follows, force = 1.0 if lag == 0.0 else 1.0 - math.exp(-dt / lag), np.zeros(2)
    for k in range(ticks):
        clock[0] = k * dt
        commands.append(control.step(x[max(shown[k] - told, 0)]))
        sent[k] = commands[-1].value
        arrived = sent[k - waits] if k >= waits else np.zeros(2)
        force = force + follows * (arrived - force)
        acts[k] = force
        size, way = math.hypot(*force), path[k + 1] - x[k]
        if sly and k <= ticks // 2:
            gain = np.minimum(force @ WAYS, force @ WAYS - (sent[max(k - back, 0) : k + 1] @ WAYS).max(axis=0))
            way = WAYS[:, gain.argmax()] * (most if gain.max() > 0.0 else 0.01 * most * rng.random())
        elif hand in ("greedy", "sly", "hidden") and size > 0.1:
            way = force * (most / size)
        elif hand == "shuttle" and size > 0.1:
            way = force * (most / size) * (1.0 if k * dt % 0.3 < 0.2 else -1.0)
        length = math.hypot(*way)
        x[k + 1] = x[k] + way * min(1.0, most / length) if length > 0 else x[k]
    verdict.answers(commands, dt)
    total = np.cumsum(np.einsum("ni,ni->n", acts, np.diff(x, axis=0)))
    taken = total - np.minimum(np.minimum.accumulate(total), 0.0)
    verdict.within("energy drawn from the acting force over the budget", taken.max() / budget, 1 + 1e-9)
    verdict.during("half of the budget drawn", taken > 0.5 * budget, dt)
    verdict.during("the acting force is another", np.linalg.norm(acts - sent, axis=1) > 0.1, dt)
    verdict.during("told late", np.full(ticks, told > 0), dt)
    verdict.during("later than said", np.full(ticks, late > said + 1e-6), dt)
    verdict.during("frozen", shown[:ticks] < np.arange(ticks), dt)
    verdict.during("lags more", np.full(ticks, lag > lag_said + 1e-6), dt)
    verdict.during(f"hand {hand}", np.ones(ticks, dtype=bool), dt)


def _seen(rng: np.random.Generator, frozen: bool, ticks: int) -> np.ndarray:
    """(ticks,) whether the sensor says where the hand is: a frozen one waits for a while, again and again."""
    waits = rng.integers(1, rng.choice([4, 60], 2), (ticks, 2)).ravel()
    seen = np.repeat(np.arange(len(waits)) % 2 == 0, waits)[:ticks]
    return seen if frozen else np.ones(ticks, dtype=bool)


run = judging(__name__, LEAST, Runs(one_run))
