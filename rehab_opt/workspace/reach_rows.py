"""Reaches of people with dyskinetic cerebral palsy and of typically developing people (Vanmechelen et al.).

There is one file without header for each task and each of thirteen joint angles. A row is the mean reach of one upper
limb (a person can have two rows): the group, then 101 angles [deg] from 0 to 100 % of the reach. There is no subject
id, and rows do not align across files, so ranges of all joints exist only for a group, not for a person.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rehab_opt.errors import ProblemFileError
from rehab_opt.text_file import finite_number, text_lines
from rehab_opt.workspace.clinical_angles import CLINICAL_ANGLES, WITHOUT_A_JOINT

__all__ = [
    "COLUMNS",
    "GROUPS",
    "SAMPLES",
    "TASKS",
    "ReachAngles",
    "Suspect",
    "flip_suspects",
    "read_cp_reach",
    "task_title",
    "tasks_in",
]

Array = NDArray[np.float64]

TASKS = MappingProxyType({"RF": "reach forwards", "RGV": "reach and grasp vertical"})
"""Titles of the published tasks; other tasks are called by their file names."""
GROUPS = ("typically developing", "dyskinetic cerebral palsy")
"""Groups by the number in column 0."""
SAMPLES = 101
COLUMNS = (*(angle.column for angle in CLINICAL_ANGLES), *WITHOUT_A_JOINT)
MAX_DEG = 360.0
FEWEST = 5
"""Least number of rows of a group for the search for wrong signs."""
CLEAR, CLOSE, SIGNED = 4.0, 3.0, 2.0
"""Thresholds in robust standard deviations, see `flip_suspects`."""


class Suspect(NamedTuple):
    """A row whose sign is probably wrong: with the opposite sign it is like the other rows of its group."""

    file: str
    line: int  # counted from 1
    mean: float  # [rad] of the row
    typical: float  # [rad] median of the group's means


@dataclass(frozen=True, eq=False)
class ReachAngles:
    """Angles of one group in one task.

    Parameters
    ----------
    task, group : a task's name, a member of `GROUPS`.
    angles : (rows, 101) [rad] by the files' column names, positive as `CLINICAL_ANGLES` says; rows of different columns
        are not of the same limb. Columns without a file are missing.
    left_out : rows left out of `angles` because of a suspected wrong sign.
    notes : remarks for readers of a result.
    """

    task: str
    group: str
    angles: Mapping[str, Array]
    left_out: tuple[Suspect, ...] = ()
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for rows in self.angles.values():
            rows.flags.writeable = False
        object.__setattr__(self, "angles", MappingProxyType(dict(self.angles)))

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.task, self.group, dict(self.angles), self.left_out, self.notes)


def read_cp_reach(folder: Path, task: str) -> tuple[ReachAngles, ReachAngles]:
    """Read the angles of both groups in one task, in the order of `GROUPS`, from `{task}_MEAN_{column}.csv`.

    Rows with a suspected wrong sign (`flip_suspects`) are left out and listed. A note names
    groups with identical rows under two columns, because one of these files must be wrong.

    Raises
    ------
    ProblemFileError : no file of the task or of an angle that the model needs, a row of the wrong length, a group other
        than 0 or 1, a group without rows, a cell that is not an angle in degrees.
    """
    there = tasks_in(folder)
    if task not in there:
        expected = (
            f"a task of which there are files: {', '.join(there) or 'none is there'} ({{task}}_MEAN_{{angle}}.csv)"
        )
        raise ProblemFileError(folder, "task", task, expected)
    signs = {angle.column: angle.sign for angle in CLINICAL_ANGLES}
    rows_of: tuple[dict[str, Array], ...] = ({}, {})
    left_out: tuple[list[Suspect], ...] = ([], [])
    absent = []
    for column in COLUMNS:
        path = folder / f"{task}_MEAN_{column}.csv"
        if column in WITHOUT_A_JOINT and not path.exists():
            absent.append(column)
            continue
        lines, groups, angles = _table(path)
        for group in range(len(GROUPS)):
            rows, at = signs.get(column, 1) * angles[groups == group], lines[groups == group]
            turned = flip_suspects(rows)
            typical = float(np.median(rows.mean(axis=1)))
            left_out[group].extend(
                Suspect(path.name, int(at[i]), float(rows[i].mean()), typical) for i in np.flatnonzero(turned)
            )
            rows_of[group][column] = rows[~turned]
    shared = [f"{task}: no file of {', '.join(absent)}"] if absent else []
    both = []
    for group, name in enumerate(GROUPS):
        notes = [*shared, *_repeated(rows_of[group])]
        if left_out[group]:
            notes.append(
                f"left out, sign looks turned round: {', '.join(f'{s.file} line {s.line}' for s in left_out[group])}"
            )
        both.append(ReachAngles(task, name, rows_of[group], tuple(left_out[group]), tuple(notes)))
    return both[0], both[1]


def tasks_in(folder: Path) -> list[str]:
    """Names of the tasks with files in a folder."""
    return sorted({path.name.partition("_MEAN_")[0] for path in folder.glob("*_MEAN_*.csv")})


def task_title(task: str) -> str:
    """Title of a task, or its name if it has none."""
    return TASKS.get(task, f"task {task}")


def flip_suspects(rows: Array) -> NDArray[np.bool_]:
    """(n,) True for rows of one group (n, T) that would look like the others with their sign changed.

    A suspect row fulfils three conditions. Its sign is opposite to the group's median, which is at least `SIGNED`
    robust standard deviations from zero. Its root mean square distance from the group's median curve is above `CLEAR`
    robust standard deviations. With the sign changed, this distance is below `CLOSE`. The standard deviation is that of
    the rows' means, from the median absolute deviation. Near 180 deg a wrapped row looks like one with the opposite
    sign, so both are suspect. Groups of fewer than `FEWEST` rows have no suspects.
    """
    if len(rows) < FEWEST:
        return np.zeros(len(rows), dtype=bool)
    means, typical = rows.mean(axis=1), np.median(rows, axis=0)
    middle = float(np.median(means))
    deviation = 1.4826 * float(np.median(np.abs(means - middle)))
    away = np.sqrt(np.mean((rows - typical) ** 2, axis=1))
    turned = np.sqrt(np.mean((-rows - typical) ** 2, axis=1))
    signed = abs(middle) > SIGNED * deviation  # trunk angles are near zero: their sign is arbitrary
    return np.asarray(signed & (means * middle < 0) & (away > CLEAR * deviation) & (turned < CLOSE * deviation))


def _table(path: Path) -> tuple[NDArray[np.int64], NDArray[np.int64], Array]:
    """Three results for the rows of a file: line numbers from 1, groups, and angles [rad]."""
    name = str(path)
    lines, groups, angles = [], [], []
    for number, text in enumerate(text_lines(path, name), start=1):
        if not text.strip():
            continue
        cells = text.split(",")
        if len(cells) != 1 + SAMPLES:
            raise ProblemFileError(name, f"line {number}", f"{len(cells)} cells", f"a group and {SAMPLES} angles")
        group = finite_number(cells[0], name=name, line=number, column="1")
        if group not in range(len(GROUPS)):
            raise ProblemFileError(name, f"line {number}, column 1", group, "group 0 or 1")
        lines.append(number)
        groups.append(int(group))
        angles.append(
            [
                math.radians(finite_number(cell, name=name, line=number, column=str(i), most=MAX_DEG))
                for i, cell in enumerate(cells[1:], start=2)
            ]
        )
    for group, title in enumerate(GROUPS):
        if group not in groups:
            raise ProblemFileError(name, "column 1", "no rows", f"rows of group {group} ({title})")
    return np.array(lines), np.array(groups), np.array(angles)


def _repeated(rows_of: Mapping[str, Array]) -> list[str]:
    """Notes on columns whose rows are identical to those of another column."""
    columns = list(rows_of)
    return [
        f"the rows of {second} are those of {first}: one of the files is not what it says"
        for i, first in enumerate(columns)
        for second in columns[i + 1 :]
        if rows_of[first].shape == rows_of[second].shape and np.array_equal(rows_of[first], rows_of[second])
    ]
