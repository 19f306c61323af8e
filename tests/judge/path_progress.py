"""Help along a path that crosses itself: of the stretch where the hand is, in order, whatever else lies near it.

Judged on paths made of straight stretches that cross each other, turn back sharply, or lie side by side, closer than
the field is wide, walked by hands that nothing can hold: the progress never goes back; it is behind the length that the
hand has walked, and ahead of it on a straight stretch, by three widths and what a spring at the force limit may lead by
at most; round corners it passes no place that is more than one width further from the hand, and as far again as the
hand draws back by more than one and a half times what the spring stretches at the force limit. The place that leads is
that of the progress, or before it by six widths at most. Where a hand was let go both stand, until soon after the hand
has come to a place further on. From 0.3 s after that, the force that is wanted pulls across the stretch where the hand
is, not towards the other one, and damps across it alone. A hand that is not at the path moves nothing on.
"""

from __future__ import annotations

import math

import numpy as np
import shapely
import shapely.ops

from rehab_opt import PathAssistance, Workspace
from tests.judge.force_bounds import judge as judge_bounds
from tests.judge.force_runs import Run, Settings
from tests.judge.numbering import numbered, run_length
from tests.judge.references import tremor
from tests.judge.sensor_faults import schedule
from tests.judge.verdict import Verdict

GUARANTEES = ("G23",)
LEAST = {
    "near another branch": 1696,
    "standing": 20_000,
    "on a straight stretch": 28_000,
    "led on beyond a corner": 700,
}
CI_TICKS = 6000
TREMBLES = 200
"""Ticks of a run of a hand that is not at the path."""
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
    angle = rng.uniform(0, 2 * math.pi)
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    return np.asarray(found @ turn.T)


def run(ticks: int, seed: int, *, only: int | None = None) -> Verdict:
    """Hands that walk along such paths."""
    verdict = Verdict("path_progress", seed, LEAST)
    for number, rng in numbered(verdict, ticks, only):
        one_run(verdict, number, rng)
    for number, rng in numbered(verdict, ticks // 50, only, first=1_000_000):
        elsewhere(verdict, number, rng)
    return verdict


def elsewhere(verdict: Verdict, number: int, rng: np.random.Generator) -> None:
    """A hand that trembles at the centre of a path's circle, or far from it, which the spring's full force tears at."""
    width, dt = float(rng.choice([0.005, 0.01, 0.02])), float(rng.choice([2e-3, 5e-3, 1e-2]))
    near = 30.0 / 3000.0 + width
    angle = np.linspace(0.0, 2 * math.pi, 200)
    circle = near * rng.uniform(1.1, 4.0) * np.column_stack([np.cos(angle), np.sin(angle)])
    place = rng.choice([0.0, 1.0, 500.0]) * rng.uniform(-1.0, 1.0, 2)
    apart = shapely.distance(shapely.LineString(circle), shapely.Point(place))
    force = PathAssistance(circle, stiffness=3000.0, width=width, dt=dt, trust_stillness=True, compile=False,
                           comfortable=Workspace(shapely.box(-2, -2, 2, 2), accuracy=0.0))  # fmt: skip
    verdict.begin(number, f"elsewhere, width {width:g}, dt {dt:g}")
    x = place + tremor(rng, TREMBLES, dt, size=0.02 * width, axes=2)
    progress = np.empty((TREMBLES, 2))
    answers = []
    for k in range(TREMBLES):
        answers.append(force.step(x[k]))
        progress[k] = force.progress, force.reference_progress
    verdict.answers(answers, dt)
    off = np.full(TREMBLES, bool(apart > 1.05 * near))
    verdict.holds("a hand that is not at the path covers nothing of it", (progress == 0.0).all(axis=1) | ~off)
    verdict.during("not at the path", off, dt)


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
    if number % 4 < 2:  # from the start to the end, with rests, as fast as a hand
        pieces = ticks // 100 + 1
        pace = np.repeat(rng.uniform(0.0, 0.5, size=pieces) * rng.choice([0.0, 1.0], size=pieces), 100)
        walked = np.minimum(np.r_[0.0, np.cumsum(pace[:ticks] * dt)], lengths[-1])
        drawn = walked
    else:
        walked, drawn = insisting(rng, ticks, dt, lengths, reach=30.0 / stiffness, freely=6.0 * width)
    on = _at(knots, lengths, drawn)
    x = on + tremor(rng, ticks + 1, dt, size=float(rng.choice([0.0, 0.3])) * width, axes=2)
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
                              none, told, step > dt, force))  # fmt: skip

    at, led = (progress * lengths[-1]).T
    verdict.holds("the progress never goes back", np.diff(at) >= -1e-12)
    short = (at - led) / (6.0 * width)
    verdict.within("s short of the progress [6 widths]", short, 1.0 + 1e-9)
    verdict.holds("s is never beyond the progress", short >= -1e-9)
    verdict.during("s short of the progress", short > 0.1, dt)
    away = np.zeros(ticks, dtype=bool)
    for k, each in enumerate(commands):  # a tick whose hand cannot be used changes nothing
        away[k] = "stood under force" in each.reason or (each.status.value != "ok" and away[k - 1])
    judge_progress(verdict, knots, at, led, walked[:-1], drawn[:-1], x[:-1], away, width=width, reach=30.0 / stiffness,
                   dt=dt)  # fmt: skip
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
    verdict.during("standing", np.diff(walked) < 1e-9, dt)
    verdict.during("on a straight stretch", free, dt)


def insisting(
    rng: np.random.Generator, ticks: int, dt: float, lengths: np.ndarray, *, reach: float, freely: float
) -> tuple[np.ndarray, np.ndarray]:
    """(ticks + 1,) [m] the length walked, and where the hand is along the path, which draws back from there at times.

    It rests shortly before corners and before the middles of stretches, where paths cross, and draws back in half of
    its rests, by up to one and a half times what the spring stretches at the force limit, and in half of these by as
    much as s goes back besides.
    """
    marks = np.sort(np.r_[lengths[1:], (lengths[1:] + lengths[:-1]) / 2])
    walked, drawn, at = [np.zeros(1)], [np.zeros(1)], 0.0
    while sum(map(len, walked)) <= ticks:
        ahead = marks[marks > at + 1e-6]
        stop = float(rng.choice(ahead[:2])) - rng.uniform(0.0, 1.0) * min(reach, 0.02) if len(ahead) else at
        way = np.linspace(at, max(stop, at), 1 + math.ceil(max(stop - at, 0.0) / (rng.uniform(0.1, 0.5) * dt)))
        at = float(way[-1])
        rest = round(float(rng.choice([0.3, 1.0, 2.2])) / dt)
        slope = np.minimum(np.arange(rest), np.arange(rest)[::-1]) * dt
        back = rng.uniform(0.2, 1.5) * min(reach, at) * np.minimum(slope / 0.2, 1.0)
        back = rng.choice([0.0, 1.0]) * (back + rng.choice([0.0, freely]) * np.minimum(slope / 0.3, 1.0))
        walked += [way, np.full(rest, at)]
        drawn += [way, at - back]
    return np.concatenate(walked)[: ticks + 1], np.maximum(np.concatenate(drawn)[: ticks + 1], 0.0)


def judge_progress(
    verdict: Verdict,
    knots: np.ndarray,
    at: np.ndarray,
    led: np.ndarray,
    walked: np.ndarray,
    drawn: np.ndarray,
    x: np.ndarray,
    away: np.ndarray,
    *,
    width: float,
    reach: float,
    dt: float,
) -> None:
    """The progress `at` and the s `led` to (n + 1,) [m] before and after each tick of a hand at x (n, 2) [m].

    `walked` (n,) [m] is how far it has come, `drawn` (n,) [m] where along the path it has drawn back to, `away` (n,)
    tells whether it is let go in the tick, and `reach` [m] is how far the spring stretches at the force limit.
    """
    lengths, line = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(knots, axis=0), axis=1))], shapely.LineString(knots)
    before, after, lead = at[:-1], at[1:], 3.0 * width + reach
    gone = np.r_[away[1:], away[-1]]
    taken_in = np.flatnonzero(away & ~gone)
    # A later branch may take in a hand that has not gone on along its own: in order of another branch from there on.
    skips = taken_in[led[1:][taken_in] > walked[taken_in] + width]
    in_order = np.arange(len(x)) < min(skips, default=len(x))

    free = in_order & ~gone
    verdict.within("progress behind the length walked", np.where(free, (walked - after) / lead, 0.0), 1.0)
    low, high = np.minimum(walked, after), np.maximum(walked, after)
    straight = free & (np.searchsorted(lengths, low, side="right") == np.searchsorted(lengths, high, side="left"))
    straight &= after > before  # what it was led on beyond a corner, the hand comes to later
    verdict.within("progress ahead on a straight stretch", np.where(straight, (after - walked) / lead, 0.0), 1.0)
    # Of what is passed of a straight stretch, one end is furthest from the hand.
    begin = np.maximum(before, walked)
    on = free & ~away & (after > begin)
    passed = np.where(on, np.linalg.norm(_at(knots, lengths, after) - x, axis=1), 0.0)
    for corner, place in zip(lengths[1:-1], knots[1:-1], strict=True):
        beyond = on & (begin < corner) & (corner < after)
        passed = np.maximum(passed, np.where(beyond, np.linalg.norm(place - x, axis=1), 0.0))
        verdict.during("led on beyond a corner", free & (walked < corner) & (corner < after), dt)
    moved = np.maximum(walked - drawn - 1.5 * reach, 0.0)  # as far as a push back moves it away from the place
    verdict.within("place that progress passes, away from the hand", passed / (lead + width + moved), 1.0)

    stands = (after == before) & (led[1:] == led[:-1])
    verdict.holds("the progress of a hand that was let go stands", (~(away & gone) | stands)[:-1])
    before, after = led[:-1], led[1:]  # of where it was let go, and where it is taken in
    left = np.full(len(x), np.inf)  # [m] from where it was let go
    for let_go in np.unique(before[away]):
        ticks = away & (before == let_go)
        stretch = shapely.ops.substring(line, let_go, let_go + 0.7 * width)
        left[ticks] = shapely.distance(stretch, shapely.points(x[ticks]))
    near = in_order & (np.linalg.norm(_at(knots, lengths, walked) - x, axis=1) < 0.8 * width)
    returned = away & near & (walked > before + 1.5 * width) & (left > 1.3 * width)
    waits = np.diff(np.flatnonzero(np.r_[True, ~returned, True])) - 1  # ticks of each time that it stays there
    searches = 2.0 * math.ceil(lengths[-1] / (8.0 * width) + 1.0)
    verdict.within("let go though on the path again [s]", float(waits.max()) * dt, 0.3 + (searches + 2.0) * dt)
    back = np.linalg.norm(_at(knots, lengths, after[taken_in]) - x[taken_in], axis=1) / width
    verdict.within("a hand that is taken in, away from its place [widths]", back, 1.001)
    verdict.holds("a hand that is where it was let go is not taken in", left[taken_in] > 0.98 * width)
    for k in skips[:1]:  # only where the hand was near some branch when the search began
        began = k - 1 - int((after[k] - before[k] - width) / (8.0 * width))
        further = shapely.ops.substring(line, before[k] + width, lengths[-1])
        apart = shapely.distance(further, shapely.points(x[max(began - 1, 0) : began + 2])).min()
        verdict.holds("the first branch that it comes to takes it in", not (returned[k] and apart > 1.1 * width))
    for situation, mask in (("let go and on the path further on", returned), ("taken in again", away & ~gone)):
        verdict.during(situation, mask, dt)
    verdict.during("taken in by a later branch", np.isin(np.arange(len(x)), skips), dt)


def _at(knots: np.ndarray, lengths: np.ndarray, along: np.ndarray) -> np.ndarray:
    return np.column_stack([np.interp(along, lengths, knots[:, i]) for i in (0, 1)])


def _nearest(a: np.ndarray, b: np.ndarray, x: np.ndarray) -> np.ndarray:
    fraction = np.clip((x - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
    return np.asarray(a + fraction[:, None] * (b - a))
