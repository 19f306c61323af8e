"""A drive that moves the arm's joints along a sequence of postures, with intermediate postures between samples."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.smoothing import smooth_path
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.session.outcome import Array
from rehab_opt.session.trace import Trace
from rehab_opt.session.upper_limb.problem import SmoothingSection

DT = 0.001  # duration of a drive's tick [s]
OFF, OVER = 1e-4, math.radians(1e-3)
"""Largest deviation of the hand [m] and excess tilt of the handle [rad] between two postures."""
LONG = 0.02
"""Largest joint step [rad] without an intermediate posture; the hand's motion is then close to a straight line."""
HEAVY = 100.0
"""Weight of the error of the handle tilt's cosine, relative to the error of the hand position [m]."""
DAMPING, ROUNDING = 1e-2, 1e-9
"""Initial damping [m/rad] of a Gauss-Newton step; margin [rad] added to its joint limits."""
HALVINGS, STEPS = 6, 20
"""Largest number of halvings between two samples, and of Gauss-Newton steps for an intermediate posture."""


def law_columns(trace: Trace, law: str) -> dict[str, NDArray[Any]]:
    """Columns of a controller, named without the controller's prefix; `joint` (N, n) [rad] are the joint positions."""
    found = {name.lstrip("_"): values for name, values in trace.items() if name.lstrip("_").startswith(law)}
    return {name[len(law) + 1 :] or "joint": values for name, values in found.items()}


def hand_and_tilt(arm: SerialChain, q: Array) -> tuple[Array, Array]:
    """Hand positions (N, 3) [m], and angles (N,) [rad] between handle and vertical, for postures q (N, n) [rad]."""
    poses = np.array([arm.pose(posture) for posture in q])
    hand, handle = poses[:, :3, 3], poses[:, :3, 0]
    return hand, np.arctan2(np.hypot(handle[:, 0], handle[:, 1]), handle[:, 2])


def bounds_of_drive(chain: SerialChain, bounds: SmoothingSection) -> dict[str, Any]:
    """Bounds of joint speed, acceleration (n,) and jerk [rad/s^k], from the file and, if smaller, from the chain."""
    return {
        "velocity": np.minimum(math.radians(bounds.speed_deg_s), chain.velocity),
        "acceleration": np.minimum(math.radians(bounds.acceleration_deg_s2), chain.acceleration),
        "jerk": math.radians(bounds.jerk_deg_s3),
    }


def driven(
    chain: SerialChain, q: Array, times: Array, path: Array, bounds: Mapping[str, Any], *, handle_tilt: float
) -> Iterator[tuple[str, Array]]:
    """Columns of a trace of a drive that moves the joints along a path with `smooth_path`.

    All joints wait for the slowest joint, so hand and handle stay on their path. Between two samples, intermediate
    postures are inserted if a straight joint motion would move the hand off its path or tilt the handle too far.

    Parameters
    ----------
    chain : kinematics of the arm. q : joint positions (N, n) [rad] at `times` (N,) [s].
    path : reference positions (N, 3) [m] of the hand at `times`. bounds : bounds from `bounds_of_drive`.
    handle_tilt : largest angle [rad] between handle and vertical.

    Yields
    ------
    drive_t_s (N,), drive (N, n) : time [s] at which the drive passes each sample, and its joint positions then [rad].
    drive_position_error_m, drive_handle_tilt_rad (N,) : largest values while the sample is the nearest one.
    _drive_time_s, _drive_phase_s (M,) : time of the drive in steps of `DT`, and the corresponding recording time.
    _drive_joint (M, n), _drive_hand (M, 3) : joint positions [rad] and hand positions [m] at these times.
    _drive_deviation (n,) : joint deviation as in `SmoothPath`.
    """
    found = smooth_path(
        *_with_between(chain, q, times, handle_tilt), **bounds, dt=DT, lower=chain.lower, upper=chain.upper,
        measured=False,
    )  # fmt: skip
    hand, tilt = hand_and_tilt(chain, found.positions)
    asked = np.column_stack([np.interp(found.phase, times, column) for column in path.T])
    begins = np.searchsorted(found.phase, np.append(times[0], (times[1:] + times[:-1]) / 2))
    begins = np.minimum(begins, len(hand) - 1)
    passes = np.interp(times, found.phase, found.times)
    yield "drive_t_s", passes
    yield "drive_position_error_m", np.maximum.reduceat(np.linalg.norm(hand - asked, axis=1), begins)
    yield "drive_handle_tilt_rad", np.maximum.reduceat(tilt, begins)
    yield "drive", np.column_stack([np.interp(passes, found.times, column) for column in found.positions.T])
    yield "_drive_time_s", found.times
    yield "_drive_phase_s", found.phase
    yield "_drive_joint", found.positions
    yield "_drive_hand", hand
    yield "_drive_deviation", found.deviation


def _with_between(chain: SerialChain, q: Array, times: Array, handle_tilt: float) -> tuple[Array, Array]:
    """Times (M,) and postures (M, n), with intermediate postures inserted that keep hand and handle on their path."""
    for _ in range(HALVINGS):
        hand, tilt = hand_and_tilt(chain, q)
        middle, most = (q[1:] + q[:-1]) / 2, np.maximum(np.maximum(tilt[1:], tilt[:-1]), handle_tilt)
        there, tilted = hand_and_tilt(chain, middle)
        wanted = (hand[1:] + hand[:-1]) / 2
        long = np.abs(np.diff(q, axis=0)).max(axis=1) > LONG
        off = np.flatnonzero(long | (np.linalg.norm(there - wanted, axis=1) > OFF) | (tilted > most + OVER))
        if not off.size:
            break
        more = [_amid(chain, middle[k], wanted[k], float(most[k])) for k in off.tolist()]
        q, times = np.insert(q, off + 1, more, axis=0), np.insert(times, off + 1, (times[off] + times[off + 1]) / 2)
    return times, q


def _amid(chain: SerialChain, q: Array, hand: Array, handle_tilt: float) -> Array:
    """Posture near q (n,) with the hand at `hand` (3,) [m] and limited tilt, by Gauss-Newton within joint limits."""
    from scipy.optimize import lsq_linear  # noqa: PLC0415  (loaded when used)

    best, least, damping, tried = q, math.inf, DAMPING, q
    for _ in range(STEPS):
        pose, jacobian = chain.pose(tried), chain.jacobian(tried)
        x, y, z = pose[:3, 0]
        missing = np.append(hand - pose[:3, 3], HEAVY * max(math.cos(handle_tilt) - z, 0.0))
        if (size := float(missing @ missing)) < least:
            best, least, damping, error = tried, size, damping / 10.0, missing
            rows = np.vstack([jacobian[:3], HEAVY * (y * jacobian[3] - x * jacobian[4])])
        else:
            damping *= 30.0
        stacked = np.vstack([rows, damping * np.eye(chain.n)]), np.append(error, np.zeros(chain.n))
        away = chain.lower - best - ROUNDING, chain.upper - best + ROUNDING
        tried = np.clip(best + lsq_linear(*stacked, bounds=away).x, chain.lower, chain.upper)
    return best
