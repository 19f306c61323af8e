"""One person who takes part: a name and a problem file's content, not yet checked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rehab_opt.errors import ProblemFileError
from rehab_opt.session.files import ProblemFile, problem_of
from rehab_opt.text_file import shown

__all__ = ["Participant", "checked_name", "without_twins"]

LONGEST_NAME = 100
FORBIDDEN = frozenset('/\\:*?"<>|')  # in a folder's name, on one system or another


@dataclass(frozen=True)
class Participant:
    """One person's problem, not yet checked.

    Parameters
    ----------
    name : of the person, and of the folder of the result.
    content : what the problem file says, as TOML has it.
    file : what errors call the file.
    path : where it lies; recordings are looked for beside it.
    error : why nothing can be run for this person; "" where that is not known yet.
    """

    name: str
    content: Mapping[str, Any]
    file: str
    path: Path
    error: str = ""

    def problem(self) -> ProblemFile[Any]:
        """The checked problem.

        Raises
        ------
        ProblemFileError : a key or value cannot be used.
        """
        return problem_of(dict(self.content), name=self.name, file=self.file, path=self.path)


def checked_name(name: str, *, file: object, key: str) -> str:
    """A name that can also be a folder's.

    Raises
    ------
    ProblemFileError : it cannot.
    """
    bad = (
        name.casefold() == "results.csv"
        or not name.isprintable()
        or FORBIDDEN & set(name)
        or name.startswith(".")
        or name.endswith((" ", "."))
    )
    if bad or not 0 < len(name) <= LONGEST_NAME:
        expected = f"1 to {LONGEST_NAME} characters that a folder's name may have, no dot at either end"
        raise ProblemFileError(file, key, shown(name), expected)
    return name


def without_twins(people: Sequence[Participant], *, file: object, keys: Sequence[str]) -> tuple[Participant, ...]:
    """The people, if no two share a name; upper and lower case are one, as they are to some file systems.

    Raises
    ------
    ProblemFileError : two do; `keys` say where each stands.
    """
    seen: dict[str, str] = {}
    for person, key in zip(people, keys, strict=True):
        folded = person.name.casefold()
        if folded in seen:
            raise ProblemFileError(file, key, person.name, f"a name of its own: {seen[folded]} has it already")
        seen[folded] = key
    return tuple(people)
