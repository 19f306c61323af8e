"""Help along a path that crosses itself: of the stretch where the hand is, whatever else lies near it.

Judged on paths of straight stretches that cross each other, turn back sharply, or lie side by side, walked to and fro
by hands that nothing can hold. The progress never goes back. s moves to the place nearest to the hand within two widths
along the path, and by the speed cap at most; far from the hand it stands. The force pulls across the stretch at s, and
damps across it alone. A hand that stands under force is let go, s stands, and the nearest place along the path takes it
in again. At the path's end the force ends.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import shapely

from rehab_opt import PathAssistance, Workspace
from tests.judge.force_bounds import judge as judge_bounds
from tests.judge.force_runs import Run, Settings
from tests.judge.numbering import Runs, judging, run_length
from tests.judge.references import tremor
from tests.judge.sensor_faults import schedule
from tests.judge.verdict import Verdict

GUARANTEES = ("G23",)
LEAST = {
    "near another branch": 1696,
    "standing": 20_000,
    "on a straight stretch": 28_000,
    "let go": 10_000,
    "taken in again": 10,
    "after the end": 1000,
}
CI_TICKS = 6000
SHAPES = ("cross", "hairpin", "meander")


def corners(rng: np.random.Generator, shape: str, width: float) -> np.ndarray:
    """(k, 2) a path that comes near itself."""
    size = rng.uniform(0.15, 0.3)
    if shape == "cross":
        found = size * np.array([[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]])
    elif shape == "hairpin":  # there and back, side by side
        found = np.array([[0.0, 0.0], [size, 0.0], [size, 2.5 * width], [0.0, 2.5 * width]])
    else:
        found = np.array([[(k + 1) // 2 % 2 * size, k // 2 * 4 * width] for k in range(6)])
    return np.asarray(found @ _turned(rng))


def _turned(rng: np.random.Generator) -> np.ndarray:
    """(2, 2) a rotation."""
    angle = rng.uniform(0, 2 * math.pi)
    return np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])


def one_run(verdict: Verdict, number: int, rng: np.random.Generator) -> None:
    """One path, one hand."""
    shape, width = SHAPES[number % len(SHAPES)], float(rng.choice([0.005, 0.01, 0.02]))
    knots, dt = corners(rng, shape, width), float(rng.choice([2e-3, 5e-3, 1e-2]))
    stiffness, damping, slew = float(rng.choice([500.0, 3000.0])), float(rng.choice([0.0, 40.0])), 1000.0
    growth = (1e5, 200.0)[number % 2]
    comfortable = Workspace(shapely.box(-2, -2, 2, 2), accuracy=0.0)
    force = PathAssistance(knots, stiffness=stiffness, width=width, damping=damping, comfortable=comfortable,
                           slew_limit=slew, growth_limit=growth, energy_budget=1e3, dt=dt, trust_stillness=True,
                           compile=False)  # fmt: skip
    verdict.begin(number, f"{shape}, width {width:g}, dt {dt:g}")
    ticks = max(run_length(rng, number, dt), 600 if number % 4 < 2 else round(5.0 / dt))
    lengths = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(knots, axis=0), axis=1))]
    along, aside = strolled(rng, ticks, dt, lengths[-1], reach=30.0 / stiffness)
    if number % 4 < 2:  # from the start to the end, with rests, as fast as a hand
        pieces = ticks // 100 + 1
        pace = np.repeat(rng.uniform(0.0, 0.5, size=pieces) * rng.choice([0.0, 1.0], size=pieces), 100)
        along, aside = np.minimum(np.r_[0.0, np.cumsum(pace[:ticks] * dt)], lengths[-1]), np.zeros(ticks + 1)
    x = _at(knots, lengths, along) + aside[:, None] * _turned(rng)[0]
    x += tremor(rng, ticks + 1, dt, size=float(rng.choice([0.0, 0.3])) * width, axes=2)
    step = np.linalg.norm(np.diff(x, axis=0), axis=1)
    commands, progress, wanted = [], np.empty((ticks + 1, 2)), np.empty((ticks, 2))
    told = np.vstack([np.zeros(2), np.diff(x[:-1], axis=0) / dt])
    progress[0] = force.progress, force.reference_progress
    for k in range(ticks):
        commands.append(force.step(x[k], told[k]))
        progress[k + 1], wanted[k] = (force.progress, force.reference_progress), force.desired_force
    given = Settings(dt, "follow", 30.0, slew, growth, 1000.0, 1.0, stiffness, damping, 500.0, 10.0, knots, 0.003)
    none = schedule(rng, ticks, dt, ("",), every=math.inf)
    judge_bounds(verdict, Run(given, shape, x, x[:-1], np.full(ticks, dt), commands, wanted, np.full(ticks, 1000.0),
                              none, told, step > dt))  # fmt: skip

    at, led = (progress * lengths[-1]).T
    away = np.zeros(ticks, dtype=bool)
    for k, each in enumerate(commands):  # a tick whose hand cannot be used changes nothing
        away[k] = "stood under force" in each.reason or (each.status.value != "ok" and away[k - 1])
    sizes = np.array([np.linalg.norm(each.value) for each in commands])
    judge_progress(verdict, knots, at, led, x[:-1], sizes, wanted, away, width=width, reach=30.0 / stiffness,
                   cap=force.speed_cap, dt=dt)  # fmt: skip
    # What is wanted in a tick is of the s before it.
    piece = np.clip(np.searchsorted(lengths, led[:-1], side="right") - 1, 0, len(knots) - 2)
    ways = np.diff(knots, axis=0)
    ways = ways / np.linalg.norm(ways, axis=1)[:, None]
    normal = np.column_stack([-ways[:, 1], ways[:, 0]])[piece]
    offset = np.einsum("ni,ni->n", x[:-1] - knots[piece], normal)
    speed = np.einsum("ni,ni->n", told, normal)
    straight = np.minimum(led[:-1] - lengths[piece], lengths[piece + 1] - led[:-1]) > width
    free = np.array([each.status.value == "ok" and each.scale > 0.0 for each in commands]) & straight
    # The force of a hand that comes back grows, in ticks whose hand can be used.
    used = np.cumsum([each.status.value in ("ok", "blocked") for each in commands])
    free &= used - np.maximum.accumulate(np.where(away, used, -ticks)) > round(0.3 / dt) + 1
    free &= np.linalg.norm(x[:-1] - _at(knots, lengths, led[:-1]), axis=1) < 0.9 * 30.0 / stiffness
    across = np.einsum("ni,ni->n", wanted, normal)
    pull = -stiffness * offset - damping * speed
    verdict.within(
        "pull across the stretch: error [N]", np.where(free, np.abs(across - pull), 0.0), 1e-3 * stiffness * width
    )
    apart = [np.linalg.norm(x[:-1] - _nearest(knots[i], knots[i + 1], x[:-1]), axis=1) for i in range(len(knots) - 1)]
    others = np.where(np.arange(len(knots) - 1)[:, None] == piece, np.inf, np.array(apart)).min(axis=0)
    verdict.during("near another branch", free & (others < 3 * width), dt)
    verdict.during("standing", np.diff(along) < 1e-9, dt)
    verdict.during("on a straight stretch", free, dt)


def strolled(
    rng: np.random.Generator, ticks: int, dt: float, length: float, *, reach: float
) -> tuple[np.ndarray, np.ndarray]:
    """(ticks + 1,) [m] where a hand is along the path, to and fro with rests, and how far aside.

    In half of its rests and ways it is aside by up to 1.2 of what the spring stretches at the force limit.
    """
    along, goal, at = [np.zeros(1)], [np.zeros(1)], 0.0
    while sum(map(len, along)) <= ticks:
        to = float(np.clip(at + rng.uniform(-0.2, 0.4) * length, 0.0, length))
        way = np.linspace(at, to, 1 + math.ceil(abs(to - at) / (rng.uniform(0.1, 0.5) * dt)))
        rest = np.full(round(float(rng.choice([0.3, 1.2, 2.2])) / dt), to)
        for part in (way, rest):
            along.append(part)
            goal.append(np.full(len(part), rng.choice([0.0, 1.0]) * rng.uniform(0.2, 1.2) * reach))
        at = to
    aside, goals = np.zeros(ticks + 1), np.concatenate(goal)
    for k in range(ticks):
        aside[k + 1] = aside[k] + np.clip(goals[k] - aside[k], -0.2 * dt, 0.2 * dt)
    return np.concatenate(along)[: ticks + 1], aside


def judge_progress(
    verdict: Verdict, knots: np.ndarray, at: np.ndarray, led: np.ndarray, x: np.ndarray, sizes: np.ndarray,
    wanted: np.ndarray, away: np.ndarray, *, width: float, reach: float, cap: float, dt: float,
) -> None:  # fmt: skip
    """The progress `at` and s `led` (n + 1,) [m] before and after each tick of a hand at x (n, 2) [m].

    `sizes` (n,) [N] of the forces, `wanted` (n, 2) [N]; `away` (n,): the hand is let go; `reach` [m] is how far the
    spring stretches at the force limit.
    """
    lengths = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(knots, axis=0), axis=1))]
    before, after, gone = led[:-1], led[1:], np.r_[away[1:], away[-1]]
    moved, place = np.abs(after - before), _at(knots, lengths, before)
    verdict.holds("the progress never goes back", np.diff(at) >= -1e-12)
    verdict.holds("s is never beyond the progress", at - led >= -1e-9)

    # s follows the hand.
    held, off = ~away & ~gone, np.linalg.norm(x - place, axis=1)
    follows = np.where(held & (after < lengths[-1] - 1e-12), moved, 0.0)  # within a sample of the end s goes there
    verdict.within("s of a held hand moves [cap dt]", follows / (cap * dt), 1.0 + 1e-6)
    far = off > reach + 1.3 * width
    verdict.holds("s stands while the hand is far from it", ~(held & far) | (moved < 1e-12))
    ended = held & (after >= lengths[-1] - 1e-12) & (np.linalg.norm(x - knots[-1], axis=1) < width)
    ended, new = np.maximum.accumulate(ended), np.r_[False, away[:-1]]  # p(s) of a hand taken in: from the next tick on
    free = held & ~new & ~ended & (off < reach + 0.9 * width)
    low = np.maximum(before - 2 * width, 0.0), np.minimum(before + 2 * width, lengths[-1])
    nearest, goal = np.full(len(x), np.inf), before
    for i, (a, b) in enumerate(pairwise(knots)):
        size = lengths[i + 1] - lengths[i]
        ends = [np.clip((each - lengths[i]) / size, 0.0, 1.0) for each in low]
        meets = (low[0] <= lengths[i + 1]) & (low[1] >= lengths[i])
        fraction = np.clip((x - a) @ (b - a) / size**2, *ends)
        apart = np.linalg.norm(x - a - fraction[:, None] * (b - a), axis=1)
        better = meets & (apart < nearest)
        nearest, goal = np.where(better, apart, nearest), np.where(better, lengths[i] + fraction * size, goal)
    free &= (moved < 0.99 * cap * dt) | (np.abs(after - goal) > np.abs(before - goal))  # else s is on its way there
    beyond = (np.linalg.norm(x - _at(knots, lengths, after), axis=1) - nearest) / width
    verdict.within("s is further from the hand than the nearest place [widths]", np.where(free, beyond, 0.0), 0.3)

    # The end of the help.
    since = np.cumsum(ended)
    verdict.holds(
        "no force after the end of the path", ~(since > round(0.5 / dt)) | (np.abs(wanted).max(axis=1) == 0.0)
    )
    verdict.during("after the end", since > round(0.5 / dt), dt)

    # A hand that stands is let go, and held again.
    long, stands = round(1.1 / dt), np.zeros(len(x), dtype=bool)
    if len(x) > long:
        view = np.lib.stride_tricks.sliding_window_view
        pulled = (view(sizes, long) > 0.16 * 30.0).all(axis=1)
        stands[long - 1 :] = pulled & (np.ptp(view(before, long), axis=1) < width)
    verdict.holds("a hand that stands under force is let go", ~stands | away)
    verdict.holds("s of a hand that was let go stands", (~(away & gone) | (moved < 1e-12))[:-1])
    taken_in, reaches = np.flatnonzero(away & ~gone), np.arange(1.0, 20.0, 0.05) * width
    for k in taken_in:
        apart = np.minimum(*(_off(knots, lengths, before[k] + way * reaches, x[k]) for way in (-1, 1)))
        least = reaches[apart < 0.8 * width]
        verdict.holds("the nearest place takes a hand in", moved[k] <= min(least, default=20 * width) + 0.3 * width)
    back = np.linalg.norm(_at(knots, lengths, after[taken_in]) - x[taken_in], axis=1) / width
    verdict.within("a hand that is taken in, away from its place [widths]", back, 1.3)
    verdict.holds("a hand that is where it was let go is not taken in", off[taken_in] > 0.98 * width)
    let_go = np.arange(len(x)) - np.maximum.accumulate(np.where(away, -1, np.arange(len(x))))
    waits = away & (let_go > round(0.3 / dt) + 2) & (off > 1.3 * width)
    for k in np.flatnonzero(waits & gone)[:: round(0.05 / dt)]:
        apart = np.minimum(*(_off(knots, lengths, before[k] + way * reaches[10:-10], x[k]) for way in (-1, 1)))
        verdict.holds("a place of the path takes a hand in at once", apart.min() > 0.6 * width)
    verdict.during("let go", away, dt)
    verdict.during("taken in again", away & ~gone, dt)


def _off(knots: np.ndarray, lengths: np.ndarray, along: np.ndarray, hand: np.ndarray) -> np.ndarray:
    """[m] from the hand to places of the path; infinite beyond its ends."""
    off = np.linalg.norm(_at(knots, lengths, along) - hand, axis=1)
    return np.where((along >= 0.0) & (along <= lengths[-1]), off, np.inf)


def _at(knots: np.ndarray, lengths: np.ndarray, along: np.ndarray) -> np.ndarray:
    return np.column_stack([np.interp(along, lengths, knots[:, i]) for i in (0, 1)])


def _nearest(a: np.ndarray, b: np.ndarray, x: np.ndarray) -> np.ndarray:
    fraction = np.clip((x - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
    return np.asarray(a + fraction[:, None] * (b - a))


run = judging(__name__, LEAST, Runs(one_run))
