"""An FR3 with its jerk bounded, for 10^6 ticks with faults, judged by franka-sim's own limits: `python -m bench.jerk`.

Targets jump, numbers are none, stamps repeat, the enable input is released; what is sent goes to the checks that stop a
robot of the vendor at 1 kHz: joint velocity by position, acceleration and jerk of the finite differences. The tick is
timed beside the same tracker without a bound of jerk, both round a circle, by the processor's time.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from collections.abc import Sequence
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from bench.machine import machine
from bench.verdict import Verdict, all_met, print_verdicts
from rehab_opt import PoseTracker, SerialChain

__all__ = ["main"]

DT = 1e-3
EPS = 1e-3
"""What libfranka's own rate limiter stays inside of every limit by."""
SLOWER = 1.3
"""A tick with the bound, of one without."""
TIMED, ROUNDS = 1500, 4
"""Ticks that are timed, each the least of so many rounds."""
HOME = np.array([0.0, -0.78, 0.0, -2.36, 0.0, 1.57, 0.78])
HOSTILE = (np.nan, np.inf, -np.inf, 1e300, 1e7)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the verdicts; 0 where every one is met."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--ticks", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--packages", type=Path, action="append", default=[], help="folder that wheels are unpacked in")
    options = parser.parse_args(arguments)
    console = Console()
    console.print(machine())
    folder = next(f for f in [*options.packages, *map(Path, sys.path)] if (f / "franka_sim/models/fr3.urdf").exists())
    tables = _module(folder / "franka_sim/limits/tables.py")
    lower, upper = np.array(tables.JOINT_POSITION_LIMITS).T
    # The vendor's velocity limit falls with the square root of the room less an offset: who stops by the same
    # deceleration this much sooner stays below it.
    velocity, offset, most = np.array(tables.POSITION_BASED_VELOCITY_LIMITS).T
    sooner = (2 * velocity * offset + offset**2) / (2 * most)
    chain = SerialChain.from_urdf(
        folder / "franka_sim/models/fr3.urdf", base="base", tip="link8",
        lower=lower + sooner, upper=upper - sooner, velocity=velocity - 2 * EPS,
        acceleration=np.minimum(np.array(tables.MAX_JOINT_ACCELERATION) - EPS, most),
    )  # fmt: skip
    jerk = np.array(tables.MAX_JOINT_JERK) - EPS
    tracker, free = (PoseTracker(chain, dt=DT, jerk=each, compile="wait") for each in (jerk, None))
    sent, places, said = driven(tracker, options.ticks, options.seed)
    console.print(dict(said))
    change = np.diff(sent, axis=0, prepend=0.0) / DT
    jerks = np.diff(change, axis=0, prepend=0.0) / DT
    fast = np.array([tables.upper_joint_velocity_limits(q) for q in places[::10]])
    slow = np.array([tables.lower_joint_velocity_limits(q) for q in places[::10]])
    counts = {
        "acceleration": np.abs(change) > tables.MAX_JOINT_ACCELERATION,
        "jerk": np.abs(jerks) > tables.MAX_JOINT_JERK,
        "velocity at its position, every tenth tick": (sent[::10] > fast) | (sent[::10] < slow),
        "position": (places > upper) | (places < lower),
    }
    solved = said["ok"] + said["blocked"] + said["backup"]
    verdicts = [Verdict("fraction of ticks that are solved", solved / len(sent), ">=", 0.8)]
    verdicts += [
        Verdict(f"{len(sent)} ticks, {name}: stopped", float(np.sum(bad)), "<=", 0) for name, bad in counts.items()
    ]
    verdicts.append(Verdict("largest jerk, as a fraction of the limit", float(np.abs(jerks / jerk).max()), ">=", 0.99))
    seconds = np.min([[processor_time(each) for each in (tracker, free)] for _ in range(ROUNDS)], axis=0)
    ratio = float(np.divide(*np.median(seconds, axis=1)))
    verdicts.append(Verdict("tick round a circle, of the same without a bound of jerk", ratio, "<=", SLOWER))
    print_verdicts(console, verdicts)
    return 0 if all_met(verdicts) else 1


def processor_time(tracker: PoseTracker) -> Any:
    """(N,) [s] of this thread in each tick, the hand going round a circle."""
    tracker.reset()
    q, first, seconds = HOME.copy(), tracker.chain.pose(HOME), np.empty(TIMED)
    for k in range(TIMED):
        phase = 2 * np.pi * DT * k / 4.0
        pose, twist = first.copy(), np.zeros(6)
        pose[:2, 3] += 0.1 * np.array([1 - np.cos(phase), np.sin(phase)])
        twist[:2] = 0.05 * np.pi * np.array([np.sin(phase), np.cos(phase)])
        began = time.thread_time()
        command = tracker.step(q, pose, twist)
        seconds[k] = time.thread_time() - began
        q = q + DT * command.value
    return seconds


def driven(tracker: PoseTracker, ticks: int, seed: int) -> tuple[Any, Any, Counter[str]]:
    """What is sent and where it is sent from (N, n), and how often each status."""
    rng, chain, n = np.random.default_rng(seed), tracker.chain, tracker.chain.n
    sent, places, said = np.empty((ticks, n)), np.empty((ticks, n)), Counter[str]()
    q = HOME.copy()
    for k in range(ticks):
        if k % 200 == 0:
            goal = np.clip(q + rng.normal(size=n) * rng.choice([1e-3, 0.1, 1.0]), chain.lower, chain.upper)
            pose, twist = chain.pose(goal), rng.normal(size=6) * rng.choice([0.0, 0.0, 0.1, 3.0])
            faulty = rng.random() < 0.2
        told, enable = [q, pose, twist], True
        stamp = DT * (k + 1)
        if rng.random() < (0.3 if faulty else 0.01):
            kind = rng.integers(5)
            told = [each.copy() for each in told]
            if kind < 3:
                told[kind].flat[rng.integers(told[kind].size)] = rng.choice(HOSTILE)
            enable, stamp = bool(kind != 3), stamp - DT * (kind == 4)  # repeated, and then in time again
        command = tracker.step(*told, enable=enable, stamp=stamp)
        sent[k], places[k] = command.value, q
        said[command.status.value] += 1
        q = q + DT * command.value
    return sent, places, said


def _module(file: Path) -> Any:
    """A file of franka-sim by itself: the package asks for a simulator."""
    spec = spec_from_file_location(file.stem, file)
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


if __name__ == "__main__":
    raise SystemExit(main())
