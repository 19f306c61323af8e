"""The arrays of a sequence: which belong together, and where a number that is none may stand."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rehab_opt.errors import ConfigurationError

__all__ = ["ARRAYS", "checked_arrays", "checked_costs", "checked_numbers"]

Array = NDArray[np.float64]

ARRAYS = ("hessian", "gradient", "rows", "rows_lower", "rows_upper", "lower", "upper")
"""The fields of numbers, in the order of `Instance`."""
BOUNDS = ("rows_lower", "rows_upper", "lower", "upper")
CONVEX = 1e-9
"""Of H's largest number, by how much it may miss its symmetry, or an eigenvalue zero: what rounding leaves."""


def checked_arrays(given: Mapping[str, Any]) -> dict[str, Array]:
    """Copies that are read-only, of n variables, m rows, and T ticks or one for all.

    Raises
    ------
    ConfigurationError : no ticks, no variables, shapes that do not belong together.
    """
    shapes = {key: np.shape(given[key]) for key in ARRAYS}
    m, n = shapes["rows"][1:] if len(shapes["rows"]) == 3 else (0, 0)
    ticks = max(shape[0] if shape else 0 for shape in shapes.values())
    ends = {"hessian": (n, n), "gradient": (n,), "rows": (m, n), "rows_lower": (m,), "rows_upper": (m,)}
    arrays = {}
    for key, shape in shapes.items():
        end = ends.get(key, (n,))
        if not (n and ticks) or shape not in ((1, *end), (ticks, *end)):
            expected = f"({ticks} or 1, {', '.join(map(str, end))}): one or more ticks, variables as rows has columns"
            raise ConfigurationError(key, f"shape {shape}", expected)
        arrays[key] = np.array(given[key], dtype=np.float64)
        arrays[key].setflags(write=False)
    return arrays


def checked_numbers(arrays: Mapping[str, Array], ticks: int, may_be_broken: Callable[[int], bool]) -> None:
    """Refuse numbers that are none, but in ticks where they may be; bounds may be infinite.

    Raises
    ------
    ConfigurationError : NaN, or an infinite cost or row.
    """
    for key, array in arrays.items():
        broken = np.isnan(array) if key in BOUNDS else ~np.isfinite(array)
        for tick in map(int, np.flatnonzero(broken.reshape(len(array), -1).any(axis=1))):
            used_in = [tick] if len(array) > 1 else range(ticks)
            if not all(may_be_broken(each) for each in used_in):
                raise ConfigurationError(key, f"not finite in tick {tick}", 'numbers in a tick not marked "nan"')


def checked_costs(hessian: Array) -> None:
    """Refuse an H that is not symmetric, or not positive semidefinite.

    Of one that is not symmetric some solvers read a half, others the whole; of one that is not convex a certificate
    accepts any stationary point.

    Raises
    ------
    ConfigurationError : it names the first such tick. Ticks that are not finite are passed over.
    """
    known = hessian.copy()
    known[~np.isfinite(known).all(axis=(1, 2))] = 0.0
    size = np.abs(known).max(axis=(1, 2)) + np.finfo(np.float64).tiny
    skew = np.abs(known - known.transpose(0, 2, 1)).max(axis=(1, 2))
    least = np.linalg.eigvalsh(known)[:, 0]
    for wrong, expected in ((skew > CONVEX * size, "symmetric"), (least < -CONVEX * size, "positive semidefinite")):
        if wrong.any():
            raise ConfigurationError(
                "hessian", f"not {expected} in tick {int(np.argmax(wrong))}", f"{expected} matrices"
            )
