"""Maps between workspaces of Rossa et al. and of random people, both ways, beside the published rule: `python -m
bench.workspace_maps`; `--people 0` for the paper's alone. Its W_c is read from Table I and from the caption of Fig. 3.

A person: every limit of Table I's regular range is normal about the printed one with a standard deviation of 6 deg,
cut at two of them (between people, goniometric limits of the upper limb vary by 5 to 10 deg); segment lengths are
normal about the participant's with 5 %; either side. Their restricted range: of every joint a share of the width
between 0.3 and 0.9, evenly drawn, at an evenly drawn place of the regular one. Height and tilt as in the paper. People
are drawn until as many as asked for have two workspaces in one piece without holes; the others are counted.
"""

from __future__ import annotations

import argparse
import math
import pickle
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table

from bench.machine import machine
from bench.verdict import Verdict, all_met, print_verdicts
from rehab_opt import SerialChain, human_arm
from rehab_opt.kinematics.human_arm import ARM_SEGMENTS
from rehab_opt.workspace.audit import MAX_STRETCH, Audit
from rehab_opt.workspace.mapping import WorkspaceMap
from rehab_opt.workspace.reach import planar_workspace
from rehab_opt.workspace.region import Workspace
from rehab_opt.workspace.variation import varied_ranges

__all__ = ["arms_of", "main", "people"]

LIMIT_SPREAD_DEG = 6.0
SEGMENT_SPREAD = 0.05
SUBRANGE = (0.3, 0.9)
POLAR_LANDMARKS = 20
READINGS = {"Table I": "restricted", "Fig. 3": "figure_3"}
"""Of the paper's W_c."""


class Pair(NamedTuple):
    """Regular and restricted workspace of one person."""

    name: str
    regular: Workspace
    restricted: Workspace


class Outcome(NamedTuple):
    """One map."""

    name: str
    safe: Audit
    polar: Audit
    coefficients: int
    seconds: float


def main(arguments: Sequence[str] | None = None) -> int:
    """Build and audit all maps, print a row for each and the verdicts."""
    options = _options(arguments)
    console = Console(width=150)
    console.print("  ".join(f"{key}: {value}" for key, value in machine().items()), highlight=False)
    regular = planar_workspace(human_arm(range_of_motion="regular"))
    pairs = [
        Pair(name, regular, planar_workspace(human_arm(range_of_motion=range_of_motion)))
        for name, range_of_motion in READINGS.items()
    ]
    passed_over: Counter[str] = Counter()
    pairs += list(_cached(options.cache, options.people, options.seed, passed_over))
    table = Table(title=f"{len(pairs)} pairs, {options.samples} points each; stretch over the pair's overall ratio")
    for column in (
        "map",
        "cm2",
        "folded",
        "outside",
        "stretch",
        "used",
        "det >=",
        "mm inside",
        "coefs",
        "s",
        "polar: folded",
    ):
        table.add_column(column, justify="left" if column == "map" else "right", no_wrap=True)
    table.add_column("outside", justify="right")
    outcomes = []
    for pair in pairs:
        for name, source, target in (
            (f"{pair.name} Wr->Wc", pair.regular, pair.restricted),
            (f"{pair.name} Wc->Wr", pair.restricted, pair.regular),
        ):
            outcomes.append(outcome(name, source, target, options.samples))
            table.add_row(*row(outcomes[-1], source, target))
            if not outcomes[-1].safe.passed:
                console.print(f"{name}: {'; '.join(outcomes[-1].safe.reasons)}", highlight=False, soft_wrap=True)
    console.print(table)
    console.print(
        "passed over while drawing people: " + (", ".join(f"{n} {why}" for why, n in passed_over.items()) or "none")
    )
    for line in yardstick_lines(outcomes):
        console.print(line, highlight=False)
    verdicts = [*table_verdicts(outcomes), *people_verdicts(outcomes, options.people)]
    print_verdicts(console, verdicts)
    return 0 if all_met(verdicts) else 1


def people(count: int, seed: int, passed_over: Counter[str]) -> Iterator[Pair]:
    """As many people as asked for whose workspaces admit a one-to-one map; why others do not is counted."""
    found, drawn = 0, 0
    while found < count:
        pair = person(seed, drawn)
        drawn += 1
        why = _unusable(pair)
        if why:
            passed_over[why] += 1
        else:
            found += 1
            yield pair


def person(seed: int, number: int) -> Pair:
    """The person of that number."""
    return Pair(f"person {number}", *(planar_workspace(arm) for arm in arms_of(seed, number)))


def arms_of(seed: int, number: int) -> tuple[SerialChain, SerialChain]:
    """The arm of the person of that number, with their regular and their restricted range."""
    random = np.random.default_rng([seed, number])
    own_seed = int(random.integers(2**31))
    (regular,) = varied_ranges("regular", spread=math.radians(LIMIT_SPREAD_DEG), count=1, seed=own_seed)
    restricted = {}
    for name, (low, high) in regular.items():
        width = random.uniform(*SUBRANGE) * (high - low)
        start = random.uniform(low, high - width)
        restricted[name] = (start, start + width)
    segments = {name: float(length * random.normal(1.0, SEGMENT_SPREAD)) for name, length in ARM_SEGMENTS.items()}
    side: Any = "left" if random.random() < 0.5 else "right"
    whole, part = (human_arm(range_of_motion=each, segments=segments, side=side) for each in (regular, restricted))
    return whole, part


def outcome(name: str, source: Workspace, target: Workspace, samples: int) -> Outcome:
    """Both rules from one workspace to another."""
    begun = time.perf_counter()
    safe = WorkspaceMap.between(source, target)
    seconds = time.perf_counter() - begun
    polar = WorkspaceMap.between(source, target, rule="polar", landmarks=POLAR_LANDMARKS)
    return Outcome(name, safe.audit(samples), polar.audit(samples), safe.spline.parameters, seconds)


def row(outcome: Outcome, source: Workspace, target: Workspace) -> list[str]:
    """Cells of one map."""
    safe, polar, proven = outcome.safe, outcome.polar, outcome.safe.certificate
    ratio = safe.overall_ratio
    return [
        outcome.name,
        f"{1e4 * source.area:.0f}->{1e4 * target.area:.0f}",
        f"{safe.folded:.2%}",
        f"{safe.outside:.2%}",
        f"{safe.min_stretch / ratio:.2f}..{safe.max_stretch / ratio:.2f}",
        f"{safe.coverage:.0%}",
        f"{proven.determinant / ratio**2:.3f} r2" if proven.valid else "no",
        f"{1e3 * proven.margin:.2f}" if proven.valid else "no",
        str(outcome.coefficients),
        f"{outcome.seconds:.1f}",
        f"{polar.folded:.1%}",
        f"{polar.outside:.1%}",
    ]


def yardstick_lines(outcomes: list[Outcome]) -> list[str]:
    """The published rule over all maps, and what building ours cost."""
    polar = [each.polar for each in outcomes]
    folded, outside = ([getattr(audit, name) for audit in polar] for name in ("folded", "outside"))
    seconds = [each.seconds for each in outcomes]
    coefficients = [each.coefficients for each in outcomes]
    used = [each.safe.coverage for each in outcomes]
    return [
        f"polar rule, {len(polar)} maps: {np.mean([a.passed for a in polar]):.0%} pass their audit; "
        f"folded: median {np.median(folded):.1%}, worst {max(folded):.1%}; "
        f"outside: median {np.median(outside):.1%}, worst {max(outside):.1%}",
        f"safe rule: built and certified in {np.median(seconds):.1f} s (median), {max(seconds):.1f} s (longest); "
        f"{min(coefficients)} to {max(coefficients)} coefficients; "
        f"{min(used):.0%} to {max(used):.0%} of the target used",
    ]


def table_verdicts(outcomes: list[Outcome]) -> list[Verdict]:
    """Each reading of the paper's W_c, each way."""
    return [verdict for each in outcomes[: 2 * len(READINGS)] for verdict in _verdicts(each.name, [each])]


def people_verdicts(outcomes: list[Outcome], count: int) -> list[Verdict]:
    """All people together."""
    return _verdicts(f"{count} people, both ways", outcomes[2 * len(READINGS) :]) if count else []


def _verdicts(name: str, outcomes: list[Outcome]) -> list[Verdict]:
    safe = [each.safe for each in outcomes]
    extreme = [max(a.max_stretch / a.overall_ratio, a.overall_ratio / a.min_stretch) for a in safe]
    return [
        Verdict(f"{name}: worst folded share", max(a.folded for a in safe), "<=", 0.0),
        Verdict(f"{name}: worst share outside", max(a.outside for a in safe), "<=", 0.0),
        Verdict(f"{name}: share certified", float(np.mean([a.certificate.valid for a in safe])), ">=", 1.0),
        Verdict(f"{name}: worst round trip", max(a.round_trip for a in safe), "<=", 1e-9, "m"),
        Verdict(f"{name}: share that a controller accepts", float(np.mean([a.passed for a in safe])), ">=", 1.0),
        Verdict(f"{name}: largest stretch or squeeze over the overall ratio", max(extreme), "<=", MAX_STRETCH),
    ]


def _unusable(pair: Pair) -> str:
    for what, each in (("regular", pair.regular), ("restricted", pair.restricted)):
        if each.empty:
            return f"with an empty {what} slice"
        if each.components != 1 or each.holes:
            return f"whose {what} slice is not one piece without holes"
    return ""


def _cached(file: Path | None, count: int, seed: int, passed_over: Counter[str]) -> Iterator[Pair]:
    """People, kept in a file between runs where one is given."""
    if file is not None and file.exists():
        pairs, kept = pickle.loads(file.read_bytes())
        passed_over.update(kept)
        yield from pairs[:count]
        return
    pairs = list(people(count, seed, passed_over))
    if file is not None:
        file.write_bytes(pickle.dumps((pairs, passed_over)))
    yield from pairs


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m bench.workspace_maps", description=__doc__)
    parser.add_argument("--people", type=int, default=50, help="random people beside Table I")
    parser.add_argument("--samples", type=int, default=20_000, help="points each map is audited at")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--cache", type=Path, help="keep the people's workspaces in this file (trusted: a pickle)")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())
