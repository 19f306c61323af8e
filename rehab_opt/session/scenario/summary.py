"""The measures of a law over all of its trials."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

__all__ = ["law_summary"]

LESS_IS_WORSE = frozenset(
    {
        "smoothness_sparc",
        "time_on_target_s",
        "time_on_target_share",
        "goals_reached_share",
        "reference_covered_share",
        "inside_share",
        "pair_energy_left_min_J",
    }
)
"""Of all other measures the largest is the worst."""
NEVER_IS_WORST = frozenset({"time_to_target_s"})
"""Where a trial that has no such number is the worst of all."""


def law_summary(measures: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Mean and worst of every number over the trials, and the share of trials that succeeded.

    A mean is over the trials that have the number, None where none has. The worst of a time that a trial never came to
    is None.
    """
    mean: dict[str, Any] = {}
    worst: dict[str, Any] = {}
    for key in measures[0] if measures else ():
        values = [of[key] for of in measures]
        if key == "success":
            continue
        if isinstance(values[0], Mapping):
            names = dict.fromkeys(name for of in values for name in of)
            mean[key] = {name: float(np.mean([of.get(name, 0.0) for of in values])) for name in names}
            continue
        known = [float(value) for value in values if value is not None]
        mean[key] = float(np.mean(known)) if known else None
        missing = key in NEVER_IS_WORST and len(known) < len(values)
        of_worst = min if key in LESS_IS_WORSE else max
        worst[key] = of_worst(known) if known and not missing else None
    return {
        "success_rate": float(np.mean([of["success"] for of in measures])) if measures else None,
        "mean": mean,
        "worst": worst,
    }
