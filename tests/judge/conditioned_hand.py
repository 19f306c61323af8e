"""A tracker's samples made even: lost sight is told, what is steady is only delayed, and by as much as is said.

Judged on hands that move and turn steadily between gaps, jumps and spikes that the test made: which samples are lost,
how many were dropped, and where the hand truly was `lag` ago. Both ways to condition must give the same numbers.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from rehab_opt.control.conditioning import Conditioner, conditioned
from tests.judge.numbering import Runs, judging
from tests.judge.verdict import Verdict

GUARANTEES = ("G19",)
LEAST = {"sight lost": 50_000, "after a jump": 1000, "steady": 200_000, "turning steadily": 200_000}
CI_TICKS = 12_000
SHARE = 0.1
TOGETHER = 3
"""Samples that make a stretch."""
TURN = 5e-5
"""[rad] The filter means turns as quaternions: off by the cube of what is turned in its memory, 2.3e-5 was seen."""
SETTLED = 40.0
"""Time constants of the filter after which a steady motion is only delayed."""


class Stretch(NamedTuple):
    """Samples that belong together; the hand's own way between them."""

    times: np.ndarray
    place: np.ndarray
    velocity: np.ndarray
    axis: np.ndarray
    rate: float
    """[rad/s] about the axis, from no turn at time 0."""

    def sample(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Positions, quaternions x, y, z, w."""
        half = 0.5 * self.rate * np.asarray(t)[:, None]
        return self.place + t[:, None] * self.velocity, np.hstack([np.sin(half) * self.axis, np.cos(half)])


def one_run(verdict: Verdict, number: int, rng: np.random.Generator) -> None:
    """One recording."""
    dt, max_gap = float(rng.choice([0.002, 0.005, 0.01])), float(rng.choice([0.05, 0.1, 0.2]))
    cutoff = (20.0, math.inf, 8.0, 4.0)[number % 4]
    options = {"dt": dt, "cutoff_hz": cutoff, "max_gap": max_gap, "max_speed": 3.0, "max_turn_rate": 12.0}
    stretches: list[Stretch] = []
    times, places, turns, spoilt = [], [], [], 0
    t = 5.0
    place = np.zeros(3)
    for index in range(rng.integers(2, 5)):
        axis = rng.standard_normal(3)
        one = Stretch(
            t + np.cumsum(np.minimum(rng.uniform(0.2, 0.99, rng.integers(40, 150)) * min(max_gap, 0.02), 0.02)),
            place + rng.uniform(-0.3, 0.3, 3) + 0.3 * (index > 0), rng.uniform(-0.8, 0.8, 3),
            axis / np.linalg.norm(axis), rng.uniform(-1.5, 1.5),
        )  # fmt: skip
        far, turn = one.sample(one.times)
        flip = rng.choice([-1.0, 1.0], len(turn))  # both say the same turn
        stretches.append(one)
        times += one.times.tolist()
        places += far.tolist()
        turns += (turn * flip[:, None] * rng.uniform(0.5, 2.0)).tolist()
        place, t = far[-1], one.times[-1] + (rng.uniform(1.05, 3.0) * max_gap if rng.random() < 0.6 else 0.4 * max_gap)
        if t - one.times[-1] < max_gap:  # a jump instead: too far for a hand
            place = place + 3.1 * (t - one.times[-1] + 0.03) + 1.0
    x, q = np.array(places), np.array(turns)
    stamps = np.array(times)
    for kind in rng.choice(["nan", "repeated", "large", *["spike"] * (number % 2)], rng.integers(0, 4)):
        at = int(rng.integers(5, len(stamps) - 5))
        if kind == "repeated":
            stamps, x, q = (np.insert(each, at, each[at - 1], axis=0) for each in (stamps, x, q))
            x[at] += 7.0
        else:
            between = 0.5 * (stamps[at - 1] + stamps[at])
            stamps = np.insert(stamps, at, between)
            x = np.insert(x, at, {"nan": math.nan, "spike": 50.0, "large": 1e7}[kind], axis=0)
            q = np.insert(q, at, q[at], axis=0)
        spoilt += 1
    spikes = bool((x[:, 0] == 50.0).any())  # these part what they stand in
    verdict.begin(number, f"dt {dt:g}, cutoff {cutoff:g}, {len(stretches)} stretches, {spoilt} spoilt")
    found = conditioned(stamps, x, q, **options)
    live = Conditioner(**options)
    parts = [live.push(*each) for each in zip(stamps.tolist(), x, q, strict=True)]
    ticks = len(found.times)
    verdict.ticks += ticks
    together = [
        np.concatenate([getattr(each, name) for each in parts]) for name in ("times", "poses", "twists", "lost")
    ]
    verdict.holds("sample by sample as many ticks as at once", len(together[0]) == ticks)
    if len(together[0]) == ticks:
        for name, each in zip(("times", "poses", "twists"), together, strict=False):
            apart = np.abs(np.nan_to_num(each - getattr(found, name)).reshape(ticks, -1)).max(axis=1)
            verdict.within(f"{name} sample by sample away from those at once", apart, 1e-8)
        verdict.holds("lost sample by sample as at once", together[3] == found.lost)
    beside = 2 * (TOGETHER - 1) * int(spikes)  # next to a spike and a gap too few samples are together
    verdict.holds("samples left out are counted", spoilt <= found.dropped <= spoilt + beside)
    verdict.holds("sample by sample as many are left out", parts[-1].dropped == found.dropped)
    verdict.holds("stretches without samples are counted", parts[-1].gaps == found.gaps)
    if not spikes:
        verdict.holds("each gap and jump is one", found.gaps == len(stretches) - 1)
    verdict.within("ticks that are not even [s]", np.abs(found.times - stamps[0] - dt * np.arange(ticks)), 1e-9)
    verdict.holds("lost samples are none", np.isnan(found.poses[:, 0, 3]) == found.lost)
    lag = live.lag
    tau = 0.0 if math.isinf(cutoff) else 1.0 / (2 * math.pi * cutoff)
    inside = np.zeros(ticks, dtype=bool)
    for one in stretches:
        within = (found.times >= one.times[0] - 1e-12) & (found.times <= one.times[-1] + 1e-12)
        inside |= within
        if spikes:
            continue
        verdict.holds("no sight is lost where samples follow each other", ~(within & found.lost))
        steady = within & (found.times - one.times[0] > SETTLED * tau + 2 * dt)
        if not steady.any():
            continue
        true, turn = one.sample(found.times[steady] - lag)
        off = np.linalg.norm(found.poses[steady][:, :3, 3] - true, axis=1)
        verdict.within("steady motion away from where it was `lag` ago [m]", off, 1e-6)
        verdict.within("steady velocity [m/s]", np.abs(found.twists[steady][:, :3] - one.velocity), 1e-5)
        verdict.within("steady turn's rate [rad/s]", np.abs(found.twists[steady][:, 3:] - one.rate * one.axis), 2e-4)
        turned = Rotation.from_matrix(found.poses[steady][:, :3, :3]) * Rotation.from_quat(turn).inv()
        verdict.within("steady turn away from that of `lag` ago [rad]", turned.magnitude(), TURN)
        verdict.during("steady", steady, dt)
        verdict.during("turning steadily", steady & (abs(one.rate) > 0.2), dt)
    if not spikes:
        verdict.holds("sight between stretches is lost", found.lost | inside)
    verdict.during("sight lost", found.lost, dt)
    verdict.during("after a jump", np.r_[False, found.lost[:-1]] & ~found.lost, dt)


run = judging(__name__, LEAST, Runs(one_run))
