"""What a run leaves behind: numbers, a table of samples, and what a reader has to know. No files, no plots."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rehab_opt.kinematics.chain import SerialChain

__all__ = ["ArmOutcome", "LawResult", "Outcome", "Progress", "RobotOutcome"]

Array = NDArray[np.float64]
Progress = Callable[[str, int, int], None]
"""Called with what is being done, how much of it is done, and how much there is."""


@dataclass(frozen=True, eq=False)
class LawResult:
    """One law's run along a path of N samples.

    Parameters
    ----------
    law : "optimised" or "published".
    q : (N, n) joint values [rad].
    hand : (N, 3) hand positions [m].
    position_error : (N,) [m] distance of the hand from the path.
    handle_tilt : (N,) [rad] angle of the handle from the vertical.
    status : (N,) what the law said of each sample.
    reason : (N,) why, where that is not a plain ok; empty otherwise, and where the law does not tell.
    seconds : (N,) time it took [s].
    smooth : (N, n) joint values behind the smoother [rad].
    metrics : its numbers.
    """

    law: str
    q: Array
    hand: Array
    position_error: Array
    handle_tilt: Array
    status: tuple[str, ...]
    reason: tuple[str, ...]
    seconds: Array
    smooth: Array
    metrics: Mapping[str, Any]


@dataclass(frozen=True, eq=False)
class Outcome:
    """What every run has.

    Parameters
    ----------
    name, title : of the problem.
    chain : what moved.
    time : (N,) [s].
    notes : sentences a reader of the numbers has to know.
    metrics : all numbers, nested by law.
    """

    name: str
    title: str
    chain: SerialChain
    time: Array
    notes: tuple[str, ...]
    metrics: Mapping[str, Any]


@dataclass(frozen=True, eq=False)
class ArmOutcome(Outcome):
    """A hand path followed by an arm: path (N, 3) [m], the laws that followed it, and where it can be reached.

    `reachable` (N,) is None where the optimised law, which alone tells, was not run.
    """

    path: Array = field(kw_only=True)
    laws: tuple[LawResult, ...] = field(kw_only=True)
    reachable: NDArray[np.bool_] | None = field(kw_only=True)
    handle_tilt_limit: float = field(kw_only=True)


@dataclass(frozen=True, eq=False)
class RobotOutcome(Outcome):
    """A pose followed by a robot, N ticks.

    Parameters
    ----------
    reference, tool : (N, 3) positions [m].
    position_error, orientation_error : (N,) [m, rad].
    q, command : (N, n) [rad, rad/s].
    status : (N,) of each command.
    """

    reference: Array = field(kw_only=True)
    tool: Array = field(kw_only=True)
    position_error: Array = field(kw_only=True)
    orientation_error: Array = field(kw_only=True)
    q: Array = field(kw_only=True)
    command: Array = field(kw_only=True)
    status: tuple[str, ...] = field(kw_only=True)
