"""What a run leaves behind: numbers, and what a reader has to know. No files, no plots."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rehab_opt.kinematics.chain import SerialChain

__all__ = ["Column", "Columns", "MovementOutcome", "Outcome", "Progress", "joint_columns", "point_columns", "stacked"]

Array = NDArray[np.float64]

Cells = NDArray[np.float64] | NDArray[np.int64] | Sequence[float] | Sequence[int] | Sequence[str]
Columns = Mapping[str, Cells]
Column = tuple[str, Cells]
"""Header, which ends in the unit, and cells of one column of trace.csv."""
Progress = Callable[[str, int, int], None]
"""Called with what is being done, how much of it is done, and how much there is."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """What every run has.

    Parameters
    ----------
    notes : sentences a reader of the numbers has to know.
    metrics : all numbers, nested.
    columns : of trace.csv by header, which ends in the unit; all of one length.

    Attributes
    ----------
    system, name, title, inputs, options : of the problem, files that it was made of (see `input_files`) and options
        that it was run with. `run_problem` fills them in, and what the problem says as the metric "parameters".
    """

    notes: tuple[str, ...]
    metrics: Mapping[str, Any]
    columns: Columns = field(default_factory=dict, kw_only=True)
    system: str = field(default="", kw_only=True)
    name: str = field(default="", kw_only=True)
    title: str = field(default="", kw_only=True)
    inputs: Mapping[str, Mapping[str, str]] = field(default_factory=dict, kw_only=True)
    options: Mapping[str, str] = field(default_factory=dict, kw_only=True)

    def trace(self) -> Iterable[Column]:
        """The columns of trace.csv, one after another; for an outcome that keeps them otherwise."""
        return self.columns.items()


@dataclass(frozen=True, eq=False)
class MovementOutcome(Outcome):
    """Something with joints that moved: the chain, and the times (N,) [s] of its samples."""

    chain: SerialChain = field(kw_only=True)
    time: Array = field(kw_only=True)


def point_columns(name: str, points: Array) -> Iterator[tuple[str, Array]]:
    """Points (N, 2) or (N, 3) [m]."""
    for axis, column in zip("xyz", points.T, strict=False):
        yield f"{name}_{axis}_m", column


def joint_columns(name: str, chain: SerialChain, values: Array, unit: str) -> Iterator[tuple[str, Array]]:
    """Values (N, n), one for each joint of the chain."""
    for joint, column in zip(chain.names, values.T, strict=True):
        yield f"{name}_{joint}_{unit}", column


def stacked(parts: Iterable[Columns]) -> Columns:
    """Tables of the same columns, one below the other."""
    tables = list(parts)
    return {header: np.concatenate([np.asarray(each[header]) for each in tables]).tolist() for header in tables[0]}
