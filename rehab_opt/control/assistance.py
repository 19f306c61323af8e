"""Assistance: force of a potential field, bounded so that it is safe for a person."""

from __future__ import annotations

import math
from threading import get_ident
from typing import Unpack, cast
from weakref import WeakKeyDictionary

from rehab_opt.control.assistance_statement import TINY
from rehab_opt.control.bounded_force import BoundedForce, ForceBounds
from rehab_opt.control.gate import GATE, PULL_BACK, DesiredForce, Mode, check_mode, gated_force, numbers_of
from rehab_opt.control.thread_owner import setting
from rehab_opt.control.velocity_controller import checked_number
from rehab_opt.errors import ConfigurationError
from rehab_opt.field.energy import arranged_samples
from rehab_opt.field.potential import PotentialField
from rehab_opt.field.settling import settling_notes
from rehab_opt.symbolic import BufferedFunction
from rehab_opt.workspace.edge_distance import edge_columns
from rehab_opt.workspace.region import Workspace

__all__ = ["Assistance"]


class Assistance(BoundedForce):
    """Force on a hand [N] from a field, gated by a workspace and bounded as in `BoundedForce`.

    Inside the comfortable workspace the force of a therapy mode ("stretch", "assist", "resist") never grows, and falls
    to zero within force_limit / slew_limit seconds.

    Parameters
    ----------
    field : potential of the desired force; `set_field` replaces it.
    comfortable : workspace, not empty, whose boundary gates the force.
    mode : "stretch", "assist", "resist", "follow" or "hold", see `gated_force`.
    force_limit : [N] largest size of the force.
    onset : [m] distance outside the boundary over which the force of a therapy mode grows; zero gives Eq. 23 of Rossa
        et al.
    return_stiffness, return_force : [N/m, N] stiffness and limit of the pull back into the workspace, in the modes
        "follow" and "hold".
    bounds : all other arguments of `BoundedForce`.
    """

    comfortable: Workspace = setting()
    mode: Mode = setting()

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
        self.gate = GATE.numbers(
            acts_inside=mode in ("follow", "hold"),
            pull_limit=checked_number("force_limit", force_limit, above=0.0, below=1e4),
            onset=checked_number("onset", onset, above=-TINY, most=1.0),
            back=PULL_BACK.numbers(
                stiffness=checked_number("return_stiffness", return_stiffness, above=0.0),
                force=checked_number("return_force", return_force, above=0.0),
            ),
        )
        self._edges, self._compile = edge_columns(comfortable.polygon), bounds.get("compile")
        self._known: WeakKeyDictionary[PotentialField, tuple[DesiredForce, memoryview[float]]] = WeakKeyDictionary()
        self.set_field(field)
        super().__init__(self._desired, force_limit=force_limit, **bounds)

    def set_field(self, field: PotentialField) -> None:
        """Replace the field; the slew limit makes the change smooth."""
        if not isinstance(field, PotentialField):
            raise ConfigurationError("field", field, "a PotentialField")
        self._refuse_others()
        if field not in self._known:
            check_mode(self.mode, field)
            self._known[field] = self._gated(field)
        self.field, (self._desired, self._by) = field, self._known[field]
        self._by[0] = self._by[1] = 0.0

    def _gated(self, field: PotentialField) -> tuple[DesiredForce, memoryview[float]]:
        """Two results: the desired force of a field, as a function, and a memory view of the field's offset [m]."""
        samples, in_blocks = arranged_samples(field.samples, compile=self._compile)
        statement = gated_force(len(self._edges), samples.shape[int(in_blocks)], in_blocks=in_blocks)
        function = BufferedFunction(statement, compile=self._compile)
        for held, values in zip(function.inputs[2:], (self.gate, self._edges, numbers_of(field), samples), strict=True):
            held[...] = values
        # Memory views: twice as fast as numpy's indexing.
        hand, offset, force = (
            cast("memoryview[float]", array.data) for array in (*function.inputs[:2], function.outputs[0])
        )

        def desired(x: float, y: float, vx: float, vy: float) -> tuple[float, float]:
            hand[0], hand[1], hand[2], hand[3] = x, y, vx, vy
            function.evaluate()
            return force[0], force[1]

        return desired, offset

    @property
    def notes(self) -> tuple[str, ...]:
        """Warnings, with better values, if field, bounds and delay do not fit together; see `settling_notes`."""
        field = self.field
        drag = 2.0 * abs(field.drag) if field.drag == field.drag else 0.0  # NaN if learnt: then in the samples
        stiffness = max(float(field.samples.stiffness.max()), drag)
        bounds = {"force_limit": self.force_limit, "slew_limit": self.slew_limit}
        dampings = dict.fromkeys((float(field.damping.min()), float(field.damping.max())))
        return tuple(note for each in dampings for note in settling_notes(stiffness, each, **bounds, **self._late_by))

    @property
    def offset(self) -> tuple[float, float]:
        """Offset of the field from its original position [m]."""
        return self._by[0], self._by[1]

    def shift(self, dx: float, dy: float) -> None:
        """Set the field's offset (dx, dy) [m] from its original position, for a moving target; `set_field` resets it.

        A NaN offset releases the force; a wrong type raises `ConfigurationError`.
        """
        try:
            to_x, to_y = float(0.0 + dx), float(0.0 + dy)
        except OverflowError:
            to_x = to_y = math.nan
        except TypeError as problem:
            raise ConfigurationError("dx, dy", (dx, dy), "two real numbers [m]") from problem
        if self._owner != get_ident():
            self._refuse_others()
        self._by[0], self._by[1] = to_x, to_y
