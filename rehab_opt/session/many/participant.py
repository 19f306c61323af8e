"""One person of a batch, and the computation for this person, which can run on another machine."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from rehab_opt.errors import ProblemFileError
from rehab_opt.session.files import ProblemFile, problem_of
from rehab_opt.session.report import write_results
from rehab_opt.session.run import run_problem
from rehab_opt.text_file import is_formula, shown

COVARIATES = ("session", "group", "condition", "visit", "date")
"""Columns of a table that are labels for a study and for `groups.csv`, not keys of a problem."""
LONGEST_NAME = 100
FORBIDDEN = frozenset('/\\:*?"<>|')  # characters that some systems forbid in a folder's name


@dataclass(frozen=True)
class Participant:
    """Problem of one person, not yet validated.

    Parameters
    ----------
    name : name of the person and of the results folder.
    content : content of the problem file, as parsed from TOML.
    file : name of the problem file in error messages.
    path : path of the problem file; paths of recordings are relative to its folder.
    error : reason why the problem cannot run; "" if none is known yet.
    inputs : cells of the person's row in a table, by dotted key.
    covariates : values of the columns `COVARIATES` in the person's row.
    """

    name: str
    content: Mapping[str, Any]
    file: str
    path: Path
    error: str = ""
    inputs: Mapping[str, str] = field(default_factory=dict)
    covariates: Mapping[str, str] = field(default_factory=dict)

    def problem(self) -> ProblemFile[Any]:
        """The validated problem.

        Raises
        ------
        ProblemFileError : a key or value is not valid.
        """
        return problem_of(dict(self.content), name=self.name, file=self.file, path=self.path)


def checked_name(name: str, *, file: object, key: str) -> str:
    """Check that a name can also name a folder, and return it.

    Raises
    ------
    ProblemFileError : the name cannot name a folder.
    """
    bad = (
        name.casefold() in ("results.csv", "results.parquet", "groups.csv")
        or not name.isprintable()
        or FORBIDDEN & set(name)
        or name.startswith(".")
        or name.endswith((" ", "."))
        or is_formula(name)
    )
    if bad or not 0 < len(name) <= LONGEST_NAME:
        expected = f"1 to {LONGEST_NAME} characters that a folder's name may have, no dot at either end, no formula"
        raise ProblemFileError(file, key, shown(name), expected)
    return name


def unnamed(place: str, name: str, *, file: str, path: Path, error: ProblemFileError) -> Participant:
    """A person with an invalid name, which is prefixed with the `place` in the input."""
    said = "".join("_" if letter in FORBIDDEN or not letter.isprintable() else letter for letter in shown(name))
    return Participant(f"{place}: {said}", {}, file, path, str(error))


def without_twins(people: Sequence[Participant], *, file: object, keys: Sequence[str]) -> tuple[Participant, ...]:
    """The people, with an error for people who share a name; upper and lower case count as equal.

    `keys` has the positions of the people in the input, for the error messages.
    """
    of: dict[str, list[int]] = {}
    for i, person in enumerate(people):
        of.setdefault(person.name.casefold(), []).append(i)
    found = list(people)
    for same in of.values():
        for i in same if len(same) > 1 else ():
            others = " and ".join(keys[j] for j in same if j != i)
            error = ProblemFileError(file, keys[i], people[i].name, f"a name of its own: {others} has it, too")
            found[i] = replace(
                unnamed(keys[i].split(",")[0], people[i].name, file=people[i].file, path=people[i].path, error=error),
                inputs=people[i].inputs,
                covariates=people[i].covariates,
            )
    return tuple(found)


Cell = str | float | int | bool | None


@dataclass(frozen=True)
class PersonResult:
    """Result of one person's problem.

    Parameters
    ----------
    files : contents of the result's files by name.
    numbers : scalar metrics by dotted key.
    seconds : computing time [s].
    """

    files: Mapping[str, bytes]
    numbers: Mapping[str, Cell]
    seconds: float


def work_on(participant: Participant) -> PersonResult:
    """Run the problem of a person and return the result, without writing files.

    Raises
    ------
    RehabOptError : the problem cannot run.
    """
    began = time.perf_counter()
    outcome = run_problem(participant.problem())
    with tempfile.TemporaryDirectory(prefix="rehab-opt-") as scratch:
        written = write_results(outcome, Path(scratch))
        files = {path.name: path.read_bytes() for path in written}
    numbers = dict(flat_numbers({key: value for key, value in outcome.metrics.items() if key != "parameters"}))
    return PersonResult(files, numbers, time.perf_counter() - began)


def flat_numbers(metrics: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Cell]]:
    """Scalars of nested tables by dotted key; a list of texts becomes one text, other lists are left out."""
    for key, value in metrics.items():
        if isinstance(value, Mapping):
            yield from flat_numbers(value, f"{above}{key}.")
        elif isinstance(value, list | tuple):
            if all(isinstance(part, str) for part in value):
                yield f"{above}{key}", "; ".join(value)
        else:
            yield f"{above}{key}", value
