"""Export of `PathAssistance`: the path, the spring that keeps the hand on the path, and the progress."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.command import Command
from rehab_opt.control.gate import guided_force
from rehab_opt.control.path_assistance import PathAssistance
from rehab_opt.control.path_progress import PATH_MODEL, PROGRESS, progress_function
from rehab_opt.export.c_text import Evaluated
from rehab_opt.export.controllers.bounded_force import ALONE, DIFFERENCES, ExportedForce, faulty_ticks
from rehab_opt.export.recording import RunTick, recorded
from rehab_opt.optim.fallback_chain import as_in_c
from rehab_opt.workspace.edge_distance import edge_columns

__all__ = ["exported_path_assistance"]

Array = NDArray[np.float64]

NAME = "path_assistance"
CALL = """\
rehab_path_assistance_step(&controller, tick->x, tick->with_v ? tick->v : NULL, tick->enable, tick->stamp, out);
    more[0] = rehab_path_assistance_energy_left(&controller);
    more[1] = rehab_path_assistance_progress(&controller);"""
USAGE = """\
static rehab_path_assistance controller;
rehab_command command;

rehab_path_assistance_init(&controller);
for (;;) { /* every tick */
    rehab_path_assistance_step(&controller, x, NULL, enable, stamp, &command);
    apply(command.value); /* force, N */
}"""
MEMORY = f"    double path[{PROGRESS.size}];        /* {', '.join(PROGRESS.places)} */"


def exported_path_assistance(helper: PathAssistance, positions: Array, *, title: str) -> ExportedForce:
    """Prepare `PathAssistance` for export, with a run along hand positions (N, 2) [m]; see `exported_assistance`.

    Raises
    ------
    ConfigurationError : a solver without C code.
    """
    helper.reset()
    edges = edge_columns(helper.comfortable.polygon)
    at = {each: f"self->path + {PROGRESS[each]}" for each in ("place", "along", "grip")}
    desired = Evaluated(
        controller=NAME,
        name="desired",
        about="the spring towards the place of the path to which the hand has come [N]",
        function=guided_force(len(edges)),
        inputs=("self->view + X", at["place"], at["along"], at["grip"], "SPRING", "GATE", "COMFORTABLE"),
        tables={"SPRING": helper.spring, "GATE": helper.gate, "COMFORTABLE": edges},
    )
    seen = ("self->path", "self->view + X", "self->force")
    proceed = Evaluated(
        controller=NAME,
        name="proceed",
        about="how far along the path the hand has come",
        function=progress_function(),
        inputs=("PATH_MODEL", *seen, "PATH + 2 * (int)self->path[AT]"),
        tables={"PATH_MODEL": helper.path_model, "AT_START": helper.at_start, "PATH": helper.track.T},
    )
    places = ", ".join(f"{each.upper()} = {PROGRESS[each]}" for each in ("at", "away", "gap", "furthest"))
    ticks = faulty_ticks(helper, positions, [{} for _ in positions])

    def answer(tick: RunTick) -> Command:
        v = tick["v"] if tick["with_v"] else None
        return helper.step(tick["x"], v, enable=tick["enable"], stamp=tick["stamp"])

    about = f"{len(ticks)} ticks of a hand's path, with faults among them"
    with as_in_c(helper._solvers):
        recording = recorded(answer, ticks, about, more=lambda: (helper.energy_left, helper.progress))
    helper.reset()
    last = int(helper.path_model[PATH_MODEL["last"]])
    return ExportedForce(
        name=NAME,
        title=f"{title}: force-bounded assistance along a path of {last + 1} samples",
        force=helper,
        desired=desired,
        interface="path_assistance",
        call=CALL,
        usage=USAGE,
        recording=recording,
        differences=DIFFERENCES,
        solves=0,
        more_memory=MEMORY,
        parts={proceed.name: proceed.function},
        values={
            **ALONE,
            "on_reset": "\n    memcpy(self->path, AT_START, sizeof self->path);",
            "at_first": "at the path's start",
            "after_reset": "and the hand is at the path's start. energy: 1 fills the tank, too",
            "proceed": f"enum {{ {places} }};\n{proceed.code}",
            "last_place": f"{last}.0",
        },
    )
