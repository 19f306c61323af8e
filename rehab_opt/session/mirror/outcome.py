"""What a robot did that led a hand along a mirrored path, tick by tick."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.kinematics.vr import Mirror
from rehab_opt.published.astar import AStarPath
from rehab_opt.session.clearance import NearestBodies
from rehab_opt.session.outcome import Array, turn_angles
from rehab_opt.session.trace import Trace

__all__ = ["DrivenJoints", "Led", "MirrorRuns", "led_trace"]


BEFORE, STEP, PLAN = "without floor", "step", "plan"
LAWS = (BEFORE, STEP, PLAN)
"""Names of what is run, in the order they are shown; A* is a path without times, and apart."""


@dataclass(frozen=True, eq=False)
class Led:
    """One law along the reference, M ticks; everything holds at the beginning of its tick.

    Parameters
    ----------
    time : (M,) [s] when each tick begins.
    q, command : (M, n) [rad], and the velocity held during the tick [rad/s].
    tool, reference : (M, 4, 4) where the robot is, and the reference where it was read.
    manipulability : (M,) w / w_max, computed from q.
    lag : (M,) [s] how old the reference is that is followed.
    pace : (M,) seconds of the reference in a second.
    short : (M, 2) [m, rad] by which person and robot stay short of the reference at best, from where they are.
    person : (M, 2) [m, rad] of that which are the person's arm's.
    status, relaxed : (M,) of each command.
    reasons : (M,) why a command is not a plain one.
    seconds : (M,) computing time of each tick, or (1,) of all of them.
    complete : whether the reference's end was reached.
    counts : how often the tracker waited, cut, shortened and so on.
    motion : the run, where joints do not move exactly as commanded; else None.
    """

    time: Array
    q: Array
    command: Array
    tool: Array
    reference: Array
    manipulability: Array
    lag: Array
    pace: Array
    short: Array
    person: Array
    status: tuple[str, ...]
    relaxed: tuple[str, ...]
    reasons: tuple[str, ...]
    seconds: Array
    complete: bool
    counts: dict[str, int]
    motion: Trace | None = None

    @property
    def deviation(self) -> Array:
        """(M,) [m] of the tool from the reference."""
        return np.asarray(np.linalg.norm(self.tool[:, :3, 3] - self.reference[:, :3, 3], axis=1))

    @property
    def turn(self) -> Array:
        """(M,) [rad] of the tool from the reference's orientation."""
        return turn_angles(self.tool[:, :3, :3], self.reference[:, :3, :3])


class DrivenJoints(NamedTuple):
    """What a drive does with a law's joints, M samples; where the robot has servos, what it did."""

    time: Array
    """(M,) [s]"""
    q: Array
    """(M, n) [rad]"""
    tool: Array
    """(M, 4, 4)"""
    deviation: Array
    """(M,) [m] of the tool from the reference where the law read it."""
    manipulability: Array
    """(M,) w / w_max"""
    law_time: Array
    """(M,) [s] of the law's run at which these are passed."""
    lag: Array
    """(M,) [s] how old the reference is that is followed."""
    pace: Array
    """(M,) seconds of the reference in a second."""


def led_trace(led: Led, drive: DrivenJoints, cause: NDArray[np.int_], names: Sequence[str]) -> Trace:
    """A row a tick; cells are empty where there is no reference. Kept with it: `_led`, `_drive`, `_cause`."""
    trace = Trace(
        {
            "t_s": led.time,
            "lag_s": led.lag,
            "pace": led.pace,
            "reference": led.reference[:, :3, 3],
            "tool": led.tool[:, :3, 3],
            "deviation_m": led.deviation,
            "turn_rad": led.turn,
            "manipulability": led.manipulability,
            "status": led.status,
            "relaxed": led.relaxed,
            "joint": led.q,
            "command": led.command,
            "_cause": cause,
        },
        {"joint": [f"{name}_rad" for name in names], "command": [f"{name}_rad_s" for name in names]},
    )
    for name, made in (("_led", led), ("_drive", drive)):
        trace[name] = np.empty((), dtype=object)
        trace[name][()] = made
    return trace


@dataclass(frozen=True, eq=False)
class MirrorRuns:
    """What the figures of a run show.

    Parameters
    ----------
    metrics : of the run.
    chain : the robot. floor : least w / w_max. mirror : of the patient.
    time, reference : (N,) [s] and (N, 4, 4) the mirrored poses of the tool; NaN where sight was lost.
    recorded : (K, 3) [m] the healthy hand in the robot's frame.
    laws : what was run, by its name among `LAWS`.
    drives : of each of these, what a drive does with its joints.
    causes : of each drive, (M,) why the hand is not where or when the reference is, as places in `metrics.CAUSES`.
    astar : the published path where it was asked for.
    max_deviation, linear_speed : [m, m/s] the bounds.
    near : how near bodies came to each other, tick by tick; None without `[clearance]`.
    """

    title: str
    metrics: Mapping[str, Any]
    chain: SerialChain
    time: Array
    floor: float
    mirror: Mirror
    reference: Array
    recorded: Array
    laws: dict[str, Led]
    drives: dict[str, DrivenJoints]
    causes: dict[str, NDArray[np.int_]]
    astar: AStarPath | None
    max_deviation: float
    linear_speed: float
    near: NearestBodies | None
