"""`Assistance`: a field, the comfortable workspace that gates it, and the energy that is accounted for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.assistance import Assistance
from rehab_opt.control.assistance_statement import EXACT, TINY
from rehab_opt.control.bounded_force import MISSED, MUCH
from rehab_opt.control.command import Command
from rehab_opt.control.energy_tank import HAND_SPEED
from rehab_opt.control.hand import FURTHEST, ROUNDING
from rehab_opt.errors import ConfigurationError, ProblemFileError
from rehab_opt.export.c_text import initialiser, number
from rehab_opt.export.exported import ExportedController, watchdog_of
from rehab_opt.export.generated import renamed
from rehab_opt.export.recording import Tick, recorded, with_faults
from rehab_opt.field.energy import field_function_in_blocks, field_table
from rehab_opt.optim.ladder import FUSED
from rehab_opt.optim.qrqp import QRQP_ITERATIONS
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.outcome import Progress
from rehab_opt.session.scenario.laws import Assisted
from rehab_opt.session.scenario.loop import ran
from rehab_opt.session.scenario.prepared import prepared
from rehab_opt.session.scenario.problem import THERAPY, ScenarioProblem
from rehab_opt.session.scenario.run import assistance_of, scene_of
from rehab_opt.workspace.edge_table import doubtful_edges, edge_table

__all__ = ["ExportedAssistance", "exported_assistance", "exported_scenario"]

Array = NDArray[np.float64]

NEAR = 1e-9
"""[m] Edges nearer than this to one another may be mistaken for each other."""
CALL = "rehab_assistance_step(&controller, tick->x, tick->with_v ? tick->v : NULL, tick->enable, tick->stamp, out);"
USAGE = """\
static rehab_assistance controller;
rehab_command command;

rehab_assistance_init(&controller);
for (;;) { /* every tick */
    rehab_assistance_step(&controller, x, NULL, enable, stamp, &command);
    apply(command.value); /* force, N */
}"""
DIFFERENCES = (
    "There is no backup solver. Where Python would ask daqp, C releases the force and says `REHAB_NOT_CERTIFIED`; "
    "the recorded run is of a Python controller without the backup, too.",
    "The field and the comfortable workspace are constants. In Python `aim` changes the field.",
    "The nearest point of the workspace's boundary is found by asking every edge. Python asks those of a grid's cell.",
    "A stamp is always asked for and checked. In Python it may be left out.",
    "An x that is NULL counts as not a number; Python raises an error for an argument of the wrong shape.",
)


@dataclass(frozen=True, eq=False, kw_only=True)
class ExportedAssistance(ExportedController):
    """A controller of a force.

    Parameters
    ----------
    helper : what answers in Python.
    """

    core: ClassVar[str] = "assistance_core"
    helper: Assistance

    @property
    def iterations(self) -> int:
        """Cap on the active-set changes of a solve."""
        return self.helper.stated.iterations or QRQP_ITERATIONS

    def functions(self) -> list[ca.Function]:
        """The tick's QP, and the field."""
        field = field_function_in_blocks(len(field_table(self.helper.field.samples)))
        return [renamed(self.helper.stated.fused, "assistance_tick"), renamed(field, "assistance_field")]

    def shape(self) -> dict[str, str]:
        """Bounds, the field's samples and the workspace's edges."""
        helper, stated = self.helper, self.helper.stated
        tank, hand = helper._tank, helper._hand
        gates = {name: helper._gate.keywords[name] for name in ("onset", "return_stiffness", "return_force")}
        edges, samples = edge_table(helper.comfortable.polygon), field_table(helper.field.samples)
        memory = int(stated.memory.numel())
        sizes = {
            "memory_at": stated.state_size - memory,
            "state_count": stated.state_size,
            "parameter_count": stated.parameter_size,
            "verdict_count": 3 + int(stated.report.numel()),
            "edge_count": len(edges),
            "trust_stillness": int(hand._trusted),
            "acts_inside": int(helper.mode in ("follow", "hold")),
            "values": 2,
            "wheels": 0,
            "numbers": stated.parameter_size + 2 * stated.state_size + 30,
        }
        doubles = {
            "tolerance": helper.tolerance, "force_limit": helper.force_limit, "step": helper._step, "exact": EXACT,
            "tiny": TINY, "much": MUCH, "missed": MISSED, "budget": tank.budget, "slew": tank._slew,
            "speed_cap": helper.speed_cap, "per_newton": tank._per_newton, "hand_speed": HAND_SPEED,
            "velocity_lag": hand._lag, "furthest": FURTHEST, "rounding": ROUNDING, **gates,
            "sharpness": 1 / helper.field.width**2,
        }  # fmt: skip
        return {
            **{name: str(size) for name, size in sizes.items()},
            **{name: number(value) for name, value in doubles.items()},
            **watchdog_of(hand._watchdog, helper.dt),
            "damping": initialiser(helper.field.damping),
            "field_table": ",\n".join(f"    {', '.join(map(number, row))}" for row in samples.tolist()),
            "edge_table": ",\n".join(f"    {initialiser(row)}" for row in edges.tolist()),
            "tick_function": "assistance_tick",
            "field_function": "assistance_field",
        }


def exported_scenario(loaded: ProblemFile[ScenarioProblem], *, progress: Progress) -> ExportedAssistance:
    """The controller of a scenario, with the hand of its first trial.

    Raises
    ------
    ProblemFileError : a mode whose field moves, or a value of the file that cannot be used.
    """
    problem = loaded.problem
    if problem.mode not in THERAPY:
        expected = f"one with a field that stays where it is: {', '.join(THERAPY)}"
        raise ProblemFileError(loaded.file, "mode", problem.mode, expected)
    ready = prepared(loaded, progress=progress)
    helper = assistance_of(problem, ready, solver=FUSED, backup=FUSED)
    trial = ran(scene_of(loaded, ready), Assisted(helper), name="assisted", number=0, seed=problem.task.seed)
    return exported_assistance(helper, trial.position, title=problem.title)


def exported_assistance(helper: Assistance, positions: Sequence[Array] | Array, *, title: str) -> ExportedAssistance:
    """The controller, and what it answers along a path of the hand.

    Parameters
    ----------
    helper : made with backup="qrqp"; it is reset.
    positions : (N, 2) [m] where the hand is in each tick. In the first half its velocity is given, then estimated.
    title : what it is, in a few words.

    Raises
    ------
    ConfigurationError : a backup that C has not, or a workspace with rings that touch, slivers or spikes, of which
        Python asks shapely on which side a point is.
    """
    if helper._ladder.solver != FUSED or helper._ladder.backup != FUSED:
        raise ConfigurationError("helper", helper._ladder.backup, f"Assistance(..., backup='{FUSED}'), as C is")
    polygon = helper.comfortable.polygon
    if doubtful_edges(edge_table(polygon), NEAR).any():
        raise ConfigurationError("comfortable", polygon.wkt[:60], "no rings that touch, no slivers, no spikes")
    path = np.asarray(positions, dtype=np.float64)
    velocities = np.gradient(path, helper.dt, axis=0)
    sound: list[Tick] = [
        {"x": x, "v": v, "with_v": int(i < len(path) / 2)}
        for i, (x, v) in enumerate(zip(path, velocities, strict=True))
    ]
    ticks = with_faults(
        sound, dt=helper.dt, max_age=helper._hand._watchdog.max_age,
        more=(
            lambda tick: {**tick, "x": tick["x"] + 0.3},  # a jump, and back
            lambda tick: {**tick, "v": np.array([2.0 * helper.speed_cap, 0.0]), "with_v": 1},
            lambda tick: {**tick, "v": np.array([np.nan, 0.0]), "with_v": 1},
        ),
    )  # fmt: skip
    helper.reset()

    def answer(tick: Tick) -> Command:
        v = tick["v"] if tick["with_v"] else None
        return helper.step(tick["x"], v, enable=tick["enable"], stamp=tick["stamp"])

    return ExportedAssistance(
        name="assistance",
        title=f"{title}: force-bounded assistance, mode {helper.mode}",
        helper=helper,
        interface="assistance",
        call=CALL,
        usage=USAGE,
        recording=recorded(answer, ticks, f"{len(ticks)} ticks of a hand's path, with faults among them"),
        differences=DIFFERENCES,
        solves=2,  # and again from a cold start
    )
