"""Ranges of motion drawn around a nominal one, where only the mean and the spread of its limits are known."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from rehab_opt.errors import ConfigurationError
from rehab_opt.workspace.used_range import named_ranges

__all__ = ["varied_ranges"]

FURTHEST = 2.0
"""Standard deviations at which the normal distribution is cut: a limit further off is a slip, not a bad day."""


def varied_ranges(
    range_of_motion: str | Mapping[str, Sequence[float]],
    *,
    spread: float | Mapping[str, float | Sequence[float]],
    count: int,
    seed: int,
    keep_locked: bool = True,
) -> tuple[dict[str, tuple[float, float]], ...]:
    """`count` ranges of motion, each usable as `human_arm(range_of_motion=...)`.

    Each lower and each upper limit is normal about the nominal one, cut at two standard deviations (so its own standard
    deviation is 0.88 of the stated one), all independent but for one condition: a pair that comes out inverted is drawn
    again. What is known of real days may well be otherwise: limits of one person tend to fall together.

    Parameters
    ----------
    range_of_motion : nominal (lower, upper) [rad] by joint, "regular" or "restricted".
    spread : [rad] standard deviation of every limit, or by joint, for both limits or (lower, upper). A joint not named
        does not vary. `ReachGroup.spread` has this form.
    count, seed : how many; equal seeds draw equal ranges, and more of them begin with the same ones.
    keep_locked : a joint of zero width stays as it is; else it may come free.

    Raises
    ------
    ConfigurationError : an unknown joint, an inverted range, a negative spread, no draws.
    """
    nominal = named_ranges("range_of_motion", range_of_motion)
    if not isinstance(count, int | np.integer) or not count >= 1:
        raise ConfigurationError("count", count, "a whole number of 1 or more")
    if not isinstance(seed, int | np.integer) or not seed >= 0:
        raise ConfigurationError("seed", seed, "a whole number of 0 or more")
    deviations = dict.fromkeys(nominal, (0.0, 0.0))
    for name, given in spread.items() if isinstance(spread, Mapping) else [(name, spread) for name in nominal]:
        if name not in nominal:
            raise ConfigurationError("spread", name, f"joint names among {', '.join(nominal)}")
        deviations[name] = _deviations(name, given)
    rng = np.random.default_rng(seed)
    drawn = []
    for _ in range(count):
        limits = {}
        for name, (lower, upper) in nominal.items():
            kept = (keep_locked and lower == upper) or deviations[name] == (0.0, 0.0)
            limits[name] = (lower, upper) if kept else _pair((lower, upper), deviations[name], rng)
        drawn.append(limits)
    return tuple(drawn)


def _pair(
    nominal: tuple[float, float], deviation: tuple[float, float], rng: np.random.Generator
) -> tuple[float, float]:
    # Symmetric about an ordered pair: every draw is in order with probability 1/2 or more.
    while True:
        z = rng.standard_normal(2)
        lower, upper = nominal[0] + deviation[0] * float(z[0]), nominal[1] + deviation[1] * float(z[1])
        if np.abs(z).max() <= FURTHEST and lower <= upper:
            return lower, upper


def _deviations(name: str, given: float | Sequence[float]) -> tuple[float, float]:
    try:
        lower, upper = (float(given),) * 2 if np.ndim(given) == 0 else (float(part) for part in given)  # type: ignore
    except (TypeError, ValueError, OverflowError):
        lower = upper = math.nan
    if not (0 <= lower < math.inf and 0 <= upper < math.inf):
        raise ConfigurationError(f"spread[{name!r}]", given, "an angle of 0 or more, or (lower, upper) of such")
    return lower, upper
