"""The text of a regular file of limited size, and the numbers in it."""

from __future__ import annotations

import codecs
import math
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from rehab_opt.errors import ProblemFileError

__all__ = ["file_content", "is_formula", "number_in", "regular_file", "shown", "whole_text"]


@contextmanager
def regular_file(path: Path, name: str) -> Iterator[BinaryIO]:
    """A regular file, open to be read; `name` is what errors call it.

    Raises
    ------
    ProblemFileError : absent, unreadable, or a directory, pipe, socket or device, which may never end.
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


def file_content(path: Path, name: str, *, largest: int) -> bytes:
    """Content of a regular file of at most `largest` bytes; `name` is what errors call the file.

    Raises
    ------
    ProblemFileError : as `regular_file`; larger.
    """
    with regular_file(path, name) as file:
        size = os.fstat(file.fileno()).st_size
        content = file.read(largest + 1)  # more than was said where it grows meanwhile
    size = max(size, len(content))
    if size > largest:
        expected = f"at most {_megabytes(largest)}: split the file, or leave out what is not needed"
        raise ProblemFileError(name, "file size", _megabytes(size), expected)
    return content


def _open_without_waiting(path: str, flags: int) -> int:
    """Open a file; a pipe that nobody writes to is opened too, at once."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))  # Windows has neither the flag nor such files


def _megabytes(size: int) -> str:
    return f"{size / 1e6:.6g} MB"


def whole_text(path: Path, name: str, *, largest: int) -> str:
    """Content of a UTF-8 text file of at most `largest` bytes.

    Raises
    ------
    ProblemFileError : as `file_content`; empty, or not text.
    """
    content = file_content(path, name, largest=largest)
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as problem:
        if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
            raise ProblemFileError(name, "file", "UTF-16", "UTF-8 text (of Excel: save as 'CSV UTF-8')") from problem
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
    """Decimal or scientific number in ASCII that `text` says, blanks around it; NaN for anything else.

    Python's own reading also takes 1_0 for 10, digits of other scripts, and infinity.
    """
    if text.strip("0123456789+-.eE \t"):
        return math.nan
    try:
        return float(text)
    except ValueError:
        return math.nan


def is_formula(text: str) -> bool:
    """Whether a spreadsheet that opens a table with this cell in it would compute it: =1+1, but not -1."""
    return text[:1] in ("=", "+", "-", "@") and text != "-" and math.isnan(number_in(text))


def shown(text: str, most: int = 40) -> str:
    """`text`, shortened for a one-line message."""
    text = text.strip()
    return text if len(text) <= most else text[: most - 3] + "..."
