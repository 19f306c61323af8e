"""Read text files within size limits, and numbers in them; each error names the file and the line."""

from __future__ import annotations

import codecs
import math
import os
import re
import stat
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from rehab_opt.errors import ProblemFileError

__all__ = [
    "DEEPEST_KEY",
    "FARTHEST",
    "LATEST",
    "MAX_COLUMNS",
    "MAX_PROBLEM_SIZE",
    "MAX_RECORDING_SIZE",
    "MAX_TABLE_SIZE",
    "brief",
    "check_key_depth",
    "file_content",
    "finite_number",
    "header_cells",
    "is_formula",
    "number_in",
    "regular_file",
    "shown",
    "text_lines",
    "times",
    "whole_text",
    "write_whole",
]


@contextmanager
def regular_file(path: Path, name: str) -> Iterator[BinaryIO]:
    """Open a regular file for reading; error messages call the file `name`.

    Raises
    ------
    ProblemFileError : the file is missing or unreadable, or is a directory, pipe, socket or device.
    """
    try:
        with open(path, "rb", opener=_open_without_waiting) as file:
            mode = os.fstat(file.fileno()).st_mode
            if not stat.S_ISREG(mode):
                raise ProblemFileError(name, "file", "a pipe" if stat.S_ISFIFO(mode) else "a device", "a file")
            yield file
    except IsADirectoryError as problem:
        raise ProblemFileError(name, "file", "a directory", "a file") from problem
    except OSError as problem:
        expected = f"a file that can be read ({problem.strerror})"
        raise ProblemFileError(name, "file", path.name, expected) from problem


def file_content(path: Path, name: str, *, max_size: int) -> bytes:
    """Content of a regular file of at most `max_size` bytes; error messages call the file `name`.

    Raises
    ------
    ProblemFileError : as `regular_file`, or the file is too large.
    """
    with regular_file(path, name) as file:
        size = os.fstat(file.fileno()).st_size
        content = file.read(max_size + 1)  # the file may have grown since its size was read
    size = max(size, len(content))
    if size > max_size:
        expected = f"at most {_megabytes(max_size)}: split the file, or leave out what is not needed"
        raise ProblemFileError(name, "file size", _megabytes(size), expected)
    return content


def write_whole(file: Path, content: bytes, *, mode: int = 0o666) -> Path:
    """Replace a file by `content`; if writing fails, the old file stays and the OSError names the file."""
    to = file.resolve()
    if to.exists() and not to.is_file():  # a pipe or device cannot be replaced, only written to
        to.write_bytes(content)
        return file
    beside = to.with_name(f".{to.name}.partial")
    try:
        beside.unlink(missing_ok=True)
        with os.fdopen(os.open(beside, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode), "wb") as written:
            written.write(content)
            written.flush()
            os.fsync(written.fileno())
        beside.replace(to)
    except OSError as problem:
        beside.unlink(missing_ok=True)
        problem.filename = str(file)
        raise
    return file


def _open_without_waiting(path: str, flags: int) -> int:
    """Open a file at once, even a pipe that has no writer."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))  # Windows has neither the flag nor such files


def _megabytes(size: int) -> str:
    return f"{size / 1e6:.6g} MB"


def whole_text(path: Path, name: str, *, max_size: int) -> str:
    """Content of a UTF-8 text file of at most `max_size` bytes.

    Raises
    ------
    ProblemFileError : as `file_content`, or the file is empty or is not UTF-8 text.
    """
    content = file_content(path, name, max_size=max_size)
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as problem:
        if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
            raise ProblemFileError(name, "file", "UTF-16", "UTF-8 text (Excel: save as 'CSV UTF-8')") from problem
        line = content.count(b"\n", 0, problem.start) + 1
        value = f"byte 0x{content[problem.start]:02x}"
        raise ProblemFileError(name, f"line {line}", value, "UTF-8 text") from problem
    if not text.strip():
        raise ProblemFileError(name, "file", f"{len(content)} bytes", "a file that is not empty")
    if "\0" in text:
        line = text.count("\n", 0, text.index("\0")) + 1
        raise ProblemFileError(name, f"line {line}", "byte 0x00", "UTF-8 text")
    return text


def number_in(text: str) -> float:
    """Number in decimal or scientific notation, in ASCII; NaN for any other text.

    Python's `float` also accepts 1_0 for 10, digits of other scripts, and infinity.
    """
    if text.strip("0123456789+-.eE \t"):
        return math.nan
    try:
        return float(text)
    except ValueError:
        return math.nan


def is_formula(text: str) -> bool:
    """Whether a spreadsheet would evaluate this cell as a formula, such as =1+1; -1 is not a formula."""
    return text[:1] in ("=", "+", "-", "@") and text != "-" and math.isnan(number_in(text))


def shown(text: str, most: int = 40) -> str:
    """`text`, shortened to at most `most` characters for a one-line message."""
    text = text.strip()
    return text if len(text) <= most else text[: most - 3] + "..."


MAX_PROBLEM_SIZE = 256_000
"""Largest size [byte] of a problem file; shipped problems have at most 3000."""
MAX_TABLE_SIZE = 4_000_000
"""Largest size [byte] of a table of participants: 10 000 people with 40 cells each."""
MAX_RECORDING_SIZE = 50_000_000
"""Largest size [byte] of a recording; an hour at 100 Hz with ten columns has 36 million bytes."""
MAX_COLUMNS = 5000
DEEPEST_KEY = 32
"""Largest number of parts of a dotted key; the parsing time grows with the square of this number."""

_TEXT_OR_COMMENT = re.compile(
    r'"""(?:[^\\]|\\.)*?(?:"""|\Z)|'
    r"'''.*?(?:'''|\Z)|"
    r'"(?:[^"\\\n]|\\.)*"?|'
    r"'[^'\n]*'?|"
    r"#[^\n]*",
    re.DOTALL,
)
"""Pattern of strings and comments in TOML; it also matches unclosed strings, so that the scan takes linear time."""
_DEEP_KEY = re.compile(rf"(?<![\w-])(?:[\w-]+[ \t]*\.[ \t]*){{{DEEPEST_KEY},}}")


def check_key_depth(text: str, *, name: str) -> None:
    """Check the number of parts of all dotted keys in TOML; the error message calls the file `name`.

    Raises
    ------
    ProblemFileError : a dotted key has more than `DEEPEST_KEY` parts.
    """
    # Each string, which may be a part of a key, becomes one word; line numbers stay.
    bare = _TEXT_OR_COMMENT.sub(lambda found: "_" + "\n" * found[0].count("\n"), text)
    deep = _DEEP_KEY.search(bare)
    if deep is not None:
        line = bare.count("\n", 0, deep.start()) + 1
        value, expected = f"a key of {deep[0].count('.') + 1} parts", f"at most {DEEPEST_KEY} parts between dots"
        raise ProblemFileError(name, f"line {line}", value, expected)


def header_cells(cells: Sequence[str], *, name: str, line: int) -> list[str]:
    """Cells of a header without surrounding blanks.

    Raises
    ------
    ProblemFileError : the header has more than `MAX_COLUMNS` cells.
    """
    if len(cells) > MAX_COLUMNS:
        expected = f"at most {MAX_COLUMNS} columns: leave out those that are not needed"
        raise ProblemFileError(name, f"line {line}", f"{len(cells)} columns", expected)
    return [cell.strip() for cell in cells]


def text_lines(path: Path, name: str) -> list[str]:
    """Lines of a text file, without line ends and trailing empty lines; raises as `whole_text`."""
    lines = whole_text(path, name, max_size=MAX_RECORDING_SIZE).splitlines()
    while not lines[-1].strip():
        lines.pop()
    return lines


FARTHEST = 10.0
"""Largest coordinate [m]; a larger one is probably in another unit."""
LATEST = 1e10
"""Largest time [s] of a recording; some loggers count seconds since 1970."""


def finite_number(
    text: str,
    *,
    name: str,
    line: int,
    column: str,
    most: float = math.inf,
    point: str = ".",
    beyond: str = "another unit?",
) -> float:
    """The number in one cell.

    Parameters
    ----------
    text : content of the cell. name : name of the file. line : line of the cell, from 1. column : name of its column.
    most : largest accepted magnitude. point : decimal sign.
    beyond : hint in the error message for a number above `most`.

    Raises
    ------
    ProblemFileError : the text is not a finite number, or its magnitude is above `most`.
    """
    # With a decimal comma, a point may separate thousands: 1.828 is ambiguous, so points are rejected.
    number = number_in(text if point == "." else text.replace(".", "?").replace(point, "."))
    if not math.isfinite(number):
        expected = "a finite number"
        if point != ".":
            expected += " with a decimal comma, and no points between thousands"
        elif math.isfinite(number_in(text.replace(",", "."))):
            expected += " (a decimal comma? recording.decimal = 'comma')"
        raise ProblemFileError(name, f"line {line}, column {shown(column)}", shown(text), expected)
    if abs(number) > most:
        raise ProblemFileError(
            name,
            f"line {line}, column {shown(column)}",
            shown(text),
            f"a number from {-most:g} to {most:g} ({beyond})",
        )
    return number


def times(count: int) -> str:
    """A count in words: "once" or "2 times"."""
    return "once" if count == 1 else f"{count} times"


def brief(value: object, most: int = 60) -> object:
    """`value` for a message; a text instead if it has more than `most` characters or cannot be printed."""
    try:
        written = str(value)
    except (ValueError, RecursionError):
        return "too long to be shown"
    return value if len(written) <= most else shown(written, most)
