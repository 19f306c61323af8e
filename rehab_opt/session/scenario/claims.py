"""What the scenarios promise, as numbers of a trial: no force within W_c, most resistance near the target."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.gate import Mode
from rehab_opt.session.scenario.deviation import Projection
from rehab_opt.session.scenario.trial import Trial

__all__ = ["promised", "time_to_zero_force"]

NEAR = 0.25
"""Share of the reference that counts as near its end."""


def promised(trial: Trial, where: Projection, mode: Mode) -> dict[str, Any]:
    """The numbers of one trial; `where` are its places on the reference.

    The size of the commanded force may not grow inside. Along the reference, towards its end, only outside W_c counts.
    """
    wanted, commanded = np.linalg.norm(trial.wanted, axis=1), np.linalg.norm(trial.commanded, axis=1)
    growth = np.diff(np.concatenate(([0.0], commanded)))
    inside, outside = trial.inside, ~trial.inside
    along = (trial.commanded * where.tangent).sum(axis=1)
    led = mode != "hold" and bool(outside.any())
    near = where.length - where.along <= NEAR * where.length
    return {
        "force_wanted_inside_max_N": float(wanted[inside].max()) if inside.any() else None,
        "force_growth_inside_max_N": float(growth[inside].max()) if inside.any() else None,
        "time_to_zero_force_after_entry_max_s": time_to_zero_force(trial),
        "force_along_reference_outside_min_N": float(along[outside].min()) if led else None,
        "force_along_reference_outside_max_N": float(along[outside].max()) if led else None,
        "force_along_reference_last_quarter_mean_N": _mean(along, outside & near if led else None),
        "force_along_reference_before_mean_N": _mean(along, outside & ~near if led else None),
    }


def time_to_zero_force(trial: Trial) -> float | None:
    """[s] from entering W_c, or the start in it, until the force is exactly zero: the longest of all stays.

    A stay that ends before counts with its length, so that it cannot hide a force that was never let go. None where
    the hand was never inside.
    """
    edges = np.flatnonzero(np.diff(np.concatenate(([0], trial.inside.astype(np.int8), [0]))))
    zero: NDArray[np.bool_] = (trial.commanded == 0).all(axis=1)
    longest: float | None = None
    for entry, left in zip(edges[::2], edges[1::2], strict=True):
        first = entry + int(np.argmax(zero[entry:left])) if zero[entry:left].any() else min(left, len(zero) - 1)
        longest = max(longest or 0.0, float(trial.time[first] - trial.time[entry]))
    return longest


def _mean(values: NDArray[np.float64], ticks: NDArray[np.bool_] | None) -> float | None:
    return float(values[ticks].mean()) if ticks is not None and ticks.any() else None
