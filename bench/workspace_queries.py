"""One point asked of a `Workspace` beside shapely: `python -m bench.workspace_queries`.

Both get the same points, shapely as plain floats to a prepared geometry, which is its fastest form for one point.
Points lie within twice the size of the workspace, and within ten times: a hand is often far from a small comfortable
one. Rounds alternate; the ratio is the median of the rounds' own. Times are of this process on its processor: other
work on the machine does not count. The look-up's making is measured on a smooth outline of 500 corners too.
"""

from __future__ import annotations

import argparse
import math
import statistics
import sys
import time
from collections.abc import Callable, Sequence

import numpy as np
import shapely
from rich.console import Console
from rich.table import Table

from bench.machine import machine
from bench.verdict import Verdict, all_met, print_verdicts
from rehab_opt import human_arm
from rehab_opt.workspace.reach import planar_workspace
from rehab_opt.workspace.region import Workspace

__all__ = ["main"]

REACHES = (2.0, 10.0)


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure both Table I slices and judge."""
    parser = argparse.ArgumentParser(prog="python -m bench.workspace_queries", description=__doc__)
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--points", type=int, default=2000)
    options = parser.parse_args(arguments)
    console = Console()
    console.print("  ".join(f"{key}: {value}" for key, value in machine().items()), highlight=False)
    table = Table(
        "workspace", "corners", "points within", "question", "ours, us", "shapely, us", "ratio", "look-up, ms"
    )
    ratios: dict[str, list[float]] = {"contains": [], "signed distance": []}
    furthest = 0.0
    for name in ("regular", "restricted"):
        workspace = planar_workspace(human_arm(range_of_motion=name))
        built = _making(workspace.polygon)
        for reach in REACHES:
            points = _spread(workspace, reach, options.points)
            furthest = max(furthest, _error(workspace, points))
            for question, (ours, theirs) in _pairs(workspace).items():
                own, other, ratio = _alternated(ours, theirs, points, options.rounds)
                ratios[question].append(ratio)
                row = (name, shapely.get_num_coordinates(workspace.polygon), f"{reach:g} sizes", question)
                table.add_row(*map(str, row), f"{own:.2f}", f"{other:.2f}", f"{ratio:.2f}", f"{built:.0f}")
    console.print(table)
    verdicts = [
        Verdict("contains / shapely.contains_xy, worst", max(ratios["contains"]), "<=", 1.2),
        Verdict("signed distance / shapely.distance to the boundary, worst", max(ratios["signed distance"]), "<=", 0.5),
        Verdict("making the look-up of 500 corners", _making(_outline(500)), "<=", 50.0, "ms"),
        Verdict("largest difference from shapely's distance", furthest, "<=", 1e-12, "m"),
    ]
    print_verdicts(console, verdicts)
    return 0 if all_met(verdicts) else 1


def _making(polygon: shapely.Polygon | shapely.MultiPolygon) -> float:
    """[ms] the first question takes, median of several workspaces."""
    each = []
    for _ in range(9):
        workspace = Workspace(polygon, accuracy=1e-3)
        began = time.process_time()
        workspace.distance((0.0, 0.0))
        each.append(1e3 * (time.process_time() - began))
    return statistics.median(each)


def _outline(corners: int) -> shapely.Polygon:
    """A star with five rounded tips: from its centre many edges are equally near."""
    angle = np.linspace(0, 2 * math.pi, corners, endpoint=False)
    radius = 0.2 + 0.05 * np.sin(5 * angle)
    return shapely.Polygon(np.column_stack((radius * np.cos(angle), radius * np.sin(angle))))


def _spread(workspace: Workspace, reach: float, count: int) -> np.ndarray:
    low_x, low_y, high_x, high_y = workspace.polygon.bounds
    size = reach * max(high_x - low_x, high_y - low_y)
    middle = ((low_x + high_x) / 2, (low_y + high_y) / 2)
    return middle + size * np.random.default_rng(0).uniform(-0.5, 0.5, (count, 2))


def _error(workspace: Workspace, points: np.ndarray) -> float:
    exact = shapely.distance(workspace.polygon.boundary, shapely.points(points))
    return float(np.abs(np.abs(workspace.distance(points)) - exact).max())


def _pairs(workspace: Workspace) -> dict[str, tuple[Callable[[np.ndarray], object], Callable[[np.ndarray], object]]]:
    polygon, ring = workspace.polygon, workspace.polygon.boundary
    shapely.prepare((polygon, ring))
    return {
        "contains": (workspace.contains, lambda point: shapely.contains_xy(polygon, *point.tolist())),
        "signed distance": (workspace.distance, lambda point: shapely.distance(ring, shapely.points(point))),
    }


def _alternated(
    ours: Callable[[np.ndarray], object], theirs: Callable[[np.ndarray], object], points: np.ndarray, rounds: int
) -> tuple[float, float, float]:
    """Median microseconds a point of either, and the median of the rounds' ratios."""
    each = list(points)
    times: tuple[list[float], list[float]] = ([], [])
    for number in range(rounds + 1):
        for ask, kept in zip((ours, theirs), times, strict=True):
            began = time.process_time()
            for point in each:
                ask(point)
            if number:  # the first round warms up
                kept.append(1e6 * (time.process_time() - began) / len(each))
    ratios = [own / other for own, other in zip(*times, strict=True)]
    return statistics.median(times[0]), statistics.median(times[1]), statistics.median(ratios)


if __name__ == "__main__":
    sys.exit(main())
