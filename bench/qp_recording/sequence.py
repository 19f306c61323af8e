"""QPs of consecutive ticks of one controller: what they are, where they lie, how they are written and read."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from bench.qp_recording.array_file import META, read_arrays, versions_now, write_arrays
from bench.qp_recording.sequence_arrays import ARRAYS, checked_arrays, checked_costs, checked_numbers
from rehab_opt.errors import ConfigurationError, ProblemFileError
from rehab_opt.optim.rows import Instance

if TYPE_CHECKING:
    import qpsolvers

__all__ = [
    "ARRAYS",
    "MARKS",
    "QPSequence",
    "read_sequence",
    "sequence_of",
    "write_sequence",
]

Array = NDArray[np.float64]

FORMAT = "rehab_opt qp sequence 1"
MARKS = ("infeasible", "degenerate", "badly_scaled", "nan")
"""What a tick may be said to be beside an ordinary one."""


@dataclass(frozen=True, eq=False)
class QPSequence:
    """QPs min 1/2 x'Hx + g'x, rows_lower <= A x <= rows_upper, lower <= x <= upper of T consecutive ticks.

    Every array has the tick first; one that is the same in all ticks has length 1 there. Units are those of the
    controller's statement. All arrays are read-only.

    Parameters
    ----------
    name : "family/which"; see `family`.
    hessian : (T or 1, n, n). gradient : (T or 1, n). rows : (T or 1, m, n).
    rows_lower, rows_upper : (T or 1, m). lower, upper : (T or 1, n). An absent bound is infinite.
    dt : [s] from tick to tick, NaN where the sequence is no run in time.
    tolerance : certificate tolerance of the controller that made it.
    marks : of each tick, or of all of them if there is one entry: which of `MARKS` it is.
    command : what makes this sequence again.
    about : one sentence.
    versions : of the library, and of those that its numbers depend on.

    Raises
    ------
    ConfigurationError : shapes that do not belong together, a mark that is none, a number that is not finite in a tick
        not marked "nan", a Hessian that is not symmetric and positive semidefinite.
    """

    name: str
    hessian: Array
    gradient: Array
    rows: Array
    rows_lower: Array
    rows_upper: Array
    lower: Array
    upper: Array
    dt: float
    tolerance: float
    marks: tuple[tuple[str, ...], ...] = ((),)
    command: str = ""
    about: str = ""
    versions: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check and freeze it."""
        family, _, which = self.name.partition("/")
        if not (family and which):
            raise ConfigurationError("name", self.name, "family/which")
        if not 0 < self.tolerance < 1:
            raise ConfigurationError("tolerance", self.tolerance, "a number above 0 and below 1")
        if not (self.dt > 0 or math.isnan(self.dt)) or math.isinf(self.dt):
            raise ConfigurationError("dt", self.dt, "seconds, or NaN")
        for key, array in checked_arrays({key: getattr(self, key) for key in ARRAYS}).items():
            object.__setattr__(self, key, array)
        if len(self.marks) not in (1, len(self)):
            raise ConfigurationError("marks", f"{len(self.marks)} entries", f"1, or one for each of {len(self)} ticks")
        for mark in {mark for marks in self.marks for mark in marks}:
            if mark not in MARKS:
                raise ConfigurationError("marks", mark, f"of {', '.join(MARKS)}")
        arrays = {key: getattr(self, key) for key in ARRAYS}
        checked_numbers(arrays, len(self), lambda tick: "nan" in self.marks_of(tick))
        checked_costs(self.hessian)

    @property
    def family(self) -> str:
        """What the name has before its stroke."""
        return self.name.partition("/")[0]

    @property
    def n(self) -> int:
        """Number of variables."""
        return int(self.gradient.shape[1])

    @property
    def m(self) -> int:
        """Number of rows."""
        return int(self.rows.shape[1])

    def __len__(self) -> int:
        return max(len(getattr(self, key)) for key in ARRAYS)

    def __getitem__(self, tick: int) -> Instance:
        """The QP of one tick; its arrays are views, and read-only."""
        if not -len(self) <= tick < len(self):
            raise IndexError(tick)
        return Instance(*(array[tick if len(array) > 1 else 0] for array in map(self.__getattribute__, ARRAYS)))

    def __iter__(self) -> Iterator[Instance]:
        return (self[tick] for tick in range(len(self)))

    def problem(self, tick: int) -> qpsolvers.Problem:
        """The QP of one tick as qpsolvers has it."""
        from rehab_opt.optim.backends import to_qpsolvers  # noqa: PLC0415  (solvers load when used)

        return to_qpsolvers(self[tick])

    def marks_of(self, tick: int) -> tuple[str, ...]:
        """The marks of one tick."""
        return self.marks[tick if len(self.marks) > 1 else 0]

    def first(self, ticks: int) -> QPSequence:
        """Its first ticks, at most as many."""
        parts: dict[str, Any] = {key: getattr(self, key)[:ticks] for key in ARRAYS}
        return replace(self, **parts, marks=self.marks[:ticks])


def sequence_of(
    name: str,
    instances: Sequence[Instance],
    *,
    dt: float,
    tolerance: float,
    command: str,
    about: str,
    marks: Iterable[Sequence[str]] = ((),),
) -> QPSequence:
    """Instances of one size, one after another, as a sequence; what does not change in time is kept once.

    Raises
    ------
    ConfigurationError : none, or of several sizes.
    """
    if not instances:
        raise ConfigurationError("instances", 0, "one or more")
    if len({(qp.g.size, qp.rows_lower.size) for qp in instances}) > 1:
        raise ConfigurationError("instances", "several sizes", "QPs of one size")
    columns = {key: np.stack(parts) for key, parts in zip(ARRAYS, zip(*instances, strict=True), strict=True)}
    constant = {key: np.array_equal(array, np.broadcast_to(array[:1], array.shape)) for key, array in columns.items()}
    kept: dict[str, Any] = {key: array[:1] if constant[key] else array for key, array in columns.items()}
    if all(constant.values()):  # a tick that repeats is a tick all the same
        kept["gradient"] = columns["gradient"]
    each = tuple(tuple(marked) for marked in marks)
    return QPSequence(
        name=name, **kept, dt=dt, tolerance=tolerance, marks=each, command=command, about=about, versions=versions_now()
    )


def write_sequence(path: Path | str, sequence: QPSequence, *, argument: str = "path") -> None:
    """Write it compressed, in the layout of `bench/solvers/README.md`.

    Parameters
    ----------
    argument : what the user calls the path.

    Raises
    ------
    ConfigurationError : the file cannot be written.
    """
    meta = {
        "format": FORMAT, "name": sequence.name, "dt": None if math.isnan(sequence.dt) else float(sequence.dt),
        "tolerance": float(sequence.tolerance), "marks": sequence.marks, "command": sequence.command,
        "about": sequence.about, "versions": dict(sequence.versions),
    }  # fmt: skip
    write_arrays(Path(path), meta, {key: getattr(sequence, key) for key in ARRAYS}, argument=argument)


def read_sequence(path: Path | str) -> QPSequence:
    """A sequence as `write_sequence` wrote it, to the last bit.

    Raises
    ------
    ProblemFileError : the file is no sequence; it names the key, what stands there and what was expected.
    """
    meta, arrays = read_arrays(path)
    numbers: dict[str, Any] = {**arrays}
    if meta.get("format") != FORMAT:
        raise ProblemFileError(path, f"{META}.format", meta.get("format"), repr(FORMAT))
    for key in ARRAYS:
        if key not in arrays:
            raise ProblemFileError(path, key, None, "an array of float64")
    unknown = next((key for key in arrays if key not in ARRAYS), None)
    if unknown is not None:
        raise ProblemFileError(path, unknown, "an array", f"only {', '.join(ARRAYS)} and {META}")
    texts: dict[str, Any] = {key: _kind(path, meta, key, str, "a text") for key in ("name", "command", "about")}
    dt = _kind(path, meta, "dt", (float, type(None)), "seconds, or null")
    tolerance = _kind(path, meta, "tolerance", float, "a number above 0 and below 1")
    marks = _kind(path, meta, "marks", list, "a list of lists of marks")
    versions = _kind(path, meta, "versions", dict, "versions by name")
    if not all(isinstance(each, list) and all(isinstance(mark, str) for mark in each) for each in marks):
        raise ProblemFileError(path, f"{META}.marks", marks, "a list of lists of marks")
    try:
        return QPSequence(
            **texts, **numbers, dt=math.nan if dt is None else dt, tolerance=tolerance,
            marks=tuple(tuple(each) for each in marks), versions=versions,
        )  # fmt: skip
    except ConfigurationError as problem:
        key = problem.argument if problem.argument in ARRAYS else f"{META}.{problem.argument}"
        raise ProblemFileError(path, key, problem.value, problem.expected) from problem


def _kind(path: Path | str, meta: dict[str, Any], key: str, kind: Any, expected: str) -> Any:
    value = meta.get(key)
    if key not in meta or not isinstance(value, kind) or isinstance(value, bool):
        raise ProblemFileError(path, f"{META}.{key}", value, expected)
    return value
