"""Export of `Assistance`: fields, the gate of the comfortable workspace, and the energy budget."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.control.assistance import Assistance
from rehab_opt.control.command import Command
from rehab_opt.control.gate import FIELD, gated_force, numbers_of
from rehab_opt.export.c_text import Evaluated
from rehab_opt.export.controllers.bounded_force import ALONE, DIFFERENCES, ExportedForce, faulty_ticks
from rehab_opt.export.recording import RunTick, recorded
from rehab_opt.field.energy import field_table, filled_up
from rehab_opt.field.potential import PotentialField
from rehab_opt.optim.fallback_chain import as_in_c
from rehab_opt.workspace.edge_distance import edge_columns

__all__ = ["MEMORY", "exported_assistance", "gated_fields"]

Array = NDArray[np.float64]

NAME = "assistance"
MEMORY = """\
    int field;               /* the field in use */
    double offset[2];        /* from where it was made [m] */"""
CALL = """\
(void)rehab_assistance_set_field(&controller, tick->field);
    (void)rehab_assistance_shift(&controller, tick->offset[0], tick->offset[1]);
    rehab_assistance_step(&controller, tick->x, tick->with_v ? tick->v : NULL, tick->enable, tick->stamp, out);
    more[0] = rehab_assistance_energy_left(&controller);"""
USAGE = """\
static rehab_assistance controller;
rehab_command command;

rehab_assistance_init(&controller);
for (;;) {{ /* every tick */
{offset}    rehab_assistance_step(&controller, x, NULL, enable, stamp, &command);
    apply(command.value); /* force, N */
}}"""
SHIFT = "    rehab_assistance_shift(&controller, dx, dy); /* where the field is to stand */\n"
CARRIER = (
    "What moves the field from point to point, a `Smoother` with Ruckig in it, is not there: the caller moves the "
    "field. Its motion stands in the recorded run as `offset`."
)
FIELDS = "`set_field` takes the number of an exported field, of which there {}. In Python it takes any field."


def exported_assistance(
    helper: Assistance,
    positions: Sequence[Array] | Array,
    *,
    title: str,
    fields: Sequence[PotentialField] = (),
    offset: ArrayLike | None = None,
) -> ExportedForce:
    """Prepare `Assistance` for export, with a recorded run along a path of the hand.

    Parameters
    ----------
    helper : the controller; the export resets it.
    positions : (N, 2) [m] hand position in each tick. In the first half of the run velocities are inputs, then they are
        estimated.
    title : short description.
    fields : further fields for `set_field`, numbered from 1; the helper's own is 0.
    offset : (N, 2) [m] offset of the field in each tick.

    Raises
    ------
    ConfigurationError : a solver without C code, a field that does not fit the mode.
    """
    path = np.asarray(positions, dtype=np.float64)
    all_fields = (helper.field, *fields)
    desired = gated_fields(helper, all_fields, name=NAME)
    there = np.zeros_like(path) if offset is None else np.asarray(offset, dtype=np.float64)
    others: list[RunTick] = [{"field": 0, "offset": by} for by in there]
    ticks = faulty_ticks(
        helper, path, others,
        (
            lambda tick: {**tick, "field": len(all_fields) - 1, "offset": np.zeros(2)},
            lambda tick: {**tick, "offset": tick["offset"] + 0.05},
        ),
    )  # fmt: skip
    helper.reset()

    def answer(tick: RunTick) -> Command:
        helper.set_field(all_fields[tick["field"]])
        helper.shift(*tick["offset"].tolist())
        v = tick["v"] if tick["with_v"] else None
        return helper.step(tick["x"], v, enable=tick["enable"], stamp=tick["stamp"])

    about = f"{len(ticks)} ticks of a hand's path, with faults among them"
    with as_in_c(helper._solvers):
        recording = recorded(answer, ticks, about, more=lambda: (helper.energy_left,))
    helper.set_field(all_fields[0])
    helper.reset()
    there_too = () if offset is None else (CARRIER,)
    count = "is 1" if len(all_fields) == 1 else f"are {len(all_fields)}"
    return ExportedForce(
        name=NAME,
        title=f"{title}: force-bounded assistance, mode {helper.mode}",
        force=helper,
        desired=desired,
        interface="assistance",
        call=CALL,
        usage=USAGE.format(offset="" if offset is None else SHIFT),
        recording=recording,
        differences=(*DIFFERENCES, FIELDS.format(count), *there_too),
        solves=0,
        more_memory=MEMORY,
        values={
            **ALONE,
            "on_reset": "",
            "at_first": "the first field where it was made",
            "after_reset": "the field stays. energy: 1 fills the tank, too",
            "last_field": str(len(all_fields) - 1),
        },
    )


def gated_fields(helper: Assistance, fields: Sequence[PotentialField], *, name: str) -> Evaluated:
    """C function for the desired force under any of the helper's fields; the C struct must have the member `MEMORY`.

    Raises
    ------
    ConfigurationError : a field that does not fit the mode.
    """
    held = helper.field
    for field in fields:
        helper.set_field(field)  # raises the same errors as in Python
    helper.set_field(held)
    tables = [field_table(field.samples) for field in fields]
    most, edges = max(map(len, tables)), edge_columns(helper.comfortable.polygon)
    return Evaluated(
        controller=name,
        name="desired",
        about="the force of the field in use, where the gate lets it act [N]",
        function=gated_force(len(edges), most),
        inputs=(
            *("self->view + X", "self->offset", "GATE", "COMFORTABLE"),
            *(f"FIELDS + {FIELD.size} * self->field", f"SAMPLES + {8 * most} * self->field"),
        ),
        tables={
            "GATE": helper.gate,
            "COMFORTABLE": edges,
            "FIELDS": np.column_stack([numbers_of(field) for field in fields]),
            "SAMPLES": np.column_stack([filled_up(table, most).ravel() for table in tables]),
        },
    )
