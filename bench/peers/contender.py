"""What a contender is: one library set up on one arm, as its own users would write the tick."""

from __future__ import annotations

import abc
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.peers.path import HandPath
from rehab_opt import SerialChain

__all__ = ["Contender", "verify_kinematics"]

Array = NDArray[np.float64]


class Contender(abc.ABC):
    """One library following a hand path with position and velocity limits.

    Attributes
    ----------
    name : library and solver, as the table prints them.
    versions : of everything that takes part.
    """

    name: str
    versions: dict[str, str]

    @abc.abstractmethod
    def pose(self, q: Array) -> Array:
        """(4, 4) hand pose at joint angles q (n,): compared with ours before anything is timed."""

    @abc.abstractmethod
    def target(self, path: HandPath, k: int) -> Any:
        """What tick k is given to go from sample k to k + 1, in the library's own type; not in the timed tick."""

    @abc.abstractmethod
    def command(self, q: Array, target: Any) -> Any:
        """Timed as "step": take the state q (n,), compute kinematics, solve. Returns the library's own answer."""

    @abc.abstractmethod
    def integrated(self, q: Array, command: Any) -> Array:
        """(n,) joint angles after one tick of `command`, as the library integrates; with `command` timed as "tick"."""


def verify_kinematics(contender: Contender, chain: SerialChain, *, tolerance: float = 1e-9, samples: int = 50) -> None:
    """Compare poses at random joint angles.

    Raises
    ------
    AssertionError : the contender computes with another arm; its times would mean nothing.
    """
    random = np.random.default_rng(0)
    for _ in range(samples):
        q = random.uniform(chain.lower, chain.upper)
        difference = float(np.abs(contender.pose(q) - chain.pose(q)).max())
        if not difference <= tolerance:
            raise AssertionError(f"{contender.name}: hand pose differs by {difference:.1e} at q = {q.tolist()}")
