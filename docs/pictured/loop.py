"""The log of a loop whose switch is released, and whose measurements are late."""

from __future__ import annotations

import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rehab_opt.control.watchdog import default_max_age
from rehab_opt.kinematics.ur5 import ur5
from rehab_opt.loop.log import DEPTH
from rehab_opt.loop.logged import read_log
from rehab_opt.loop.loop import DEAD_MAN, Loop
from rehab_opt.loop.of_problem import control_of, decide_of, log_of, replay_problem
from rehab_opt.loop.records import operator_layout, state_layout
from rehab_opt.loop.shared_ring import SharedRing
from rehab_opt.session.drawing import LIMIT, REFERENCE, TRUE, framed, label_times, legend_below
from rehab_opt.session.files import load_problem
from rehab_opt.session.run import live_problem

PROBLEM, PLANT = "robot/ur5_circle", "mujoco"
SECONDS = 6.0
LET_GO = (2.0, 2.8)
LATE, LATE_BY = (4.2, 4.8), 0.08
"""[s] Interval of late measurements, and their additional delay."""
EACH = 0.02
"""[s] Between two heartbeats."""


def loop_log() -> Figure:
    """Speed, switch and age of measurements from the log."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "trace.mcap"
        _run(path)
        logged = read_log(path)
    again = replay_problem(logged)
    assert again.same == again.ticks, again.first
    return _figure(logged.records)


def _run(path: Path) -> None:
    """Run the problem's loop with an operator and a log."""
    config = load_problem(PROBLEM)
    problem = live_problem(config, plant=PLANT)
    with ExitStack() as stack:
        control = stack.enter_context(control_of(problem))
        wants = operator_layout(problem.encoders, axes=2, force=problem.force)
        operator = stack.enter_context(SharedRing.create(wants))
        layout = state_layout(problem.encoders, wants, force=problem.force)
        state = stack.enter_context(SharedRing.create(layout, depth=DEPTH))
        log = stack.enter_context(log_of(config, problem, state, path, {"plant": PLANT}))
        loop = Loop(
            control.plant, decide_of(control), state=state, operator=operator, watches=(log.watch,),
            plant_command=control.plant_command,
        )  # fmt: skip
        with _operated(operator):
            print(loop.run(seconds=SECONDS))


@contextmanager
def _operated(ring: SharedRing) -> Iterator[None]:
    """An operator who releases the switch for a while, and later delays the measurements."""
    begun, over = time.monotonic(), threading.Event()

    def operate() -> None:
        while not over.wait(EACH):
            now = time.monotonic() - begun
            if not LET_GO[0] < now < LET_GO[1]:
                late = LATE_BY if LATE[0] < now < LATE[1] else 0.0
                ring.write(heartbeat=time.monotonic(), target=np.full((1, 4, 4), np.nan), delay=late)

    operating = threading.Thread(target=operate)
    operating.start()
    try:
        yield
    finally:
        over.set()
        operating.join()


def _figure(records: NDArray[np.void]) -> Figure:
    records = records[(records["operated"] == 1) & (records["time"] < SECONDS)]
    robot, at = ur5(), records["time"]
    states = zip(records["true_position"], records["true_velocity"], strict=True)
    speed = [1e3 * float(np.linalg.norm((robot.jacobian(q) @ v)[:3])) for q, v in states]
    since = 1e3 * (records["clock"] - records["operator_heartbeat"])
    most_age = default_max_age(float(np.diff(at).min()))
    panels: list[tuple[str, Any, float | None]] = [
        ("speed of the tool\n[mm/s]", speed, None),
        ("since the switch\nwas held [ms]", since, 1e3 * DEAD_MAN),
        ("age of the\nstate [ms]", 1e3 * records["age"], 1e3 * most_age),
    ]
    figure = framed("The log of a loop: a simulated UR5 on a circle brakes when it must.", 4.6)
    grid = figure.subplots(len(panels), 1, sharex=True, height_ratios=(1.4, 1, 1))
    for axes, (_, values, most) in zip(grid, panels, strict=True):
        axes.fill_between(
            at, 0, 1, where=records["enabled"] == 0, color=LIMIT, alpha=0.6, linewidth=0,
            transform=axes.get_xaxis_transform(), label="fallback command: the robot brakes and holds",
        )  # fmt: skip
        axes.plot(at, values, color=TRUE, label="from the log")
        if most is not None:
            axes.axhline(most, color=REFERENCE, linestyle="--", label="limit: at most this old")
    label_times(grid, *(label for label, _, _ in panels), from_zero=True)
    top = 1.4 * max(speed)
    grid[0].set_ylim(0, top)
    for middle, words in (
        (np.median(at[since > 1e3 * DEAD_MAN]), "dead man's\nswitch\nreleased"),
        (np.median(at[records["age"] > most_age]), "state\narrives\nlate"),
    ):
        grid[0].text(middle, 0.97 * top, words, ha="center", va="top")
    return legend_below(figure)
