"""Metrics of a mirrored motion, and the causes for which the hand deviates from the reference or is late."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.hand_bounds import HandBounds
from rehab_opt.control.mirror_statement import WHOLE
from rehab_opt.control.smoothing import smooth_path
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.published.astar import AStarPath
from rehab_opt.session.outcome import Array, error_metrics, joint_metrics, reason_counts, status_counts, time_metrics
from rehab_opt.session.trace import Trace
from rehab_opt.session.upper_limb.problem import SmoothingSection

CAUSES = ("followed", "late", "person's arm", "floor", "keep-out", "robot's reach", "stopped")
"""Causes in the order of the figures. `late`: the reference is slowed, or the hand lags behind it. If several apply,
the
first of `stopped`, `person's arm`, `floor`, `keep-out`, `robot's reach`, `late` counts."""
NEAR, TURNED = 5e-3, math.radians(5.0)
"""[m, rad] Within this deviation, the hand counts as following the reference."""
AT_FLOOR, AT_PLANE = 0.02, 0.005
"""The floor counts as the cause if w / w_max is this close to it, and a plane if the robot is less than this height [m]
above it."""


def causes(led: Trace, drive: Trace, bounds: HandBounds) -> NDArray[np.int_]:
    """Index (M,) into `CAUSES` for each sample of the drive: why the hand deviates or is late."""
    short, from_arm = led["_short"], led["_person"]
    person = (from_arm[:, 0] > NEAR) | (from_arm[:, 1] > TURNED)
    robot = (short - from_arm > (NEAR, TURNED)).any(axis=1) & ~person
    behind = (led["deviation_m"] > NEAR + short[:, 0]) | (led["turn_rad"] > TURNED + short[:, 1])
    found = np.where((led["pace"] < WHOLE) | behind, 1, 0)
    found[robot] = 5
    # `_short` does not contain a deviation within the largest allowed one; a bound that is near is its cause.
    off = robot | (behind & ~person)
    for plane in bounds.planes:
        found[off & (bounds.min_heights(led["joint"], plane) < AT_PLANE)] = 4
    found[off & (np.abs(led["manipulability"] - bounds.floor) < AT_FLOOR)] = 3
    found[person] = 2
    found[np.isin(led["status"], ("braking", "holding"))] = 6
    found = found[_ticks(led, drive["law_t_s"])]
    return np.where((found == 0) & (drive["pace"] < WHOLE), 1, found)


def _ticks(led: Trace, when: Array) -> NDArray[np.int_]:
    """(K,) index of the controller's tick at each time (K,) [s]."""
    return np.searchsorted(led["t_s"], when + ROUNDING, side="right") - 1


DT, EVERY = 1e-3, 5
"""[s] Tick of a drive, and number of ticks between stored samples."""
FREE = 1e9
ROUNDING = 1e-9
"""[s] Tolerance for the time of a tick."""
AGAIN = 20
"""Largest number of attempts to find a speed of the joints at which the hand is slow enough."""


def driven(
    led: Trace, robot: SerialChain, bounds: SmoothingSection, *, linear_speed: float, max_manipulability: float
) -> Trace:
    """Motion of a drive along a controller's joint path; all joints wait for the slowest joint and for the hand.

    `smooth_path` treats the hand's path length as one more axis, with the speed limit `linear_speed` [m/s].
    If the hand is faster between two samples, the motion is computed again at a lower speed. For a robot with servos,
    the result is the robot's true motion. `law_t_s` is the corresponding time of the controller's run.
    """
    if "_velocity" in led:
        return Trace(led | {"law_t_s": led["t_s"]})
    fraction = 1.0
    for _ in range(AGAIN):
        times, q, when = _passed(led, robot, bounds, linear_speed=fraction * linear_speed)
        tool = np.array([robot.pose(each) for each in q])
        fastest = float(np.linalg.norm(np.diff(tool[:, :3, 3], axis=0), axis=1).max(initial=0.0)) / (EVERY * DT)
        if fastest <= linear_speed:
            break
        fraction *= linear_speed / fastest * (1 - 1e-6)
    reference = np.column_stack([np.interp(when, led["t_s"], axis) for axis in led["reference"].T])
    return Trace(
        {
            "t_s": times,
            "joint": q,
            "_tool": tool,
            "deviation_m": np.linalg.norm(tool[:, :3, 3] - reference, axis=1),
            "manipulability": np.array([robot.manipulability(each) for each in q]) / max_manipulability,
            "law_t_s": when,
            "lag_s": times - np.interp(when, led["t_s"], led["t_s"] - led["lag_s"]),
            "pace": led["pace"][_ticks(led, when)] * np.diff(when, append=when[-1]) / (EVERY * DT),
        }
    )


def _passed(
    led: Trace, robot: SerialChain, bounds: SmoothingSection, *, linear_speed: float
) -> tuple[Array, Array, Array]:
    """Three results: a drive's times (K,) [s] and joint positions (K, n) [rad]; the controller's times (K,) [s]."""
    jerk = np.full(robot.n, math.radians(bounds.jerk_deg_s3))
    way = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(led["tool"], axis=0), axis=1)))
    found = smooth_path(
        led["t_s"],
        np.column_stack([led["joint"], way]),
        velocity=np.append(np.minimum(robot.velocity, math.radians(bounds.speed_deg_s)), linear_speed),
        acceleration=np.append(np.minimum(robot.acceleration, math.radians(bounds.acceleration_deg_s2)), FREE),
        jerk=np.append(jerk, FREE),
        lower=np.append(robot.lower, -FREE),
        upper=np.append(robot.upper, FREE),
        dt=DT,
        measured=False,
    )
    return found.times[::EVERY], found.positions[::EVERY, :-1], found.phase[::EVERY]


BELOW = 1e-3
"""w / w_max counts as below the floor only if it is lower by more than this."""
SAMPLES = 400
"""Largest number of reference poses for which `passed_fraction` searches a path."""


def led_metrics(
    led: Trace, drive: Trace, bounds: HandBounds, reference: Array, *, cause: NDArray[np.int_], rate: float
) -> dict[str, Any]:
    """Metrics of one controller and its `drive`; samples with a lost hand have no deviation.

    `reference` (N, 4, 4) are the reference poses without lost samples; `cause` (K,) are the drive's `causes`.
    """
    deviation, robot = led["deviation_m"], bounds.chain
    seen, time, command = np.isfinite(deviation), drive["t_s"], led["command"]
    q = np.concatenate([led["joint"], led["joint"][-1:] + command[-1:] / rate])  # and the positions after the last tick
    tool = np.concatenate([led["_tool"][:, :3, 3], robot.pose(q[-1])[None, :3, 3]])
    w = np.append(led["manipulability"], robot.manipulability(q[-1]) / bounds.max_manipulability)
    speed = np.linalg.norm(np.diff(tool, axis=0), axis=1) * rate
    change = (np.abs(np.diff(command, axis=0, prepend=0.0)) * rate / robot.acceleration).max(axis=1)
    moves = np.linalg.norm(np.diff(drive["_tool"][:, :3, 3], axis=0), axis=1) / np.diff(time)
    return {
        "drive": {
            "duration_s": float(time[-1]),
            "passed_fraction_of_time": passed_fraction(drive["_tool"], reference),
            **error_metrics(drive["deviation_m"][np.isfinite(drive["deviation_m"])], "deviation", "m"),
            "manipulability_min": float(drive["manipulability"].min()),
            "tool_speed_max_m_s": float(moves.max()),
            "seconds_by_cause": {
                name: float(np.sum(cause == k) * (time[1] - time[0])) for k, name in enumerate(CAUSES)
            },
            **_lags(drive["lag_s"]),
        },
        "ticks": len(led["t_s"]),
        "duration_s": float(led["t_s"][-1]),
        "complete": bool(led["_complete"]),
        "manipulability_min": float(w.min()),
        "manipulability_median": float(np.median(w)),
        "below_floor_fraction_of_time": float(np.mean(w < bounds.floor - BELOW)),
        "passed_fraction_of_time": passed_fraction(led["_tool"], reference),
        **error_metrics(deviation[seen], "deviation", "m"),
        **error_metrics(np.rad2deg(led["turn_rad"][seen]), "turn", "deg"),
        "tool_speed_max_m_s": float(speed.max()),
        **joint_metrics(robot, q, rate),
        "joint_acceleration_max_fraction_of_limit": float(change.max()),
        "joint_acceleration_above_limit_ticks": int(np.sum(change > 1.0 + 1e-6)),
        **_lags(led["lag_s"]),
        "pace_mean": float(led["pace"].mean()),
        "reference_held_back_s": float(np.maximum(1.0 - led["pace"], 0.0).sum() / rate),
        "computing_s": float(led["_seconds"].sum()),
        **(time_metrics(led["_seconds"], "tick") if len(led["_seconds"]) > 1 else {}),
        "status": status_counts(led["status"].tolist()),
        "relaxed": status_counts(filter(None, led["relaxed"].tolist())),
        "reasons": reason_counts(_kind(text) for text in led["_reason"].tolist()),
        "counts": led["_counts"].item(),
    }


def _lags(lag: Array) -> dict[str, float]:
    return {"lag_mean_s": float(lag.mean()), "lag_max_s": float(lag.max()), "lag_at_end_s": float(lag[-1])}


def passed_fraction(tool: Array, reference: Array) -> float:
    """Fraction of reference poses (N, 4, 4) that a path (M, 4, 4) passes within `NEAR` and `TURNED`, at any time."""
    poses = reference[:: math.ceil(len(reference) / SAMPLES)]
    met = 0
    for pose in poses:
        near = np.linalg.norm(tool[:, :3, 3] - pose[:3, 3], axis=1) <= NEAR
        cosines = 0.5 * (np.einsum("nij,ij->n", tool[near, :3, :3], pose[:3, :3]) - 1.0)
        met += bool(np.any(cosines >= math.cos(TURNED)))
    return met / len(poses)


def astar_metrics(path: AStarPath, bounds: HandBounds, reference: Array) -> dict[str, Any]:
    """Metrics of the A* path; a deviation is the distance of a reference position from the path, which has no times."""
    w = np.array([bounds.chain.manipulability(each) for each in path.q]) / bounds.max_manipulability
    return {
        "positions": len(path.q),
        "complete": path.complete,
        "manipulability_min": float(w.min()),
        **error_metrics(path.deviations(reference), "deviation", "m"),
        "expanded": path.expanded,
        "blocked": path.blocked,
        "computing_s": path.seconds,
    }


def _kind(reason: str) -> str:
    """A reason without its measured numbers."""
    parts = ["the reference is slowed" if "of its pace" in part else part for part in reason.split("; ") if part]
    return "; ".join(parts)
