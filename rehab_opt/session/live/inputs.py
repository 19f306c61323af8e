"""What somebody does at the page of a live problem, as a controller reads it in a tick."""

from __future__ import annotations

import math
from typing import NamedTuple

__all__ = ["AT_REST", "LiveInputs"]

Triple = tuple[float, float, float]

NOWHERE = (math.nan, math.nan, math.nan)


class LiveInputs(NamedTuple):
    """One state of the page's controls; places and forces in the base frame."""

    enable: bool = False
    """The dead-man."""
    target: Triple = NOWHERE
    """[m] where the hand, or its target, is dragged to; NaN where nobody drags: the problem's own reference."""
    push: Triple = (0.0, 0.0, 0.0)
    """[N] on the hand."""
    stick: tuple[float, float] = (0.0, 0.0)
    """Deflection forward and to the left, -1 to 1."""
    switch: bool = False
    gripper: bool = False
    frozen: int = -1
    """Encoder that repeats its last value; -1 for none."""
    noise: float = 0.0
    """[rad, m] standard deviation that is added to every position."""
    delay: float = 0.0
    """[s] by which measurements are late, besides the plant's own delay."""

    @property
    def dragged(self) -> bool:
        """Whether there is a target."""
        return all(map(math.isfinite, self.target))


AT_REST = LiveInputs()
"""Nobody there: the dead-man released, nothing touched."""
