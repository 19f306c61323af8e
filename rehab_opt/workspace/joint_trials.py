"""Joint angles of one or many trials, in any accepted form, without jumps by whole turns."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.human_arm import ARM_JOINTS
from rehab_opt.kinematics.real_array import checked_array

__all__ = ["joint_trials", "one_branch"]

Array = NDArray[np.float64]

MOST = 4 * math.pi
"""[rad] Largest magnitude of a joint angle; larger ones are degrees."""
WIDEST = 2 * math.pi
"""[rad] Largest range of a joint; a larger one is in degrees."""


def joint_trials(angles: object, names: Sequence[str] | None) -> dict[str, list[Array]]:
    """Trials (T_i,) by joint, from any form of angles that `range_of_motion` accepts.

    Raises
    ------
    ConfigurationError : arrays of a wrong rank, or names that do not fit the columns.
    """
    if isinstance(angles, Mapping):
        if names is not None:
            raise ConfigurationError("names", names, "no names where the angles have theirs")
        if not angles:
            raise ConfigurationError("angles", angles, "at least one joint")
        return {name: [_of_rank(f"angles[{name!r}]", t, 1) for t in _split(given, 1)] for name, given in angles.items()}
    trials = [_of_rank("angles", trial, 2) for trial in _split(angles, 2)]
    if not trials:
        raise ConfigurationError("angles", angles, "at least one trial")
    n = trials[0].shape[1]
    if names is not None and (
        isinstance(names, str)
        or not isinstance(names, Sequence | np.ndarray)
        or not all(isinstance(name, str) for name in names)
    ):
        raise ConfigurationError("names", names, "one name (str) a column of angles, or None")
    columns = tuple(names) if names is not None else (ARM_JOINTS if n == len(ARM_JOINTS) else ())
    if any(trial.shape[1] != len(columns) for trial in trials) or len(set(columns)) != len(columns) or not columns:
        shapes = [trial.shape for trial in trials[:3]]
        raise ConfigurationError("names", names, f"one different name a column of angles (T, n), here {shapes}")
    return {name: [trial[:, i] for trial in trials] for i, name in enumerate(columns)}


def _split(given: object, rank: int) -> list[object]:
    """`given` as a list of trials: its elements if it is a list or a stacked array, else `given` alone."""
    if isinstance(given, np.ndarray):
        return list(given) if given.ndim == rank + 1 else [given]
    if isinstance(given, Sequence) and len(given) and not isinstance(given, str):
        try:
            deeper = np.ndim(given[0]) >= rank
        except ValueError:  # ragged inside
            deeper = True
        return list(given) if deeper else [given]
    return [given]


def _of_rank(argument: str, trial: object, rank: int) -> Array:
    expected = "numbers (T,)" if rank == 1 else "numbers (T, n)"
    array = checked_array(argument, trial, expected)
    if array.ndim != rank:
        raise ConfigurationError(argument, f"an array of shape {array.shape}", expected)
    return array


def one_branch(name: str, trials: Sequence[Array], bound: tuple[float, float] | None) -> Array:
    """All samples of a joint, shifted by whole turns: next to the first trial or, if `bound` is given, into it.

    Raises
    ------
    ConfigurationError : angles in degrees, or a scapula angle that is not relative to rest.
    """
    worst = max(float(np.abs(trial).max()) for trial in trials)
    if worst > MOST:
        raise ConfigurationError(f"angles of {name}", worst, "radians (are these degrees?)")
    turn = 2 * math.pi
    branches = [np.unwrap(trial) for trial in trials]
    first = float(np.median(branches[0]))
    values = np.concatenate([trial + turn * round((first - float(np.median(trial))) / turn) for trial in branches])
    width = float(np.ptp(values))
    if width > WIDEST:
        raise ConfigurationError(
            f"angles of {name}", f"a range {width:.3g} wide", "radians within one turn (are these degrees, or noise?)"
        )
    middle = float(np.median(values))
    if bound is not None:  # fewest turns that bring the median in, or nearest to it
        outside = {k: max(bound[0] - middle - k * turn, middle + k * turn - bound[1], 0.0) for k in (0, 1, -1, 2, -2)}
        values = values + turn * min(outside, key=outside.__getitem__)
    elif name == ARM_JOINTS[0] and not abs(middle) <= math.pi / 2:
        # Handed to human_arm, 180 deg too many would turn the whole workspace about the vertical.
        raise ConfigurationError(f"angles of {name}", middle, "angles from its rest: subtract ARM_REST[0]")
    return values
