"""A reachable slice by optimisation against Monte Carlo over the joints: `python -m bench.workspace`.

Prints one line a number, asked and measured; exit code 1 where one is missed. Monte Carlo is given every advantage:
compiled kinematics evaluated in one call for a block of samples, uniform joint angles, a hit within 1 mm of the plane.
Both are timed by the processor time of this process, which is one thread: other programs on the machine do not count.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import casadi as ca
import numpy as np
import shapely
from numpy.typing import NDArray
from rich.console import Console

from bench.machine import machine
from bench.verdict import Verdict, all_met, print_verdicts
from bench.workspace_maps import arms_of
from rehab_opt import ArmIK, SerialChain, human_arm
from rehab_opt.symbolic import BufferedFunction, compiled
from rehab_opt.workspace.reach import Slice, slice_at

__all__ = ["main"]

Array = NDArray[np.float64]
HEIGHT, TILT, ACCURACY = -0.24, math.radians(2), 1e-3
SECONDS = 0.5
BLOCK = 4096
"""Samples evaluated in one call: few enough to stay in the cache."""


class Sampled(NamedTuple):
    """What Monte Carlo found."""

    hits: Array
    """(N, 2) [m]"""
    samples: int
    seconds: float


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure what is asked for and judge it."""
    options = _options(arguments)
    console = Console()
    console.print("  ".join(f"{key}: {value}" for key, value in machine().items()), highlight=False)
    verdicts: list[Verdict] = []
    for name in options.ranges:
        console.rule(name)
        some, lines = measured(human_arm(range_of_motion=name), options)
        for line in lines:
            console.print(line, highlight=False, soft_wrap=True)
        some = [verdict._replace(what=f"{name}: {verdict.what}") for verdict in some]
        print_verdicts(console, some)
        verdicts += some
    if options.people:
        console.rule(f"{options.people} random people, seed {options.seed}")
        some = people_verdicts(options)
        print_verdicts(console, some)
        verdicts += some
    if options.json:
        options.json.write_text(
            json.dumps({"machine": machine(), "verdicts": [v._asdict() | {"met": v.met} for v in verdicts]}, indent=2)
        )
    return 0 if all_met(verdicts) else 1


def measured(arm: SerialChain, options: argparse.Namespace) -> tuple[list[Verdict], list[str]]:
    """One range: our time and errors, and Monte Carlo's."""
    begun = time.perf_counter()
    found = _slice(arm)
    first = time.perf_counter() - begun
    seconds, walls = [], []
    for _ in range(options.repeats):
        begun, wall = time.process_time(), time.perf_counter()
        found = _slice(arm)
        seconds.append(time.process_time() - begun)
        walls.append(time.perf_counter() - wall)
    ours = float(np.median(seconds))
    wrong, probed = _wrong_probes(arm, found, options.probes)
    sampled = _monte_carlo(arm, options.factor * ours)
    rate, fraction = sampled.samples / sampled.seconds, len(sampled.hits) / sampled.samples
    cells = found.polygon.area / ACCURACY**2
    # Coupon collector: hits until every cell has one, were they spread evenly; they are not, so it takes longer.
    needed = cells * (math.log(cells) + 0.5772) / fraction if fraction else math.inf
    hours = needed / rate / 3600
    gap, seen = _unseen(found, sampled.hits)
    lines = [
        f"ours: median {ours:.2f} s of processor time in {options.repeats} runs, from {min(seconds):.2f} to "
        f"{max(seconds):.2f} (wall {np.median(walls):.2f} s under the load above); "
        f"the first call, with all that is made once: {first:.2f} s",
        f"area {1e4 * found.polygon.area:.2f} cm^2, accuracy {1e3 * found.accuracy:g} mm; {found.solves} solver calls, "
        f"certified minima {1 - (found.uncertified + found.failures) / found.solves:.2%}, "
        f"no answer {found.failures / found.solves:.2%}; own probes {found.probes}, contradicting {found.failed}",
        f"Monte Carlo: {rate:.3g} samples/s, {fraction:.2e} of them within 1 mm of the plane and 2 deg of vertical",
        f"Monte Carlo for a hit in each of {cells:.0f} cells of 1 mm: at least {needed:.2g} samples, {hours:.3g} h "
        "(extrapolated from the rates measured, for hits spread evenly, which favours it)",
        f"Monte Carlo after {sampled.seconds:.0f} s, {sampled.seconds / ours:.0f} x our time: {len(sampled.hits)} "
        f"hits, cells of 1 mm with one {seen:.2%}, largest disc without one {1e3 * gap:.1f} mm in radius",
    ]
    return [
        Verdict("one slice", ours, "<=", SECONDS, "s"),
        Verdict(f"wrong of {probed} probes by ArmIK, 1 mm to either side", wrong, "<=", 0),
        Verdict("stated accuracy", found.accuracy, "<=", ACCURACY, "m"),
        Verdict("Monte Carlo's time for the same accuracy / ours", 3600 * hours / ours, ">=", 100),
        Verdict(f"error of Monte Carlo after {options.factor:g} x our time", gap, ">=", ACCURACY, "m"),
    ], lines


def people_verdicts(options: argparse.Namespace) -> list[Verdict]:
    """Random people of `bench.workspace_maps`, both ranges of each: time and independent probes of every slice."""
    seconds, wrong, probed, coarser, furthest = [], 0, 0, 0, [0.0]
    for number in range(options.people):
        for arm in arms_of(options.seed, number):
            begun = time.process_time()
            found = _slice(arm)
            seconds.append(time.process_time() - begun)
            coarser += found.accuracy > ACCURACY
            if not found.polygon.is_empty:
                bad, count = _wrong_probes(arm, found, options.probes_of_people)
                wrong, probed = wrong + bad, probed + count
                furthest.append(_off_a_finer_one(arm, found) / found.accuracy)
    return [
        Verdict("people: one slice, median", float(np.median(seconds)), "<=", SECONDS, "s"),
        Verdict("people: one slice, longest", max(seconds), "<=", 4 * SECONDS, "s"),
        Verdict(f"people: wrong of {probed} probes by ArmIK, at the accuracy stated", wrong, "<=", 0),
        Verdict("people: furthest off a finer boundary / accuracy stated", float(np.max(furthest)), "<=", 1.25),
        Verdict(f"people: of {len(seconds)} slices, those stated coarser than asked", coarser, "<=", 0),
    ]


def _slice(arm: SerialChain, accuracy: float = ACCURACY) -> Slice:
    return slice_at(arm, height=HEIGHT, handle_tilt=TILT, accuracy=accuracy)


def _off_a_finer_one(arm: SerialChain, found: Slice) -> float:
    """[m] Largest distance between two boundaries: of a notch that is not there, its depth, which few probes meet."""
    finer = _slice(arm, ACCURACY / 4)
    return float(shapely.hausdorff_distance(found.polygon.boundary, finer.polygon.boundary, densify=0.05))


def _wrong_probes(arm: SerialChain, found: Slice, count: int) -> tuple[int, int]:
    """Probes 1 mm outside that ArmIK reaches, and 1 mm inside that it does not; and how many there were."""
    arm_ik = ArmIK(arm, handle_tilt=TILT)
    wrong = probed = 0
    for side in (1.0, -1.0):
        line = found.polygon.buffer(side * found.accuracy).boundary
        if line.is_empty:
            continue
        at = np.random.default_rng(0).uniform(0, line.length, count)
        for x, y in shapely.get_coordinates(shapely.line_interpolate_point(line, at)):
            wrong += arm_ik.solve([x, y, HEIGHT]).status.certified != (side < 0)
        probed += count
    return wrong, probed


def _monte_carlo(arm: SerialChain, seconds: float) -> Sampled:
    q = ca.SX.sym("q", arm.n)
    pose = arm.pose_expression(q)
    one = ca.Function("one", [q], [ca.vertcat(pose[:3, 3], pose[2, 0])], {"cse": True})
    several = BufferedFunction(compiled(one.map("sampled", "serial", BLOCK, [], [])))
    random, width = np.random.default_rng(0), arm.upper - arm.lower
    postures, found = several.inputs[0].T, several.outputs[0]
    hits, samples, upright = [], 0, math.cos(TILT)
    begun = time.process_time()
    while time.process_time() - begun < seconds:
        random.random(out=postures)
        postures *= width
        postures += arm.lower
        several()
        good = (np.abs(found[2] - HEIGHT) <= ACCURACY) & (found[3] >= upright)
        if good.any():
            hits.append(found[:2, good].T.copy())
        samples += BLOCK
    taken = time.process_time() - begun
    return Sampled(np.concatenate([np.zeros((0, 2)), *hits]), samples, taken)


def _unseen(found: Slice, hits: Array) -> tuple[float, float]:
    """Radius [m] of the largest disc about a point of the slice without a hit, and the share of 1 mm cells with one."""
    from scipy.spatial import cKDTree  # noqa: PLC0415

    x, y, right, top = found.polygon.bounds
    nodes = np.stack(np.meshgrid(np.arange(x, right, ACCURACY), np.arange(y, top, ACCURACY)), axis=-1).reshape(-1, 2)
    nodes = nodes[shapely.contains_xy(found.polygon, nodes)]
    if not len(hits):
        return math.inf, 0.0
    hit_cells = np.unique(np.floor(hits / ACCURACY), axis=0)
    return float(cKDTree(hits).query(nodes)[0].max()), min(1.0, len(hit_cells) / len(nodes))


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m bench.workspace", description=__doc__)
    parser.add_argument("--ranges", nargs="*", default=["regular", "restricted"], choices=["regular", "restricted"])
    parser.add_argument("--repeats", type=int, default=5, help="slices that are timed")
    parser.add_argument("--probes", type=int, default=200, help="independent probes on either side")
    parser.add_argument("--factor", type=float, default=100.0, help="Monte Carlo's time over ours")
    parser.add_argument("--people", type=int, default=0, help="random people besides, both ranges of each")
    parser.add_argument("--seed", type=int, default=0, help="of the people")
    parser.add_argument("--probes-of-people", type=int, default=40, help="on either side of each of their slices")
    parser.add_argument("--json", type=Path, help="write the numbers here too")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())
