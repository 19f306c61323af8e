"""What the laws did along a recorded path."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rehab_opt.session.outcome import MovementOutcome

__all__ = ["ArmOutcome", "LawResult"]

Array = NDArray[np.float64]


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
class ArmOutcome(MovementOutcome):
    """A hand path followed by an arm: path (N, 3) [m], the laws that followed it, and where it can be reached.

    `reachable` (N,) is None where the optimised law, which alone tells, was not run.
    """

    path: Array = field(kw_only=True)
    laws: tuple[LawResult, ...] = field(kw_only=True)
    reachable: NDArray[np.bool_] | None = field(kw_only=True)
    handle_tilt_limit: float = field(kw_only=True)
