"""How a loop keeps the time: `python -m bench.loop`; `--ur`, `--franka PYTHON`: led by RTDE or FCI, on no robot.

A `PoseTracker` on a simulated UR5 at 1 kHz: alone; with a log and a viewer in processes of their own; the same as
SCHED_FIFO. Each row is the best of `--rounds` by p99.9, as the load of others is in all of them. `--franka` is told a
Python that has franka-sim, see `tests/loop/franka_robot.py`.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from bench.machine import empty_loop, machine
from bench.verdict import Verdict, all_met, print_verdicts
from rehab_opt.errors import DeviceLostError
from rehab_opt.loop.log import DEPTH, Log
from rehab_opt.loop.logged import read_log
from rehab_opt.loop.loop import Loop
from rehab_opt.loop.of_problem import decide_of
from rehab_opt.loop.records import state_layout
from rehab_opt.loop.report import LoopReport
from rehab_opt.loop.scheduling import in_time
from rehab_opt.loop.shared_ring import SharedRing
from rehab_opt.session.files import ProblemFile, load_problem
from rehab_opt.session.run import live_problem

__all__ = ["main"]

PROBLEM = "robot/ur5_circle"
FIFO = 20
HOST = "127.0.0.1"
VIEWER = (
    "import sys, time\n"
    "from rehab_opt.loop.shared_ring import SharedRing\n"
    "ring = SharedRing.attach(sys.argv[1])\n"
    "while True:\n"
    "    newest = ring.latest()\n"
    "    until = time.perf_counter() + 0.004\n"  # as long as a page draws
    "    while time.perf_counter() < until: pass\n"
    "    time.sleep(0.0125)\n"
)
ROWS = (
    ("alone", False, None, 1.0, None),
    ("log and viewer", True, None, 6.0, None),
    ("log and viewer, SCHED_FIFO", True, FIFO, 0.3, 5.0),
)
"""Name, whether others read, priority, p99.9 and worst that were asked for [ms]."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run, print the table and the verdicts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--ur", action="store_true", help="only the robot behind RTDE, at 500 Hz")
    parser.add_argument("--franka", metavar="PYTHON", help="only mirror therapy with a robot of franka-sim")
    options = parser.parse_args(arguments)
    os.environ.setdefault("REHAB_OPT_COMPILE", "wait")
    console = Console(width=140)
    console.print("  ".join(f"{key}: {value}" for key, value in machine().items()), highlight=False)
    if options.ur:
        return _behind_rtde(console, options.seconds)
    if options.franka:
        return _behind_fci(console, options.seconds, options.franka)
    table = Table(title=f"PoseTracker on MuJoCo's UR5 at 1 kHz, {options.seconds:g} s, best of {options.rounds}")
    for name in (
        "",
        "load",
        "p50 ms",
        "p99 ms",
        "p99.9 ms",
        "worst ms",
        "tick p99.9 ms",
        "missed",
        "stale",
        "log lost",
    ):
        table.add_column(name, justify="right")
    verdicts = []
    for name, others, fifo, p999, worst in ROWS:
        runs = []
        for _ in range(options.rounds):
            console.print(f"{name}: {empty_loop(fifo)}", highlight=False)
            runs.append(_run(options.seconds, others=others, fifo=fifo))
        report, load, lost = min(runs, key=lambda run: run[0].lateness.percentile(99.9))
        late = [1e3 * report.lateness.percentile(each) for each in (50, 99, 99.9)]
        most, took = 1e3 * report.lateness.worst, 1e3 * report.tick_time.percentile(99.9)
        table.add_row(
            name,
            load,
            *(f"{each:.3f}" for each in (*late, most, took)),
            str(report.missed),
            str(report.stale),
            str(lost),
        )
        verdicts.append(Verdict(f"{name}: lateness p99.9", late[2], "<=", p999, "ms"))
        if worst is not None:
            verdicts.append(Verdict(f"{name}: worst lateness", most, "<=", worst, "ms"))
        verdicts.append(Verdict(f"{name}: records the log lost", lost, "<=", 0))
        console.print(report.scheduling, highlight=False)
    console.print(table)
    print_verdicts(console, verdicts)
    return 0 if all_met(verdicts) else 1


def _run(seconds: float, *, others: bool, fifo: int | None) -> tuple[LoopReport, str, int]:
    problem = live_problem(load_problem(PROBLEM), plant="mujoco")
    control = problem.control()
    plant, decide = control.plant, decide_of(control)
    plant.reset(control.start)
    load = f"{os.getloadavg()[0]:.1f}"
    with ExitStack() as stack:
        ring = stack.enter_context(SharedRing.create(state_layout(problem.encoders), depth=DEPTH))
        if not others:
            return Loop(plant, decide, state=ring, fifo=fifo).run(seconds=seconds), load, 0
        folder = stack.enter_context(tempfile.TemporaryDirectory())
        log = stack.enter_context(Log(ring, Path(folder) / "trace.mcap", names=problem.names))
        stack.enter_context(_process([sys.executable, "-c", VIEWER, ring.name]))
        report = Loop(plant, decide, state=ring, watches=(log.watch,), fifo=fifo).run(seconds=seconds)
    return report, load, log.lost


@contextmanager
def _process(command: list[str], *, fifo: int | None = None) -> Iterator[None]:
    with subprocess.Popen(command) as process:
        try:
            if fifo is not None:
                os.sched_setscheduler(process.pid, os.SCHED_FIFO, os.sched_param(fifo))
            yield
        finally:
            process.kill()


def _behind_rtde(console: Console, seconds: float) -> int:
    """A joint swings for so long, its commands and positions through ur_rtde and `tests/loop/rtde_server.py`."""
    from rehab_opt.control.command import Command, Relaxed, Status  # noqa: PLC0415
    from rehab_opt.loop.delay import measured_delay  # noqa: PLC0415
    from rehab_opt.loop.records import Tick  # noqa: PLC0415
    from rehab_opt.loop.ur import connect_ur  # noqa: PLC0415  (its extra)
    from tests.loop.rtde_server import DELAY, ORDERS, TRUTH  # noqa: PLC0415

    def swing(tick: Tick) -> Command:
        value = np.zeros(6)
        value[1] = 0.1 * np.sin(tick.time) * tick.enabled
        status = Status.OK if tick.enabled else Status.HOLDING
        return Command(value, status, "", 0.0, 0, "", Relaxed.NOTHING, 1.0)

    with ExitStack() as stack:
        truth, orders = (stack.enter_context(SharedRing.create(each)) for each in (TRUTH, ORDERS))
        server = [sys.executable, "-m", "tests.loop.rtde_server", HOST, truth.name, orders.name]
        stack.enter_context(_process(server, fifo=FIFO))
        while truth.latest() is None:
            time.sleep(0.01)
        robot = stack.enter_context(connect_ur(HOST, fifo=FIFO))
        console.print(
            f"delay: {1e3 * measured_delay(robot, joint=1, fifo=FIFO):.1f} ms, the robot's own {1e3 * DELAY:.1f}"
        )
        report = Loop(robot, swing, fifo=FIFO).run(seconds=seconds)
    console.print(str(report), highlight=False)
    ran = report.ticks * robot.dt
    verdicts = [
        Verdict("RTDE at 500 Hz: ran without a break", 0.0 if report.lost else ran, ">=", 0.99 * seconds, "s"),
        Verdict("commands of a state that was too old", float(report.stale), "<=", 0),
    ]
    print_verdicts(console, verdicts)
    return 0 if all_met(verdicts) else 1


def _behind_fci(console: Console, seconds: float, python: str) -> int:
    """Mirror therapy on franka-sim, which stops at its limits and at 20 missed cycles; then a step that it refuses."""
    import franky  # noqa: PLC0415  (its extra)

    from rehab_opt.loop.franka import FrankaDriver  # noqa: PLC0415
    from rehab_opt.loop.of_problem import delay_of, replay_problem, run_in_time  # noqa: PLC0415
    from tests.loop.franka_robot import robot  # noqa: PLC0415

    name, host = "mirror/franka_pick_fruit", "127.0.0.1"

    def on(folder: Path) -> ProblemFile[Any]:
        """The shipped problem with a table of its own, so that its log has that, too."""
        shutil.copytree(load_problem(name).path.parents[1], folder, dirs_exist_ok=True)
        file = folder / f"{name}.toml"
        plant = f'[plant]\nkind = "franka"\naddress = "{host}"\n'
        file.write_text(f"{file.read_text()}\n{plant}")
        return load_problem(str(file))

    with robot(python, fifo=FIFO, strict=True), tempfile.TemporaryDirectory() as folder:
        start = np.deg2rad(load_problem(name).problem.robot.start_deg)
        mover = franky.Robot(host, realtime_config=franky.RealtimeConfig.Ignore, relative_dynamics_factor=0.1)
        mover.move(franky.JointMotion(start))
        del mover
        delay = delay_of(on(Path(folder) / "unknown"), joint=0, fifo=FIFO)
        console.print(f"delay: {1e3 * delay:.1f} ms")
        log = Path(folder) / "trace.mcap"
        report, lost = run_in_time(on(Path(folder) / "told"), seconds=seconds, log=log, fifo=FIFO)
        console.print(str(report), highlight=False)
        ticks = read_log(log)
        again, moved = (
            replay_problem(ticks),
            float(np.abs(np.diff(ticks.records["position"], axis=0)).sum(axis=0).max()),
        )
        reflex = ""
        with in_time(FIFO), closing(FrankaDriver(host, 0.05)) as driver:
            for limit in (driver._robot.joint_jerk_limit, driver._robot.joint_acceleration_limit):
                limit.set(list(limit.max))
            try:
                for k in range(40):
                    driver.send([0.0, 0.0, 0.0, 0.3 * (-1) ** k, 0.0, 0.0, 0.0])
                    time.sleep(0.02)
                    driver.read()
            except DeviceLostError as told:
                reflex = str(told)
                driver._robot.recover_from_errors()
    console.print(f"the step beyond the limits: {reflex or 'nothing said'}; the farthest joint went {moved:.2f} rad")
    ran = 0.0 if report.lost else report.ticks / load_problem(name).problem.tracker.rate_hz
    verdicts = [
        Verdict("mirror therapy on franka-sim: ran without a reflex", ran, ">=", 0.99 * seconds, "s"),
        Verdict("way of the joint that moved most", moved, ">=", 0.5, "rad"),
        Verdict("commands of a state that was too old", float(report.stale), "<=", 0),
        Verdict(
            "records the log lost, and commands that do not repeat", float(lost + again.ticks - again.same), "<=", 0
        ),
        Verdict("steps beyond the limits that were stopped by a reflex", float("reflex" in reflex), ">=", 1),
    ]
    print_verdicts(console, verdicts)
    return 0 if all_met(verdicts) else 1


if __name__ == "__main__":
    raise SystemExit(main())
