"""What is known of a controller that goes into C, and the table that C reads its shape from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import casadi as ca

from rehab_opt.control.velocity_controller import VelocityController
from rehab_opt.export.reasons import REASONS, reason_number
from rehab_opt.export.recording import Recording
from rehab_opt.optim.qrqp import QRQP_ITERATIONS

__all__ = ["ExportedController", "Law"]


@dataclass(frozen=True, eq=False)
class Law:
    """One controller of a velocity QP as its functions and the sizes of what they take.

    Parameters
    ----------
    name : identifier, different from those of other laws of the same file.
    controller : what answers in Python.
    lesser : (parameters, memory) -> report, memory, violation: what may be sent where the solver failed, or None.
    obstacles : how many of the last parameters `braking` needs, too.
    """

    name: str
    controller: VelocityController
    lesser: ca.Function | None = None
    obstacles: int = 0

    @property
    def iterations(self) -> int:
        """Cap on the active-set changes of a solve."""
        return self.controller.stated.iterations or QRQP_ITERATIONS

    @property
    def memory(self) -> int:
        """How many numbers pass from tick to tick, besides the warm start."""
        return int(self.controller.stated.memory.numel())

    @property
    def state(self) -> int:
        """The same with the warm start."""
        return self.controller.stated.state_size

    @property
    def reported(self) -> int:
        """Numbers of the statement's report."""
        return int(self.controller.stated.report.numel())

    def row(self) -> str:
        """The C initialiser of its `law_shape`."""
        controller, stated, n = self.controller, self.controller.stated, self.controller.chain.n
        sent = controller.sent or slice(n)
        wheels = controller.wheels
        inputs = [int(symbol.numel()) for symbol in stated.parameters]
        braked = int(controller.braking().size1_out(0))
        requirement = REASONS[reason_number(controller.requirement)].name
        begin, count = (-1, 0) if wheels is None else (wheels.start, wheels.stop - wheels.start)
        cells = (
            *(stated.parameter_size, stated.n, self.state - self.memory, self.memory, braked, self.reported),
            *(sent.start or 0, begin, count),
            *(len(inputs), "{" + ", ".join(map(str, inputs)) + "}"),
            *(stated.parameter_size - self.obstacles, self.obstacles, f"REHAB_{requirement}"),
            *(f"{self.name}_tick", f"{self.name}_brake", f"{self.name}_lesser" if self.lesser else "NULL"),
        )
        return "{" + ", ".join(map(str, cells)) + "}"


@dataclass(frozen=True, eq=False)
class ExportedController:
    """A controller that goes into C.

    Parameters
    ----------
    name : identifier; files are named after it.
    title : what it is, in a few words.
    laws : its QPs, of which one is in use at a time; all of the same chain.
    interface : the templates of what the user calls, without their suffixes .h.in and .c.in.
    call : C that gives the inputs of `tick`, a `recorded_tick`, to `controller`.
    usage : C of a loop, for the reader.
    recording : the run that it repeats.
    differences : sentences on what C does not do as Python does.
    solves : most solves of a tick.
    values : what the templates of the interface hold besides.
    more_memory : members of the C struct besides.
    """

    name: str
    title: str
    laws: Sequence[Law]
    interface: str
    call: str
    usage: str
    recording: Recording
    differences: Sequence[str]
    solves: int
    values: Mapping[str, str] = field(default_factory=dict)
    more_memory: str = ""
