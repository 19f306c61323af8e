"""Export of `RedundancyResolver`, `system = "ardis"`: one controller for each drive with a stick."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.chair_and_arm import ChairAndArm
from rehab_opt.control.command import Command
from rehab_opt.control.hand_task import FRAMES
from rehab_opt.control.obstacles import DISC, HALF_PLANE, NUMBERS, obstacle_function
from rehab_opt.control.redundancy import RedundancyResolver
from rehab_opt.export.c_text import indented, initialiser, number
from rehab_opt.export.controllers.pose_tracker import moving_argument, moving_values
from rehab_opt.export.exported import ExportedController, ExportedVelocity, Law, refuse_other_solvers
from rehab_opt.export.generated import renamed
from rehab_opt.export.recording import (
    NO_ITERATIONS,
    STAMPED,
    Run,
    RunTick,
    about_run,
    encoders,
    recorded,
    standing,
    thinned,
    with_faults,
)  # fmt: skip
from rehab_opt.optim.fallback_chain import BACKUP, as_in_c
from rehab_opt.session.ardis.problem import ArdisProblem
from rehab_opt.session.ardis.robot import resolver_of
from rehab_opt.session.ardis.scene import ArdisScene
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.outcome import Progress

__all__ = ["exported_resolver", "exported_resolvers"]

Array = NDArray[np.float64]

DIFFERENCES = (
    f"There is no backup solver. Where Python would use {BACKUP}, C goes on to a tick of braking together "
    f"(`REHAB_BACKUP`), as Python does where {BACKUP} fails, and to the safe command where that is not certified; the "
    "recorded run is of a Python controller without the backup, too.",
    "Only the sets of rows of the problem's stick are there. Others give the safe command and `REHAB_ROWS_UNKNOWN`; "
    "Python makes their functions when the robot is at rest.",
    "`reset` is to rest. In Python it takes a velocity, too.",
    "`reach`, which leads the hand to a place, is not there: it needs Ruckig. Neither is the stick itself.",
    STAMPED,
    "A q or twist that is NULL counts as not a number; Python raises an error for an argument of the wrong shape.",
    NO_ITERATIONS,
)


class ExportedResolver(ExportedVelocity):
    """`RedundancyResolver` of a chair with an arm, for export."""

    def functions(self) -> list[ca.Function]:
        """CasADi functions of the QP controllers, and the one that converts an obstacle to numbers."""
        return [*super().functions(), renamed(obstacle_function(), "obstacle")]


class Listening:
    """A `RedundancyResolver` that records its inputs."""

    def __init__(self, resolver: RedundancyResolver) -> None:
        self._resolver = resolver
        self.ticks: list[RunTick] = []

    def step(self, q: Array, twist: Array, rows: tuple[str, ...], frame: str, **given: Any) -> Command:
        """Record the inputs and return the resolver's command."""
        told = {"q": q.copy(), "twist": np.array(twist), "rows": self._resolver.row_sets.index(rows)}
        self.ticks.append({**told, "frame": int(FRAMES[frame])})
        return self._resolver.step(q, twist, rows, frame, **given)


def exported_resolvers(config: ProblemFile[ArdisProblem], *, progress: Progress) -> Sequence[ExportedController]:
    """Prepare a `RedundancyResolver` for each drive of a problem file; the problem gives the recorded runs.

    Raises
    ------
    ProblemFileError : a solver without C code, or an invalid value in the file.
    """
    refuse_other_solvers(config, "run.solver")
    return [
        _of_a_file(config, ArdisScene(config, None, drive), progress=progress) for drive in config.problem.stick.drives
    ]


def exported_resolver(
    resolver: RedundancyResolver, run: Sequence[RunTick], *, title: str, of: str
) -> ExportedController:
    """Prepare a `RedundancyResolver` for export, with all its sets of rows.

    Parameters
    ----------
    resolver : the controller; the export resets it. It repeats the run without a backup solver, because C has none.
    run : ticks of a valid run, each with q (n,), twist (k,) with k the size of the largest set of rows, and `rows` and
        `frame` as indices of `row_sets` and `FRAMES`; for a resolver with moving capsules also `obstacles` (k, 14). C
        repeats the run with faults added. For joints that move as commanded, only the first q is used.
    title : short description. of : origin of the run in words.

    Raises
    ------
    ConfigurationError : a solver without C code, or a robot with too many joints for a command.
    """
    name = f"redundancy_{resolver.drive}"
    active = list(resolver._sets.values())
    max_obstacles = active[0].max_obstacles
    rows = [f"REHAB_{name.upper()}_{'_'.join(names).upper()}" for names in resolver.row_sets]
    return ExportedResolver(
        name=name,
        title=f"{title}: joint velocities of a chair with an arm, {resolver.drive} drive",
        laws=[Law(f"law_{i}", law, {"going_on": law.going_on()}) for i, law in enumerate(active)],
        interface="redundancy",
        call=f"rehab_{name}_step(&controller, tick->q, tick->twist, tick->rows, tick->frame,"
        f"{moving_argument(resolver.limits, 'tick->')} tick->enable, tick->stamp, out);",
        usage=_usage(name, rows[0], moving_argument(resolver.limits)),
        recording=_recording(resolver, run, of),
        differences=DIFFERENCES,
        solves=2 * 2,  # by the dual active set and by qrqp; both again from a cold start
        values=_values(rows, active, max_obstacles, resolver),
        more_memory=f"double obstacles[{max(1, NUMBERS * max_obstacles)}]; /* four numbers each */",
    )


def _of_a_file(config: ProblemFile[ArdisProblem], scene: ArdisScene, *, progress: Progress) -> ExportedController:
    """Resolver for one drive of a file; the problem's own run supplies the inputs of its recorded run."""
    drive = scene.drive
    control, resolver = scene.control(), resolver_of(config, scene.robot, drive)
    listening = control.law = Listening(resolver_of(config, scene.robot, drive))
    scene.run(lambda _, *how_far: progress(f"{drive}, recorded", *how_far), control)
    kept = thinned(len(listening.ticks))
    step = 1 if len(kept) < 2 else int(kept[1])
    part = "" if step == 1 else f" (one of {step}, since the run is longer)"
    return exported_resolver(
        resolver, [listening.ticks[i] for i in kept], title=config.problem.title,
        of=f"`rehab-opt run {config.name}`, {drive} drive{part}",
    )  # fmt: skip


def _recording(resolver: RedundancyResolver, run: Sequence[RunTick], of: str) -> Run:
    robot = resolver.robot
    law = next(iter(resolver._sets.values()))
    valid, joints, moves = encoders(run, dt=resolver.dt)
    ticks = with_faults(
        valid, dt=resolver.dt, max_age=law.max_age,
        more=(
            lambda tick: {**tick, "twist": 1e4 * np.ones_like(tick["twist"])},
            lambda tick: {**tick, "frame": 1},
            lambda tick: {**tick, "q": np.minimum(robot.chain.upper, 10.0) + 0.05},  # beyond every limit
        ),
    )  # fmt: skip
    ticks += standing(ticks, moves, dt=resolver.dt)
    frames = {int(value): name for name, value in FRAMES.items()}

    def answer(tick: RunTick) -> Command:
        rows = resolver.row_sets[tick["rows"]]
        return resolver.step(
            tick["q"], tick["twist"][: len(rows)], rows, frames[tick["frame"]], moving=tick.get("obstacles"),
            enable=tick["enable"], stamp=tick["stamp"],
        )  # fmt: skip

    about = about_run(len(ticks), of)
    resolver.reset()
    with as_in_c(*(law._solvers for law in resolver._sets.values())):
        recording = recorded(answer, ticks, about, joints=joints)
    resolver.reset()
    return recording


def _values(
    rows: Sequence[str], laws: Sequence[ChairAndArm], max_obstacles: int, resolver: RedundancyResolver
) -> dict[str, str]:
    return {
        "row_constants": indented(
            f"{constant}{'' if i == len(rows) - 1 else ','} /* twist[{len(law.rows)}]: {', '.join(law.rows)} */"
            for i, (constant, law) in enumerate(zip(rows, laws, strict=True))
        ),
        "row_counts": "{" + ", ".join(str(len(law.rows)) for law in laws) + "}",
        "obstacle_numbers": str(NUMBERS * max_obstacles),
        "max_obstacles": str(max_obstacles),
        "wall": number(HALF_PLANE),
        "post": number(DISC),
        "room": initialiser(resolver._numbers if max_obstacles else [0.0]),
        **moving_values(resolver.limits, "parameters + JOINTS + ROWS[which] + 1 + ROOM"),
    }


def _usage(name: str, rows: str, moving: str) -> str:
    return f"""\
static rehab_{name} controller;
rehab_command command;

rehab_{name}_init(&controller);
for (;;) {{ /* every tick */
    rehab_{name}_step(&controller, q, twist, {rows}, REHAB_CHASSIS,{moving} enable, stamp, &command);
    send(command.value, command.wheels); /* joint velocities, m/s and rad/s, and wheel speeds, rad/s */
}}"""
