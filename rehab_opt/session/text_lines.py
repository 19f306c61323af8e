"""The text of a file, and the numbers in it, with errors that say where."""

from __future__ import annotations

import math
import os
import stat
from pathlib import Path

from rehab_opt.errors import ProblemFileError
from rehab_opt.session.file_limits import LARGEST_RECORDING

__all__ = [
    "FARTHEST",
    "LATEST",
    "brief",
    "file_content",
    "finite_number",
    "number_in",
    "shown",
    "text_lines",
    "whole_text",
]


def file_content(path: Path, name: str, *, largest: int = LARGEST_RECORDING) -> bytes:
    """Content of a regular file of at most `largest` bytes; `name` is what errors call the file.

    Raises
    ------
    ProblemFileError : absent, unreadable, larger, or a directory, pipe, socket or device, which may never end.
    """
    try:
        with open(path, "rb", opener=_open_without_waiting) as file:
            about = os.fstat(file.fileno())
            if not stat.S_ISREG(about.st_mode):
                raise ProblemFileError(name, "file", "a pipe" if stat.S_ISFIFO(about.st_mode) else "a device", "a file")
            content = file.read(largest + 1)  # more than was said where it grows meanwhile
    except IsADirectoryError as problem:
        raise ProblemFileError(name, "file", "a directory", "a file") from problem
    except OSError as problem:
        raise ProblemFileError(name, "file", problem.strerror, "a file that can be read") from problem
    size = max(about.st_size, len(content))
    if size > largest:
        expected = f"at most {_megabytes(largest)}: split the file, or leave out what is not needed"
        raise ProblemFileError(name, "file size", _megabytes(size), expected)
    return content


def _open_without_waiting(path: str, flags: int) -> int:
    """Open a file; a pipe that nobody writes to is opened too, at once."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))  # Windows has neither the flag nor such files


def _megabytes(size: int) -> str:
    return f"{size / 1e6:.6g} MB"


def whole_text(path: Path, name: str, *, largest: int = LARGEST_RECORDING) -> str:
    """Content of a UTF-8 text file of at most `largest` bytes.

    Raises
    ------
    ProblemFileError : as `file_content`; empty, or not text.
    """
    content = file_content(path, name, largest=largest)
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as problem:
        line = content.count(b"\n", 0, problem.start) + 1
        value = f"byte 0x{content[problem.start]:02x}"
        raise ProblemFileError(name, f"line {line}", value, "UTF-8 text") from problem
    if not text.strip():
        raise ProblemFileError(name, "file", f"{len(content)} bytes", "a file that is not empty")
    if "\0" in text:
        line = text.count("\n", 0, text.index("\0")) + 1
        raise ProblemFileError(name, f"line {line}", "byte 0x00", "UTF-8 text")
    return text


def text_lines(path: Path, name: str) -> list[str]:
    """Lines of a text file without their ends and without empty ones at the end; raises as `whole_text`."""
    lines = whole_text(path, name).splitlines()
    while not lines[-1].strip():
        lines.pop()
    return lines


FARTHEST = 10.0
"""[m] A coordinate beyond is in another unit than it says."""
LATEST = 1e9
"""[s] A time beyond is no time of a recording: this is thirty years."""


def finite_number(text: str, *, name: str, line: int, column: str, most: float = math.inf) -> float:
    """The number written in one cell; `line` counts from 1.

    Raises
    ------
    ProblemFileError : not a number, NaN, infinite, or beyond `most` in size.
    """
    number = number_in(text)
    if not math.isfinite(number):
        raise ProblemFileError(name, f"line {line}, column {shown(column)}", shown(text), "a finite number")
    if abs(number) > most:
        raise ProblemFileError(
            name,
            f"line {line}, column {shown(column)}",
            shown(text),
            f"a number from {-most:g} to {most:g} (another unit?)",
        )
    return number


def number_in(text: str) -> float:
    """Decimal or scientific number in ASCII that `text` says, blanks around it; NaN for anything else.

    Python's own reading also takes 1_0 for 10, digits of other scripts, and infinity.
    """
    if text.strip("0123456789+-.eE \t"):
        return math.nan
    try:
        return float(text)
    except ValueError:
        return math.nan


def brief(value: object, most: int = 60) -> object:
    """`value`, or a text in its place where writing it out would be long or, as Python has it, refused."""
    try:
        written = str(value)
    except (ValueError, RecursionError):
        return "too long to be shown"
    return value if len(written) <= most else shown(written, most)


def shown(text: str, most: int = 40) -> str:
    """`text`, shortened for a one-line message."""
    text = text.strip()
    return text if len(text) <= most else text[: most - 3] + "..."
