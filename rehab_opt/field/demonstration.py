"""Recordings of a guided hand: its position, its velocity, and the guiding force."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.field.samples import HAND_SPEED, arc_length, checked_paths, interpolated, strides
from rehab_opt.kinematics.real_array import checked_array, is_real

__all__ = ["Demonstration", "check_agreement", "check_closeness", "check_units"]

Array = NDArray[np.float64]
PLACES = 100
"""Number of points at which two paths are compared, at equal fractions of their lengths."""
TURNED = 0.1
"""A demonstration counts as reversed if reversal brings it nearer to the path by more than this fraction of the length.
(A reversed straight line comes nearer by a half, a circle by a fifth, a there-and-back path not at all.)"""

WEAKEST, STRONGEST = 0.1, 1e3
"""[N] accepted range of the largest force of a movement."""
SLOWEST = 1e-3
"""[m/s] smallest accepted peak speed of a movement."""
SPAN = 0.04
"""[s] Interval of the differences of positions from which velocities are computed."""


@dataclass(frozen=True, eq=False)
class Demonstration:
    """One recorded movement.

    Parameters
    ----------
    positions : (N, 2) [m] of the hand, first to last.
    forces : (N, 2) [N] on the hand.
    velocities : (N, 2) [m/s]; if None, central differences over 40 ms, or over two samples if those are further apart;
        this needs `dt` or `times`. Shorter differences are noisy, and noise in the velocity leads to zero damping.
    dt : [s] between samples, or
    times : (N,) [s] of the samples, rising.

    Raises
    ------
    ConfigurationError : different lengths, numbers that are not finite, fewer than three samples.
    """

    positions: Array
    forces: Array
    velocities: Array = None  # type: ignore[assignment]  # always there once it is made
    dt: float | None = None
    times: Array | None = None

    def __post_init__(self) -> None:
        (positions,) = checked_paths([self.positions], "positions")
        if len(positions) < 3:
            raise ConfigurationError("positions", f"{len(positions)} samples", "at least three")
        object.__setattr__(self, "positions", positions)
        object.__setattr__(self, "forces", _column("forces", self.forces, positions))
        velocities = self.velocities
        if velocities is None:
            velocities = _velocities(positions, self._seconds(len(positions)))
        object.__setattr__(self, "velocities", _column("velocities", velocities, positions))

    def _seconds(self, count: int) -> Array:
        if self.times is not None:
            times = checked_array("times", self.times, f"{count} rising times in seconds")
            if times.shape != (count,):
                raise ConfigurationError("times", times.shape, f"{count} rising times in seconds")
            rises = np.isfinite(times) & np.r_[True, np.diff(times) > 0]
            _refuse_first("times", times, ~rises, "finite, rising times")
            from_first: Array = times - times[0]
            return from_first
        if is_real(self.dt) and 0 < self.dt < math.inf:
            return np.asarray(float(self.dt) * np.arange(count))
        raise ConfigurationError("dt", self.dt, "seconds between samples, or times, or velocities")


def _velocities(positions: Array, seconds: Array) -> Array:
    """(N, 2) [m/s] velocities by differences over `SPAN`; shorter ones would show the sensor's noise."""
    if not np.median(np.diff(seconds)) < SPAN / 2:
        return np.asarray(np.gradient(positions, seconds, axis=0))
    after = np.minimum(seconds + SPAN / 2, seconds[-1])
    before = np.maximum(seconds - SPAN / 2, seconds[0])
    moved = [np.interp(after, seconds, column) - np.interp(before, seconds, column) for column in positions.T]
    return np.asarray(np.stack(moved, axis=1) / (after - before)[:, None])


def _column(argument: str, values: ArrayLike, positions: Array) -> Array:
    expected = f"finite numbers of shape {positions.shape}"
    array = np.array(checked_array(argument, values, expected))
    if array.shape != positions.shape:
        raise ConfigurationError(argument, array.shape, expected)
    _refuse_first(argument, array, np.any(~np.isfinite(array), axis=1), "finite numbers")
    return array


def _refuse_first(argument: str, values: Array, wrong: NDArray[np.bool_], expected: str) -> None:
    if wrong.any():
        first = int(np.argmax(wrong))
        raise ConfigurationError(f"{argument}[{first}]", values[first].tolist(), expected)


def check_units(demonstrations: Sequence[Demonstration]) -> None:
    """Raise an error for a demonstration in a wrong unit.

    Raises
    ------
    ConfigurationError : names it by its number, from 0.
    """
    for i, each in enumerate(demonstrations):
        force, speed = (float(np.linalg.norm(of, axis=1).max()) for of in (each.forces, each.velocities))
        if not WEAKEST <= force <= STRONGEST:
            expected = f"{WEAKEST:g} to {STRONGEST:g} N (another unit?)"
            raise ConfigurationError(f"demonstrations[{i}]", f"a largest force of {force:.3g} N", expected)
        rests = speed == 0 and np.ptp(each.positions, axis=0).any()  # given velocities of zero although the hand moves
        if not (rests or SLOWEST <= speed <= HAND_SPEED):
            expected = f"{SLOWEST:g} to {HAND_SPEED:g} m/s (time or place in another unit?)"
            raise ConfigurationError(f"demonstrations[{i}]", f"a hand of at most {speed:.3g} m/s", expected)


def check_agreement(demonstrations: Sequence[Demonstration], paths: Sequence[Array] | None, width: float) -> None:
    """Raise an error if a demonstration runs backwards along `paths` (N, 2) [m] or, without paths, along the first one.

    Raises
    ------
    ConfigurationError : names it by its number, from 0.
    """
    against = "the path" if paths else "demonstrations[0]"
    shapes = [_places(each, width) for each in paths or [demonstrations[0].positions]]
    lengths = [float(arc_length(shape)[-1]) for shape in shapes]
    for i, each in enumerate(demonstrations):
        shown = _places(each.positions, width)
        aways = [min(_away(shown, shape), _away(shown, shape[::-1])) for shape in shapes]
        nearest = int(np.argmin(aways))
        shape = shapes[nearest]
        if _away(shown, shape) - _away(shown, shape[::-1]) > TURNED * lengths[nearest]:
            expected = f"movements in one direction (turned round it is nearer to {against})"
            raise ConfigurationError(f"demonstrations[{i}]", f"a movement against {against}", expected)


def check_closeness(demonstrations: Sequence[Demonstration], paths: Sequence[Array], width: float) -> None:
    """Raise an error if most samples of a demonstration are further than `width` [m] from all paths (m, 2) [m].

    Raises
    ------
    ConfigurationError : names it by its number, from 0.
    """
    from scipy.spatial import KDTree  # noqa: PLC0415  (heavy, and needed only where something is learnt)

    samples = KDTree(np.concatenate(paths))
    for i, each in enumerate(demonstrations):
        away = float(np.median(samples.query(each.positions)[0]))
        if not away <= width:
            value = f"a movement that is mostly {1e3 * away:.3g} mm or more from the field's path"
            expected = f"within width, at most {1e3 * width:g} mm, of it (another path or frame?)"
            raise ConfigurationError(f"demonstrations[{i}]", value, expected)


def _places(points: Array, width: float) -> Array:
    walked = strides(np.asarray(points, dtype=np.float64), width / 4)
    return interpolated(walked, walked, np.linspace(0.0, 1.0, PLACES) * arc_length(walked)[-1])


def _away(one: Array, other: Array) -> float:
    return float(np.linalg.norm(one - other, axis=1).mean())
