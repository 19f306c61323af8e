"""Arrays and numbers that measures are taken of, refused where they cannot be used."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError

__all__ = ["numbers", "positive", "rows", "vectors"]

Array = NDArray[np.float64]


def numbers(argument: str, values: object) -> Array:
    """`values` as finite float64, at least one.

    Raises
    ------
    ConfigurationError : no numbers, none at all, or one that is not finite (the message says which).
    """
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as problem:
        raise ConfigurationError(argument, type(values).__name__, "finite numbers") from problem
    if not array.size:
        raise ConfigurationError(argument, f"shape {array.shape}", "finite numbers, at least one")
    if not np.isfinite(array).all():
        at = np.argwhere(~np.isfinite(array))[0]
        place = ", ".join(str(int(i)) for i in at)
        value = float(array[tuple(at)])
        raise ConfigurationError(f"{argument}[{place}]", value, "a finite number: leave out or fill what was not seen")
    return array


def vectors(argument: str, values: ArrayLike, *, fewest: int = 1) -> Array:
    """(N, d) finite, N at least `fewest`, d at least 1; raises as `numbers`."""
    array = numbers(argument, values)
    if array.ndim != 2 or len(array) < fewest:
        raise ConfigurationError(argument, f"shape {array.shape}", f"(N, d) with N at least {fewest}")
    return array


def rows(argument: str, values: ArrayLike, *, fewest: int = 1) -> Array:
    """(N, d) finite, of a vector of each sample or, as (N,), one number of each; raises as `numbers`."""
    array = numbers(argument, values)
    if array.ndim not in (1, 2) or len(array) < fewest:
        raise ConfigurationError(argument, f"shape {array.shape}", f"(N,) or (N, d) with N at least {fewest}")
    return array.reshape(len(array), -1)


def positive(argument: str, value: float) -> float:
    """A finite number above zero; raises as `numbers`."""
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not 0 < number < math.inf:
        raise ConfigurationError(argument, value, "a finite number above zero")
    return number
