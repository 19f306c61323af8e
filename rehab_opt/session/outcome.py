"""Results of a run: columns, notes, and numbers in strict JSON with the unit in each key; no files, no plots."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from rehab_opt.session.trace import Trace, stacked

if TYPE_CHECKING:
    from rehab_opt.kinematics.chain import SerialChain

T = TypeVar("T")
Array = NDArray[np.float64]
"""Array of floats, whose shape and unit are in the docstring that mentions it."""
Names = tuple[Any, ...]
"""Name of one scene of a run, such as (drive, controller) or (controller, trial)."""
Progress = Callable[[str, int, int], None]
"""Callback with the name of the current step, the number of finished items, and the number of all items."""


def with_progress(progress: Progress, what: str, items: Collection[T]) -> Iterator[T]:
    """Yield one item after the other; `progress` is called before each item and at the end."""
    for done, item in enumerate(items):
        progress(what, done, len(items))
        yield item
    progress(what, len(items), len(items))


@dataclass(frozen=True, eq=False)
class Outcome:
    """Results common to all runs.

    Parameters
    ----------
    notes : sentences that a reader of the numbers must know.
    metrics : all numbers, as nested dictionaries.
    traces, scenes : the scenes of the run and their traces, by the names of the scenes.
    labels : names of the columns of trace.csv that hold a scene's name; empty for a single scene.
    table : numbers of each scene, for the table.

    Attributes
    ----------
    system, name, title, inputs : those of the problem, with inputs from `input_files`. options : options of the run.
        `run_problem` sets these attributes, and stores the problem's parameters as the metric "parameters".
    """

    notes: tuple[str, ...] = ()
    metrics: Mapping[str, Any] = field(default_factory=dict)
    traces: Mapping[Names, Trace] = field(default_factory=dict, kw_only=True)
    scenes: Mapping[Names, Any] = field(default_factory=dict, kw_only=True)
    labels: Names = field(default=(), kw_only=True)
    table: Mapping[Names, Mapping[str, Any]] = field(default_factory=dict, kw_only=True)
    system: str = field(default="", kw_only=True)
    name: str = field(default="", kw_only=True)
    title: str = field(default="", kw_only=True)
    inputs: Mapping[str, Mapping[str, str]] = field(default_factory=dict, kw_only=True)
    options: Mapping[str, str] = field(default_factory=dict, kw_only=True)

    def trace(self) -> Iterable[tuple[str, NDArray[Any]]]:
        """The columns of trace.csv: one row for each sample, the scenes one below the other."""
        if self.labels:
            return stacked(self.traces, self.labels)
        (trace,) = self.traces.values()
        return trace.written()


MEASURED = re.compile(r" by \S+ m(?=:)|(?<=failed:) \S+ over(?= the bounds)")
"""The measured numbers in a reason, which differ from sample to sample."""


def path_fractions(path: Array, met: NDArray[np.bool_]) -> tuple[float, float]:
    """Fractions of the path's length and of its time that belong to the samples for which `met` (N,) is true.

    Half of each step's length counts for the sample at either end; samples at rest have no length.
    """
    steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
    weights = np.concatenate((steps, [0.0])) + np.concatenate(([0.0], steps))
    of_time = float(np.mean(met))
    return (float(weights[met].sum() / weights.sum()) if weights.sum() > 0 else of_time), of_time


def error_metrics(error: Array, name: str, unit: str) -> dict[str, float]:
    """Mean, 95th percentile and maximum of an error (N,)."""
    return {
        f"{name}_mean_{unit}": float(np.mean(error)),
        f"{name}_p95_{unit}": float(np.percentile(error, 95)),
        f"{name}_max_{unit}": float(np.max(error)),
    }


def turn_angles(rotations: Array, references: Array) -> Array:
    """Rotation angles (N,) [rad] between orientations (N, 3, 3) and their references, exact for small angles too."""
    # |R - S| = 2 sqrt(2) sin(angle / 2), Frobenius norm
    chord = np.linalg.norm(rotations - references, axis=(1, 2)) / (2 * math.sqrt(2))
    return np.asarray(2 * np.arcsin(np.minimum(chord, 1.0)))


def joint_metrics(chain: SerialChain, q: Array, rate: float) -> dict[str, Any]:
    """Least distance to a joint limit and largest joint speed of q (N, n), sampled at `rate` [Hz].

    The distance is negative outside a limit. Locked joints have no distance to a limit; all joints have a speed.
    """
    free = np.flatnonzero(~chain.locked)
    margin = np.minimum(q - chain.lower, chain.upper - q).min(axis=0)
    speed = np.abs(np.diff(q, axis=0)).max(axis=0) * rate
    numbers: dict[str, Any] = {"joint_limit_margin_min_deg": None, "joint_limit_margin_joint": None}
    if free.size:
        least = int(free[margin[free].argmin()])
        numbers["joint_limit_margin_min_deg"] = finite(np.rad2deg(margin[least]))
        numbers["joint_limit_margin_joint"] = chain.names[least]
    fastest = int((speed / chain.velocity).argmax())
    return numbers | {
        "joint_speed_max_deg_s": float(np.rad2deg(speed[fastest])),
        "joint_speed_max_joint": chain.names[fastest],
        "joint_speed_max_fraction_of_limit": float(speed[fastest] / chain.velocity[fastest]),
    }


def time_metrics(seconds: Array, name: str) -> dict[str, float]:
    """Median, 99th percentile and maximum of durations (N,) [s], in milliseconds."""
    milliseconds = 1e3 * seconds
    return {
        f"{name}_median_ms": float(np.median(milliseconds)),
        f"{name}_p99_ms": float(np.percentile(milliseconds, 99)),
        f"{name}_max_ms": float(np.max(milliseconds)),
    }


def status_counts(statuses: Iterable[str]) -> dict[str, int]:
    """Number of occurrences of each status, the most frequent first."""
    return dict(Counter(statuses).most_common())


def reason_counts(reasons: Iterable[str]) -> dict[str, int]:
    """Number of occurrences of each reason without its measured numbers, the most frequent first; no empty reasons."""
    return status_counts(MEASURED.sub("", reason) for reason in reasons if reason)


def finite(number: float) -> float | None:
    """`number`, or None if JSON cannot express it (an unlimited joint is infinitely far from its limit)."""
    return float(number) if np.isfinite(number) else None
