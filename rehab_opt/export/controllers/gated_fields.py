"""Fields that act where a workspace lets them, as C: what `control/gate.py` wants."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

from rehab_opt.control.assistance import Assistance
from rehab_opt.export.c_text import filled, initialiser, number
from rehab_opt.export.controllers.workspace_edges import edge_rows, pull_back
from rehab_opt.export.generated import renamed
from rehab_opt.field.energy import field_function_in_blocks, field_table, filled_up
from rehab_opt.field.potential import PotentialField

__all__ = ["MEMORY", "GatedFields", "gated_fields"]

MEMORY = """\
    int aimed;               /* the field in use */
    double carried[2];       /* from where it was made [m] */
    double field[3];"""


class GatedFields(NamedTuple):
    """C of the function `wanted`, whose struct has `MEMORY`, and what it calls."""

    code: str
    function: ca.Function


def gated_fields(helper: Assistance, fields: Sequence[PotentialField], *, name: str) -> GatedFields:
    """The gate of a helper, and all fields that may be aimed at.

    Raises
    ------
    ConfigurationError : a field that does not go with the mode, or a workspace that C cannot tell the sides of.
    """
    held = helper.field
    for field in fields:
        helper.aim(field)  # refuses what Python refuses
    helper.aim(held)
    tables = [field_table(field.samples) for field in fields]
    most = max(map(len, tables))
    function = renamed(field_function_in_blocks(most), f"{name}_field")
    gate = helper._gate.keywords
    rows = [np.array((1 / field.width**2, *field.damping)) for field in fields]
    code = filled(
        "gate.c",
        {
            "onset": number(gate["onset"]),
            "pull_limit": number(gate["pull_limit"]),
            "name": name,
            "workspace": filled("workspace.c", {}),
            "pull_back": pull_back(gate["return_stiffness"], gate["return_force"], name=name),
            "acts_inside": str(int(helper.mode in ("follow", "hold"))),
            "comfortable": edge_rows(helper.comfortable, "comfortable"),
            "field_count": str(len(fields)),
            "samples": str(most),
            "field_tables": ",\n".join(f"    {initialiser(filled_up(table, most).ravel())}" for table in tables),
            "of_fields": ",\n".join(f"    {initialiser(row)}" for row in rows),
            "field_function": function.name(),
        },
    )
    return GatedFields(code, function)
