"""Export of `HelperSide` and `ParticipantSide`: a controller for each side, and the messages between them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.bilateral_sides import FromHelper, FromParticipant, HelperSide, ParticipantSide
from rehab_opt.control.command import Command
from rehab_opt.control.force_tick import MESSAGE, NUMBERS, hear, say
from rehab_opt.control.gate import reflected_force
from rehab_opt.export.c_text import Evaluated, layout, number
from rehab_opt.export.controllers.assistance import MEMORY, gated_fields
from rehab_opt.export.controllers.bounded_force import DIFFERENCES, ExportedForce, faulty_ticks
from rehab_opt.export.recording import Run, RunTick, recorded
from rehab_opt.optim.fallback_chain import as_in_c
from rehab_opt.workspace.edge_distance import edge_columns, nearest_point_function

__all__ = ["exported_helper_side", "exported_participant_side"]

Array = NDArray[np.float64]

HELPER, PARTICIPANT = "helper_side", "participant_side"
SERIALS = f"    double numbers[{NUMBERS.size}];       /* of messages: {', '.join(NUMBERS.places)} */"
FELT = "    double felt[2];          /* on the participant's hand [N]; NaN where it is not known */"
IMAGE = "\n        image(self, self->offset);"
FORCE_TOO = "    said->force_x = message[MESSAGE_FORCE];\n    said->force_y = message[MESSAGE_FORCE + 1];"
CALL = """\
rehab_from_{other} received = {{{received}, tick->serial}};
    rehab_from_{own} said;
    rehab_{name}_step(&controller, tick->x, tick->with_received ? &received : NULL, tick->with_v ? tick->v : NULL,
                      tick->enable, tick->stamp, out, &said);
    more[0] = rehab_{name}_energy_left(&controller);
    {said}
    more[{last}] = (double)said.serial;"""
USAGE = """\
static rehab_{name} controller;
rehab_command command;
rehab_from_{other} received;
rehab_from_{own} said;

rehab_{name}_init(&controller);
for (;;) {{ /* every tick */
    rehab_{name}_step(&controller, x, receive(&received) ? &received : NULL, NULL, enable, stamp, &command, &said);
    apply(command.value); /* force, N */
    send(&said);
}}"""
AT_FIRST = "no message received: their numbers\n * begin anew, so the other side has to begin anew, too"
RECEIVED = "\n * received the other side's message; NULL where none came. Without a new message the force is released"
OF_THE_PAIR = (
    "A message's number is a whole one. Python takes any.",
    "How messages are sent, and a delay between the sides, are the caller's: `Bilateral` is not there.",
)
PARTNER = "`partner`, the participant's hand in the helper's workspace for a display, is not there."
HELPER_SAYS, PARTICIPANT_SAYS = ("x", "y", "energy"), ("x", "y", "force_x", "force_y", "energy")


def exported_helper_side(
    side: HelperSide, positions: Array, received: Sequence[FromParticipant | None], *, title: str
) -> ExportedForce:
    """Prepare `HelperSide` for export, with a recorded run for hand positions (N, 2) [m] and received messages.

    Parameters
    ----------
    side : the controller; the export resets it.

    Raises
    ------
    ConfigurationError : a solver without C code.
    """
    edges = edge_columns(side.workspace_map.source.polygon)
    spline, force = side.workspace_map.spline.statement, reflected_force(len(edges))
    at, felt, *numbers = (ca.MX.sym("input", force.sparsity_in(i)) for i in (0, *range(2, force.n_in())))
    function = ca.Function("desired", [at, felt, *numbers], [force(at, spline(at[:2])[1], felt, *numbers)])
    desired = Evaluated(
        controller=HELPER,
        name="desired",
        about="the participant's force as it is felt in the helper's workspace; outside, what brings the hand back [N]",
        function=function,
        inputs=("self->view + X", "self->felt", "DAMPING", "BACK", "SOURCE"),
        tables={"DAMPING": np.array([side.damping]), "BACK": side.back, "SOURCE": edges},
    )
    return _exported(
        side,
        HELPER,
        title=f"{title}: the helper's side",
        desired=desired,
        more_memory=f"{SERIALS}\n{FELT}",
        recording=_recording(side, positions, received),
        differences=(*DIFFERENCES, *OF_THE_PAIR, PARTNER),
        says=(HELPER_SAYS, PARTICIPANT_SAYS),
        means={"target": "felt", "told": "force_", "listen": "", "say": ""},
    )


def exported_participant_side(
    side: ParticipantSide, positions: Array, received: Sequence[FromHelper | None], *, title: str
) -> ExportedForce:
    """Prepare `ParticipantSide` for export, with a recorded run; arguments as in `exported_helper_side`."""
    spline = side.workspace_map.spline.statement
    edges = edge_columns(side.workspace_map.source.polygon)
    inside = nearest_point_function(len(edges))
    point = ca.MX.sym("point", 2)
    held = ca.MX.sym("edges", inside.sparsity_in(1))
    image = Evaluated(
        controller=PARTICIPANT,
        name="image",
        about="the image of a point of the helper's workspace, or of its point nearest to it [m]; of NaN, NaN",
        function=ca.Function("image", [point, held], [spline(inside(point, held))[0] + 0 * point]),
        inputs=("self->offset", "SOURCE"),
        tables={"SOURCE": edges},
    )
    return _exported(
        side,
        PARTICIPANT,
        title=f"{title}: the participant's side",
        desired=gated_fields(side.force, (side.force.field,), name=PARTICIPANT),
        image=image,
        more_memory=f"{MEMORY}\n{SERIALS}",
        recording=_recording(side, positions, received),
        differences=(*DIFFERENCES, *OF_THE_PAIR),
        says=(PARTICIPANT_SAYS, HELPER_SAYS),
        means={"target": "offset", "told": "", "listen": IMAGE, "say": FORCE_TOO},
    )


def _exported(
    side: HelperSide | ParticipantSide,
    name: str,
    *,
    title: str,
    desired: Evaluated,
    image: Evaluated | None = None,
    more_memory: str,
    recording: Run,
    differences: Sequence[str],
    says: tuple[Sequence[str], Sequence[str]],
    means: Mapping[str, str],
) -> ExportedForce:
    """Prepare either side for export. `says`: fields of sent and received messages; `means`: the side's own C text."""
    own, received = says
    names = {
        "own": name.removesuffix("_side"),
        "other": (PARTICIPANT if name == HELPER else HELPER).removesuffix("_side"),
    }
    return ExportedForce(
        name=name,
        title=title,
        force=side.force,
        desired=desired,
        parts={
            **{what: part(side.force.slots) for what, part in (("hear", hear), ("say", say))},
            **({image.name: image.function} if image else {}),
        },
        interface="side",
        call=CALL.format(
            name=name,
            received=", ".join(f"tick->received[{i}]" for i in range(len(received))),
            said="\n    ".join(f"more[{i + 1}] = said.{each};" for i, each in enumerate(own)),
            last=len(own) + 1,
            **names,
        ),
        usage=USAGE.format(name=name, **names),
        recording=recording,
        differences=differences,
        solves=0,
        more_memory=more_memory,
        pieces={"begin": "force_begin.c", "messages": "messages.h", "declared": "force.h"},
        values={
            **names,
            **means,
            "full": "",
            "energy": "",
            "fills": "1",
            "at_first": AT_FIRST,
            "after_reset": "a full tank, no message. The numbers of messages go on",
            "on_hand": f" on the {names['own']}'s hand",
            "received_input": RECEIVED,
            "received_argument": f" const rehab_from_{names['other']} *received,",
            "said_output": "; said is the message to the other side, and not NULL either",
            "said_argument": f", rehab_from_{names['own']} *said",
            "on_reset": f"\n    self->{means['target']}[0] = self->{means['target']}[1] = NAN;",
            "image": f"{image.code}\n\n" if image else "",
            "fraction": number(side._messages.fraction),
            "message_layout": layout("MESSAGE", MESSAGE.places),
        },
    )


def _ticks(
    side: HelperSide | ParticipantSide,
    positions: Array,
    received: Sequence[FromHelper | FromParticipant | None],
    numbers: int,
) -> list[RunTick]:
    """Inputs of a run with hand positions and messages; some messages are lost, duplicated, late or corrupt."""
    nothing = (*[0.0] * numbers, 0)
    others: list[RunTick] = [
        {"received": np.array((message or nothing)[:-1]), "with_received": int(message is not None),
         "serial": (message or nothing)[-1]}
        for message in received
    ]  # fmt: skip
    return faulty_ticks(
        side.force, positions, others,
        (
            lambda tick: {**tick, "with_received": 0},
            lambda tick: {**tick, "serial": tick["serial"] - 1},
            lambda tick: {**tick, "serial": max(tick["serial"] - 7, 0)},
            lambda tick: {**tick, "serial": 2**31 - 1},
            lambda tick: {**tick, "received": np.full(numbers, np.nan)},
            lambda tick: {**tick, "received": np.where(np.arange(numbers) == numbers - 2, np.inf, tick["received"])},
            lambda tick: {**tick, "received": np.where(np.arange(numbers) == numbers - 1, 1e9, tick["received"])},
        ),
    )  # fmt: skip


def _recording(
    side: HelperSide | ParticipantSide,
    positions: Array,
    received: Sequence[FromHelper | FromParticipant | None],
) -> Run:
    """Run with the side's commands; each is recorded with the remaining energy and the sent message."""
    hears: Any = FromParticipant if isinstance(side, HelperSide) else FromHelper
    said: list[FromHelper | FromParticipant] = []

    def command_of(tick: RunTick) -> Command:
        message = hears._make((*tick["received"].tolist(), tick["serial"])) if tick["with_received"] else None
        v = tick["v"] if tick["with_v"] else None
        command, answer = side.step(tick["x"], message, v, enable=tick["enable"], stamp=tick["stamp"])
        said.append(answer)
        return command

    side.reset()
    ticks = _ticks(side, positions, received, len(hears._fields) - 1)
    about = f"{len(ticks)} ticks of a hand's path and of messages, with faults among them"
    numbers = side._messages.numbers.copy()  # a reset does not change them, but C starts anew
    try:
        side._messages.numbers[:] = 0.0
        with as_in_c(side.force._solvers):
            return recorded(command_of, ticks, about, more=lambda: (side.force.energy_left, *said[-1]))
    finally:
        side._messages.numbers[:] = numbers
        side.reset()
