"""Results of a robot that led a hand along a mirrored path, tick by tick."""

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
"""Names of the controllers in the order of the figures; A* is separate, since its path has no times."""


@dataclass(frozen=True, eq=False)
class Led:
    """One controller along the reference, M ticks; values hold at the beginning of their tick.

    Parameters
    ----------
    time : (M,) [s] when each tick begins.
    q, command : (M, n) [rad], and the velocity held during the tick [rad/s].
    tool, reference : (M, 4, 4) pose of the tool, and the reference at the clock's time.
    manipulability : (M,) w / w_max, computed from q.
    lag : (M,) [s] age of the followed reference.
    pace : (M,) seconds of the reference per second.
    short : (M, 2) [m, rad] least deviation from the reference that person and robot can reach from here.
    person : (M, 2) [m, rad] part of it due to the person's arm.
    status, relaxed : (M,) as in each command.
    reasons : (M,) reason for a command that is not an ordinary one.
    seconds : (M,) computing time of each tick, or (1,) of all ticks.
    complete : whether the end of the reference was reached.
    counts : how often the tracker waited, gave up a stretch, slowed and so on.
    motion : the run, if joints do not move exactly as commanded; else None.
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
    """Motion of a drive along a controller's joints, M samples; for a robot with servos, its true motion."""

    time: Array
    """(M,) [s]"""
    q: Array
    """(M, n) [rad]"""
    tool: Array
    """(M, 4, 4)"""
    deviation: Array
    """(M,) [m] distance of the tool from the reference at the controller's time."""
    manipulability: Array
    """(M,) w / w_max"""
    law_time: Array
    """(M,) [s] corresponding time of the controller's run."""
    lag: Array
    """(M,) [s] age of the followed reference."""
    pace: Array
    """(M,) seconds of the reference per second."""


def led_trace(led: Led, drive: DrivenJoints, cause: NDArray[np.int_], names: Sequence[str]) -> Trace:
    """One row for each tick; cells without a reference are empty. `_led`, `_drive` and `_cause` are kept with it."""
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
    """Data for the figures of a run.

    Parameters
    ----------
    metrics : of the run.
    chain : the robot. floor : least w / w_max. mirror : mirror plane of the patient.
    time, reference : (N,) [s] and (N, 4, 4) the mirrored poses of the tool; NaN where the tracker lost the hand.
    recorded : (K, 3) [m] path of the healthy hand in the robot's frame.
    laws : runs by name in `LAWS`.
    drives : for each of these, the motion of a drive along its joints.
    causes : for each drive, (M,) causes of deviation or lag as indices into `metrics.CAUSES`.
    astar : the published path, if requested.
    max_deviation, linear_speed : [m, m/s] the bounds.
    near : distances between bodies, tick by tick; None without `[clearance]`.
    """

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
