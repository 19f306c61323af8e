"""What a controller is given in a tick, all that its answer may depend on: a log of it is a session to run again."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np

from rehab_opt.control.command import Command
from rehab_opt.plants.plant import Measurement

__all__ = ["Decide", "Tick"]


class Tick(NamedTuple):
    """One tick's inputs."""

    number: int
    """From 0 on; ticks that were left out are counted."""
    time: float
    """[s] of its deadline since the loop began: `number` times dt."""
    seen: Measurement
    """What the sensors say."""
    operator: np.void | None
    """What the operator wants, see `operator_layout`; None where nobody operates, or has yet."""
    enabled: bool
    """The dead-man input of `step`."""


Decide: TypeAlias = Callable[[Tick], Command]
"""A controller as the loop calls it: `lambda tick: tracker.step(tick.seen.position, pose, twist, enable=tick.enabled)`.
It reads no clock and nothing else that changes from run to run, else its log cannot be run again."""
