"""A drive that gets the joints of a followed path, and the postures that it needs between two samples."""

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

__all__ = ["DT", "bounds_of_drive", "driven", "hand_and_tilt", "law_columns"]

DT = 0.001  # [s]
OFF, OVER = 1e-4, math.radians(1e-3)
"""[m, rad] by which hand and handle may leave their ways amid two postures."""
LONG = 0.02
"""[rad] Steps of a joint up to this, from posture to posture, are curves near enough to lines."""
HEAVY = 100.0
"""What the cosine of the handle's tilt counts for against the hand's place [m]."""
DAMPING, ROUNDING = 1e-2, 1e-9
"""[m/rad] What a step counts for at first; [rad] by which its bounds are apart where a joint is at its limit."""
HALVINGS, STEPS = 6, 20
"""Of the way from sample to sample, and of Newton's to a posture amid two."""


def law_columns(trace: Trace, law: str) -> dict[str, NDArray[Any]]:
    """The columns of one controller, without its name; `joint` (N, n) [rad] are its joints."""
    found = {name.lstrip("_"): values for name, values in trace.items() if name.lstrip("_").startswith(law)}
    return {name[len(law) + 1 :] or "joint": values for name, values in found.items()}


def hand_and_tilt(arm: SerialChain, q: Array) -> tuple[Array, Array]:
    """Hands (N, 3) [m], and angles (N,) [rad] of the handle from the vertical, of postures q (N, n)."""
    poses = np.array([arm.pose(posture) for posture in q])
    hand, handle = poses[:, :3, 3], poses[:, :3, 0]
    return hand, np.arctan2(np.hypot(handle[:, 0], handle[:, 1]), handle[:, 2])


def bounds_of_drive(chain: SerialChain, bounds: SmoothingSection) -> dict[str, Any]:
    """Bounds of the joints, each (n,) [rad/s, rad/s^2]: the smaller of the file's and the chain's; jerk [rad/s^3]."""
    return {
        "velocity": np.minimum(math.radians(bounds.speed_deg_s), chain.velocity),
        "acceleration": np.minimum(math.radians(bounds.acceleration_deg_s2), chain.acceleration),
        "jerk": math.radians(bounds.jerk_deg_s3),
    }


def driven(
    chain: SerialChain, q: Array, times: Array, path: Array, bounds: Mapping[str, Any], *, handle_tilt: float
) -> Iterator[tuple[str, Array]]:
    """Columns of a trace: the joints q (N, n) [rad] at `times` (N,) [s] of a hand path (N, 3) [m], by `smooth_path`.

    All joints wait for the slowest, so that hand and handle keep their way; the hand is compared with the path at the
    drive's phase. Where a straight line of the joints would lead the hand off its way, or the handle (largest tilt
    `handle_tilt` [rad]) further over, from one sample to the next, postures in between are found (`_with_between`).

    Yields
    ------
    drive_t_s (N,), drive (N, n) : when it passes each sample, its joints there [rad].
    drive_position_error_m, drive_handle_tilt_rad (N,) : largest ones while it is nearest to this sample.
    _drive_time_s, _drive_phase_s (M,), _drive_joint (M, n), _drive_hand (M, 3) : each `DT`, its time and that of the
        recording which it passes, joints, hand. _drive_deviation (n,) : as of `SmoothPath`.
    """
    found = smooth_path(
        *_with_between(chain, q, times, handle_tilt), **bounds, dt=DT, lower=chain.lower, upper=chain.upper
    )
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
    """Times (M,) and postures (M, n): those given, and as many amid them as the hand and the handle need."""
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
    """Posture near q (n,), with the hand (3,) [m] and the handle over by so much at most; the nearest to it on the way.

    Gauss-Newton's steps within the joint limits, in which the handle comes before the hand.
    """
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
