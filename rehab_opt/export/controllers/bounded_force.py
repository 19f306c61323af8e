"""Export of bounded force controllers: force bounds, motion of the hand, and energy tank, for any desired force."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.bounded_force import BoundedForce
from rehab_opt.control.energy_tank import tank_record
from rehab_opt.control.force_tick import DESIRED, MODEL, SOLVED, VIEW, anew, force_tick, watched_record
from rehab_opt.export.c_text import Evaluated, initialiser, layout, number
from rehab_opt.export.exported import ExportedController
from rehab_opt.export.generated import renamed
from rehab_opt.export.recording import STAMPED, RunTick, with_faults
from rehab_opt.optim.fallback_chain import BACKUP

__all__ = ["ALONE", "DIFFERENCES", "ExportedForce", "faulty_ticks"]

Array = NDArray[np.float64]

DIFFERENCES = (
    f"There is no backup solver. Where Python would use {BACKUP}, C releases the force with `REHAB_NOT_CERTIFIED`; "
    "the recorded run is of a Python controller without the backup, too.",
    STAMPED,
    "An x that is NULL counts as not a number; Python raises an error for an argument of the wrong shape.",
)
"""Differences between C and Python for every force controller."""
ALONE = {
    "full": ", 1", "energy": ", int energy", "fills": "energy", "on_hand": "",
    **dict.fromkeys(("received_input", "received_argument", "said_output", "said_argument"), ""),
}  # fmt: skip
"""Template values of a controller with one hand, whose reset may fill the tank."""
UNITS = {"force_limit": "N", "slew_limit": "N/s", "growth_limit": "N/s", "speed_cap": "m/s", "budget": "J"}
"""Units of the numbers in the header."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ExportedForce(ExportedController):
    """A force controller for export.

    Parameters
    ----------
    force : the controller in Python.
    desired : its desired force.
    parts : further functions of a tick by name.
    """

    core: ClassVar[str] = "bounded_force"
    contents: ClassVar[str] = "desired force, QP solve, certificate, energy tank, watchdog, safe command"
    force: BoundedForce
    desired: Evaluated
    parts: Mapping[str, ca.Function] = field(default_factory=dict)
    pieces: Mapping[str, str] = field(default_factory=lambda: {"begin": "force_begin.c", "declared": "force.h"})

    @property
    def dt(self) -> float:
        """[s] Length of a tick."""
        return self.force.dt

    def limits(self) -> list[str]:
        """Lines of text: each bound of force, speed and energy with its unit."""
        return [f"{name} {self.force.model[MODEL[name]]:.9g} {unit}" for name, unit in UNITS.items()]

    @property
    def slots(self) -> int:
        """Number of time slots for forces that are commanded but not yet delivered."""
        return self.force.slots

    def functions(self) -> list[ca.Function]:
        """CasADi functions that a tick calls, with unique names."""
        tick = force_tick(self.slots)
        parts = {"judge": tick.judge, "conclude": tick.conclude, "anew": anew(self.slots)}
        parts |= {"desired": self.desired.function, **self.parts}
        return [renamed(part, f"{self.name}_{what}") for what, part in parts.items()]

    def shape(self) -> dict[str, str]:
        """Values for the templates: sizes and offsets of the records, and the numbers of the controller's model."""
        slots = self.slots
        watched, tank = watched_record(slots), tank_record(slots)
        level, pending = (watched["tank"] + tank[each] for each in ("level", "pending"))
        sizes = {
            "watched": watched.size, "view": VIEW.size, "desired_size": DESIRED.size, "solved": SOLVED.size,
            "level": level, "pending": pending,
            **{f"view_{each}": VIEW[each] for each in ("x", "v", "reason")},
            "lets_go": DESIRED["lets_go"],
            "values": 2,
            "wheels": 0,
            "numbers": 2 + watched.size + VIEW.size + SOLVED.size + 7,
        }  # fmt: skip
        records = {"model": MODEL, "watched": watched, "view": VIEW, "desired": DESIRED, "solved": SOLVED}
        return {
            **{name: str(size) for name, size in sizes.items()},
            **{f"{name}_names": ", ".join(record.places) for name, record in records.items()},
            "at_rest": "REHAB_RELEASED",
            "dt": number(self.force.dt),
            "report_layout": layout("REPORT", SOLVED.places),
            "model": initialiser(self.force.model),
            "nothing_seen": initialiser(self.force.nothing_seen()),
            "desired": self.desired.code,
        }


def faulty_ticks(
    force: BoundedForce,
    positions: Array,
    others: Sequence[RunTick],
    faults: Sequence[Callable[[RunTick], RunTick]] = (),
) -> list[RunTick]:
    """Ticks of a hand along positions (N, 2) [m]; some ticks have faults in their inputs.

    In the first half of the run velocities are inputs, then they are estimated.

    Parameters
    ----------
    others : further inputs of each tick.
    faults : further functions that put a fault into a valid tick.
    """
    velocities = np.gradient(positions, force.dt, axis=0)
    valid: list[RunTick] = [
        {"x": x, "v": v, "with_v": int(i < len(positions) / 2), **other}
        for i, (x, v, other) in enumerate(zip(positions, velocities, others, strict=True))
    ]
    return with_faults(
        valid, dt=force.dt, max_age=force.max_age,
        more=(
            lambda tick: {**tick, "x": tick["x"] + 0.3},  # a jump, and back
            lambda tick: {**tick, "v": np.array([2.0 * force.speed_cap, 0.0]), "with_v": 1},
            lambda tick: {**tick, "v": np.array([np.nan, 0.0]), "with_v": 1},
            *faults,
        ),
    )  # fmt: skip
