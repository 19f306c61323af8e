"""ThinPlateSpline beside scipy's RBFInterpolator on the same landmarks: `python -m bench.spline`.

Prints one line a number, asked and measured; exit code 1 where one is missed. Both sides are timed in turn, round
after round, and the least of each is compared, so that neither gains from a quiet moment. Landmarks are those of a
mild map, since neither side's time depends on the numbers.
"""

from __future__ import annotations

import argparse
import sys
import time
import tracemalloc
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from scipy.interpolate import RBFInterpolator

from bench.machine import machine
from bench.verdict import Verdict, all_met, print_verdicts
from rehab_opt.workspace.spline import ThinPlateSpline

__all__ = ["main"]

Array = NDArray[np.float64]


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure what is asked for and judge it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--points", type=int, default=100_000, help="of the large array")
    parser.add_argument("--landmarks", type=int, default=2000, help="of the large fit")
    options = parser.parse_args(arguments)
    console = Console()
    console.print("  ".join(f"{key}: {value}" for key, value in machine().items()), highlight=False)
    verdicts: list[Verdict] = []
    for measured, lines in (
        *(one_point(n, options.rounds) for n in (20, 200)),
        many_points(options.points, max(3, options.rounds // 5)),
        large_fit(options.landmarks),
        round_trip(),
    ):
        for line in lines:
            console.print(line, highlight=False, soft_wrap=True)
        print_verdicts(console, measured)
        verdicts += measured
    return 0 if all_met(verdicts) else 1


def landmarks(n: int, seed: int = 0) -> tuple[Array, Array]:
    """Sources in a rectangle the size of a workspace; targets a smooth image of them."""
    source = np.random.default_rng(seed).uniform((-0.4, 0.1), (0.2, 0.5), (n, 2))
    return source, source @ np.array([[0.8, 0.1], [-0.2, 0.7]]) + 0.02 * np.sin(9 * source[:, ::-1])


def one_point(n: int, rounds: int) -> tuple[list[Verdict], list[str]]:
    """One call with one point."""
    source, target = landmarks(n)
    spline = ThinPlateSpline(source, target)
    scipy = RBFInterpolator(source, target, kernel="thin_plate_spline")
    begun = time.perf_counter()
    spline.value_and_jacobian(spline(source[0]))
    made = time.perf_counter() - begun
    scattered = np.random.default_rng(3).uniform((-0.4, 0.1), (0.2, 0.5), (1000, 2))
    angle = np.linspace(0, 2 * np.pi, 1000)
    path = (-0.1, 0.3) + 0.1 * np.column_stack((np.cos(angle), np.sin(angle)))  # a round in one second of ticks
    images = spline(path)
    difference = float(np.abs([spline(p) - scipy(p[np.newaxis])[0] for p in scattered]).max())
    ours, both, back, theirs = in_turn(
        [
            over(scattered, spline),
            over(path, spline.value_and_jacobian),
            over(images, spline.inverse),
            over(scattered[:, np.newaxis], scipy),
        ],
        rounds,
        repeats=1,
    )
    ours, both, back, theirs = (1e-3 * t for t in (ours, both, back, theirs))
    lines = [
        f"{n} landmarks, one point: {1e6 * ours:.2f} us, "
        f"with its Jacobian {1e6 * both:.2f} us, inverse {1e6 * back:.1f} us; scipy {1e6 * theirs:.2f} us; "
        f"all that is made once {made:.2f} s",
    ]
    return [
        Verdict(f"one point through {n} landmarks, share of scipy's time", ours / theirs, "<=", 0.2),
        Verdict(f"the same point, difference from scipy with {n} landmarks", difference, "<=", 1e-10, "m"),
    ], lines


def over(points: Array, call: Callable[[Array], object]) -> Callable[[], None]:
    """All of the points, one a call."""
    single = list(points)

    def loop() -> None:
        for point in single:
            call(point)

    return loop


def many_points(count: int, rounds: int) -> tuple[list[Verdict], list[str]]:
    """A large array through 200 landmarks."""
    source, target = landmarks(200)
    spline = ThinPlateSpline(source, target)
    scipy = RBFInterpolator(source, target, kernel="thin_plate_spline")
    points = np.random.default_rng(1).uniform((-0.4, 0.1), (0.2, 0.5), (count, 2))
    tracemalloc.start()
    spline(points)
    peak = tracemalloc.get_traced_memory()[1] / 1e6
    tracemalloc.stop()
    ours, theirs = in_turn([lambda: spline(points), lambda: scipy(points)], rounds, repeats=1)
    lines = [
        f"{count} points, 200 landmarks: {ours:.3f} s, at most {peak:.1f} MB with the result; scipy {theirs:.3f} s"
    ]
    return [Verdict(f"{count} points through 200 landmarks, share of scipy's time", ours / theirs, "<=", 0.5)], lines


def large_fit(n: int) -> tuple[list[Verdict], list[str]]:
    """A fit with thousands of landmarks: its time and how well it meets them."""
    source, target = landmarks(n)
    begun = time.perf_counter()
    spline = ThinPlateSpline(source, target)
    taken = time.perf_counter() - begun
    begun = time.perf_counter()
    scipy = RBFInterpolator(source, target, kernel="thin_plate_spline")
    theirs = time.perf_counter() - begun
    residual = float(np.abs(spline(source) - target).max())
    lines = [
        f"fit of {n} landmarks: {taken:.2f} s, scipy {theirs:.2f} s; "
        f"scipy's residual {np.abs(scipy(source) - target).max():.1e} m",
    ]
    return [
        Verdict(f"fit of {n} landmarks", taken, "<=", 3.0, "s"),
        Verdict(f"residual at {n} landmarks", residual, "<=", 1e-9, "m"),
    ], lines


def round_trip() -> tuple[list[Verdict], list[str]]:
    """There and back through a map of 200 landmarks."""
    spline = ThinPlateSpline(*landmarks(200))
    points = np.random.default_rng(2).uniform((-0.4, 0.1), (0.2, 0.5), (20_000, 2))
    images = spline(points)
    begun = time.perf_counter()
    found = spline.inverse(images)
    taken = time.perf_counter() - begun
    error = float(np.abs(spline(found) - images).max())
    away = float(np.abs(found - points).max())
    lines = [f"{len(points)} points back through 200 landmarks: {taken:.2f} s, {away:.1e} m from where they came"]
    return [Verdict("round trip through 200 landmarks", error, "<=", 1e-9, "m")], lines


def in_turn(calls: list[Callable[[], object]], rounds: int, *, repeats: int) -> list[float]:
    """Least mean time of `repeats` calls [s], each call taking its turn in every round."""
    best = [float("inf")] * len(calls)
    for _ in range(rounds):
        for i, call in enumerate(calls):
            begun = time.perf_counter()
            for _ in range(repeats):
                call()
            best[i] = min(best[i], (time.perf_counter() - begun) / repeats)
    return best


if __name__ == "__main__":
    sys.exit(main())
