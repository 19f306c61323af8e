"""QPs of many ticks with the statement that they are of: the recorded ones, and those of controllers led at random."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.qp_recording.sequence import read_sequence
from bench.redundancy_run import AGAIN, HOLD
from bench.solvers.dense_qp import dense_statement, fits
from bench.solvers.shipped import shipped_sequences
from bench.test_bench_control import ROOM
from rehab_opt import Clearance, Limit, MirrorTracker, PoseTracker, RedundancyResolver, ardis, ur5
from rehab_opt.control.velocity_controller import VelocityController
from rehab_opt.export import random_runs
from rehab_opt.kinematics.ardis import ARDIS_READY
from rehab_opt.optim.qp import Statement
from rehab_opt.optim.recorder import recording_qps
from rehab_opt.symbolic.compiled import compiled

__all__ = ["Ticks", "led_at_random", "recorded"]

Array = NDArray[np.float64]


class Ticks(NamedTuple):
    """QPs of one statement, one a tick."""

    name: str
    statement: Statement
    tolerance: float
    full: Array
    """(T, ...) complete parameters."""
    memory: Array


def recorded(only: str) -> Iterator[Ticks]:
    """Those of the corpus, but what is too large: each QP is the memory of a statement that has nothing else."""
    for name, path in shipped_sequences().items():
        if name.startswith(("pose_tracking/", "mirror/", "ardis/")) and only in name:
            found = read_sequence(path)
            equal = np.flatnonzero((found.rows_lower == found.rows_upper).all(axis=0)).tolist()
            if fits(found.n, found.m):
                stated = replace(dense_statement(found.n, found.m, equalities=equal), active_set=True)
                numbers = [np.concatenate([part.reshape(-1, order="F") for part in qp]) for qp in found]
                yield Ticks(name, stated, found.tolerance, np.zeros((len(found), 1)), np.array(numbers))


def led_at_random(ticks: int, only: str) -> Iterator[Ticks]:
    """Those of controllers of a UR5, and of chair and arm."""
    random_runs.TICKS = ticks
    elbow = Limit(lambda arm, q: arm.frames_expression(q)[3][2, 3] - 0.1)
    trackers: dict[str, dict[str, Any]] = {
        "poses": {}, "elbow": {"limits": [elbow]}, "moving bodies": {"limits": [Clearance(margin=0.02, moving=2)]},
    }  # fmt: skip
    runs: dict[str, tuple[Callable[[], Any], Callable[[Any], object]]] = {
        name: (partial(PoseTracker, ur5(), dt=0.005, compile="wait", **options), random_runs.tracker_run)
        for name, options in trackers.items()
    }
    runs["mirror"] = partial(MirrorTracker, ur5(), floor=0.3, dt=0.002, compile="wait"), _mirrored
    for drive in ("mecanum", "differential"):
        options = {"drive": drive, "row_sets": [("x", "y", "z")], "obstacles": ROOM, "compile": "wait"}
        runs[f"chair, {drive}"] = partial(RedundancyResolver, ardis(), **options), partial(_led, ticks)
    for name, (make, lead) in runs.items():
        if only in f"{name}, random":
            with recording_qps() as recorder:
                made = make()
                lead(made)
            controller = made if isinstance(made, VelocityController) else made._active
            stated = controller.stated
            (seen,) = (each.seen for each in recorder.streams if each.name == stated.name and len(each))
            parameters, memory = (np.array(column) for column in zip(*seen, strict=True))
            full = np.array(compiled(stated.complete, compile="wait")(parameters.T, memory.T)).T
            yield Ticks(f"{name}, random", stated, controller.tolerance, full, memory)


def _mirrored(tracker: MirrorTracker) -> None:
    reference = random_runs.mirror_reference(tracker)
    q = reference[0]["q"]
    for tick in reference:
        q = q + tracker.dt * tracker.step(q, tick["pose"], tick["twist"]).value


def _led(ticks: int, resolver: RedundancyResolver) -> None:
    rng, stick, q = np.random.default_rng(0), np.zeros(3), ARDIS_READY.copy()
    for k in range(ticks):
        if k % HOLD == 0:
            stick = rng.choice([0.0, 0.1, 0.3, 1.0]) * rng.standard_normal(3) * [1.0, 1.0, 0.3]
        if k % AGAIN == 0:
            q[:] = ARDIS_READY
            resolver.reset()
        q += resolver.dt * resolver.step(q, stick).value
