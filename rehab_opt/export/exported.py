"""Data of a controller for export to C, and the table of sizes in the C code."""

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
"""Largest number of values of a command: `REHAB_MAX_VALUES`."""
BYTES = 8
"""[bytes] Size of a number or an address."""
SPARE = 100
"""Reserve for members of a struct that are not counted."""
VERDICT = 3
"""Number of values in a certificate's verdict before the statement's report."""


def refuse_other_solvers(config: ProblemFile[Problem], key: str) -> None:
    """Raise `ProblemFileError` if a file names a solver without C code."""
    solver = value_at(config.problem, key)
    if solver not in (None, FUSED):
        raise ProblemFileError(config.file, key, solver, f"{FUSED}, which can become C")


@dataclass(frozen=True, eq=False)
class Law:
    """One velocity QP controller: its functions and their sizes.

    Parameters
    ----------
    name : identifier, unique in the file.
    controller : the controller in Python.
    more : further functions by their role.
    """

    name: str
    controller: VelocityController
    more: Mapping[str, ca.Function] = field(default_factory=dict)

    @property
    def state(self) -> int:
        """Number of values that the controller keeps from tick to tick."""
        return self.controller.stated.state_size + self.controller.judged.size

    @property
    def reported(self) -> int:
        """Number of values in the report of the controller's QP."""
        return int(self.controller.stated.report.numel())

    def functions(self) -> list[ca.Function]:
        """CasADi functions for the tick, the fallback command and the reset, and those in `more`."""
        of = self.controller
        pairs = {"tick": of.functions.tick, "finish": of.functions.finish, "begin": of.beginning()}
        return [renamed(function, f"{self.name}_{what}") for what, function in (pairs | dict(self.more)).items()]

    def row(self) -> str:
        """C initialiser of the controller's `law_shape`, the struct with its sizes and functions."""
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
    """A controller for export to C.

    Parameters
    ----------
    name : identifier; also the name of the files.
    title : short description.
    interface : templates of the user's functions, without the suffixes .h.in and .c.in.
    call : C code that passes the inputs of a `recorded_tick` named `tick` to the struct `controller`.
    usage : example of a loop in C.
    recording : the run that C repeats.
    differences : sentences on differences between C and Python.
    solves : largest number of solves in a tick.
    values : further template values of the interface.
    more_memory : further members of the C struct.
    pieces : templates (without .in) that core, interface and later pieces include; the keys are the names used there.
    """

    core: ClassVar[str]
    """Templates of the controller's memory and tick, without suffixes."""
    contents: ClassVar[str]
    """Description of the C file's content."""

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
        """[s] Length of a tick."""

    @abstractmethod
    def limits(self) -> list[str]:
        """The controller's bounds, one line each."""

    @property
    def bytes(self) -> int:
        """Upper bound of the C struct's size in bytes; it exceeds the true size by at most 1 kB."""
        functions = self.generated
        work = (max(3, *(each.sz_arg() for each in functions)), max(3, *(each.sz_res() for each in functions)))
        numbers = max(each.sz_iw() for each in functions) + max(1, *(each.sz_w() for each in functions))
        return BYTES * (int(self.shape()["numbers"]) + sum(work) + numbers + SPARE)

    @abstractmethod
    def functions(self) -> list[ca.Function]:
        """All CasADi functions that become C code, with unique names."""

    @cached_property
    def generated(self) -> list[ca.Function]:
        """`functions()`, cached because making them takes as long as making the controller."""
        return self.functions()

    @abstractmethod
    def shape(self) -> dict[str, str]:
        """Values for the templates of the core; `numbers` is the number of doubles in the controller's memory."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ExportedVelocity(ExportedController):
    """A joint velocity controller for export.

    Parameters
    ----------
    laws : its QP controllers; the first one's chain is the robot.

    Raises
    ------
    ConfigurationError : a chain with too many joints for a command.
    """

    core: ClassVar[str] = "velocity_controller"
    contents: ClassVar[str] = "kinematics, QP solve, certificate, watchdog, safe command"
    laws: Sequence[Law]

    def __post_init__(self) -> None:
        for law in self.laws:
            if law.controller.chain.n > MAX_VALUES:
                raise ConfigurationError("chain", law.controller.chain.n, f"at most {MAX_VALUES} joints, as C has")

    @property
    def dt(self) -> float:
        """[s] Length of a tick."""
        return self.laws[0].controller.dt

    def limits(self) -> list[str]:
        """Text lines with the limits of each joint (position, speed, acceleration, jerk) and of the hand's speed."""
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
        """CasADi functions of all QP controllers."""
        return [function for law in self.laws for function in law.functions()]

    def shape(self) -> dict[str, str]:
        """Values for the templates: sizes, limits and the table of the QP controllers."""
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
