"""Assistance beside the same law in numpy and qpsolvers, large fields, and learning: `python -m bench.assistance`.

Prints one line a number, asked and measured; exit code 1 where one is missed. Both sides are timed in turn, tick for
tick, on the same hand motion through gate, onset, slew and force limit, and medians are compared. The other side sums
over the same samples, asks the same workspace, and states the same QP with a polygon of 16 sides for the disc.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence

import numpy as np
import qpsolvers
import shapely
from numpy.typing import NDArray
from rich.console import Console

from bench.machine import machine
from bench.verdict import Verdict, all_met, print_verdicts
from rehab_opt import Assistance, PotentialField, Workspace
from rehab_opt.field.assembly import assembled
from rehab_opt.field.demonstration import Demonstration
from rehab_opt.field.energy import energies_and_forces, field_kernel

__all__ = ["main"]

Array = NDArray[np.float64]

S = np.linspace(0.0, 1.0, 1000)
PATH = np.column_stack([-0.15 + 0.3 * S, 0.4 + 0.03 * np.sin(3 * S)])
COMFORTABLE = Workspace(shapely.box(-0.18, 0.365, -0.06, 0.435), accuracy=1e-3)
DT, SLEW, LIMIT, BUDGET, CAP = 1e-3, 200.0, 30.0, 1e3, 1.0


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure what is asked for and judge it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--ticks", type=int, default=6000)
    parser.add_argument("--samples", type=int, default=100_000, help="of the largest field")
    options = parser.parse_args(arguments)
    console = Console()
    console.print("  ".join(f"{key}: {value}" for key, value in machine().items()), highlight=False)
    verdicts: list[Verdict] = []
    for measure in (
        lambda: beside_numpy(options.ticks, 200),
        lambda: growth(options.samples),
        learning,
    ):
        measured, lines = measure()
        for line in lines:
            console.print(line, highlight=False, soft_wrap=True)
        print_verdicts(console, measured)
        verdicts += measured
    return 0 if all_met(verdicts) else 1


# ------------------------------------------------------------------------------------------------------------ one tick
class PlainAssistance:
    """The same law as a good numpy programmer writes it."""

    def __init__(self, field: PotentialField) -> None:
        self.points, self.offsets, self.stiffness, self.log_weights, self.lean = field.samples
        self.width, self.damping = field.width, field.damping
        angles = 2 * np.pi * np.arange(16) / 16
        self.disc = np.column_stack([np.cos(angles), np.sin(angles)])
        self.disc_limit = np.full(16, LIMIT * np.cos(np.pi / 16))
        self.last, self.x, self.v, self.left = np.zeros(2), None, np.zeros(2), BUDGET

    def step(self, x: Array) -> Array:
        """Force for a hand at x."""
        if self.x is not None:
            moved = x - self.x
            self.left = min(BUDGET, self.left - self.last @ moved)
            self.v = self.v + DT / (0.01 + DT) * (moved / DT - self.v)
        self.x = x
        wanted = np.zeros(2)
        if COMFORTABLE.distance(x) > 0:
            away = x - self.points
            exponents = self.log_weights - (away**2).sum(axis=1) / (2 * self.width**2)
            weights = np.exp(exponents - exponents.max())
            weights /= weights.sum()
            pull = self.lean + self.stiffness * away
            energies = self.offsets + ((self.lean + 0.5 * self.stiffness * away) * away).sum(axis=1)
            slope = weights * (energies - weights @ energies) / self.width**2
            wanted = slope @ away - weights @ pull - self.damping * self.v
        G = np.vstack([self.disc, self.v * DT])
        h = np.append(self.disc_limit, max(self.left, 0.0))
        step = SLEW * DT
        force = qpsolvers.solve_qp(
            np.eye(2), -wanted, G, h, lb=self.last - step, ub=self.last + step, solver="quadprog"
        )
        self.last = force if force is not None and np.isfinite(force).all() else self.last * 0.9
        return self.last


def hand(ticks: int) -> list[Array]:
    """Back and forth along the path, inside and outside the comfortable workspace, with a tremor."""
    t = np.arange(ticks) * DT
    fraction = 0.5 - 0.5 * np.cos(2 * np.pi * 0.3 * t)
    x = np.column_stack([np.interp(fraction, S, column) for column in PATH.T])
    x += 4e-3 * np.column_stack([np.sin(2 * np.pi * 5 * t), np.cos(2 * np.pi * 4 * t)])
    return list(x)


def beside_numpy(ticks: int, count: int) -> tuple[list[Verdict], list[str]]:
    """The whole tick with `count` samples."""
    field = field_of(count)
    ours = Assistance(field, comfortable=COMFORTABLE, mode="assist", energy_budget=BUDGET, speed_cap=CAP)
    theirs = PlainAssistance(field)
    taken: list[list[float]] = [[], []]
    solvers: dict[str, int] = {}
    apart = 0.0
    for x in hand(ticks):
        begun = time.perf_counter()
        command = ours.step(x)
        taken[0].append(time.perf_counter() - begun)
        begun = time.perf_counter()
        other = theirs.step(x)
        taken[1].append(time.perf_counter() - begun)
        solvers[command.solver] = solvers.get(command.solver, 0) + 1
        apart = max(apart, abs(float(np.linalg.norm(command.value) - np.linalg.norm(other))))
    a, b = np.array(taken) * 1e6
    where = COMFORTABLE.distance(np.array(hand(ticks)))
    outside = np.asarray(where) > 0
    used = len(field.samples.points)
    in_use, theirs_in_use = float(np.median(a[outside])), float(np.median(b[outside]))
    lines = [
        f"{used} samples, {ticks} ticks: ours median {np.median(a):.2f} us, p99 {np.percentile(a, 99):.1f}, largest "
        f"{a.max():.0f}; outside the comfortable workspace {in_use:.2f}",
        f"numpy, quadprog: median {np.median(b):.1f} us, p99 {np.percentile(b, 99):.0f}; outside {theirs_in_use:.1f}",
        f"answered by {solvers}; sizes of the two forces differ by at most {apart:.2g} N "
        "(their polygon of 16 sides loses 0.6 N, their slew box is wider on its diagonals)",
    ]
    fraction = float(np.median(a) / np.median(b))
    return [
        Verdict(f"tick with {used} samples, fraction of numpy and quadprog", fraction, "<=", 0.2),
        Verdict("the same outside the comfortable workspace", in_use / theirs_in_use, "<=", 0.2),
    ], lines


def field_of(count: int) -> PotentialField:
    """One that sums over about `count` samples, its continuation included."""
    length = float(np.linalg.norm(np.diff(PATH, axis=0), axis=1).sum())
    spacing = (length + 12 * 0.025) / (count - 1)
    return PotentialField(PATH, stiffness=1000.0, drag=200.0, damping=5.0, width=0.025, spacing=spacing)


# -------------------------------------------------------------------------------------------------------- large fields
def growth(most: int) -> tuple[list[Verdict], list[str]]:
    """The tick of fields of many demonstrations, ten times more samples each time."""
    lines, verdicts = [], []
    before = None
    for count in [most // 100, most // 10, most]:
        field, begun = many_demonstrations(count), time.perf_counter()
        ours = Assistance(field, comfortable=COMFORTABLE, mode="assist", energy_budget=BUDGET)
        ready = time.perf_counter() - begun
        seconds = median_tick(ours)
        error = merging_error(field)
        lines.append(
            f"{field.count} samples, evaluated as {len(field.samples.points)}: tick {1e6 * seconds:.1f} us, ready in "
            f"{ready:.2f} s; merging changes forces by {error:.2g} N (median at 40 points)"
        )
        if before is not None:
            times = seconds / before[1]
            verdicts.append(
                Verdict(
                    f"tick at {field.count} samples, in ticks at {before[0]}",
                    times,
                    "<=",
                    field.count / before[0] * 0.5,
                )
            )
        before = (field.count, seconds)
    assert before is not None
    verdicts.append(Verdict(f"tick at {before[0]} samples", before[1] * 1e3, "<=", 1.0, "ms"))
    return verdicts, lines


def many_demonstrations(count: int) -> PotentialField:
    """Swaying paths to one target."""
    rng = np.random.default_rng(0)
    each = 52  # samples of one path at a quarter of the width
    paths = [
        PATH
        + np.sin(np.pi * S)[:, None] * rng.normal(0, 0.01, 2)
        + (0.01 * np.sin(6 * S + rng.uniform(0, 6)) * (1 - S))[:, None] * [0, 1]
        for _ in range(max(1, count // each))
    ]
    return PotentialField(paths, stiffness=1000.0, drag=200.0, width=0.025)


def merging_error(field: PotentialField) -> float:
    """[N] median of what merging changes."""
    whole = assembled(
        field.paths, [200.0 * path.remaining**2 for path in field.paths],
        [np.full(path.points.shape, 1000.0) for path in field.paths],
        along="remaining", width=field.width, target=field.target, most=10**9,
    )  # fmt: skip
    x = np.random.default_rng(1).uniform((-0.2, 0.35), (0.2, 0.5), (40, 2))
    errors = np.linalg.norm(energies_and_forces(field_kernel(whole, field.width).mine, x)[1] - field.force(x), axis=1)
    return float(np.median(errors))


def median_tick(helper: Assistance) -> float:
    """[s] of a step outside the comfortable workspace."""
    taken = []
    for x in hand(2000):
        begun = time.perf_counter()
        helper.step(x)
        taken.append(time.perf_counter() - begun if not COMFORTABLE.contains(x) else np.nan)
    return float(np.nanmedian(taken))


# ------------------------------------------------------------------------------------------------------------ learning
def learning() -> tuple[list[Verdict], list[str]]:
    """Ten demonstrations of a thousand samples."""
    true = {"stiffness": 1000.0, "drag": 200.0, "damping": 8.0}
    truth = PotentialField(PATH, **true, width=0.025)
    lines, verdicts = [], []
    for noise in (0.0, 1.0):
        hands = recorded(truth, noise)
        begun = time.perf_counter()
        fit = PotentialField.learn(hands, path=PATH, width=0.025).fit
        seconds = time.perf_counter() - begun
        assert fit is not None
        lines.append(
            f"noise {noise:g} N: {seconds:.2f} s, condition {fit.condition:.3g}, held-out error "
            f"{fit.held_out_error:.3g} N ({100 * fit.held_out_fraction:.2g} %), "
            f"constant stiffness {fit.constant_stiffness_error:.3g} N"
        )
        verdicts.append(Verdict(f"learning from 10 x 1000 samples, noise {noise:g} N", seconds, "<=", 10.0, "s"))
        if not noise:
            worst = max(abs(fit.parameters[name] / value - 1) for name, value in true.items())
            verdicts.append(Verdict("held-out force, without noise", 100 * fit.held_out_fraction, "<=", 2.0, "%"))
            verdicts.append(Verdict("S, k1 and D, without noise, largest error", 100 * worst, "<=", 2.0, "%"))
    return verdicts, lines


def recorded(truth: PotentialField, noise: float) -> list[Demonstration]:
    """Reaches in two seconds that sway beside the path."""
    rng, path = np.random.default_rng(0), truth.paths[0]
    t = np.linspace(0.0, 1.0, 1000)
    length = path.travelled[-1] * (10 * t**3 - 15 * t**4 + 6 * t**5)
    on_path = np.column_stack([np.interp(length, path.travelled, column) for column in path.points.T])
    hands = []
    for _ in range(10):
        beside = rng.normal(0, 0.01, 2) * np.sin(3 * np.pi * t[:, None] + rng.uniform(0, 6, 2))
        x = on_path + beside * np.sin(np.pi * t[:, None])
        v = np.gradient(x, 2.0 * t, axis=0)
        hands.append(Demonstration(x, truth.force(x, v) + noise * rng.standard_normal(x.shape), v))
    return hands


if __name__ == "__main__":
    sys.exit(main())
