"""Results of inverse kinematics: a posture or a path of postures, with status and residuals."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.command import Status

__all__ = ["IKPath", "IKSolution"]

Array = NDArray[np.float64]


class IKSolution(NamedTuple):
    """One posture and how it came about."""

    q: Array
    """(n,) [rad] finite, inside the joint limits."""
    status: Status
    """OK, BACKUP, UNREACHABLE (q is the nearest, or the most upright) or HOLDING (the target was not a number)."""
    position_error: float
    """[m] distance from the hand to the target; infinite where the target is not a number."""
    handle_tilt: float
    """[rad] angle between the handle and the vertical."""
    residual: float
    """Certificate residual of the problem that was solved in the end; infinite where none was certified."""
    solver: str
    """Whose answer it is; empty for a safe answer."""
    iterations: int
    """Of the run that found q; -1 where the solver does not tell."""
    reason: str
    """Why this is not a plain OK; empty otherwise."""
    cost: float
    """Posture cost of q; terms that had nothing to refer to left out."""


@dataclass(frozen=True, eq=False)
class IKPath:
    """A path followed, one row a sample."""

    q: Array
    """(N, n) [rad]"""
    status: list[Status]
    position_error: Array
    """(N,) [m]"""
    handle_tilt: Array
    """(N,) [rad]"""
    residual: Array
    """(N,)"""
    seconds: Array
    """(N,) [s] time each sample took."""
    reason: list[str]

    @property
    def max_step(self) -> float:
        """[rad] Largest change of a joint between two samples: a jump to another branch shows here."""
        return float(self.steps.max(initial=0.0))

    @property
    def steps(self) -> Array:
        """(N - 1,) [rad] largest change of a joint from each sample to the next."""
        changes: Array = np.abs(np.diff(self.q, axis=0)).max(axis=1, initial=0.0)
        return changes

    @classmethod
    def of(cls, solutions: list[IKSolution], seconds: list[float], n: int) -> IKPath:
        """The answers of a path of an arm of n joints, one after the other."""
        return cls(
            q=np.array([each.q for each in solutions]).reshape(-1, n),
            status=[each.status for each in solutions],
            position_error=np.array([each.position_error for each in solutions]),
            handle_tilt=np.array([each.handle_tilt for each in solutions]),
            residual=np.array([each.residual for each in solutions]),
            seconds=np.array(seconds),
            reason=[each.reason for each in solutions],
        )

    @property
    def reached(self) -> float:
        """Share of the samples with the hand in place."""
        return float(np.mean([each.certified for each in self.status])) if self.status else 0.0
