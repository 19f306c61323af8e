"""Whole ticks of each capability by each of its solvers: `python -m bench.defaults`.

`python -m bench.solvers` compares solvers on recorded QPs; this is the same question to the controllers, with their
kinematics, closed forms, certificates and rungs: is what they use by default slower than the best of what `solver=` and
`backup=` offer? A solver is an alternative where at least as many of its ticks are certified. Each keeps its own state;
rounds alternate, compiled code is waited for. Times are the thread's processor time, so that what other programs take
away does not count; the mean is arithmetic, so that rare slow ticks do. Exit code 1 where a default's mean is longer by
more than a fifth.

A second table asks whether our own code of active sets is worth its lines: the mean time of the default's tick, that of
a tick which CasADi's qrqp solves alone, and those by the other solvers, in all ticks and in those that the default's
closed form does not answer. It is kept where the last ratio is 1.3 or more.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple
from unittest.mock import patch

import numpy as np
import qpsolvers
from rich.console import Console
from rich.table import Table

from bench.arm.targets import reachable
from bench.assistance import COMFORTABLE, field_of, hand
from bench.long_run import DT, round_trip
from bench.machine import machine
from bench.peers.path import START
from bench.test_bench_control import ROOM, TILT
from bench.verdict import Verdict, all_met, print_verdicts
from rehab_opt import ArmIK, Assistance, MirrorTracker, PoseTracker, RedundancyResolver, Status, ardis, human_arm, ur5
from rehab_opt.export import random_runs
from rehab_opt.kinematics.ardis import ARDIS_READY
from rehab_opt.optim.qp import Statement
from rehab_opt.symbolic import shared

__all__ = ["main"]

SLACK = 1.2
DEFAULT, QRQP = "default", "qrqp alone"
Tick = Callable[[], tuple[bool, str]]
"""One tick; whether it is certified, and by which solver."""


class Row(NamedTuple):
    """One solver of one capability; times in us."""

    capability: str
    solver: str
    certified: float
    median: float
    mean: float
    p99: float
    largest: float
    solved: float
    """Share of ticks that the closed form does not answer; mean time of those that it does not in the default."""
    solved_mean: float


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure every capability, print the table and the verdicts."""
    parser = argparse.ArgumentParser(prog="python -m bench.defaults", description=__doc__)
    parser.add_argument("--rounds", type=int, default=12)
    parser.add_argument("--ticks", type=int, default=200, help="of each solver in a round")
    parser.add_argument("--json", type=Path, help="write the numbers here too")
    parser.add_argument("--only", default="", help="a part of the capabilities' names")
    options = parser.parse_args(arguments)
    os.environ.setdefault("REHAB_OPT_COMPILE", "wait")
    console = Console(width=max(Console().width, 110))
    console.print("  ".join(f"{key}: {value}" for key, value in machine().items()), highlight=False)
    table = Table("capability", "solver", "certified", "median, us", "mean", "p99", "largest")
    names = (DEFAULT, QRQP, "daqp", "proxqp", "osqp", "quadprog")
    own = Table("mean tick, us", "ticks", *names, "best other / default")
    found, verdicts = [], []
    for capability, make in _capabilities().items():
        if options.only not in capability:
            continue
        rows = _measured(capability, make(), options.rounds, options.ticks)
        default = next(row for row in rows if row.solver == DEFAULT)
        others = [row for row in rows if row.solver != DEFAULT and row.certified >= default.certified]
        for row in sorted(rows, key=lambda row: row.mean):
            numbers = (f"{value:.1f}" for value in row[3:7])
            table.add_row(row.capability, row.solver, f"{row.certified:.3%}", *numbers)
        if others:
            best = min(others, key=lambda row: row.mean)
            what = f"{capability}: default / {best.solver}"
            verdicts.append(Verdict(what, default.mean / best.mean, "<=", SLACK))
        known = {row.solver: row for row in rows}
        for share, field in ((1.0, "mean"), (default.solved, "solved_mean")) if QRQP in known else ():
            times = {name: getattr(known[name], field) if name in known else np.nan for name in names}
            beside = min(times[name] for name in names[1:] if times[name] > 0) / times[DEFAULT] if share else np.nan
            own.add_row(capability, f"{share:.1%}", *(f"{each:.1f}" for each in times.values()), f"{beside:.2f}")
        found += rows
    console.print(table, own)
    print_verdicts(console, verdicts)
    if options.json:
        report = {"machine": machine(), "rows": [row._asdict() for row in found]}
        options.json.write_text(json.dumps(report, indent=2))
    return 0 if all_met(verdicts) else 1


def _capabilities() -> dict[str, Callable[[], dict[str, Tick]]]:
    """Of every capability what makes its contenders."""
    installed = [name for name in ("quadprog",) if name in qpsolvers.available_solvers]
    choices: dict[str, dict[str, Any]] = {DEFAULT: {}}
    choices |= {f"default, backup {name}": {"backup": name} for name in ("proxqp", "osqp", *installed)}
    choices |= {name: {"solver": name} for name in ("daqp", "proxqp", "osqp", *installed)}

    def made_of(make: Callable[..., Tick]) -> dict[str, Tick]:
        made = {name: make(**options) for name, options in choices.items()}
        with patch.object(Statement, "form", _without_active_sets), patch.dict(shared._made, clear=True):
            return made | {QRQP: make()}

    def each(make: Callable[..., Tick]) -> Callable[[], dict[str, Tick]]:
        return partial(made_of, make)

    found = {
        "pose, free": each(lambda **o: _poses(PoseTracker(ur5(), dt=DT, **o))),
        "pose, limited": each(lambda **o: _poses(PoseTracker(ur5(velocity=0.35), dt=DT, **o))),
        "pose, jumping": each(lambda **o: _jumps(PoseTracker(ur5(velocity=0.35), dt=DT, **o))),
        "mirror": each(lambda **o: _poses(MirrorTracker(ur5(), floor=0.76, linear_speed=0.5, dt=DT, **o))),
    }
    for drive, (name, speed) in itertools.product(("mecanum", "differential"), {"near": 0.1, "beyond": 1.0}.items()):
        found[f"{drive}, {name}"] = each(lambda drive=drive, speed=speed, **o: _chair(drive, speed, **o))
    # What a user with redundant bounds has: every wall and table stands twice.
    twice = [*ROOM, *ROOM]
    found["mecanum, walls twice"] = each(lambda **o: _chair("mecanum", 0.1, obstacles=twice, **o))
    found["assistance"] = each(_force)
    programmes = ("ipopt", "fatrop", "sqpmethod")
    found["arm IK, cold"] = lambda: {
        DEFAULT: _postures(),
        **{name: _postures(solver=name, backup="ipopt") for name in programmes},
    }
    return found


def _without_active_sets(stated: Statement, form: Callable[..., Any] = Statement.form) -> Any:
    """`Statement.form` of a QP that is left to qrqp."""
    of, numbers = form(stated)
    return of._replace(active_set=False), numbers


def _force(**options: Any) -> Tick:
    force = Assistance(field_of(200), comfortable=COMFORTABLE, slew_limit=200.0, energy_budget=1e3, **options)
    places = itertools.cycle(hand(4000))

    def tick() -> tuple[bool, str]:
        command = force.step(next(places))
        return command.status.certified, command.solver

    return tick


def _poses(tracker: PoseTracker | MirrorTracker) -> Tick:
    path, q = round_trip(tracker.chain), START.copy()
    samples = itertools.cycle([(p.copy(), t.copy()) for p, t in zip(path.poses, path.twists, strict=True)])

    def tick() -> tuple[bool, str]:
        command = tracker.step(q, *next(samples))
        np.add(q, DT * command.value, out=q)
        return command.status.certified, command.solver

    return tick


def _jumps(tracker: PoseTracker) -> Tick:
    """Targets that jump within and beyond the arm's reach."""
    samples = itertools.cycle(random_runs.tracker_run(PoseTracker(tracker.chain, dt=DT)))

    def tick() -> tuple[bool, str]:
        command = tracker.step(**next(samples))
        return command.status.certified, command.solver

    return tick


def _chair(drive: Any, speed: float, **options: Any) -> Tick:
    settings = {"row_sets": [("x", "y", "z")], "obstacles": ROOM, **options}
    resolver = RedundancyResolver(ardis(), drive=drive, **settings)
    rng, q, ticks = np.random.default_rng(0), ARDIS_READY.copy(), itertools.count()
    stick = np.zeros(3)

    def tick() -> tuple[bool, str]:
        k = next(ticks)
        if k % 100 == 0:
            stick[:] = speed * rng.standard_normal(3) * [1.0, 1.0, 0.3]
        if k % 400 == 0:
            q[:] = ARDIS_READY
            resolver.reset()
        command = resolver.step(q, stick)
        np.add(q, resolver.dt * command.value, out=q)
        return command.status.certified, command.solver

    return tick


def _postures(**options: Any) -> Tick:
    arm = human_arm(range_of_motion="regular")
    solver, targets = ArmIK(arm, handle_tilt=TILT, **options), itertools.cycle(reachable(arm, 100, tilt=TILT))
    solver.solve(next(targets))  # makes what is made once

    def tick() -> tuple[bool, str]:
        answer = solver.solve(next(targets))
        return answer.status in (Status.OK, Status.BACKUP), answer.solver

    return tick


def _measured(capability: str, contenders: dict[str, Tick], rounds: int, ticks: int) -> list[Row]:
    if capability.startswith("arm IK"):
        rounds, ticks = max(rounds // 3, 1), max(ticks // 20, 1)  # a thousand times slower
    clock, order = time.thread_time, list(contenders)
    times: dict[str, list[float]] = {name: [] for name in order}
    certified: dict[str, list[bool]] = {name: [] for name in order}
    solved: dict[str, list[bool]] = {name: [] for name in order}
    for each in range(-1, rounds):  # the first round warms up
        for name in order:
            tick = contenders[name]
            for i in range(-5, ticks):  # cold caches after another solver
                began = clock()
                good, solver = tick()
                spent = clock() - began
                if each >= 0 and i >= 0:
                    times[name].append(1e6 * spent)
                    certified[name].append(good)
                    solved[name].append(solver != "closed form")
        order.append(order.pop(0))
    return [
        Row(
            capability, name, float(np.mean(certified[name])), float(np.median(times[name])),
            float(np.mean(times[name])), float(np.percentile(times[name], 99)), max(times[name]),
            float(np.mean(solved[name])), float(np.mean(np.array(times[name])[solved[DEFAULT]])),
        )
        for name in contenders
    ]  # fmt: skip


if __name__ == "__main__":
    sys.exit(main())
