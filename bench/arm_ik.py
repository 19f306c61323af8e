"""ArmIK against single solvers: cold, warm along paths, and on unreachable targets: `python -m bench.arm_ik`.

Prints one line a number, asked and measured; exit code 1 where one is missed. The targets are described in
`bench/arm/targets.py`, the single solvers, which share no code with ArmIK, in `bench/arm/baselines.py`.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from bench.arm.baselines import Answer, Baseline, nearest_point, position_ik, posture_cost
from bench.arm.targets import figure_eight, handle_tilt, nearest_distance, random_path, reachable, unreachable
from bench.machine import machine
from bench.verdict import Verdict, all_met, print_verdicts
from rehab_opt import ArmIK, SerialChain, Status, human_arm

__all__ = ["main"]

Array = NDArray[np.float64]
TILT = math.radians(2)
POSITION, TILT_SLACK, BOUND_SLACK = 1e-6, 1e-9, 1e-12
"""[m, rad, rad] what counts as solved."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure what is asked for and judge it."""
    options = _options(arguments)
    console = Console()
    console.print("  ".join(f"{key}: {value}" for key, value in machine().items()), highlight=False)
    verdicts: list[Verdict] = []
    for name in options.ranges:
        arm = human_arm(range_of_motion=name)
        arm_ik = ArmIK(arm, handle_tilt=TILT)
        first = reachable(arm, 1, tilt=TILT, seed=99)[0]
        begun = time.perf_counter()
        arm_ik.solve(first)
        console.print(f"{name}: the first solve, with all that is made once: {time.perf_counter() - begun:.2f} s")
        for part, measure in (("cold", cold), ("warm", warm), ("unreachable", beyond)):
            if part in options.parts:
                console.rule(f"{name}: {part}")
                some, lines = measure(arm, arm_ik, options)
                for line in lines:
                    console.print(line, highlight=False, soft_wrap=True)
                some = [verdict._replace(what=f"{name}, {part}: {verdict.what}") for verdict in some]
                print_verdicts(console, some)
                verdicts += some
    if options.json:
        report: dict[str, Any] = {
            "machine": machine(),
            "verdicts": [verdict._asdict() | {"met": verdict.met} for verdict in verdicts],
        }
        options.json.write_text(json.dumps(report, indent=2))
    return 0 if all_met(verdicts) else 1


def solved(arm: SerialChain, q: Array, position: Array) -> bool:
    """Whether q (n,) puts the hand on `position` (3,) with the handle and the joints where they belong."""
    distance = float(np.linalg.norm(arm.pose(q)[:3, 3] - position))
    beyond = float(np.max(np.maximum(arm.lower - q, q - arm.upper)))
    return distance <= POSITION and handle_tilt(arm, q) <= TILT + TILT_SLACK and beyond <= BOUND_SLACK


def cold(arm: SerialChain, arm_ik: ArmIK, options: argparse.Namespace) -> tuple[list[Verdict], list[str]]:
    """Random reachable targets, each solved with no start given; beside it ipopt once from the middle of the ranges."""
    targets = reachable(arm, options.targets, tilt=TILT)
    single = position_ik(arm, tilt=TILT, solver="ipopt")
    middle = (arm.lower + arm.upper) / 2
    ours, ipopt = np.empty(len(targets)), np.empty(len(targets))
    good, ipopt_good, cost, ipopt_cost = [], [], [], []
    for i, target in enumerate(targets):  # alternating: a drift of the machine hits both
        begun = time.perf_counter()
        answer = arm_ik.solve(target)
        ours[i] = time.perf_counter() - begun
        begun = time.perf_counter()
        once = single(middle, target)
        ipopt[i] = time.perf_counter() - begun
        good.append(answer.status.certified and solved(arm, answer.q, target))
        ipopt_good.append(once.found and solved(arm, once.q, target))
        cost.append(posture_cost(arm, answer.q))
        ipopt_cost.append(posture_cost(arm, once.q))
    both = np.array(good) & np.array(ipopt_good)
    worse = np.array(cost)[both] > np.array(ipopt_cost)[both] * (1 + 1e-6)
    lines = [
        f"ArmIK {_spread(ours)}",
        f"ipopt, one start: {_spread(ipopt)}, solved {np.mean(ipopt_good):.2%}",
        f"posture cost above ipopt's in {worse.mean():.1%}, below in "
        f"{np.mean(np.array(cost)[both] < np.array(ipopt_cost)[both] * (1 - 1e-6)):.1%} of the targets both solved",
    ]
    ratio = float(np.median(ours) / np.median(ipopt))
    return [
        Verdict(f"share of {len(targets)} targets solved", float(np.mean(good)), ">=", 1.0),
        Verdict("median / median of one ipopt solve", ratio, "<=", 1 / 3),
    ], lines


def warm(arm: SerialChain, arm_ik: ArmIK, options: argparse.Namespace) -> tuple[list[Verdict], list[str]]:
    """Paths at 100 Hz; beside ArmIK.follow fatrop, each sample from the one before: the faster of two settings."""
    settings = {name: position_ik(arm, tilt=TILT, solver=name) for name in ("fatrop", "fatrop, small barrier")}
    paths = {"figure-eight": figure_eight(arm, options.samples, tilt=TILT)}
    for seed in range(options.paths):
        paths[f"random {seed}"] = random_path(arm, options.samples, tilt=TILT, seed=seed)
    verdicts, lines = [], []
    for name, path in paths.items():
        begun = time.perf_counter()
        followed = arm_ik.follow(path)
        whole = (time.perf_counter() - begun) / len(path)
        good = [
            status.certified and solved(arm, q, point)
            for status, q, point in zip(followed.status, followed.q, path, strict=True)
        ]
        step = float(np.abs(np.diff(followed.q, axis=0)).max()) / 0.01
        lines.append(
            f"{name}: ArmIK {_spread(followed.seconds)}, whole call {whole * 1e3:.3f} ms a sample, "
            f"fastest joint {step:.2f} rad/s"
        )
        base = math.inf
        for setting, solver in settings.items():
            yardstick, found = _followed(arm, solver, path)
            lines.append(f"{name}: {setting} {_spread(yardstick)}, solved by its own word {found.mean():.1%}")
            # Samples that fatrop gave up on took it longer; they do not count against it.
            if found.any():
                base = min(base, float(np.median(yardstick[found])))
        ratio = float(np.median(followed.seconds)) / base if base < math.inf else math.nan
        verdicts += [
            Verdict(f"{name}, share solved", float(np.mean(good)), ">=", 1.0),
            Verdict(f"{name}, median / fatrop's", ratio, "<=", 1 / 3),
        ]
    return verdicts, lines


def beyond(arm: SerialChain, arm_ik: ArmIK, options: argparse.Namespace) -> tuple[list[Verdict], list[str]]:
    """Targets 10 to 300 mm outside; beside ArmIK the best of many local solves from random joint angles."""
    targets = unreachable(arm, options.unreachable, tilt=TILT)
    nearest = nearest_point(arm, tilt=TILT)
    random = np.random.default_rng(1)
    seconds = np.empty(len(targets))
    excess, said, told = [], [], []
    for i, target in enumerate(targets):
        begun = time.perf_counter()
        answer = arm_ik.solve(target)
        seconds[i] = time.perf_counter() - begun
        distance = float(np.linalg.norm(arm.pose(answer.q)[:3, 3] - target))
        within = solved(arm, answer.q, arm.pose(answer.q)[:3, 3])
        best = nearest_distance(arm, nearest, target, options.starts, random)
        excess.append(distance - best if within else math.inf)
        said.append(answer.status is Status.UNREACHABLE)
        told.append(abs(answer.position_error - distance))
    lines = [f"ArmIK {_spread(seconds)}", f"nearer than the best of {options.starts} by up to {-min(excess):.1e} m"]
    return [
        Verdict(f"further than the best of {options.starts} random starts", max(excess), "<=", POSITION, "m"),
        Verdict(f"share of {len(targets)} targets called unreachable", float(np.mean(said)), ">=", 1.0),
        Verdict("error of the distance given", max(told), "<=", 1e-9, "m"),
    ], lines


def _followed(arm: SerialChain, solver: Baseline, path: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Seconds and success of each sample, warm-started by the last one that succeeded."""
    middle = (arm.lower + arm.upper) / 2
    last: Answer | None = None
    seconds, found = np.empty(len(path)), np.zeros(len(path), dtype=np.bool_)
    for i, point in enumerate(path):
        begun = time.perf_counter()
        answer = solver(middle if last is None else last.q, point, last)
        seconds[i] = time.perf_counter() - begun
        found[i] = answer.found
        last = answer if answer.found else None
    return seconds, found


def _spread(seconds: Array) -> str:
    median, p99, most = np.percentile(1e3 * np.asarray(seconds), (50, 99, 100))
    return f"median {median:.3f} ms, p99 {p99:.3f}, max {most:.3f}"


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m bench.arm_ik", description=__doc__)
    parser.add_argument("--ranges", nargs="+", default=["regular", "restricted"], choices=["regular", "restricted"])
    parts = ["cold", "warm", "unreachable"]
    parser.add_argument("--parts", nargs="+", default=parts, choices=parts)
    parser.add_argument("--targets", type=int, default=1000, help="reachable targets of each range")
    parser.add_argument("--samples", type=int, default=1000, help="samples of each path")
    parser.add_argument("--paths", type=int, default=3, help="random paths beside the figure-eight")
    parser.add_argument("--unreachable", type=int, default=50, help="unreachable targets of each range")
    parser.add_argument("--starts", type=int, default=200, help="local solves an unreachable target is judged by")
    parser.add_argument("--json", type=Path, help="write the numbers here too")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())
