"""What a run leaves behind: numbers, and what a reader has to know. No files, no plots."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rehab_opt.kinematics.chain import SerialChain

__all__ = ["MovementOutcome", "Outcome", "Progress"]

Array = NDArray[np.float64]
Progress = Callable[[str, int, int], None]
"""Called with what is being done, how much of it is done, and how much there is."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """What every run has.

    Parameters
    ----------
    system : of the problem, which knows the tables, figures and traces of this outcome.
    name, title : of the problem.
    notes : sentences a reader of the numbers has to know.
    metrics : all numbers, nested; the problem's own under "parameters".
    """

    system: str
    name: str
    title: str
    notes: tuple[str, ...]
    metrics: Mapping[str, Any]


@dataclass(frozen=True, eq=False)
class MovementOutcome(Outcome):
    """Something with joints that moved: the chain, and the times (N,) [s] of its samples."""

    chain: SerialChain = field(kw_only=True)
    time: Array = field(kw_only=True)
