"""How much of a path an arm reaches, told before a run from a few of its samples."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.arm_ik import ArmIK
from rehab_opt.kinematics.chain import SerialChain

__all__ = ["reach_note"]

Array = NDArray[np.float64]

LOOKED_AT = 40
"""Samples, evenly along the time of the path."""


def reach_note(arm: SerialChain, path: Array, *, handle_tilt: float) -> str:
    """Of some samples of a path (N, 3) [m], how many the hand gets to, and how far off it stays from the others.

    Parameters
    ----------
    handle_tilt : [deg] largest angle between handle and vertical.
    """
    places = path[np.unique(np.linspace(0, len(path) - 1, LOOKED_AT).round().astype(int))]
    answer = ArmIK(arm, handle_tilt=math.radians(handle_tilt)).follow(places)
    near = np.array([status.certified for status in answer.status])
    said = f"in reach: {near.sum()} of {len(places)} samples looked at ({100 * near.mean():.0f} %)"
    if near.all():
        return said
    away = np.linalg.norm([arm.pose(q)[:3, 3] for q in answer.q] - places, axis=1)[~near]
    return f"{said}; from the others the hand stays {1e3 * away.min():.3g} to {1e3 * away.max():.3g} mm away"
