"""Force-bounded assistance: the field's force, as much of it as the bounds on a person's side allow."""

from __future__ import annotations

import math
from functools import partial
from threading import get_ident
from typing import Unpack

from rehab_opt.control.assistance_statement import TINY
from rehab_opt.control.bounded_force import BoundedForce, ForceBounds
from rehab_opt.control.gate import Mode, wanted_force
from rehab_opt.control.velocity_controller import checked_number
from rehab_opt.errors import ConfigurationError
from rehab_opt.field.potential import PotentialField
from rehab_opt.field.settling import settling_notes
from rehab_opt.workspace.region import Workspace

__all__ = ["Assistance"]


class Assistance(BoundedForce):
    """Force on a hand [N], from a field that leads it and a gate that says when; bounded as `BoundedForce`.

    Inside the comfortable workspace a therapy mode wants no force: its size never grows there, and is exactly zero
    after force_limit / slew_limit seconds. Field and workspace may be shared with other threads' objects.

    Parameters
    ----------
    field : what to follow; `aim` exchanges it.
    comfortable : workspace of the gate; not empty.
    mode : "stretch", "assist", "resist", "follow", "hold": see `wanted_force`.
    force_limit : [N] largest size of the force.
    onset : [m] see `wanted_force`; zero is Eq. (23).
    return_stiffness, return_force : [N/m, N] see `wanted_force`.
    bounds : slew_limit, energy_budget, speed_cap, velocity_lag, trust_stillness, dt, max_age, solver, backup, tolerance
        and compile, see `BoundedForce`.

    Raises
    ------
    ConfigurationError : an argument that cannot be used.
    """

    _by: list[float] | None

    def __init__(
        self,
        field: PotentialField,
        *,
        comfortable: Workspace,
        mode: Mode = "assist",
        force_limit: float = 30.0,
        onset: float = 0.0,
        return_stiffness: float = 500.0,
        return_force: float = 10.0,
        **bounds: Unpack[ForceBounds],
    ) -> None:
        if not isinstance(comfortable, Workspace) or comfortable.empty:
            raise ConfigurationError("comfortable", comfortable, "a Workspace that is not empty")
        self.comfortable, self.mode = comfortable, mode
        self._gate = partial(
            wanted_force,
            comfortable=comfortable,
            mode=mode,
            pull_limit=checked_number("force_limit", force_limit, above=0.0, below=1e4),
            onset=checked_number("onset", onset, above=-TINY),
            return_stiffness=checked_number("return_stiffness", return_stiffness, above=0.0),
            return_force=checked_number("return_force", return_force, above=0.0),
        )
        self.aim(field)
        super().__init__(self._wanted, force_limit=force_limit, **bounds)

    def aim(self, field: PotentialField) -> None:
        """Another field from now on: the next target of a grid, say; the slew bound makes the change smooth."""
        if not isinstance(field, PotentialField):
            raise ConfigurationError("field", field, "a PotentialField")
        self._refuse_others()
        self._wanted = self._gate(field)
        self.field, self._by = field, None
        field.pull(0.0, 0.0)  # compiled now, not in the loop

    @property
    def notes(self) -> tuple[str, ...]:
        """What of field, bounds and delay does not go together, and which number would; see `settling_notes`.

        Empty where every hand comes to rest.
        """
        field = self.field
        drag = 2.0 * abs(field.drag) if field.drag == field.drag else 0.0  # a learnt one has it in its samples
        stiffness = max(float(field.samples.stiffness.max()), drag)
        bounds = {"force_limit": self.force_limit, "slew_limit": self.slew_limit}
        return tuple(settling_notes(stiffness, float(field.damping.min()), **bounds, **self._late_by))

    @property
    def carried(self) -> tuple[float, float]:
        """[m] how far the field stands from where it was made."""
        return (0.0, 0.0) if self._by is None else (self._by[0], self._by[1])

    def carry(self, dx: float, dy: float) -> None:
        """Let the field stand (dx, dy) [m] from where it was made, for a target that moves; `aim` puts it back.

        Called in every tick, with a motion that is smooth: the force follows as fast as its slew bound allows. Where
        the target is no number, the force is released.

        Raises
        ------
        ConfigurationError : not two real numbers.
        """
        try:
            to_x, to_y = 0.0 + dx, 0.0 + dy
        except OverflowError:
            to_x = to_y = math.nan
        except TypeError as problem:
            raise ConfigurationError("dx, dy", (dx, dy), "two real numbers [m]") from problem
        if self._owner != get_ident():
            self._refuse_others()
        if self._by is None:
            self._by = [0.0, 0.0]
            self._wanted = self._gate(self.field, carried=self._by)
        self._by[0], self._by[1] = to_x, to_y
