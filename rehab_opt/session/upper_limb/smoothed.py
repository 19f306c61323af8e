"""A joint path as a drive would get it: every millisecond, with bounded speed, acceleration and jerk."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.smoother import Smoother
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.session.metrics import lag, reason_counts, status_counts
from rehab_opt.session.upper_limb.problem import SmoothingSection

__all__ = ["smoothed"]

Array = NDArray[np.float64]

DT = 0.001  # [s]


def smoothed(chain: SerialChain, q: Array, rate: float, bounds: SmoothingSection) -> tuple[Array, dict[str, Any]]:
    """The joint path q (N, n) [rad], sampled at `rate` [Hz], behind a `Smoother` at 1 kHz, and its numbers.

    The bounds of speed and acceleration are the smaller of the file's and the chain's.
    Between samples the target moves in straight lines.

    Returns
    -------
    smooth : (N, n) [rad] at the times of q.
    numbers : bounds, lag, largest distance from the target, largest speed, and what the smoother said in its ticks.
    """
    speed = np.minimum(math.radians(bounds.speed_deg_s), chain.velocity)
    acceleration = np.minimum(math.radians(bounds.acceleration_deg_s2), chain.acceleration)
    smoother = Smoother(
        velocity=speed,
        acceleration=acceleration,
        jerk=np.full(chain.n, math.radians(bounds.jerk_deg_s3)),
        dt=DT,
        lower=chain.lower,
        upper=chain.upper,
    )
    samples = np.arange(len(q)) / rate
    ticks = np.arange(round(samples[-1] / DT) + 1) * DT
    target = np.column_stack([np.interp(ticks, samples, column) for column in q.T])
    pace = np.gradient(target, DT, axis=0)
    answer = np.empty_like(target)
    answer[0] = np.clip(target[0], chain.lower, chain.upper)
    smoother.reset(answer[0])
    statuses, reasons = [], []
    for i in range(1, len(ticks)):
        command = smoother.step(target[i], pace[i])
        answer[i] = command.value
        statuses.append(command.status.value)
        reasons.append(command.reason)
    numbers = {
        "bounds": {
            "speed_deg_s": float(np.rad2deg(speed.min())),
            "acceleration_deg_s2": float(np.rad2deg(acceleration.min())),
            "jerk_deg_s3": bounds.jerk_deg_s3,
        },
        "lag_s": lag(target, answer, DT),
        "deviation_max_deg": float(np.rad2deg(np.abs(answer - target).max())),
        "joint_speed_max_deg_s": float(np.rad2deg(np.abs(np.diff(answer, axis=0)).max() / DT)),
        "status": status_counts(statuses),
        "reasons": reason_counts(reasons),
    }
    return np.column_stack([np.interp(samples, ticks, column) for column in answer.T]), numbers
