"""What is known of a controller that goes into C, and the table that C reads its shape from."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.followed_joints import SAID
from rehab_opt.control.pose_tracker import PoseTracker
from rehab_opt.control.velocity_controller import VelocityController
from rehab_opt.control.watchdog import watched
from rehab_opt.control.watched_joints import memory_of_watch, patience_of
from rehab_opt.errors import ConfigurationError
from rehab_opt.export.c_text import filled, indented, initialiser, number
from rehab_opt.export.generated import renamed
from rehab_opt.export.recording import Run
from rehab_opt.optim.fused import fused
from rehab_opt.optim.qrqp import QRQP_ITERATIONS
from rehab_opt.optim.rows import PLAUSIBLE

__all__ = ["ExportedController", "ExportedVelocity", "Law"]

MOST_VALUES = 12
"""Of a command: `REHAB_MOST_VALUES`."""
BYTES = 8
"""Of a number or an address."""
SPARE = 100
"""Numbers that a struct has besides those that are counted; with them it is not larger than said."""
VERDICT = 3
"""Numbers of a verdict before its report."""

LED = """\
    double led[{led}]; /* of the joints that are led, and of what their encoders said */
    double measured[{joints}], before[{joints}]; /* positions of the last tick, and the command before it */
    int touched, hand_held;  /* whether the hand is held from the last tick on, and whether it is held */
"""


@dataclass(frozen=True, eq=False)
class Law:
    """One controller of a velocity QP as its functions and the sizes of what they take.

    Parameters
    ----------
    name : identifier, different from those of other laws of the same file.
    controller : what answers in Python.
    fallback : (parameters, memory) -> report, memory, violation: a command where the solver failed; or None.
    """

    name: str
    controller: VelocityController
    fallback: ca.Function | None = None

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

    def functions(self) -> list[ca.Function]:
        """Its tick, its safe command, and its fallback law where there is one."""
        of = self.controller
        pairs = {"tick": fused(of.stated), "stop": of.stopping(), "faulty": of.faulty(), "fallback": self.fallback}
        return [renamed(function, f"{self.name}_{what}") for what, function in pairs.items() if function is not None]

    def row(self) -> str:
        """The C initialiser of its `law_shape`."""
        controller, stated, n = self.controller, self.controller.stated, self.controller.chain.n
        sent = controller.sent or slice(n)
        wheels = controller.wheels
        begin, count = (-1, 0) if wheels is None else (wheels.start, wheels.stop - wheels.start)
        cells = (
            *(n, stated.parameter_size, self.state - self.memory, self.memory, self.reported),
            *(sent.start or 0, begin, count, f"{self.name}_tick", f"{self.name}_stop", f"{self.name}_faulty"),
            f"{self.name}_fallback" if self.fallback else "NULL",
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
    pieces : templates (without .in) that those of core and interface hold, by the name they have there.
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

    @property
    @abstractmethod
    def iterations(self) -> int:
        """Cap on the active-set changes of a solve."""

    @abstractmethod
    def functions(self) -> list[ca.Function]:
        """All that is generated, each under a name of its own."""

    @cached_property
    def generated(self) -> list[ca.Function]:
        """The same, made once: that takes as long as making the controller."""
        return self.functions()

    @abstractmethod
    def shape(self) -> dict[str, str]:
        """What the templates of the core hold; `numbers` among it, the doubles of its memory."""


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
            if law.controller.chain.n > MOST_VALUES:
                raise ConfigurationError("chain", law.controller.chain.n, f"at most {MOST_VALUES} joints, as C has")

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

    @property
    def iterations(self) -> int:
        """The largest of its laws."""
        return max(law.iterations for law in self.laws)

    def functions(self) -> list[ca.Function]:
        """Of each law its tick, its safe command, and its fallback law where there is one."""
        watchdog = renamed(watched(), f"{self.name}_watched")
        first = self.laws[0].controller
        joints = {"followed": first.watch}
        if first.led is not None:
            joints |= {"led": first.led.tick, "led_from": first.led.start, "hurried": first.hurrying()}
        of_joints = [renamed(function, f"{self.name}_{what}") for what, function in joints.items()]
        return [watchdog, *of_joints, *(function for law in self.laws for function in law.functions())]

    def shape(self) -> dict[str, str]:
        """Sizes, limits and the table of the laws."""
        laws, first = self.laws, self.laws[0].controller
        chain, wheels = first.chain, first.wheels
        joints = max(law.controller.chain.n for law in laws)
        sizes = {
            "joints": chain.n,
            "joints_most": joints,
            "laws": len(laws),
            "parameters_most": max(law.controller.stated.parameter_size for law in laws),
            "state_most": max(law.state for law in laws),
            "memory_most": max(law.memory for law in laws),
            "verdict_most": VERDICT + max(law.reported for law in laws),
            "values": chain.n,
            "wheels": 0 if wheels is None else wheels.stop - wheels.start,
            "watch": memory_of_watch(chain.n).size,
            "watched": int(first.led is None or first.base > 0),
            "guided": first.guidance_size,
        }
        sizes["numbers"] = len(laws) * (sizes["parameters_most"] + 2 * sizes["state_most"] + sizes["verdict_most"])
        sizes["numbers"] += sizes["watch"]
        led = {"led": 0, "said_size": SAID.size, "base": first.base}
        led |= {f"said_{name}": SAID[name] for name in SAID.places}
        if first.led is not None:
            led["led"] = first.led.tick.numel_in(0)
            sizes["numbers"] += led["led"] + 2 * chain.n
        texts = {name: str(size) for name, size in (sizes | led).items()} | {"name": self.name}
        return {
            **texts,
            "lead": filled("not_led.c" if first.led is None else "led.c", texts),
            "seen": "parameters" if first.led is None else "self->measured",
            "led_memory": "" if first.led is None else LED.format(**texts),
            "dt": number(first.dt),
            "patience": number(patience_of(first.dt)),
            "watchdog": filled(
                "watchdog.c", {"name": self.name, "dt": number(first.dt), "max_age": number(first.max_age)}
            ),
            "law_shapes": indented(law.row() + "," for law in laws).rstrip(","),
            "plausible": number(PLAUSIBLE),
            "tolerance": number(first.tolerance),
            "middle": "{" + ", ".join(initialiser(_middle(law.controller)) for law in laws) + "}",
            "fastest": initialiser(chain.velocity),
        }


def _middle(controller: VelocityController) -> NDArray[np.float64]:
    """(n,) what stands in for positions before the first."""
    chain = controller.chain
    lower, upper = np.maximum(chain.lower, -PLAUSIBLE), np.minimum(chain.upper, PLAUSIBLE)
    return np.asarray((lower + upper) / 2)
