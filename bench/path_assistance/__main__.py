"""Help along handwriting that nobody has seen, beside none: `python -m bench.path_assistance`.

Traces of the seeds 1000 to 1099 (`--first`, `--traces`) and the recorded pen trace, each traced by two simulated people
(by the clock; ahead of where they see themselves) in four trials of the same moods, with help and without. Prints one
line a number, asked and measured, and the worst traces; exit code 1 where one is missed. `--write` puts it into
bench/RESULTS.md.
"""

from __future__ import annotations

import argparse
import math
import os
import shlex
import sys
from collections.abc import Sequence
from functools import cache
from multiprocessing import Pool
from pathlib import Path
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from bench.path_assistance.judge import Seen, judged
from bench.path_assistance.traces import handwriting
from bench.results import RESULTS, write_section
from bench.verdict import Verdict
from rehab_opt import PathAssistance, Workspace
from rehab_opt.plants.force_robot import RobotModel
from rehab_opt.plants.hand_robot import WithoutDelay
from rehab_opt.plants.intention import AIMS, Aims, traced
from rehab_opt.plants.simulated_person import Person
from rehab_opt.session.files import load_problem
from rehab_opt.session.scenario.laws import Assisted, ForceLaw
from rehab_opt.session.scenario.loop import Scene, simulate_trial
from rehab_opt.session.scenario.precomputed import precompute

__all__ = ["Measured", "main", "measured", "verdicts"]

Array = NDArray[np.float64]

RECORDED = -1
"""Stands for the seed of the recorded pen trace."""
HEADING = "## Help along a path"
WIDTH, SECONDS, REST, DT = 0.003, 20.0, 1.0, 2e-3
SIDES = (0.052, 0.070)
"""[m] Of the ellipse that stands for the comfortable workspace: as large as that of the shipped scenarios."""


class Measured(NamedTuple):
    """One trace and one person: means over the trials."""

    seed: int
    aims: Aims
    without: float
    """Share covered in order."""
    helped: float
    ratio: float
    """Of the deviations."""
    stuck: float
    """[s] with help, of all trials."""

    @property
    def covers(self) -> bool:
        """As much as was asked."""
        return self.helped >= min(0.98, self.without) - 1e-9


@cache
def workspace(*, wide: bool) -> Workspace:
    """Where the person is strong: an ellipse, or more than the traces need."""
    if wide:
        return Workspace(shapely.box(-0.3, -0.3, 0.3, 0.3), accuracy=0.0)
    ellipse = shapely.affinity.scale(shapely.Point(0, 0).buffer(0.5, quad_segs=8), *SIDES)
    return Workspace(ellipse, accuracy=0.0)


@cache
def trace_of(seed: int, *, wide: bool) -> tuple[Array, Workspace, float]:
    """(N, 2) [m] a trace, where it is traced, and in how many seconds."""
    if seed == RECORDED:
        ready = precompute(load_problem("upper_limb/scenario_4_pen_trace"), progress=lambda *_: None)
        return ready.reference, ready.comfortable, 30.0
    rng = np.random.default_rng((seed, 7))
    sizes = ((0.08, 0.2), (0.06, 0.15)) if wide else ((0.012, 0.03), (0.03, 0.045))
    path = handwriting(seed, width=rng.uniform(*sizes[0]), height=rng.uniform(*sizes[1]))
    return path, workspace(wide=wide), SECONDS


def measured(seed: int, aims: Aims, *, trials: int, wide: bool = False) -> Measured:
    """Trials of one person along one trace, without and with help."""
    path, comfortable, seconds = trace_of(seed, wide=wide)
    scene = Scene(
        comfortable=comfortable,
        person=Person(aims=aims),
        robot=WithoutDelay(RobotModel()),
        intention=traced(path, seconds=seconds, rest=REST, dt=DT),
        within=None,
        dt=DT,
    )
    helper = PathAssistance(
        path, stiffness=3000.0, width=WIDTH, damping=40.0, comfortable=comfortable, trust_stillness=True, dt=DT
    )
    laws: dict[str, ForceLaw] = {"unassisted": ForceLaw(), "assisted": Assisted(helper)}
    found = {}
    for name, law in laws.items():
        seen = [simulate_trial(scene, law, number=k, seed=abs(seed) * 10 + k) for k in range(trials)]
        found[name] = np.array(
            [
                judged(Seen(each["_hand"], each["force_commanded"], each["intended"], DT), path, width=WIDTH)
                for each in seen
            ]
        )
    without, helped = found["unassisted"], found["assisted"]
    ratio = math.sqrt((helped[:, 1] ** 2).mean() / (without[:, 1] ** 2).mean())
    return Measured(seed, aims, without[:, 0].mean(), helped[:, 0].mean(), ratio, helped[:, 2].sum())


def verdicts(results: Sequence[Measured]) -> list[Verdict]:
    """What was asked of one person."""
    fraction = sum(each.covers for each in results) / len(results)
    lost = max(each.without - each.helped for each in results)
    ratios = [each.ratio for each in results]
    of = f"{results[0].aims}: "
    return [
        Verdict(of + "traces covered as without help, or 98 %", fraction, ">=", 0.95),
        Verdict(of + "largest loss of coverage", lost, "<=", 0.05),
        Verdict(of + "deviation, with help / without, median", float(np.median(ratios)), "<=", 0.5),
        Verdict(of + "deviation, with help / without, largest", max(ratios), "<=", 1.0),
        Verdict(of + "held though meant to go on", sum(each.stuck for each in results), "<=", 0.0, "s"),
    ]


def lines_of(results: Sequence[Measured]) -> list[str]:
    """Numbers asked and measured, and the worst traces."""
    told = [str(each) for each in verdicts(results)]
    covered = [100 * float(np.mean([getattr(each, key) for each in results])) for key in ("without", "helped")]
    told.append(
        f"NOTE  {results[0].aims}: covered in order, mean: {covered[0]:.1f} % without help, {covered[1]:.1f} % with"
    )
    worst = sorted(results, key=lambda each: (each.covers, each.helped - each.without))[:3]
    worst += [each for each in sorted(results, key=lambda each: -each.ratio)[:2] if each not in worst]
    told += [
        f"      {'recorded' if each.seed == RECORDED else each.seed}: covered {each.without:.3f} -> {each.helped:.3f}, "
        f"deviation x {each.ratio:.2f}"
        for each in worst
    ]
    return told


def _one(job: tuple[int, Aims, int, bool]) -> Measured:
    seed, aims, trials, wide = job
    return measured(seed, aims, trials=trials, wide=wide)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run and judge."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--first", type=int, default=1000, help="seed of the first trace")
    parser.add_argument("--traces", type=int, default=100)
    parser.add_argument("--trials", type=int, default=4)
    parser.add_argument("--wide", action="store_true", help="traces of 8 to 20 cm in place of 1 to 4 cm")
    parser.add_argument("--processes", type=int, default=os.cpu_count())
    parser.add_argument("--write", action="store_true", help="into bench/RESULTS.md")
    options = parser.parse_args(arguments)
    seeds = list(range(options.first, options.first + options.traces))
    if not options.wide and Path(os.environ.get("REHAB_OPT_DATA", "")).joinpath("pen_trace").is_dir():
        seeds.append(RECORDED)
    size = "8 to 20 cm" if options.wide else "1 to 4 cm"
    about = f"{len(seeds)} traces of {size}, seeds {seeds[0]} to {options.first + options.traces - 1}"
    about += ", and the recorded pen trace" if seeds[-1] == RECORDED else ""
    print(f"{about}; {options.trials} trials each, width {1e3 * WIDTH:g} mm", flush=True)
    lines: list[str] = []
    met = True
    with Pool(options.processes) as pool:
        for aims in AIMS:
            results = pool.map(_one, [(seed, aims, options.trials, options.wide) for seed in seeds], chunksize=1)
            lines += lines_of(results)
            met = met and all(each.met for each in verdicts(results))
            print("\n".join(lines_of(results)), flush=True)
    if options.write:
        command = shlex.join(["path_assistance", *(sys.argv[1:] if arguments is None else arguments)])
        shown = [f"    {line}" for line in lines if not line.startswith(" ")]  # the worst traces are only printed
        said = [f"{HEADING}, {about}", "", f"    python -m bench.{command}", "", *shown]
        write_section(RESULTS, "path_assistance wide" if options.wide else "path_assistance", said)
    return 0 if met else 1


if __name__ == "__main__":
    sys.exit(main())
