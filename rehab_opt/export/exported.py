"""What is known of a controller that goes into C, and the table that C reads its shape from."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar

import casadi as ca

from rehab_opt.control.pose_tracker import PoseTracker
from rehab_opt.control.velocity_controller import VelocityController
from rehab_opt.control.velocity_tick import DONE, NOTHING_TO_SOLVE, REPORT
from rehab_opt.errors import ConfigurationError, ProblemFileError
from rehab_opt.export.c_text import indented, layout, number
from rehab_opt.export.generated import renamed
from rehab_opt.export.recording import Run
from rehab_opt.optim.fallback_chain import FUSED
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.schema import Problem
from rehab_opt.session.systems import value_at

__all__ = ["ExportedController", "ExportedVelocity", "Law", "refuse_other_solvers"]

MAX_VALUES = 12
"""Of a command: `REHAB_MAX_VALUES`."""
BYTES = 8
"""Of a number or an address."""
SPARE = 100
"""Numbers of a struct beyond those that are counted."""
VERDICT = 3
"""Numbers of a verdict before its report."""


def refuse_other_solvers(config: ProblemFile[Problem], key: str) -> None:
    """Raise a `ProblemFileError` where a file names a solver that does not become C."""
    solver = value_at(config.problem, key)
    if solver not in (None, FUSED):
        raise ProblemFileError(config.file, key, solver, f"{FUSED}, which can become C")


@dataclass(frozen=True, eq=False)
class Law:
    """One controller of a velocity QP as its functions and the sizes of what they take.

    Parameters
    ----------
    name : identifier, different from those of other controllers of the same file.
    controller : what answers in Python.
    more : functions besides those of every controller, by what they are.
    """

    name: str
    controller: VelocityController
    more: Mapping[str, ca.Function] = field(default_factory=dict)

    @property
    def state(self) -> int:
        """How many numbers pass from tick to tick."""
        return self.controller.stated.state_size + self.controller.judged.size

    @property
    def reported(self) -> int:
        """Numbers of the statement's report."""
        return int(self.controller.stated.report.numel())

    def functions(self) -> list[ca.Function]:
        """Functions of the tick, the fallback command and the reset, and further ones."""
        of = self.controller
        pairs = {"tick": of.functions.tick, "finish": of.functions.finish, "begin": of.beginning()}
        return [renamed(function, f"{self.name}_{what}") for what, function in (pairs | dict(self.more)).items()]

    def row(self) -> str:
        """The C initialiser of its `law_shape`."""
        controller, n, own_at = self.controller, self.controller.chain.n, self.controller.stated.state_size
        memory_at = own_at - int(controller.stated.memory.numel())
        command_slice, wheels = controller.command_slice or slice(n), controller.wheels or slice(0, 0)
        cells = (
            *(n, memory_at, own_at, own_at + controller.judged["reason"]),
            *(memory_at + (command_slice.start or 0), memory_at + wheels.start, wheels.stop - wheels.start),
            *(f"{self.name}_{what}" for what in ("tick", "finish", "begin")),
            f"{self.name}_going_on" if "going_on" in self.more else "NULL",
        )
        return "{" + ", ".join(map(str, cells)) + "}"


@dataclass(frozen=True, eq=False, kw_only=True)
class ExportedController(ABC):
    """A controller that goes into C.

    Parameters
    ----------
    name : identifier; files are named after it.
    title : what it is, in a few words.
    interface : the templates of what the user calls, without their suffixes .h.in and .c.in.
    call : C that gives the inputs of `tick`, a `recorded_tick`, to `controller`.
    usage : C of a loop, for the reader.
    recording : the run that it repeats.
    differences : sentences on what C does not do as Python does.
    solves : most solves of a tick.
    values : what the templates of the interface hold besides.
    more_memory : members of the C struct besides.
    pieces : templates (without .in) that those of core and interface hold, by the name they have there, and that
        pieces behind them may hold, too.
    """

    core: ClassVar[str]
    """The templates of its memory and its tick, likewise."""
    contents: ClassVar[str]
    """What is in its C file, for the reader."""

    name: str
    title: str
    interface: str
    call: str
    usage: str
    recording: Run
    differences: Sequence[str]
    solves: int
    values: Mapping[str, str] = field(default_factory=dict)
    more_memory: str = ""
    pieces: Mapping[str, str] = field(default_factory=dict)

    @property
    @abstractmethod
    def dt(self) -> float:
        """[s] of a tick."""

    @abstractmethod
    def limits(self) -> list[str]:
        """What it keeps to, line by line."""

    @property
    def bytes(self) -> int:
        """Of its struct, to within a kilobyte and not less."""
        functions = self.generated
        work = (max(3, *(each.sz_arg() for each in functions)), max(3, *(each.sz_res() for each in functions)))
        numbers = max(each.sz_iw() for each in functions) + max(1, *(each.sz_w() for each in functions))
        return BYTES * (int(self.shape()["numbers"]) + sum(work) + numbers + SPARE)

    @abstractmethod
    def functions(self) -> list[ca.Function]:
        """All that is generated, each under a name of its own."""

    @cached_property
    def generated(self) -> list[ca.Function]:
        """The same, made once: that takes as long as making the controller."""
        return self.functions()

    @abstractmethod
    def shape(self) -> dict[str, str]:
        """Fields of the core's templates; `numbers` are the doubles of its memory."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ExportedVelocity(ExportedController):
    """A controller of joint velocities.

    Parameters
    ----------
    laws : its QPs; the first one's chain is the robot.

    Raises
    ------
    ConfigurationError : a chain of more joints than a command has room for.
    """

    core: ClassVar[str] = "velocity_controller"
    contents: ClassVar[str] = "kinematics, QP solve, certificate, watchdog, safe command"
    laws: Sequence[Law]

    def __post_init__(self) -> None:
        """Check that every command fits."""
        for law in self.laws:
            if law.controller.chain.n > MAX_VALUES:
                raise ConfigurationError("chain", law.controller.chain.n, f"at most {MAX_VALUES} joints, as C has")

    @property
    def dt(self) -> float:
        """[s] of a tick."""
        return self.laws[0].controller.dt

    def limits(self) -> list[str]:
        """Of each joint its largest and smallest position, speed, acceleration and jerk; of the hand its speeds."""
        first = self.laws[0].controller
        chain = first.chain
        bounds = {name: getattr(chain, name) for name in ("lower", "upper", "velocity", "acceleration")}
        if isinstance(first, PoseTracker) and first.jerk is not None:
            bounds["jerk"] = first.jerk.jerk
        table: list[tuple[str, ...]] = [("joint", *bounds)]
        for i, (name, row) in enumerate(zip(chain.names, chain.rows, strict=True)):
            unit = "m" if row.prismatic else "rad"
            table.append((f"{name} [{unit}]", *(f"{bound[i]:.9g}" for bound in bounds.values())))
        width = max(len(line[0]) for line in table)
        lines = [f"{line[0]:<{width}}" + "".join(f" {each:>13}" for each in line[1:]) for line in table]
        if isinstance(first, PoseTracker):
            lines.append(f"hand: at most {first.linear_speed:.9g} m/s and {first.angular_speed:.9g} rad/s")
        return lines

    def functions(self) -> list[ca.Function]:
        """Those of its controllers."""
        return [function for law in self.laws for function in law.functions()]

    def shape(self) -> dict[str, str]:
        """Sizes, limits and the table of the controllers."""
        laws, first = self.laws, self.laws[0].controller
        chain, wheels = first.chain, first.wheels
        sizes = {
            "joints": chain.n,
            "laws": len(laws),
            "max_parameters": max(law.controller.stated.parameter_size for law in laws),
            "max_state": max(law.state for law in laws),
            "max_verdict": VERDICT + max(law.reported for law in laws),
            "report_size": REPORT.size,
            "values": chain.n,
            "wheels": 0 if wheels is None else wheels.stop - wheels.start,
        }
        sizes["numbers"] = len(laws) * (sizes["max_parameters"] + 2 * sizes["max_state"] + sizes["max_verdict"])
        return {
            **{name: str(size) for name, size in sizes.items()},
            "report_layout": layout("REPORT", REPORT.places),
            "done": str(DONE),
            "nothing_to_solve": str(NOTHING_TO_SOLVE),
            "name": self.name,
            "at_rest": "REHAB_HOLDING",
            "dt": number(first.dt),
            "law_shapes": indented(law.row() + "," for law in laws).rstrip(","),
        }
