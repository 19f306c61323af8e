"""A law's joint path as a drive would get it: every millisecond, with bounded speed, acceleration and jerk."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.smoothing import smooth_path
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.session.upper_limb.laws import hand_and_tilt
from rehab_opt.session.upper_limb.outcome import Drive
from rehab_opt.session.upper_limb.problem import SmoothingSection

__all__ = ["driven"]

Array = NDArray[np.float64]

DT = 0.001  # [s]


def driven(
    chain: SerialChain, q: Array, times: Array, path: Array, bounds: SmoothingSection
) -> tuple[Drive, dict[str, Any]]:
    """The joints q (N, n) [rad] at `times` (N,) [s] of a hand path (N, 3) [m], passed by `smooth_path`; its numbers.

    The bounds of speed and acceleration are the smaller of the file's and the chain's. All joints wait for the slowest
    one, so that hand and handle keep their way; the hand is compared with the path where the drive is in it.
    """
    speed = np.minimum(math.radians(bounds.speed_deg_s), chain.velocity)
    acceleration = np.minimum(math.radians(bounds.acceleration_deg_s2), chain.acceleration)
    found = smooth_path(
        times, q, velocity=speed, acceleration=acceleration, jerk=math.radians(bounds.jerk_deg_s3), dt=DT,
        lower=chain.lower, upper=chain.upper,
    )  # fmt: skip
    hand, tilt = hand_and_tilt(chain, found.positions)
    asked = np.column_stack([np.interp(found.phase, times, column) for column in path.T])
    begins = np.searchsorted(found.phase, np.append(times[0], (times[1:] + times[:-1]) / 2))
    begins = np.minimum(begins, len(hand) - 1)
    passes = np.interp(times, found.phase, found.times)
    drive = Drive(
        path=found,
        hand=hand,
        passes=passes,
        q=np.column_stack([np.interp(passes, found.times, column) for column in found.positions.T]),
        position_error=np.maximum.reduceat(np.linalg.norm(hand - asked, axis=1), begins),
        handle_tilt=np.maximum.reduceat(tilt, begins),
    )
    moved, change = np.diff(found.positions, axis=0) / DT, np.diff(found.positions, 2, axis=0) / DT**2
    return drive, {
        "bounds": {
            "speed_deg_s": float(np.rad2deg(speed.min())),
            "acceleration_deg_s2": float(np.rad2deg(acceleration.min())),
            "jerk_deg_s3": bounds.jerk_deg_s3,
        },
        "delay_s": found.delay,
        "joint_deviation_max_deg": float(np.rad2deg(found.deviation.max())),
        "joint_speed_max_share_of_limit": float((np.abs(moved) / speed).max()),
        "joint_acceleration_max_share_of_limit": float((np.abs(change) / acceleration).max(initial=0.0)),
    }
