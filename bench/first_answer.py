"""How soon a controller answers where nothing is compiled yet, and what compiling beside it costs its loop:
`python -m bench.first_answer`.

Each controller has a process of its own with an empty cache. It is made, answers, and goes on at its rate with absolute
deadlines until its code is ready and a second longer; while it waits for a deadline it keeps its core busy, as a loop
on hardware does. Late is a tick that begins after its deadline.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from bench.machine import machine
from bench.verdict import Verdict, all_met, print_verdicts

__all__ = ["main"]

LONGEST = 600.0
"""[s] after which a controller is given up."""
PANDA = Path(__file__).parents[1] / "problems" / "robots" / "franka_panda" / "panda.urdf"
ANSWER, READY, LATE = 2.0, 120.0, 1.0
"""Asked: [s] until the first answer and until machine code answers, [ms] lateness of all but a hundredth of ticks."""


def pose_tracker() -> tuple[float, Callable[[], object]]:
    """A UR5 that goes on along x."""
    from rehab_opt import PoseTracker, ur5  # noqa: PLC0415

    robot, q = ur5(), np.array([0.0, -1.2, 1.5, -1.8, -1.57, 0.0])
    control, pose, twist = PoseTracker(robot), robot.pose(q), np.zeros(6)
    return 0.001, lambda: control.step(q, pose, twist)


def imported_arm() -> tuple[float, Callable[[], object]]:
    """A Panda, from the file on."""
    from rehab_opt import PoseTracker, SerialChain  # noqa: PLC0415

    robot = SerialChain.from_urdf(PANDA, tip="panda_link8", acceleration=7.5)
    q = np.array([0.0, -0.8, 0.0, -2.3, 0.0, 1.6, 0.8])
    control, pose, twist = PoseTracker(robot), robot.pose(q), np.zeros(6)
    return 0.001, lambda: control.step(q, pose, twist)


def mirror_tracker() -> tuple[float, Callable[[], object]]:
    """The same above its floor, at what `MirrorTracker` guards."""
    from rehab_opt import MirrorTracker, ur5  # noqa: PLC0415

    robot, q = ur5(), np.array([0.0, -1.2, 1.5, -1.8, -1.57, 0.0])
    control, pose, twist = MirrorTracker(robot), robot.pose(q), np.zeros(6)
    return 0.001, lambda: control.step(q, pose, twist)


def chair() -> tuple[float, Callable[[], object]]:
    """Chair and arm with the three sets of rows that are prepared."""
    from rehab_opt import RedundancyResolver, ardis  # noqa: PLC0415
    from rehab_opt.kinematics.ardis import ARDIS_READY  # noqa: PLC0415

    control, twist = RedundancyResolver(ardis()), np.array([0.05, 0.02, 0.0])
    return 0.01, lambda: control.step(ARDIS_READY, twist)


def assistance() -> tuple[float, Callable[[], object]]:
    """A force towards a path, outside of a comfortable workspace."""
    import shapely  # noqa: PLC0415

    from rehab_opt import Assistance, PotentialField, Workspace  # noqa: PLC0415

    line = np.column_stack([np.linspace(0, 0.3, 60), 0.1 * np.sin(np.linspace(0, 3, 60))])
    field = PotentialField(line, stiffness=800.0, width=0.02)
    comfortable = Workspace(shapely.box(-0.1, -0.1, 0.05, 0.2), accuracy=0.0)
    control, hand = Assistance(field, comfortable=comfortable, mode="assist"), np.array([0.1, 0.02])
    return 0.001, lambda: control.step(hand)


CONTROLLERS = {each.__name__: each for each in (pose_tracker, imported_arm, mirror_tracker, chair, assistance)}


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and judge."""
    parser = argparse.ArgumentParser(prog="python -m bench.first_answer", description=__doc__)
    parser.add_argument("--only", nargs="+", choices=CONTROLLERS, default=list(CONTROLLERS))
    parser.add_argument("--here", choices=CONTROLLERS, help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.here:
        print(*measured(CONTROLLERS[options.here]))
        return 0
    console = Console()
    console.print("  ".join(f"{key}: {value}" for key, value in machine().items()), highlight=False)
    table = Table("", "made [s]", "first answer [s]", "machine code [s]", "late p99 [ms]", "late most [ms]",
                  "tick before [us]", "tick after [us]")  # fmt: skip
    verdicts = []
    for name in options.only:
        with tempfile.TemporaryDirectory() as cache:
            environment = os.environ | {"REHAB_OPT_CACHE": cache, "REHAB_OPT_COMPILE": "1"}
            command = [sys.executable, "-m", "bench.first_answer", "--here", name]
            told = subprocess.run(command, env=environment, check=True, capture_output=True, text=True).stdout
        numbers = [float(each) for each in told.split()]
        table.add_row(name, *(f"{each:.3g}" for each in numbers))
        verdicts += [
            Verdict(f"{name}: first answer", numbers[1], "<=", ANSWER, "s"),
            Verdict(f"{name}: machine code answers", numbers[2], "<=", READY, "s"),
            Verdict(f"{name}: lateness of 99 of 100 ticks", numbers[3], "<=", LATE, "ms"),
        ]
    console.print(table)
    print_verdicts(console, verdicts)
    return 0 if all_met(verdicts) else 1


def measured(made: Callable[[], tuple[float, Callable[[], object]]]) -> tuple[float, ...]:
    """Seconds until it is made, answers, and is compiled; lateness p99 and most [ms]; ticks before and after [us]."""
    # What imports cost is measured elsewhere.
    from rehab_opt import Assistance, MirrorTracker, PoseTracker, RedundancyResolver, Workspace  # noqa: F401, PLC0415
    from rehab_opt.symbolic.background import finished  # noqa: PLC0415

    os.environ["REHAB_OPT_COMPILE"] = "1"  # in the background, whatever this folder's __init__ says
    begun = time.perf_counter()
    dt, tick = made()
    ready = time.perf_counter() - begun
    tick()
    answered, compiled_at = time.perf_counter() - begun, float("nan")
    late: list[float] = []
    before: list[float] = []
    after: list[float] = []
    deadline = end = time.perf_counter()
    end += LONGEST
    while time.perf_counter() < end:
        while (now := time.perf_counter()) < deadline:
            pass
        late.append(now - deadline)
        tick()
        took = time.perf_counter() - now
        (before if np.isnan(compiled_at) else after).append(took)
        if np.isnan(compiled_at) and len(late) % 10 == 0 and finished(0.0):
            compiled_at, end = time.perf_counter() - begun, time.perf_counter() + 1.0
        deadline += dt
    p99, most = np.quantile(late, [0.99, 1.0]) * 1e3
    return (
        ready,
        answered,
        compiled_at,
        float(p99),
        float(most),
        *(float(np.median(each)) * 1e6 for each in (before, after)),
    )


if __name__ == "__main__":
    sys.exit(main())
