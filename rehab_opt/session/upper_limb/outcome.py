"""What the laws did along a recorded path."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.smoothing import SmoothPath
from rehab_opt.session.outcome import MovementOutcome

__all__ = ["ArmOutcome", "Drive", "LawResult"]

Array = NDArray[np.float64]


class Drive(NamedTuple):
    """What a drive does with the joints of N samples, in M ticks."""

    path: SmoothPath
    """Its joints (M, n) [rad], and where it is in the recording."""
    hand: Array
    """(M, 3) [m]."""
    passes: Array
    """(N,) [s] when it passes each sample."""
    q: Array
    """(N, n) [rad] its joints there."""
    position_error: Array
    """(N,) [m] largest distance of the hand from the path while it is nearest to this sample."""
    handle_tilt: Array
    """(N,) [rad] largest angle of the handle from the vertical then."""


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
    metrics : its numbers.
    drive : what a drive would do with its joints; None until that is known.
    """

    law: str
    q: Array
    hand: Array
    position_error: Array
    handle_tilt: Array
    status: tuple[str, ...]
    reason: tuple[str, ...]
    seconds: Array
    metrics: Mapping[str, Any]
    drive: Drive | None = None


@dataclass(frozen=True, eq=False)
class ArmOutcome(MovementOutcome):
    """A hand path followed by an arm: path (N, 3) [m], the laws that followed it, and where it can be reached.

    `reachable` (N,) is None where the optimised law, which alone tells, was not run.
    """

    path: Array = field(kw_only=True)
    laws: tuple[LawResult, ...] = field(kw_only=True)
    reachable: NDArray[np.bool_] | None = field(kw_only=True)
    handle_tilt_limit: float = field(kw_only=True)
