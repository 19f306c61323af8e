"""Convert a caller's values to floats; masked entries, text, times and booleans do not count as numbers."""

from __future__ import annotations

import math
import sys
from typing import Any, TypeGuard

import numpy as np
from numpy.typing import NDArray

from rehab_opt.errors import ConfigurationError

__all__ = ["checked_array", "float_or_nan", "is_finite", "is_real", "is_true", "positive", "real_array"]

Array = NDArray[np.float64]
_FLOATS = np.dtype(np.float64)
_NO_NUMBERS = bool, np.bool_, np.timedelta64


def real_array(value: Any) -> Array:
    """`value` as an array of floats; masked entries become NaN.

    An array of floats is returned as it is, not copied.

    Raises
    ------
    TypeError, ValueError : text, times, booleans, complex numbers, ragged lists, or other non-numbers.
    OverflowError : an integer is too large for a float; a larger float type becomes infinite.
    """
    if type(value) is np.ndarray and value.dtype is _FLOATS:
        return value
    if _is_masked(value):
        if isinstance(value, (list, tuple)):
            return np.array([real_array(each) for each in value])
        return np.where(np.ma.getmaskarray(value), math.nan, real_array(value.data))
    array = np.asarray(value)
    if array.dtype.kind == "O":  # integers beyond 64 bits are numbers, too
        array = np.reshape([_real(each) for each in array.ravel().tolist()], array.shape)
    if array.dtype.kind not in "fiu":
        raise TypeError(f"{array.dtype} is no type of real numbers")
    with np.errstate(over="ignore", under="ignore"):  # a longer float type may become infinite
        return array.astype(np.float64)


def checked_array(argument: str, value: Any, expected: str) -> Array:
    """`real_array(value)`, but it raises `ConfigurationError` for any invalid value."""
    try:
        return real_array(value)
    except (TypeError, ValueError, OverflowError) as problem:
        raise ConfigurationError(argument, value, expected) from problem


def _is_masked(value: Any) -> bool:
    """Whether the value is or contains a masked array."""
    if isinstance(value, (list, tuple)):
        return True in [_is_masked(each) for each in value]  # no short cut: every entry is checked
    if isinstance(value, _NO_NUMBERS):
        raise TypeError(f"{value!r} is no real number")
    return "numpy.ma" in sys.modules and isinstance(value, np.ma.MaskedArray)


def is_real(value: object) -> TypeGuard[float]:
    """Whether `value` is one real number; booleans and times are not, although numpy treats them as integers."""
    return isinstance(value, (int, float, np.floating, np.integer)) and not isinstance(value, _NO_NUMBERS)


def is_finite(value: object) -> TypeGuard[float]:
    """Whether `value` is one finite real number that fits a float."""
    largest = sys.float_info.max
    return is_real(value) and -largest <= (value if isinstance(value, int) else float(value)) <= largest


def float_or_nan(value: object) -> float:
    """`value` as a float: NaN if it is no real number, infinite if an integer is too large."""
    if not is_real(value):
        return math.nan
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf


def is_true(value: object) -> bool:
    """Whether a switch is on: True or 1. Anything else, also NaN and text, is off."""
    return value is True or (isinstance(value, (np.bool_, int, float)) and bool(value == 1))


def positive(argument: str, value: object) -> float:
    """`value` as a float, finite and above zero; raises `ConfigurationError` for any other."""
    if is_finite(value) and value > 0:
        return float(value)
    raise ConfigurationError(argument, value, "a finite number above zero")


def _real(value: Any) -> float:
    if not is_real(value):
        raise TypeError(f"{value!r} is no real number")
    return float(value)
