"""The published tangent law over a grid of its gain and damping: `python -m bench.tangent_law`.

The paper gives neither number. Each pair of the grid follows the shipped recordings, and a drive gets its joints, as
in a run. The best pair follows the largest part of the paths to 1 mm (percent of length, mean over the recordings);
the least mean error decides between equals. Exit code 1 where that is not the default of `TangentLaw`.
"""

from __future__ import annotations

import argparse
import itertools
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from rich.console import Console

from rehab_opt.published.tangent_law import DAMPING, GAIN
from rehab_opt.session.files import load_problem
from rehab_opt.session.run import run_problem

__all__ = ["DAMPINGS", "ERRORS", "GAINS", "RECORDINGS", "best", "driven", "main"]

Pair = tuple[float, float]
Runs = tuple[Mapping[str, Any], ...]
RECORDINGS = ("figure_eight", "pen_trace", "mocap_lift", "mocap_box")
GAINS = (1000.0, 500.0, 200.0, 100.0, 50.0, 20.0)
"""[1/s] k0; a problem file takes up to 1000."""
DAMPINGS = (1e-4, 1e-6, 1e-8)
"""mu"""
FOLLOWED, ERRORS = "followed_fraction_of_length", tuple(f"position_error_{of}_m" for of in ("mean", "p95", "max"))


def driven(recording: str, gain: float, damping: float) -> Mapping[str, Any]:
    """Numbers of the drive with the law's joints: `published.drive` of metrics.json."""
    config = load_problem(f"upper_limb/{recording}")
    published = config.problem.published.model_copy(update={"gain_per_s": gain, "damping": damping})
    tuned = replace(config, problem=config.problem.model_copy(update={"published": published}))
    numbers: Mapping[str, Any] = run_problem(tuned, law="published").metrics["published"]["drive"]
    return numbers


def best(grid: Mapping[Pair, Runs]) -> Pair:
    """The pair that the module's docstring says, of the runs by pair."""
    return max(grid, key=lambda pair: (round(_mean(grid[pair], FOLLOWED), 9), -_mean(grid[pair], ERRORS[0])))


def _mean(runs: Runs, key: str) -> float:
    return float(np.mean([run[key] for run in runs]))


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the grid, pair by pair; 1 where its best is not the default."""
    parser = argparse.ArgumentParser(prog="python -m bench.tangent_law", description=__doc__)
    parser.add_argument("--recordings", nargs="+", default=RECORDINGS, choices=RECORDINGS)
    parser.add_argument("--gains", nargs="+", type=float, default=GAINS)
    parser.add_argument("--dampings", nargs="+", type=float, default=DAMPINGS)
    options = parser.parse_args(arguments)
    console, grid = Console(highlight=False, soft_wrap=True), dict[Pair, Runs]()
    console.print("followed by a drive to 1 mm, % of length; position error mean / p95 / max, mm")
    for pair in itertools.product(options.gains, options.dampings):
        runs = grid[pair] = tuple(driven(recording, *pair) for recording in options.recordings)
        cells = [
            f"{recording} {100 * run[FOLLOWED]:.1f}; {' / '.join(f'{1e3 * run[error]:.3g}' for error in ERRORS)}"
            for recording, run in zip(options.recordings, runs, strict=True)
        ]
        mean = f"mean {100 * _mean(runs, FOLLOWED):.1f}; {1e3 * _mean(runs, ERRORS[0]):.3g}"
        console.print(f"k0 = {pair[0]:g}/s, mu = {pair[1]:g}:  " + "  |  ".join([*cells, mean]))
    found = best(grid)
    console.print(f"best: k0 = {found[0]:g}/s, mu = {found[1]:g}; default: k0 = {GAIN:g}/s, mu = {DAMPING:g}")
    return 0 if found == (GAIN, DAMPING) else 1


if __name__ == "__main__":
    sys.exit(main())
