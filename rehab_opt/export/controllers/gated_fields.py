"""Fields that act where a workspace lets them, as C: what `control/gate.py` wants."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rehab_opt.control.assistance import Assistance
from rehab_opt.control.gate import FIELD, gated_force, numbers_of
from rehab_opt.export.c_text import Evaluated
from rehab_opt.field.energy import field_table, filled_up
from rehab_opt.field.potential import PotentialField
from rehab_opt.workspace.edge_distance import edge_columns

__all__ = ["MEMORY", "gated_fields"]

MEMORY = """\
    int aimed;               /* the field in use */
    double carried[2];       /* from where it was made [m] */"""


def gated_fields(helper: Assistance, fields: Sequence[PotentialField], *, name: str) -> Evaluated:
    """The wanted force of a helper, whose struct has `MEMORY`, with all fields that may be aimed at.

    Raises
    ------
    ConfigurationError : a field that does not go with the mode.
    """
    held = helper.field
    for field in fields:
        helper.aim(field)  # refuses what Python refuses
    helper.aim(held)
    tables = [field_table(field.samples) for field in fields]
    most, edges = max(map(len, tables)), edge_columns(helper.comfortable.polygon)
    return Evaluated(
        controller=name,
        name="wanted",
        about="the force of the field that is aimed at, where the gate lets it act [N]",
        function=gated_force(len(edges), most),
        inputs=(
            *("self->view + X", "self->carried", "GATE", "COMFORTABLE"),
            *(f"FIELDS + {FIELD.size} * self->aimed", f"SAMPLES + {8 * most} * self->aimed"),
        ),
        tables={
            "GATE": helper.gate,
            "COMFORTABLE": edges,
            "FIELDS": np.column_stack([numbers_of(field) for field in fields]),
            "SAMPLES": np.column_stack([filled_up(table, most).ravel() for table in tables]),
        },
    )
