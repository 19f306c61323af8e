"""Who takes part: a folder of problem files, or a table of what differs between people."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rehab_opt.errors import ConfigurationError, ProblemFileError, RehabOptError
from rehab_opt.session.files import ProblemFile, problem_content, problem_of
from rehab_opt.session.text_lines import shown

__all__ = ["Participant", "checked_name", "participants_in_folder", "participants_of", "without_twins"]

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


def participants_of(source: Path, *, problem: str | None = None) -> tuple[Participant, ...]:
    """The people of a folder of problem files, or of a table whose rows change one problem.

    Parameters
    ----------
    source : a folder with a `.toml` for each person, or a `.csv`.
    problem : the file, or the name of a shipped problem, that the rows of a table change; `upper_limb/workspace` by
        default.

    Raises
    ------
    ProblemFileError : nobody there, no column `participant`, a name that is no folder's or stands twice.
    ConfigurationError : `problem` for a folder, whose files are problems themselves.
    """
    from rehab_opt.session.many.participant_table import BASE, participants_in_table  # noqa: PLC0415  (builds on this)

    if source.is_dir():
        if problem is not None:
            raise ConfigurationError("--problem", problem, "no such option with a folder, whose files are problems")
        return participants_in_folder(source)
    if not source.exists():
        raise ProblemFileError(shown(str(source), 200), "file", "not found", "a folder of problem files, or a .csv")
    if source.suffix.lower() != ".csv":
        raise ProblemFileError(source, "file", source.name, "a folder of problem files, or a table ending in .csv")
    return participants_in_table(source, problem=problem or BASE)


def participants_in_folder(folder: Path) -> tuple[Participant, ...]:
    """One person for each `.toml` directly in the folder, by the name of the file; raises as `participants_of`."""
    files = sorted(path for path in folder.iterdir() if path.suffix.lower() == ".toml")
    if not files:
        raise ProblemFileError(folder, "folder", "no .toml in it", "a problem file for each participant")
    people = []
    for path in files:
        name = checked_name(path.stem, file=folder, key=path.name)
        try:
            people.append(Participant(name, problem_content(path, str(path)), str(path), path))
        except RehabOptError as refused:
            people.append(Participant(name, {}, str(path), path, str(refused)))
    return without_twins(people, file=folder, keys=[path.name for path in files])


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
