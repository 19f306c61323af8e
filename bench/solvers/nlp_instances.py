"""Nonlinear programmes of the library with their numbers: the statement is rebuilt from its own code, never copied."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.qp_recording.array_file import META, read_arrays, versions_now, write_arrays
from bench.solvers.mirror_window import MirrorWindow
from rehab_opt.control.hand_bounds import HandBounds
from rehab_opt.control.ik_statements import IKStatements
from rehab_opt.control.mirror import MirrorTracker
from rehab_opt.control.mirror_plan import MirrorPath
from rehab_opt.errors import ConfigurationError, ProblemFileError
from rehab_opt.kinematics.human_arm import ARM_SEGMENTS, human_arm
from rehab_opt.kinematics.ur5 import ur5
from rehab_opt.optim.nlp import NLP
from rehab_opt.workspace.plane_statement import PlaneStatement

__all__ = [
    "PLAN",
    "STATEMENTS",
    "WINDOW",
    "WINDOW_KEYS",
    "NLPInstances",
    "read_nlp_instances",
    "write_nlp_instances",
]

Array = NDArray[np.float64]

FORMAT = "rehab_opt nlp instances 1"
WINDOW, WINDOW_KEYS = "mirror_window", ("floor", "largest", "linear_speed", "deviation", "spacing", "knots")
TEXTS = ("name", "statement", "command", "about")


def _arm_of(arguments: Mapping[str, Any]) -> Any:
    segments = arguments.get("segments_m", dict(ARM_SEGMENTS))
    return human_arm(range_of_motion=arguments["range_of_motion"], segments=segments)


def _window(arguments: Mapping[str, Any]) -> MirrorWindow:
    floor, largest, linear_speed, deviation, spacing = (float(arguments[key]) for key in WINDOW_KEYS[:-1])
    return MirrorWindow(
        HandBounds(ur5(), floor, largest), linear_speed=linear_speed, deviation=deviation, dt=spacing,
        knots=arguments[WINDOW_KEYS[-1]],
    )  # fmt: skip


def _ik(arguments: Mapping[str, Any]) -> IKStatements:
    return IKStatements(_arm_of(arguments), handle_tilt=arguments["handle_tilt"])


STATEMENTS: Mapping[str, Callable[[Mapping[str, Any]], NLP]] = MappingProxyType(
    {
        "ik_posture": lambda arguments: _ik(arguments).posture,
        "ik_nearest": lambda arguments: _ik(arguments).nearest,
        "plane_nearest": lambda arguments: (
            PlaneStatement(_arm_of(arguments), handle_tilt=arguments["handle_tilt"]).nearest
        ),
        WINDOW: lambda arguments: _window(arguments).nlp,
    }
)
"""The library's statements by name, from the arguments in the file."""
PLAN = "mirror_plan"
"""No single programme, but a whole motion of QPs with a clock: `NLPInstances.plan` runs it."""


@dataclass(frozen=True, eq=False)
class NLPInstances:
    """N instances of one statement.

    Parameters
    ----------
    name : "family/which".
    statement : a key of `STATEMENTS`, or `PLAN`.
    arguments : what the statement is built from: `range_of_motion`, `segments_m`, `handle_tilt` [rad] of an arm; of a
        plan those of `MirrorTracker`; of a window of one `floor`, `largest`, `linear_speed` [m/s], `deviation` [m],
        `spacing` [s] and `knots`.
    parameters : (N, p) in the statement's order. Of a plan (N, 22): pose of the tool by rows, then its twist, dt apart.
    starts : (N, n) variables to start from. Of a plan (1, n) joint angles [rad].
    tolerance : largest residual of `NLP.certify` that counts as solved.
    command, about, versions : as in `QPSequence`.

    Raises
    ------
    ConfigurationError : an unknown statement, arguments or arrays that do not fit it.
    """

    name: str
    statement: str
    arguments: Mapping[str, Any]
    parameters: Array
    starts: Array
    tolerance: float
    command: str = ""
    about: str = ""
    versions: Mapping[str, str] = field(default_factory=versions_now)

    def __post_init__(self) -> None:
        """Check it against the statement."""
        if self.statement not in (*STATEMENTS, PLAN):
            raise ConfigurationError("statement", self.statement, f"one of {', '.join((*STATEMENTS, PLAN))}")
        if not 0 < self.tolerance < 1:
            raise ConfigurationError("tolerance", self.tolerance, "a number above 0 and below 1")
        plan = self.statement == PLAN
        widths = (22, 6) if plan else self._widths()
        for key, width in zip(("parameters", "starts"), widths, strict=True):
            array = np.array(getattr(self, key), dtype=np.float64)
            rows = 1 if plan and key == "starts" else len(self.parameters)
            if array.shape != (rows, width) or not rows or np.isnan(array).any():
                raise ConfigurationError(key, f"shape {array.shape}", f"numbers of shape ({rows}, {width})")
            array.setflags(write=False)
            object.__setattr__(self, key, array)

    def __len__(self) -> int:
        return 1 if self.statement == PLAN else len(self.parameters)

    @cached_property
    def nlp(self) -> NLP:
        """The library's own statement, built anew."""
        if self.statement == PLAN:
            raise ConfigurationError("statement", PLAN, "one that is a single programme; use `plan`")
        return STATEMENTS[self.statement](self.arguments)

    def plan(self) -> MirrorPath:
        """The whole motion of a mirror plan."""
        if self.statement != PLAN:
            raise ConfigurationError("statement", self.statement, PLAN)
        poses = np.tile(np.eye(4), (len(self.parameters), 1, 1))
        poses[:] = self.parameters[:, :16].reshape(-1, 4, 4)
        tracker = MirrorTracker(ur5(), **self.arguments)
        return tracker.plan(poses, self.parameters[:, 16:], self.starts[0])

    def _widths(self) -> tuple[int, int]:
        try:
            return int(self.nlp.p.numel()), self.nlp.n
        except (KeyError, TypeError, ValueError) as problem:
            of_arm = "range_of_motion, segments_m and handle_tilt of an arm"
            expected = f"numbers {', '.join(WINDOW_KEYS)}" if self.statement == WINDOW else of_arm
            raise ConfigurationError("arguments", dict(self.arguments), expected) from problem


def write_nlp_instances(path: Path | str, instances: NLPInstances, *, argument: str = "path") -> None:
    """Write them compressed; `README.md` in this folder has the layout. `argument` is what the user calls the path."""
    meta = {
        "format": FORMAT, **{key: getattr(instances, key) for key in TEXTS}, "tolerance": instances.tolerance,
        "arguments": dict(instances.arguments), "versions": dict(instances.versions),
    }  # fmt: skip
    write_arrays(Path(path), meta, {"parameters": instances.parameters, "starts": instances.starts}, argument=argument)


def read_nlp_instances(path: Path | str) -> NLPInstances:
    """What `write_nlp_instances` wrote.

    Raises
    ------
    ProblemFileError : the file holds no such instances; it names the key, what stands there and what was expected.
    """
    meta, arrays = read_arrays(path)
    if meta.get("format") != FORMAT:
        raise ProblemFileError(path, f"{META}.format", meta.get("format"), repr(FORMAT))
    kinds: dict[str, tuple[Any, str]] = {
        **dict.fromkeys(TEXTS, (str, "a text")), "tolerance": (float, "a number above 0 and below 1"),
        "arguments": (dict, "arguments by name"), "versions": (dict, "versions by name"),
    }  # fmt: skip
    for key, (kind, expected) in kinds.items():
        if not isinstance(meta.get(key), kind):
            raise ProblemFileError(path, f"{META}.{key}", meta.get(key), expected)
    if set(arrays) != {"parameters", "starts"}:
        raise ProblemFileError(path, "file", ", ".join(sorted(arrays)), "the arrays parameters and starts")
    given: dict[str, Any] = {**{key: meta[key] for key in kinds}, **arrays}
    try:
        return NLPInstances(**given)
    except ConfigurationError as problem:
        key = problem.argument if problem.argument in arrays else f"{META}.{problem.argument}"
        raise ProblemFileError(path, key, problem.value, problem.expected) from problem
