"""The run that a mirror's tracker in C repeats: faults and forces in it, the robot moving as commanded."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.command import Command
from rehab_opt.control.mirror import MirrorTracker
from rehab_opt.export.recording import (
    MAX_TICKS,
    Joints,
    Run,
    RunTick,
    as_it_moves,
    recorded,
    standing,
    with_faults,
)
from rehab_opt.session.outcome import Progress

__all__ = ["mirror_run"]

Array = NDArray[np.float64]

PUSH = 12.0
"""[N] Largest force of a push that turns the hand aside in the recorded run; once it is beyond what stops the arm."""


def mirror_run(
    tracker: MirrorTracker, start: Array, poses: Array, twists: Array, bodies: Array | None, *, source: str,
    progress: Progress,
) -> Run:  # fmt: skip
    """The tracker's run along poses (N, 4, 4), twists (N, 6) from q = start, as many as a recorded run holds.

    `bodies` (N, k, 14) are those that move, None where there are none. `source` says where the poses come from.
    """
    count = min(len(poses), MAX_TICKS)
    pushed, strong = range(count // 2, 5 * count // 8), 1.1 * tracker._interaction.stop_at
    valid: list[RunTick] = [
        {"q": start, "pose": pose, "twist": twist, "force": _force(k, pushed, strong), "with_force": int(k in pushed)}
        for k, (pose, twist) in enumerate(zip(poses[:count], twists[:count], strict=True))
    ]
    if bodies is not None:
        valid = [{**tick, "obstacles": told} for tick, told in zip(valid, bodies[:count], strict=True)]
    faulty = with_faults(valid, dt=tracker.dt, max_age=tracker.max_age, more=_faults(tracker))
    faulty += standing(faulty, valid[-1], dt=tracker.dt) if tracker.led else []
    tracker.reset()
    about = (
        f"{len(faulty)} ticks along {source}, the robot moving {as_it_moves(tracker.feedback)}, with faults among "
        "them: numbers that are none, stamps that are wrong, the enable input released, jumps, forces; encoders with "
        "noise of 0.1 mrad in the second half"
    )
    joints = Joints(start, dt=tracker.dt, ticks=count, feedback=tracker.feedback)
    return recorded(
        lambda tick: _answer(tracker, tick), faulty, about, joints=joints,
        progress=lambda k: progress("recorded", k, count) if k % 500 == 0 else None,
    )  # fmt: skip


def _answer(tracker: MirrorTracker, tick: RunTick) -> Command:
    force = tick["force"] if tick["with_force"] else None
    return tracker.step(
        tick["q"], tick["pose"], tick["twist"], obstacles=tick.get("obstacles"), force=force, enable=tick["enable"],
        stamp=tick["stamp"],
    )  # fmt: skip


def _force(k: int, pushed: range, strong: float) -> Array:
    """(3,) [N] a push that comes and goes, for five ticks as strong as that."""
    if k not in pushed:
        return np.zeros(3)
    fraction = (k - pushed.start) / len(pushed)
    size = strong if abs(k - pushed.start - len(pushed) // 3) < 3 else PUSH * math.sin(math.pi * fraction)
    return np.array([0.6, -0.8, 0.2]) * size


def _faults(tracker: MirrorTracker) -> tuple[Callable[[RunTick], RunTick], ...]:
    """What can be wrong with a tick besides, and what is only strange."""
    chain, jump = tracker.chain, np.array([0.1, -0.1, 0.05])

    def jumped(tick: RunTick) -> RunTick:
        pose = np.array(tick["pose"])
        pose[:3, 3] += jump
        return {**tick, "pose": pose}

    return (
        lambda tick: {**tick, "pose": 1.1 * tick["pose"]},  # no rigid transform
        lambda tick: {**tick, "pose": np.zeros((4, 4))},
        lambda tick: {**tick, "twist": 1e4 * np.ones(6)},
        lambda tick: {**tick, "q": np.minimum(chain.upper, 10.0) + 0.05},  # beyond every limit
        lambda tick: {**tick, "force": np.full(3, np.nan), "with_force": 1},
        jumped,
    )
