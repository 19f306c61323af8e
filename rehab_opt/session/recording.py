"""One recording of a hand or of joints: samples at increasing times, and what was noted on the way in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from rehab_opt.errors import ProblemFileError

__all__ = ["Recording"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Recording:
    """Samples of a movement at strictly increasing times.

    Parameters
    ----------
    file : where it comes from, as the user named it.
    time : (N,) [s], N >= 2.
    points : (N, 2) or (N, 3) positions [m] in the recording's own frame; (N, 0) where it has none.
    joints : joint angles [rad] by column name, (N,) each.
    forces : (N, 2) or (N, 3) [N] on the hand, in the frame of the points; (N, 0) where it has none.
    notes : what a reader of the result has to know: samples dropped, headers that do not hold, gaps.

    Raises
    ------
    ProblemFileError : fewer than two samples, or times that do not increase.
    """

    file: str
    time: Array
    points: Array
    joints: Mapping[str, Array] = field(default_factory=dict)
    forces: Array = field(default_factory=lambda: np.empty((0, 0)))
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check the times and freeze the arrays."""
        if len(self.time) < 2:
            raise ProblemFileError(self.file, "samples", len(self.time), "at least 2 usable samples")
        back = np.flatnonzero(~(np.diff(self.time) > 0))
        if back.size:
            at = int(back[0]) + 1
            value, expected = f"{self.time[at]:.9g} s", f"more than the {self.time[at - 1]:.9g} s before it"
            raise ProblemFileError(self.file, f"time of sample {at + 1}", value, expected)
        if not self.forces.size:
            object.__setattr__(self, "forces", np.empty((len(self.time), 0)))
        for array in (self.time, self.points, self.forces, *self.joints.values()):
            array.flags.writeable = False
        object.__setattr__(self, "joints", MappingProxyType(dict(self.joints)))

    @property
    def duration(self) -> float:
        """[s] from the first to the last sample."""
        return float(self.time[-1] - self.time[0])

    def noting(self, *notes: str) -> Recording:
        """The same recording with more notes."""
        return replace(self, joints=dict(self.joints), notes=(*self.notes, *notes))
