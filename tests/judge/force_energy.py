"""The energy that an assisting force delivers, whatever the hand does below the speed cap.

Judged by the work of the force that was sent on the true way of the hand: no stretch of a run, from any tick to any
later one, delivers more than the budget, also where ticks come late; with missed samples, frozen and broken sensors no
more since the beginning, net of what the hand put in. A hand that jumps may draw the force limit times its jumps more.
And the energy that is told to be left is never more than there is, nor less where every step of the hand was seen and
forces are known to act at once. A frozen sensor that twitches before it goes on hides nothing: what its twitch gave
back goes by the jump behind it.
"""

from __future__ import annotations

import itertools
import math

import numpy as np

from rehab_opt import BoundedForce
from tests.judge.force_runs import Run, followed
from tests.judge.numbering import Runs, judging
from tests.judge.verdict import Verdict

GUARANTEES = ("G22",)
LEAST = {"hand greedy": 17_000, "hand shuttle": 32_000, "nine tenths of the budget drawn": 53,
         "the tank holds the force back": 5000, "ticks that come late": 3000, "hand fast": 14_000,
         "energy put in by the hand": 20_000, "the sensor is frozen, the hand moves": 53,
         "energy put in, every step seen": 2000, "a sensor that twitches": 20_000}  # fmt: skip
CI_TICKS = 24_000
SHARE = 1.5


def drawn(work: np.ndarray) -> np.ndarray:
    """(N + 1,) [J] the most that was delivered in a stretch that ends before each tick."""
    total = np.concatenate([[0.0], np.cumsum(work)])
    return np.asarray(total - np.minimum.accumulate(total))


def judge(verdict: Verdict, one: Run) -> None:
    """Work of the force, from every tick to every later one."""
    given = one.settings
    answers = verdict.answers(one.commands, one.seconds)
    moved = np.diff(one.x, axis=0)
    work = np.einsum("ni,ni->n", answers.value, moved)
    taken = drawn(work)
    if one.fast.any():
        jumps = given.force_limit * float(np.linalg.norm(moved[one.fast], axis=1).sum())
        verdict.within("energy drawn by a hand that jumps, over budget and jumps", taken.max() / (given.budget + jumps),
                       1 + 1e-9)  # fmt: skip
    elif (one.faults.kind == "").all():
        verdict.within("energy drawn over the budget", taken.max() / given.budget, 1 + 1e-9)
        verdict.within("energy told to be left beyond what is [J]", one.left - (given.budget - taken[:-1]), 1e-9)
        seen = ~np.logical_or.accumulate(np.r_[False, (np.diff(one.shown, axis=0) == 0).all(axis=1)])
        seen &= given.unsure == 0.0
        lost = np.where(seen, given.budget - taken[:-1] - one.left, 0.0)
        verdict.within("energy told to be left below what is, every step seen [J]", lost, 1e-9)
        verdict.during("energy put in, every step seen", seen & (work < 0) & (taken[:-1] > 0), one.seconds)
    else:  # what a hand puts in unseen counts against what it draws unseen
        total = np.cumsum(work)
        verdict.within("energy drawn over the budget, in all", total.max() / given.budget, 1 + 1e-9)
        left = given.budget - np.r_[0.0, total[:-1]]
        verdict.within("energy told to be left beyond what is in all [J]", one.left - left, 1e-9)
    verdict.within("energy told to be left over the budget", one.left / given.budget, 1 + 1e-12)
    size, need = np.linalg.norm(answers.value, axis=1), np.linalg.norm(one.desired_force, axis=1)
    tight = (size < 0.9 * np.minimum(need, given.force_limit)) & (one.left < 0.3 * given.budget)
    verdict.during("the tank holds the force back", tight, one.seconds)
    verdict.during("nine tenths of the budget drawn", taken[1:] > 0.9 * given.budget, one.seconds)
    verdict.during("ticks that come late", one.seconds > 1.5 * given.dt, one.seconds)
    verdict.during("energy put in by the hand", work < 0, one.seconds)
    blind = (one.faults.kind == "frozen") & (size > 0) & moved.any(axis=1)
    verdict.during("the sensor is frozen, the hand moves", blind, one.seconds)
    verdict.during(f"hand {one.hand}", np.ones(len(work), dtype=bool), one.seconds)


def twitching(verdict: Verdict, number: int, rng: np.random.Generator) -> None:
    """A hand that goes with the force, and a sensor that freezes, moves by a hundredth of a mm, and then tells all."""
    dt, budget = float(rng.choice([1e-3, 2e-3, 5e-3])), float(rng.choice([0.5, 1.0, 2.0]))
    size, turning, drift = rng.uniform(5.0, 25.0), rng.uniform(-2.0, 2.0), 0.1 * dt * rng.uniform(-1, 1, 2)
    clock = [0.0]

    def asked(_x: float, _y: float, _vx: float, _vy: float) -> tuple[float, float]:
        return size * math.cos(turning * clock[0]), size * math.sin(turning * clock[0])

    control = BoundedForce(
        asked, force_limit=30.0, slew_limit=float(rng.choice([200.0, 1000.0])), energy_budget=budget, speed_cap=1.0,
        dt=dt, compile=False,
    )  # fmt: skip
    verdict.begin(number, f"a sensor that twitches, dt {dt:g}, {budget:g} J")
    ticks = min(1000, round(3.0 / dt))
    x, shown, commands, twitches = np.zeros((ticks + 1, 2)), np.zeros(2), [], np.zeros(ticks, dtype=bool)
    states = itertools.cycle(("seen", "frozen", "twitch"))
    state, until = next(states), int(rng.integers(5, 40))
    for k in range(ticks):
        clock[0] = k * dt
        if k == until:
            state = next(states)
            lasts = {"seen": rng.integers(5, 40), "frozen": max(20, rng.uniform(0.03, 0.2) // dt), "twitch": 1}
            until = k + int(lasts[state])
        shown = {"seen": x[k], "frozen": shown, "twitch": shown + rng.uniform(-1e-5, 1e-5, 2)}[state]
        twitches[k] = state == "twitch"
        commands.append(control.step(shown))
        force = commands[-1].value
        strength = math.hypot(*force)
        x[k + 1] = x[k] + (force * (0.99 * dt / strength) if strength > 0.1 else drift)
    answers = verdict.answers(commands, dt)
    total = np.cumsum(np.einsum("ni,ni->n", answers.value, np.diff(x, axis=0)))
    verdict.within("energy drawn over the budget, behind a sensor that twitches", total.max() / budget, 1 + 1e-9)
    verdict.during("a sensor that twitches", np.logical_or.accumulate(twitches), dt)


run = judging(
    __name__,
    LEAST,
    Runs(followed(judge), 1 / 3),
    Runs(followed(judge, late=True), 1 / 3, 1_000_000),
    Runs(followed(judge, faults=0.3), 1 / 6, 2_000_000),
    Runs(followed(judge, faults=0.3, slips=True), 1 / 6, 3_000_000),
    Runs(twitching, 1 / 8, 3_000_000),
)
