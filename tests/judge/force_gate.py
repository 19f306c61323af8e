"""When assistance acts, and which force it wants there.

Judged with the judge's own distance from the workspace's outline and with fields whose force is known in closed form:
around a straight line of one stiffness the pull across it is -S times the distance, along it 2 k1 times the length that
is left, or gone; of one point it is -S times the way. Points within 1e-9 m of the outline count for neither side.
Where a hand at a spring that acts late does not come to rest along an axis, by the loop gain of `field/settling.py`,
that is said, and not where it does.
"""

from __future__ import annotations

import math

import numpy as np
import shapely

from rehab_opt import Assistance, PotentialField, Workspace
from tests.judge.force_runs import THERAPY, Run, assistance, draw, hand_path, runs, signed_distance
from tests.judge.numbering import numbered
from tests.judge.verdict import Verdict

GUARANTEES = ("G23",)
LEAST = {"therapy inside": 20_000, "therapy outside": 50_000, "task inside": 8000, "task outside": 24_000,
         "therapy long inside": 5000, "mode stretch": 20_000, "mode assist": 20_000, "mode resist": 20_000,
         "pull back at its largest": 3000, "pull that is cut": 20_000,
         "a carried field acts": 5000}  # fmt: skip
CI_TICKS = 20_000
LENGTH, MIDDLE, LINE = 0.6, 0.15, 0.02
CARRIED = 300
"""Ticks of a run of twins."""
POINT = np.array([0.1, 0.02])
SPRINGS, MASSES, OWN, CLEARLY = 8, (1.5, 4.0), 4.0, 0.05
"""Of a run of twins; [kg] of a hand, its own damping [N s/m]; [rad] by which a margin is beyond what is asked of it."""


def run(ticks: int, seed: int, *, only: int | None = None) -> Verdict:
    """Hands that go in and out; a quarter with faults."""
    verdict = Verdict("force_gate", seed, LEAST)
    for each in runs(verdict, 3 * ticks // 4, only):
        judge(verdict, each)
    for each in runs(verdict, ticks // 4, only, faults=0.5, first=1_000_000):
        judge(verdict, each)
    for number, rng in numbered(verdict, ticks // 20, only, first=2_000_000):
        carried(verdict, number, rng)
        for _ in range(SPRINGS):
            settles(verdict, rng)
    return verdict


def settles(verdict: Verdict, rng: np.random.Generator) -> None:
    """One spring, whose damping differs along the axes, from none to far more than suits its stiffness."""
    stiffness, dt = float(10 ** rng.uniform(2.0, 3.6)), float(rng.choice([1e-3, 2e-3, 5e-3]))
    fraction = rng.permutation([float(rng.choice([0.0, 0.1, 0.5, 1.0])), float(rng.choice([1.0, 1.0, 3.0, 10.0]))])
    damping = fraction * math.sqrt(stiffness * math.sqrt(math.prod(MASSES)))
    delay, lag = float(rng.uniform(0.0, 0.01)), float(rng.choice([0.0, 0.005]))
    control = Assistance(
        PotentialField(POINT[None], stiffness=stiffness, damping=damping, width=0.03, compile=False),
        comfortable=Workspace(shapely.Point(POINT).buffer(0.1), accuracy=0.0), mode="hold", slew_limit=9e5, dt=dt,
        actuation_delay=delay, actuation_lag=lag, compile=False,
    )  # fmt: skip
    margin = min(phase_margin(stiffness, each, mass, delay + dt, lag) for each in damping.tolist() for mass in MASSES)
    told = f"S {stiffness:.4g}, D {damping}, {delay:.3g} s, lag {lag:g}, dt {dt:g}, {margin:.3g} rad: {control.notes}"
    verdict.holds("a hand that does not come to rest is told of", control.notes or margin > -CLEARLY, told)
    verdict.holds("of a hand that comes to rest nothing is told", not control.notes or margin < 0.1 + CLEARLY, told)


def phase_margin(stiffness: float, damping: float, mass: float, delay: float, lag: float) -> float:
    """[rad] by which the loop lags less than 180 degrees where its gain is one; 10 ms is the velocity's lag."""
    w = np.geomspace(0.1, 1e4, 20_000)
    s = 1j * w
    loop = (stiffness + damping * s / (1 + 0.005 * s) ** 2) / ((1 + lag * s) * (mass * s + OWN) * s)
    at = int(np.argmin(np.abs(np.log(np.abs(loop)))))
    return float(math.pi - (-np.angle(loop[at])) % math.tau - w[at] * delay)


def carried(verdict: Verdict, number: int, rng: np.random.Generator) -> None:
    """A field that is carried on the way acts as one made where it then stands; the gate stays where it was."""
    given, by = draw(rng, number), rng.uniform(-0.05, 0.05, 2)
    verdict.begin(number, f"{given.mode}, carried by {by[0]:.3g}, {by[1]:.3g} m")
    twins = assistance(given), assistance(given, by=by)
    twins[0].shift(*by)
    path = hand_path(rng, "person", CARRIED, given.dt)
    found = [[each.step(x, np.zeros(2)) for x in path[:CARRIED]] for each in twins]
    answers = verdict.answers(found[0], given.dt)
    apart = np.abs(answers.value - np.array([each.value for each in found[1]]))
    verdict.within("force of a field that is carried, from one made there [N]", apart, 1e-6 * (given.stiffness + 1))
    verdict.holds("a field that is carried says where it stands", [tuple(twins[0].offset) == tuple(by.tolist())])
    verdict.during("a carried field acts", (answers.value != 0).any(axis=1), given.dt)


def judge(verdict: Verdict, one: Run) -> None:
    """The gate in every tick."""
    given, dt, x = one.settings, one.settings.dt, one.shown
    answers = verdict.answers(one.commands, dt)
    beyond, foot = signed_distance(given.outline, x)
    inside, outside = beyond < -1e-9, beyond > 1e-9
    size = np.linalg.norm(answers.value, axis=1)
    acted = answers.status == "ok"
    if given.mode in THERAPY:
        grew = size - np.r_[0.0, size[:-1]]
        verdict.within("growth of a therapy's force inside [N]", np.where(inside, grew, 0.0), 1e-12)
        long = int(np.ceil(given.force_limit / (given.slew_limit * dt) + 1e-9)) + 1
        count = np.cumsum(inside)
        deep = np.zeros(len(x), dtype=bool)
        deep[long:] = count[long:] - count[:-long] == long
        verdict.within("therapy's force long inside [N]", np.where(deep, size, 0.0), 0.0)
        wants = np.where(inside[:, None], one.desired_force, 0.0)
        verdict.within("force wanted by a therapy inside [N]", np.abs(wants), 0.0)
        verdict.during("therapy inside", inside, dt)
        verdict.during("therapy outside", outside, dt)
        verdict.during("therapy long inside", deep, dt)
        field, pulls = outside, np.zeros(len(x), dtype=bool)
    else:
        field, pulls = inside, outside
        strong = np.minimum(given.return_stiffness * beyond, given.return_force)
        back = strong[:, None] * (foot - x) / np.maximum(beyond, 1e-12)[:, None]
        error = np.abs(one.desired_force - back).max(axis=1)
        corner = _two_feet(given.outline, x, beyond)
        verdict.within("pull back to the workspace: error [N]", np.where(pulls & acted & ~corner, error, 0.0), 1e-6)
        verdict.during("task inside", inside, dt)
        verdict.during("task outside", outside, dt)
        verdict.during("pull back at its largest", pulls & (given.return_stiffness * beyond > given.return_force), dt)
    known = ~np.isnan(one.velocity[:, 0]) | (given.damping == 0)
    damped = one.desired_force + given.damping * np.nan_to_num(one.velocity)
    asked = field & acted & known
    scale = 1e-6 * (given.stiffness + 1)
    if given.mode == "hold":
        pull = given.stiffness * (POINT - x)
        cut = np.minimum(1.0, given.force_limit / np.maximum(np.linalg.norm(pull, axis=1), 1e-12))
        off = np.abs(damped - cut[:, None] * pull).max(axis=1)
        verdict.within("spring to a point: error [N]", np.where(asked, off, 0.0), scale)
    else:
        along = {"assist": 2 * 100.0 * (LENGTH / 2 - x[:, 0]), "resist": -2 * 60.0 * (LENGTH / 2 + x[:, 0])}
        pull = np.column_stack([along.get(given.mode, np.zeros(len(x))), -given.stiffness * (x[:, 1] - LINE)])
        whole = np.linalg.norm(pull, axis=1)
        cut, middle = whole > given.force_limit, asked & (np.abs(x[:, 0]) < MIDDLE)
        gone, across = np.abs(damped - pull * np.minimum(1.0, given.force_limit / np.maximum(whole, 1e-12))[:, None]).T
        # What is cut is turned by what the length along the line is off, too.
        verdict.within("pull across a line: error [N]", np.where(middle & ~cut, across, 0.0), scale)
        verdict.within("pull across a line that is cut: error [N]", np.where(middle & cut, across, 0.0), 1e-2)
        verdict.within("force along a line: error [N]", np.where(middle, gone, 0.0), 1e-2)
        verdict.during("pull that is cut", middle & cut, dt)
    verdict.during(f"mode {given.mode}", np.ones(len(x), dtype=bool), dt)


def _two_feet(corners: np.ndarray, x: np.ndarray, beyond: np.ndarray) -> np.ndarray:
    """Whether two places of the outline are as near, to rounding: either is the nearest."""
    shifted = [signed_distance(np.roll(corners, k, axis=0), x + step)[1] for k, step in ((0, 1e-9), (1, -1e-9))]
    return np.asarray(np.linalg.norm(shifted[0] - shifted[1], axis=1) > 1e-6) | ~np.isfinite(beyond)
