"""Target position and velocity of a smoother's axes, as finite numbers inside the bounds."""

from __future__ import annotations

import math

from numpy.typing import ArrayLike

from rehab_opt.control.profiles import Profiles
from rehab_opt.kinematics.real_array import real_array

__all__ = ["AT_REST", "brought_within", "copied", "finite_numbers"]

HEADROOM = 0.99
"""Largest share of the velocity bound that a target's own velocity counts for: the rest is for catching up with it."""
NUMBERS = {float, int}
AT_REST = "target is about to leave the bounds: approached as if at rest"


def brought_within(profiles: Profiles, goal: list[float], speed: list[float]) -> str:
    """Bring goal and speed inside the bounds; a note on what was changed."""
    note = ""
    for i, (low, high, fastest, _, _) in enumerate(zip(*profiles.bounds, strict=True)):
        if not low <= goal[i] <= high:
            goal[i], speed[i] = min(max(goal[i], low), high), 0.0
            note = "target is outside the bounds: clipped"
        if not -fastest <= speed[i] <= fastest:
            note = note or "target is faster than the velocity bound"
        limit = HEADROOM * fastest
        speed[i] = min(max(speed[i], -limit), limit)
        if speed[i] and profiles.leads_out(i, goal[i], speed[i]):
            speed[i] = 0.0
            note = note or AT_REST
    return note


def copied(value: ArrayLike | None) -> object:
    """Copy of a target, to be compared with the next: the caller may overwrite its array, or one in its list."""
    if value is None:
        return None
    if isinstance(value, (list, tuple)) and NUMBERS.issuperset(map(type, value)):
        return list(value)
    try:
        return real_array(value).tolist()
    except (TypeError, ValueError, OverflowError):
        return object()  # equal to nothing


def finite_numbers(value: ArrayLike, n: int) -> list[float] | None:
    """`value` as n finite numbers, or None."""
    try:
        array = real_array(value)
    except (TypeError, ValueError, OverflowError):
        return None
    if array.ndim == 0 and n == 1:
        array = array.reshape(1)
    if array.shape != (n,):
        return None
    numbers: list[float] = array.tolist()
    return numbers if all(map(math.isfinite, numbers)) else None
