"""What a measured interaction force does to a reference: it slows it, turns it aside, and stops it at a limit."""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.control.velocity_controller import checked_number, real_numbers
from rehab_opt.errors import ConfigurationError
from rehab_opt.optim.certificate import clipped
from rehab_opt.symbolic import BufferedFunction

__all__ = ["Feeling", "Interaction"]

Array = NDArray[np.float64]

GONE = 1e-6
"""[m] A displacement up to this is none, once no force is measured any more."""


@dataclass(frozen=True, kw_only=True)
class Interaction:
    """Admittance of a led hand, B x' + K x = F, and how its reference slows down.

    Defaults are choices: ISO/TS 15066 as quoted allows a hand 140 N, of healthy adults; this stays far below.
    """

    slow_from: float = 8.0
    """[N] from which the reference slows down."""
    limit: float = 30.0
    """[N] at which the reference stands still and the arm decelerates to rest, until the force is below again."""
    stiffness: float = 1500.0
    """[N/m] K"""
    damping: float = 150.0
    """[N s/m] B"""
    most: float = 0.02
    """[m] largest displacement of the reference."""

    def __post_init__(self) -> None:
        """Check every number."""
        for name in ("limit", "stiffness", "damping", "most"):
            checked_number(name, getattr(self, name), above=0.0)
        if not 0.0 <= self.slow_from < self.limit:
            raise ConfigurationError("slow_from", self.slow_from, f"newtons from 0 to below the limit, {self.limit:g}")

    def felt_function(self, dt: float) -> ca.Function:
        """Force [N] and displacement [m] (3,) -> displacement after a tick dt [s], share of the pace that is kept."""
        force, offset = ca.SX.sym("force", 3), ca.SX.sym("offset", 3)
        size = ca.norm_2(force)
        goal = force * ca.fmin(1, self.limit / ca.fmax(size, 1e-12)) / self.stiffness
        moved = goal + math.exp(-self.stiffness / self.damping * dt) * (offset - goal)
        moved = moved * ca.fmin(1, self.most / ca.fmax(ca.norm_2(moved), 1e-12))
        pace = clipped((self.limit - size) / (self.limit - self.slow_from), 0, 1)
        return ca.Function("felt", [force, offset], [moved, pace], {"cse": True})

    def started(self, dt: float) -> Feeling:
        """What is felt tick by tick [s]."""
        return Feeling(self, dt)


class Feeling:
    """The displacement and pace that the forces so far lead to."""

    def __init__(self, law: Interaction, dt: float) -> None:
        self.law, self._felt = law, BufferedFunction(law.felt_function(dt))
        self.reset()

    def reset(self) -> None:
        """No force was felt."""
        self.offset: Array = np.zeros(3)
        """(3,) [m] displacement of the reference."""
        self.pace = 1.0
        """Share of its pace that the reference keeps."""
        self.active = False

    def feel(self, force: ArrayLike | None) -> str:
        """Take one measurement (3,) [N], None for none; why the arm must stop, or nothing."""
        if force is None:
            if self.active:
                self._move(np.zeros(3))
                x, y, z = self.offset.tolist()
                self.active = math.sqrt(x * x + y * y + z * z) > GONE
                self.offset = self.offset if self.active else np.zeros(3)
            self.pace = 1.0
            return ""
        felt = real_numbers("force", force, (3,))
        size = math.hypot(*felt.tolist())  # numpy's would warn where squares overflow
        self.active = True
        if not size < math.inf:
            self.pace = 0.0
            return "force is not a usable number"
        self._move(felt)
        self.pace = float(self._felt.outputs[1][0])
        if size >= self.law.limit:
            return f"interaction force of {size:.1f} N, at most {self.law.limit:g} N"
        return ""

    def _move(self, force: Array) -> None:
        self.offset = self._felt.of(force, self.offset)
