"""A bounded force as C, whatever it wants: its bounds, its hand, its tank."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.assistance_statement import EXACT, TINY
from rehab_opt.control.bounded_force import MISSED, MUCH, BoundedForce
from rehab_opt.control.energy_tank import HAND_SPEED
from rehab_opt.control.hand import FURTHEST, ROUNDING
from rehab_opt.errors import ConfigurationError
from rehab_opt.export.c_text import filled, number
from rehab_opt.export.exported import ExportedController, watchdog_of
from rehab_opt.export.generated import renamed
from rehab_opt.export.recording import Tick, with_faults
from rehab_opt.optim.fused import fused
from rehab_opt.optim.ladder import BACKUP, FUSED
from rehab_opt.optim.qrqp import QRQP_ITERATIONS

__all__ = ["DIFFERENCES", "ExportedForce", "check_rungs", "faulty_ticks"]

Array = NDArray[np.float64]

DIFFERENCES = (
    f"There is no backup solver. Where Python would ask {BACKUP}, C releases the force and says `REHAB_NOT_CERTIFIED`; "
    "the recorded run is of a Python controller without the backup, too.",
    "The nearest point of a workspace's boundary is found by asking every edge. Python asks those of a grid's cell.",
    "A stamp is always asked for and checked. In Python it may be left out.",
    "An x that is NULL counts as not a number; Python raises an error for an argument of the wrong shape.",
)
"""Of every force."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ExportedForce(ExportedController):
    """A controller of a force.

    Parameters
    ----------
    force : what answers in Python.
    wanted : C of the function `wanted`, and of what it needs.
    evaluated : functions that it calls.
    """

    core: ClassVar[str] = "bounded_force"
    contents: ClassVar[str] = "what force is wanted, QP solve, certificate, energy tank, watchdog, safe command"
    force: BoundedForce
    wanted: str
    evaluated: Sequence[ca.Function]

    @property
    def iterations(self) -> int:
        """Cap on the active-set changes of a solve."""
        return self.force.stated.iterations or QRQP_ITERATIONS

    def functions(self) -> list[ca.Function]:
        """The tick's QP, and what is asked for the wanted force."""
        return [renamed(fused(self.force.stated), f"{self.name}_tick"), *self.evaluated]

    def shape(self) -> dict[str, str]:
        """Sizes and bounds."""
        force, stated = self.force, self.force.stated
        tank, hand = force._tank, force._hand
        memory = int(stated.memory.numel())
        sizes = {
            "memory_at": stated.state_size - memory,
            "state_count": stated.state_size,
            "parameter_count": stated.parameter_size,
            "verdict_count": 3 + int(stated.report.numel()),
            "trust_stillness": int(hand._trusted),
            "values": 2,
            "wheels": 0,
            "numbers": stated.parameter_size + 2 * stated.state_size + 30,
        }
        doubles = {
            "tolerance": force.tolerance, "force_limit": force.force_limit, "step": force._step, "exact": EXACT,
            "tiny": TINY, "much": MUCH, "missed": MISSED, "budget": tank.budget, "slew": tank._slew,
            "speed_cap": force.speed_cap, "per_newton": tank._per_newton, "hand_speed": HAND_SPEED,
            "velocity_lag": hand._lag, "furthest": FURTHEST, "rounding": ROUNDING,
        }  # fmt: skip
        return {
            **{name: str(size) for name, size in sizes.items()},
            **{name: number(value) for name, value in doubles.items()},
            **watchdog_of(hand._watchdog, force.dt),
            "hand": filled("hand.c", {"name": self.name}),
            "wanted": self.wanted,
            "tick_function": f"{self.name}_tick",
        }


def check_rungs(force: BoundedForce) -> None:
    """Refuse a controller with more rungs than C has.

    Raises
    ------
    ConfigurationError : a solver or backup that C has not.
    """
    if force._ladder.solver != FUSED or force._ladder.backup != FUSED:
        raise ConfigurationError("helper", force._ladder.backup, f"Assistance(..., backup='{FUSED}'), as C is")


def faulty_ticks(
    force: BoundedForce, positions: Array, others: Sequence[Tick], faults: Sequence[Callable[[Tick], Tick]] = ()
) -> list[Tick]:
    """The ticks of a hand along positions (N, 2) [m], with faults of all kinds spread among them.

    Its velocity is given in the first half, then estimated.

    Parameters
    ----------
    others : what each tick holds besides.
    faults : more of them, each takes a sound tick.
    """
    velocities = np.gradient(positions, force.dt, axis=0)
    sound: list[Tick] = [
        {"x": x, "v": v, "with_v": int(i < len(positions) / 2), **other}
        for i, (x, v, other) in enumerate(zip(positions, velocities, others, strict=True))
    ]
    return with_faults(
        sound, dt=force.dt, max_age=force._hand._watchdog.max_age,
        more=(
            lambda tick: {**tick, "x": tick["x"] + 0.3},  # a jump, and back
            lambda tick: {**tick, "v": np.array([2.0 * force.speed_cap, 0.0]), "with_v": 1},
            lambda tick: {**tick, "v": np.array([np.nan, 0.0]), "with_v": 1},
            *faults,
        ),
    )  # fmt: skip
