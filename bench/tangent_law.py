"""The published tangent law over a grid of its gain and damping: `python -m bench.tangent_law`.

The paper gives neither. Each pair of the grid follows every shipped recording; the pair is judged by what a drive makes
of its joints, as a run's table does: best is the most path followed, the mean over the recordings, then the least mean
error. Exit code 1 where the best pair is not the default of `TangentLaw`.
"""

from __future__ import annotations

import argparse
import itertools
import sys
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table

from rehab_opt.published.tangent_law import DAMPING, GAIN
from rehab_opt.session.files import ProblemFile, load_problem
from rehab_opt.session.run import run_problem
from rehab_opt.session.shown import millimetres
from rehab_opt.session.upper_limb.problem import UpperLimb

__all__ = ["DAMPINGS", "GAINS", "RECORDINGS", "Setting", "best", "main", "measured"]

RECORDINGS = ("figure_eight", "pen_trace", "mocap_lift", "mocap_box")
GAINS = (20.0, 50.0, 100.0, 200.0, 500.0, 1000.0)
"""[1/s] k0"""
DAMPINGS = (1e-4, 1e-6, 1e-8)
"""mu"""


class Setting(NamedTuple):
    """A pair of the grid and the numbers of its runs."""

    gain: float
    damping: float
    runs: tuple[dict[str, Any], ...]
    """`published.drive` of metrics.json, by recording."""

    @property
    def order(self) -> tuple[float, float]:
        """Less is better: path not followed, mean error [m], means over the recordings."""
        missed = np.mean([1.0 - run["followed_fraction_of_length"] for run in self.runs])
        return round(float(missed), 9), float(np.mean([run["position_error_mean_m"] for run in self.runs]))


def measured(config: ProblemFile[UpperLimb], gain: float, damping: float) -> dict[str, Any]:
    """What a drive makes of one recording."""
    published = config.problem.published.model_copy(update={"gain_per_s": gain, "damping": damping})
    tuned = replace(config, problem=config.problem.model_copy(update={"published": published}))
    drive: dict[str, Any] = run_problem(tuned, law="published").metrics["published"]["drive"]
    return drive


def best(settings: Sequence[Setting]) -> Setting:
    """The first in the order of the module's docstring."""
    return min(settings, key=lambda setting: setting.order)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the grid; 1 where its best is not the default."""
    parser = argparse.ArgumentParser(prog="python -m bench.tangent_law", description=__doc__)
    parser.add_argument("--recordings", nargs="+", default=list(RECORDINGS), choices=RECORDINGS)
    parser.add_argument("--gains", nargs="+", type=float, default=list(GAINS))
    parser.add_argument("--dampings", nargs="+", type=float, default=list(DAMPINGS))
    options = parser.parse_args(arguments)
    configs = [load_problem(f"upper_limb/{name}") for name in options.recordings]
    grid = Table("k0, 1/s", "mu", *options.recordings, "mean", title="followed by a drive, % of length; error, mm")
    settings = []
    for gain, damping in itertools.product(options.gains, options.dampings):
        runs = tuple(measured(config, gain, damping) for config in configs)
        settings.append(Setting(gain, damping, runs))
        followed = [100 * run["followed_fraction_of_length"] for run in runs]
        errors = map(millimetres("position_error"), runs)
        cells = [f"{percent:.1f}; {error}" for percent, error in zip(followed, errors, strict=True)]
        missed, error = settings[-1].order
        grid.add_row(f"{gain:g}", f"{damping:g}", *cells, f"{100 * (1 - missed):.1f}; {1e3 * error:.3g}")
    Console(width=200).print(grid)
    found = best(settings)
    print(f"best: k0 = {found.gain:g}/s, mu = {found.damping:g}; default: k0 = {GAIN:g}/s, mu = {DAMPING:g}")
    return 0 if (found.gain, found.damping) == (GAIN, DAMPING) else 1


if __name__ == "__main__":
    sys.exit(main())
