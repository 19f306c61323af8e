"""Who takes part: a folder of problem files, or a table of what differs between people."""

from __future__ import annotations

from pathlib import Path

from rehab_opt.errors import ConfigurationError, ProblemFileError, RehabOptError
from rehab_opt.session.files import problem_content
from rehab_opt.session.many.participant import Participant, checked_name, unnamed, without_twins
from rehab_opt.session.many.participant_table import BASE, participants_in_table
from rehab_opt.text_file import shown

__all__ = ["participants_in_folder", "participants_of"]


def participants_of(source: Path, *, problem: str | None = None) -> tuple[Participant, ...]:
    """The people of a folder of problem files, or of a table whose rows change one problem.

    Parameters
    ----------
    source : a folder with a `.toml` for each person, or a `.csv`.
    problem : the file, or the name of a shipped problem, that the rows of a table change; `upper_limb/workspace` by
        default.

    Raises
    ------
    ProblemFileError : nobody there, no column `participant`. A name that is no folder's, or stands twice, is in the
        `error` of whom it concerns.
    ConfigurationError : `problem` for a folder, whose files are problems themselves.
    """
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
        try:
            name = checked_name(path.stem, file=folder, key=path.name)
        except ProblemFileError as refused:
            people.append(unnamed("file", path.name, file=str(path), path=path, error=refused))
            continue
        try:
            people.append(Participant(name, problem_content(path, str(path)), str(path), path))
        except RehabOptError as refused:
            people.append(Participant(name, {}, str(path), path, str(refused)))
    return without_twins(people, file=folder, keys=[path.name for path in files])
