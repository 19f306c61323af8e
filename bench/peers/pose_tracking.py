"""One step of differential inverse kinematics in rehab_opt, placo, pink and mink, side by side.

`python -m bench.peers.pose_tracking`: a UR5 follows a 1 kHz circle of the hand pose. A step is: take the state, compute
kinematics, solve the QP with position and velocity limits; a tick also integrates. The verdicts take steps.
Case "free": the vendor's limits, never active. Case "limited": a lower speed limit, which several joints are at most of
the time. Exit code 1 where a ratio of issue 2 is missed.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import math
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table

from bench.machine import machine
from bench.peers.contender import Contender, verify_kinematics
from bench.peers.path import START, HandPath, circle
from bench.peers.rounds import Record, alternate
from bench.verdict import Reported, Verdict, all_met, print_verdicts
from rehab_opt import SerialChain, ur5

__all__ = ["main"]

DT = 0.001
CASES = {"free": math.pi, "limited": 0.35}
"""Joint speed limit [rad/s] of each case; the path asks for up to 0.95."""


class Row(NamedTuple):
    """One line of the table."""

    name: str
    median: float
    """Of the step [us]."""
    p99: float
    """Of the step [us]."""
    of_placo: float
    """Ratio of the medians of steps, paired by round: the median over rounds."""
    of_pink: float
    tick: float
    """Median of the tick [us]."""
    tick_of_placo: float
    error: float
    """Largest distance of the hand from the path [mm]."""
    over: float
    """Worst joint speed minus its limit [rad/s]; negative: never reached."""
    saturated: float
    """Share of ticks with a joint at its speed limit."""
    joints: float
    """Mean number of joints at it."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure both cases, print the tables and the verdicts."""
    options = _options(arguments)
    if options.core is not None:
        os.sched_setaffinity(0, {options.core})
    console = Console(width=max(Console().width, 132))
    console.print("  ".join(f"{key}: {value}" for key, value in machine().items()), highlight=False)
    measured: dict[str, list[Row]] = {}
    versions: dict[str, str] = {}
    for case, limit in CASES.items():
        chain = ur5(velocity=limit)
        contenders = entered(chain)
        for contender in contenders:
            verify_kinematics(contender, chain)
            versions |= contender.versions
        path = circle(chain, 600 + options.rounds * (options.ticks + 10), dt=DT)
        records = alternate(contenders, path, START, rounds=options.rounds, ticks=options.ticks)
        measured[case] = rows(records, chain, path)
        console.print(_table(f"{case}: speed limit {limit:.3g} rad/s", measured[case]))
        for contender in contenders[:2]:
            console.print(f"{contender.name}: primary solver failed in {getattr(contender, 'not_ok', 0)} ticks")
    console.print(
        "  ".join(f"{key} {value}" for key, value in sorted(versions.items())), highlight=False, soft_wrap=True
    )
    verdicts = [verdict for case, some in measured.items() for verdict in asked(case, some)]
    print_verdicts(console, verdicts)
    for case, some in measured.items():
        for each in beside_others(case, some):
            console.print(str(each), highlight=False, soft_wrap=True)
    if options.json:
        report: dict[str, Any] = {
            "machine": machine(),
            "versions": versions,
            "cases": {case: [row._asdict() for row in some] for case, some in measured.items()},
            "verdicts": [verdict._asdict() | {"met": verdict.met} for verdict in verdicts],
        }
        options.json.write_text(json.dumps(report, indent=2))
    return 0 if all_met(verdicts) else 1


def entered(chain: SerialChain) -> list[Contender]:
    """Everyone who takes part, set up on `chain`; the two of ours first."""
    from bench.peers.ours import Ours  # noqa: PLC0415  (the peers are an optional extra)
    from bench.peers.with_mink import Mink  # noqa: PLC0415
    from bench.peers.with_pink import Pink  # noqa: PLC0415
    from bench.peers.with_placo import Placo  # noqa: PLC0415

    return [
        Ours(chain, dt=DT, compiled=True),
        Ours(chain, dt=DT, compiled=False),
        Placo(chain, dt=DT),
        Placo(chain, dt=DT, stateful=True),
        *(Pink(chain, dt=DT, solver=solver) for solver in ("daqp", "quadprog", "proxqp")),
        *(Mink(chain, dt=DT, solver=solver) for solver in ("daqp", "quadprog")),
        *_robotics_toolbox(chain),
    ]


def _robotics_toolbox(chain: SerialChain) -> list[Contender]:
    """None where it is not installed: it asks for much, and many have no room for it."""
    if importlib.util.find_spec("roboticstoolbox") is None:
        return []
    from bench.peers.with_roboticstoolbox import RoboticsToolbox  # noqa: PLC0415

    return [RoboticsToolbox(chain, dt=DT, solver="daqp")]


def rows(records: Sequence[Record], chain: SerialChain, path: HandPath) -> list[Row]:
    """The table's numbers, in the order of `records`."""
    steps = {record.name: np.median(record.step, axis=1) for record in records}
    ticks = {record.name: np.median(record.tick, axis=1) for record in records}
    table = []
    for record in records:
        velocity = np.abs(record.velocity(DT))
        at_limit = velocity >= chain.velocity * (1 - 1e-4)
        table.append(
            Row(
                record.name,
                median=float(np.median(record.step)),
                p99=float(np.percentile(record.step, 99)),
                of_placo=float(np.median(steps[record.name] / steps["placo"])),
                of_pink=float(np.median(steps[record.name] / steps["pink + daqp"])),
                tick=float(np.median(record.tick)),
                tick_of_placo=float(np.median(ticks[record.name] / ticks["placo"])),
                error=1e3 * _worst_distance(record, chain, path),
                over=float((velocity - chain.velocity).max()),
                saturated=float(at_limit.any(axis=2).mean()),
                joints=float(at_limit.sum(axis=2).mean()),
            )
        )
    return table


def asked(case: str, table: Sequence[Row]) -> list[Verdict]:
    """The ratios of issue 2."""
    compiled, virtual = table[0], table[1]
    return [
        Verdict(f"{case}: compiled / placo", compiled.of_placo, "<=", 0.8 if case == "free" else 1.0),
        Verdict(f"{case}: compiled / (pink + daqp)", compiled.of_pink, "<=", 1 / 20),
        Verdict(f"{case}: virtual machine / (pink + daqp)", virtual.of_pink, "<=", 1 / 5),
    ]


def beside_others(case: str, table: Sequence[Row]) -> list[Reported]:
    """Our compiled step beside those of the peers of which issue 2 asks nothing."""
    return [
        Reported(f"{case}: compiled / ({row.name})", table[0].median / row.median)
        for row in table
        if row.name.startswith(("mink", "roboticstoolbox"))
    ]


def _worst_distance(record: Record, chain: SerialChain, path: HandPath) -> float:
    worst = 0.0
    for visited, first in zip(record.q, record.sample, strict=True):
        for k in range(0, len(visited), 10):  # the error moves slowly
            worst = max(worst, float(np.linalg.norm(chain.pose(visited[k])[:3, 3] - path.poses[first + k, :3, 3])))
    return worst


def _table(title: str, some: Sequence[Row]) -> Table:
    table = Table(title=title)
    table.add_column("contender", no_wrap=True)
    columns = ("step us", "p99", "/placo", "/pink", "tick us", "/placo", "error mm", "over", "at limit", "joints")
    for column in columns:
        table.add_column(column, justify="right", no_wrap=True)
    for row in some:
        table.add_row(
            row.name, f"{row.median:.1f}", f"{row.p99:.1f}", f"{row.of_placo:.3f}", f"{row.of_pink:.4f}",
            f"{row.tick:.1f}", f"{row.tick_of_placo:.3f}",
            f"{row.error:.2g}", f"{row.over:.1e}", f"{row.saturated:.0%}", f"{row.joints:.2f}",
        )  # fmt: skip
    return table


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m bench.peers.pose_tracking", description=__doc__)
    parser.add_argument("--rounds", type=int, default=20)
    parser.add_argument("--ticks", type=int, default=150, help="timed ticks of each contender in a round")
    parser.add_argument("--core", type=int, help="processor core to stay on")
    parser.add_argument("--json", type=Path, help="write the numbers here too")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())
