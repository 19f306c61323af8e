"""MirrorTracker's numbers: the tick beside placo's, 10^6 ticks, the lag of the whole chain, a plan beside A*.

`python -m bench.mirror [--parts tick long lag plan]`. The tick needs placo (extra `peers`); placo's has no floor.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Callable, Sequence

import numpy as np
from rich.console import Console
from rich.table import Table

from bench.long_run import run
from bench.machine import machine
from bench.measured_lag import measured_lag
from bench.peers.contender import Array, Contender, verify_kinematics
from bench.peers.path import START, HandPath, circle
from bench.peers.rounds import alternate
from bench.verdict import Verdict, all_met, print_verdicts
from problems.mirror import motions
from rehab_opt import Command, MirrorTracker, SerialChain, Smoother, Status, ur5
from rehab_opt.control.conditioning import Conditioned, conditioned
from rehab_opt.kinematics.vr import quaternions_of
from rehab_opt.published.astar import astar_path

__all__ = ["main"]

DT = 0.001
ROUND = 3000
"""Ticks of a round of the circle: 0.21 m/s, below the hand's largest speed."""
FLOORS = {"free": 0.3, "at the floor": 0.76}
"""The second is above what the circle has on a part of it, so that the hand slides along the floor there."""
PLAN_DT, RESOLUTIONS, STATED = 0.02, (0.01, 0.005, 0.002), 0.002
"""[s, m, m] Tick of the plan, and the lattices of A*; the verdict takes the stated one."""
JERK = 500.0
"""[rad/s^3] of the joints behind the tracker."""
LAG_ASKED = 0.1


class Mirroring(Contender):
    """`MirrorTracker.step` with its floor, certificate and Command."""

    def __init__(self, chain: SerialChain, *, floor: float, compiled: bool) -> None:
        self.name = "MirrorTracker, compiled" if compiled else "MirrorTracker, virtual machine"
        self.versions = {}
        self.chain = chain
        self.tracker = MirrorTracker(chain, floor=floor, dt=DT, compile="wait" if compiled else False)
        self.least, self.not_ok = math.inf, 0

    def pose(self, q: Array) -> Array:
        return self.chain.pose(q)

    def target(self, path: HandPath, k: int) -> tuple[Array, Array]:
        return path.poses[k].copy(), path.twists[k].copy()

    def command(self, q: Array, target: tuple[Array, Array]) -> Command:
        return self.tracker.step(q, *target)

    def integrated(self, q: Array, command: Command) -> Array:
        self.not_ok += command.status is not Status.OK
        self.least = min(self.least, self.tracker.manipulability)
        after: Array = q + DT * command.value
        return after


def tick(console: Console, options: argparse.Namespace) -> list[Verdict]:
    """Medians side by side."""
    from bench.peers.with_placo import Placo  # noqa: PLC0415  (an optional extra)

    verdicts, chain = [], ur5()
    path = circle(chain, 600 + options.rounds * 160, dt=DT, period=ROUND * DT)
    for case, floor in FLOORS.items():
        ours = [Mirroring(chain, floor=floor, compiled=fast) for fast in (True, False)]
        contenders: list[Contender] = [*ours, Placo(chain, dt=DT)]
        for contender in contenders:
            verify_kinematics(contender, chain)
        records = alternate(contenders, path, START, rounds=options.rounds, ticks=150)
        table = Table(title=f"{case}: floor {floor:g} of the largest manipulability (placo has none)")
        for column in ("", "step us", "p99", "p99.9", "tick us", "step / placo"):
            table.add_column(column, justify="right")
        steps = [np.median(record.step, axis=1) for record in records]
        for record, step in zip(records, steps, strict=True):
            numbers = (*np.percentile(record.step, (50, 99, 99.9)), float(np.median(record.tick)))
            table.add_row(record.name, *(f"{x:.1f}" for x in numbers), f"{np.median(step / steps[2]):.2f}")
        console.print(table)
        console.print(f"least w / w_max {ours[0].least:.6f}, ticks that were not OK {ours[0].not_ok}")
        ratio = float(np.median(steps[0] / steps[2]))
        verdicts.append(Verdict(f"{case}: MirrorTracker / placo without a floor", ratio, "<=", 1.0))
    return verdicts


def long(console: Console, options: argparse.Namespace) -> list[Verdict]:
    """Rare long ticks."""
    tracker = MirrorTracker(ur5(), dt=DT)
    path = circle(ur5(), 3 * ROUND, dt=DT, period=ROUND * DT, onset=1e-9)
    path = HandPath(path.poses[ROUND : 2 * ROUND], path.twists[ROUND : 2 * ROUND])
    nanoseconds, statuses, memory = run(tracker, path, options.ticks)
    numbers = np.percentile(nanoseconds / 1e3, (50, 99, 99.9, 99.99, 100))
    console.print(
        f"{options.ticks} ticks: median, p99, p99.9, p99.99, max in us: " + " ".join(f"{x:.1f}" for x in numbers)
    )
    console.print(f"status {dict(statuses)}, memory gained after the first tenth {memory[-1] - memory[1]:.2f} MB")
    return [Verdict("memory gained after the first tenth", memory[-1] - memory[1], "<=", 0.5, "MB")]


def recording(task: Callable[[], list[Array]], dt: float) -> tuple[Array, Array, Conditioned]:
    """Times and poses of a motion as it was recorded, and conditioned."""
    poses = np.array(task())
    times = np.arange(len(poses)) / motions.RATE
    return times, poses, conditioned(times, poses[:, :3, 3], quaternions_of(poses[:, :3, :3]), dt=dt)


def lag(console: Console, _: argparse.Namespace) -> list[Verdict]:
    """From the raw hand to joints with bounded jerk: filter, QP, smoothing."""
    verdicts, chain = [], ur5()
    for name, task in (("pick_fruit", motions.pick_fruit), ("refrigerator_door", motions.refrigerator_door)):
        times, poses, samples = recording(task, DT)
        # Speeds below the cap: what is slowed in time on purpose is no lag of the chain.
        tracker = MirrorTracker(chain, dt=DT, linear_speed=0.6, floor=0.05)
        smoother = Smoother(velocity=chain.velocity, acceleration=chain.acceleration, jerk=JERK, dt=DT, axes=chain.n)
        q, hands = motions.START.copy(), []
        smoother.reset(q)
        for pose, twist in zip(samples.poses, samples.twists, strict=True):
            command = tracker.step(q, pose, twist)
            q = q + DT * command.value
            hands.append(chain.pose(smoother.step(q, command.value).value)[:3, 3])
        at = samples.times
        raw = np.array([np.interp(at, times, column) for column in poses[:, :3, 3].T]).T
        found = measured_lag(at, raw, np.array(hands))
        console.print(f"{name}: lag of filter, QP and smoothing at {JERK:g} rad/s^3: {1e3 * found:.1f} ms")
        verdicts.append(Verdict(f"{name}: lag of the whole chain", found, "<=", LAG_ASKED, "s"))
    return verdicts


def plan(console: Console, _: argparse.Namespace) -> list[Verdict]:
    """Deviations and times."""
    verdicts, chain = [], ur5()
    for name, task in (("pick_fruit", motions.pick_fruit), ("refrigerator_door", motions.refrigerator_door)):
        samples = recording(task, PLAN_DT)[2]
        tracker = MirrorTracker(chain, dt=PLAN_DT)
        ours = [tracker.plan(samples.poses, samples.twists, motions.START) for _ in range(5)]
        seconds, path = float(np.median([each.seconds for each in ours])), ours[0]
        off = path.deviations
        console.print(
            f"{name}: plan {1e3 * seconds:.0f} ms at {PLAN_DT:g} s, deviation mean {1e3 * off.mean():.2f}, largest "
            f"{1e3 * off.max():.2f} mm, turned by at most {math.degrees(path.turns.max()):.1f} deg"
        )
        for resolution in RESOLUTIONS:
            begun = time.perf_counter()
            theirs = astar_path(
                chain,
                samples.poses,
                motions.START,
                floor=0.3,
                max_manipulability=tracker.max_manipulability,
                resolution=resolution,
            )
            spent = time.perf_counter() - begun
            away = theirs.deviations(samples.poses[:, :3, 3])
            console.print(
                f"  A* {1e3 * resolution:g} mm: {spent:.2f} s ({spent / seconds:.0f} times), deviation mean "
                f"{1e3 * away.mean():.2f}, largest {1e3 * away.max():.2f} mm, complete {theirs.complete}"
            )
            if resolution == STATED:
                verdicts += [
                    Verdict(f"{name}: plan's time / A*'s", seconds / spent, "<=", 1 / 50),
                    Verdict(f"{name}: mean deviation / A*'s", off.mean() / away.mean(), "<=", 1.0),
                    Verdict(f"{name}: largest deviation / A*'s", off.max() / away.max(), "<=", 1.0),
                ]
    return verdicts


PARTS = {"tick": tick, "long": long, "lag": lag, "plan": plan}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the parts asked for."""
    parser = argparse.ArgumentParser(prog="python -m bench.mirror", description=__doc__)
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=list(PARTS))
    parser.add_argument("--rounds", type=int, default=60)
    parser.add_argument("--ticks", type=int, default=1_000_000)
    options = parser.parse_args(arguments)
    console = Console(width=max(Console().width, 132))
    console.print("  ".join(f"{key}: {value}" for key, value in machine().items()), highlight=False)
    verdicts = [verdict for part in options.parts for verdict in PARTS[part](console, options)]
    print_verdicts(console, verdicts)
    return 0 if all_met(verdicts) else 1


if __name__ == "__main__":
    sys.exit(main())
