"""Export measures of a study, and copy or remove the data of one person."""

from __future__ import annotations

import csv
import io
import json
import shutil
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from rehab_opt.errors import ConfigurationError, RehabOptError
from rehab_opt.study.index import content_of, trials_in
from rehab_opt.study.store import MARK, Study, private
from rehab_opt.study.summary import check_there
from rehab_opt.text_file import write_whole

__all__ = ["exported", "note_written", "removed"]

BESIDE_TABLE = ("groups.csv", "results.parquet")
"""Files that `rehab-opt many` writes beside results.csv, and writes again in the next run."""
COLUMNS = ("person", "group", "session", "visit", "date", "trial", "condition", "status", "measure", "value", "unit")


def exported(study: Study, person: str | None, folder: Path, *, parquet: bool = False) -> list[Path]:
    """Write measures.csv; for one person, also copy the person's folder of the study.

    Parameters
    ----------
    study : an open study. person : None for the measures of all people.
    folder : folder of the files, new or empty.
    parquet : whether to write measures.parquet, too.

    Raises
    ------
    ConfigurationError : the person is unknown, the folder is not empty or not writable, or pyarrow is not installed.
    """
    if person is not None:
        check_there(study, person)
    question = (
        'SELECT s.person, s."group", s.name, s.visit, s.date, t.number, t.condition, t.status, q.name, m.value, q.unit '
        "FROM sessions s JOIN trials t ON t.session = s.id "
        "JOIN measures m ON m.trial = t.id JOIN quantities q ON q.id = m.quantity "
        "WHERE ?1 IS NULL OR s.person = ?1 ORDER BY s.id, t.number, q.id"
    )
    try:
        inside = folder.resolve().is_relative_to(study.folder.resolve())
        if inside or (folder.exists() and any(folder.iterdir())):
            raise ConfigurationError("--out", str(folder), "a folder outside of the study, empty or not there yet")
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        folder.chmod(0o700)  # an existing folder may be open to others
        names = ("measures.csv", "measures.parquet", person or "")
        note_written(study, [folder / name for name in names if name], person)
        written = [private(folder / "measures.csv", "")]
        with study.transaction("DEFERRED"), written[0].open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(COLUMNS)
            writer.writerows(study.db.execute(question, (person,)))
        if parquet:
            written.append(_parquet(written[0]))
        if person is not None:
            shutil.copytree(study.folder / person, folder / person, symlinks=True)
            written += [path for path in (folder / person).rglob("*") if path.is_file()]
    except OSError as problem:
        expected = f"a folder that can be written to ({problem.strerror})"
        raise ConfigurationError("--out", str(folder), expected) from problem
    return written


def _parquet(table: Path) -> Path:
    """Write measures.csv as Parquet; all columns but visit, trial and value are text, so that 007 stays 007."""
    try:
        import pyarrow  # noqa: PLC0415
        import pyarrow.csv  # noqa: PLC0415
        import pyarrow.parquet  # noqa: PLC0415
    except ModuleNotFoundError as absent:
        needed = "csv, or the extra parquet: pip install 'rehab_opt[parquet]'"
        raise ConfigurationError("--format", "parquet", needed) from absent
    types = dict.fromkeys(COLUMNS, pyarrow.string())
    types |= {"visit": pyarrow.int64(), "trial": pyarrow.int64(), "value": pyarrow.float64()}
    how = pyarrow.csv.ConvertOptions(column_types=types, null_values=[""], strings_can_be_null=True)
    file = table.with_suffix(".parquet")
    pyarrow.parquet.write_table(pyarrow.csv.read_csv(table, convert_options=how), file)
    file.chmod(0o600)
    return file


def note_written(study: Study, paths: Iterable[Path], person: str | None) -> None:
    """Record paths of exports and reports in the study, so that `removed` can delete those that include a person."""
    mark = study.folder / MARK
    with suppress(ConfigurationError), study.writing():  # from a read-only study, no person can be removed
        known = content_of(mark)
        known.setdefault("written", []).extend([str(path.absolute()), person] for path in paths)
        private(mark, json.dumps(known, indent=1) + "\n")


def removed(study: Study, person: str) -> tuple[list[Path], list[Path]]:
    """Remove a person's folder and rows, results of the person's runs elsewhere, and exports and reports.

    If the function was interrupted, call it again. Copies made by hand are not found.

    Returns
    -------
    The person's recordings, which stay, and the removed exports and reports of all people.

    Raises
    ------
    ConfigurationError : the person is unknown, or a file cannot be removed.
    """
    check_there(study, person)
    home, recordings, others = study.folder / person, dict[Path, None](), []
    known = content_of(study.folder / MARK)  # read first: an error here must not leave half of a person
    with study.writing():
        for folder in home.glob("*/*/"):
            with suppress(RehabOptError):  # an unreadable trial is removed with the folder
                for path, kind in (file for trial in trials_in(folder) for file in trial.files):
                    if kind == "recording":
                        recordings |= {path: None} if path.exists() else {}
                    else:
                        _forget(path, kind, person)
        written = known.get("written", [])
        for path in (Path(path) for path, of in written if of in (None, person)):
            others += [path] if path.exists() and [str(path), None] in written else []
            shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)
            with suppress(OSError):  # a folder with other files stays
                path.parent.rmdir()
        known["written"] = [each for each in written if each[1] not in (None, person)]
        private(study.folder / MARK, json.dumps(known, indent=1) + "\n")
        shutil.rmtree(home)
    with study.refusals():
        study.follow()
    return [*recordings], others


def _forget(path: Path, kind: str, person: str) -> None:
    """Remove a result outside the study, or the person's row in a table of many people."""
    if kind != "table":
        path.unlink(missing_ok=True)
        with suppress(OSError):  # a folder with something else in it stays
            path.parent.rmdir()
    elif path.exists():
        with path.open(encoding="utf-8", newline="") as file:
            rows = [row for row in csv.reader(file) if row[:1] != [person]]
        left = io.StringIO()
        csv.writer(left, lineterminator="\n").writerows(rows)
        write_whole(path, left.getvalue().encode())
        for name in BESIDE_TABLE:  # the numbers of a small group may reveal the person
            path.with_name(name).unlink(missing_ok=True)
