"""`PathAssistance`: the pieces of a path, each with its field, and the progress that chooses among them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.command import Command
from rehab_opt.control.path_assistance import REACH, PathAssistance, progress_function
from rehab_opt.export.controllers.bounded_force import DIFFERENCES, ExportedForce, faulty_ticks
from rehab_opt.export.controllers.gated_fields import MEMORY, gated_fields
from rehab_opt.export.evaluated import Evaluated
from rehab_opt.export.recording import Tick, recorded

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
NEITHER = "`aim` and `carry` are not there: in Python they hold until the hand comes to the next piece of the path."


def exported_path_assistance(helper: PathAssistance, positions: Array, *, title: str) -> ExportedForce:
    """The controller, and what it answers along a path of the hand (N, 2) [m]; see `exported_assistance`."""
    helper.reset()
    wanted = gated_fields(helper, helper.pieces, name=NAME)
    proceed = Evaluated(
        controller=NAME,
        name="proceed",
        about="where along the path the hand has come to, and the piece that is nearest",
        function=progress_function(),
        inputs=("self->view + X", "PATH + 2 * self->place", "place", "PIECES"),
        tables={"PIECES": np.array([len(helper.pieces)]), "PATH": helper.track.T},
        arguments="const double *place, ",
    )
    ticks = faulty_ticks(helper, positions, [{} for _ in positions])

    def answer(tick: Tick) -> Command:
        v = tick["v"] if tick["with_v"] else None
        return helper.step(tick["x"], v, enable=tick["enable"], stamp=tick["stamp"])

    about = f"{len(ticks)} ticks of a hand's path, with faults among them"
    return ExportedForce(
        name=NAME,
        title=f"{title}: force-bounded assistance along a path, in {len(helper.pieces)} pieces",
        force=helper,
        wanted=wanted,
        interface="path_assistance",
        call=CALL,
        usage=USAGE,
        recording=recorded(answer, ticks, about, more=lambda: (helper.energy_left, helper.progress)),
        differences=(*DIFFERENCES, NEITHER),
        solves=2,  # and again from a cold start
        more_memory=MEMORY + "\n    int place;               /* along the path, where the hand is */",
        parts={proceed.name: proceed.function},
        values={"full": ", 1", "proceed": proceed.code, "last_place": str(len(helper.track) - 2 * REACH - 1)},
    )
