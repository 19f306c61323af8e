"""Help along a path that crosses itself: of the stretch where the hand is, in order, whatever else lies near it.

Judged on paths made of straight stretches that cross each other, turn back sharply, or lie side by side, closer than
the field is wide, walked by hands that nothing can hold: the progress never goes back and is the length that the hand
has walked, to three widths and what a spring at the force limit may lead by; the force that is wanted pulls across the
stretch where the hand is, not towards the other one, and damps across it alone.
"""

from __future__ import annotations

import math

import numpy as np
import shapely

from rehab_opt import PathAssistance, Workspace
from tests.judge.force_bounds import judge as judge_bounds
from tests.judge.force_runs import Run, Settings
from tests.judge.numbering import numbered, run_length
from tests.judge.references import tremor
from tests.judge.sensor_faults import schedule
from tests.judge.verdict import Promise, Verdict

PROMISES = (
    Promise("rehab_opt/control/path_assistance.py", "It is moved by the person, in order: it never goes back, and cuts "
            "no detour longer than two widths."),
    Promise("rehab_opt/control/path_assistance.py", "p(s) the place of the path and t its direction at the progress s, "
            "so that along the path the hand moves freely."),
    Promise("rehab_opt/control/path_assistance.py", "Share of the path, 0 to 1, to which the hand has come."),
)  # fmt: skip
LEAST = {"near another branch": 1696, "standing": 20_000, "on a straight stretch": 28_000}
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
    angle = rng.uniform(0, 2 * math.pi)
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    return np.asarray(found @ turn.T)


def run(ticks: int, seed: int, *, only: int | None = None) -> Verdict:
    """Hands that walk along such paths."""
    verdict = Verdict("path_progress", seed, LEAST)
    for number, rng in numbered(verdict, ticks, only):
        one_run(verdict, number, rng)
    return verdict


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
    ticks = max(run_length(rng, number, dt), 600)
    lengths = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(knots, axis=0), axis=1))]
    # From the start to the end, with rests, as fast as a hand.
    pace = np.repeat(rng.uniform(0.0, 0.5, size=ticks // 100 + 1) * rng.choice([0.0, 1.0], size=ticks // 100 + 1), 100)
    walked = np.minimum(np.r_[0.0, np.cumsum(pace[:ticks] * dt)], lengths[-1])
    on = np.column_stack([np.interp(walked, lengths, knots[:, i]) for i in (0, 1)])
    x = on + tremor(rng, ticks + 1, dt, size=float(rng.choice([0.0, 0.3])) * width, axes=2)
    step = np.linalg.norm(np.diff(x, axis=0), axis=1)
    commands, progress, wanted = [], np.empty(ticks + 1), np.empty((ticks, 2))
    told = np.vstack([np.zeros(2), np.diff(x[:-1], axis=0) / dt])
    progress[0] = force.progress
    for k in range(ticks):
        commands.append(force.step(x[k], told[k]))
        progress[k + 1], wanted[k] = force.progress, force.wanted
    given = Settings(dt, "follow", 30.0, slew, growth, 1000.0, 1.0, stiffness, damping, 500.0, 10.0, knots)
    none = schedule(rng, ticks, dt, ("",), every=math.inf)
    judge_bounds(verdict, Run(given, shape, x, x[:-1], np.full(ticks, dt), commands, wanted, np.full(ticks, 1000.0),
                              none, told, step > dt, force))  # fmt: skip

    at = progress * lengths[-1]
    verdict.holds("the progress never goes back", np.diff(progress) >= -1e-12)
    led = 3.0 * width + 30.0 / stiffness
    verdict.within("progress away from the length walked [m]", np.abs(at[1:] - walked[:-1]) / led, 1.0)
    # What is wanted in a tick is of the progress before it.
    piece = np.clip(np.searchsorted(lengths, at[:-1], side="right") - 1, 0, len(knots) - 2)
    ways = np.diff(knots, axis=0)
    ways = ways / np.linalg.norm(ways, axis=1)[:, None]
    normal = np.column_stack([-ways[:, 1], ways[:, 0]])[piece]
    offset = np.einsum("ni,ni->n", x[:-1] - knots[piece], normal)
    speed = np.einsum("ni,ni->n", told, normal)
    straight = np.minimum(at[:-1] - lengths[piece], lengths[piece + 1] - at[:-1]) > width
    free = np.array([each.status.value == "ok" and each.scale > 0.0 for each in commands]) & straight
    free &= np.linalg.norm(x[:-1] - _at(knots, lengths, at[:-1]), axis=1) < 0.9 * 30.0 / stiffness
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


def _at(knots: np.ndarray, lengths: np.ndarray, along: np.ndarray) -> np.ndarray:
    return np.column_stack([np.interp(along, lengths, knots[:, i]) for i in (0, 1)])


def _nearest(a: np.ndarray, b: np.ndarray, x: np.ndarray) -> np.ndarray:
    share = np.clip((x - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
    return np.asarray(a + share[:, None] * (b - a))
