"""The text of a file, and the numbers in it, with errors that say where."""

from __future__ import annotations

import math
from pathlib import Path

from rehab_opt.errors import ProblemFileError

__all__ = ["FARTHEST", "LATEST", "brief", "finite_number", "shown", "text_lines", "whole_text"]


def whole_text(path: Path, name: str) -> str:
    """Content of a UTF-8 text file.

    Raises
    ------
    ProblemFileError : absent, a directory, unreadable, empty, or not text; `name` is what the error calls the file.
    """
    if path.is_dir():
        raise ProblemFileError(name, "file", "a directory", "a file")
    if path.is_char_device():
        raise ProblemFileError(name, "file", "a device", "a file")  # it may never end
    try:
        content = path.read_bytes()
    except OSError as problem:
        raise ProblemFileError(name, "file", problem.strerror, "a file that can be read") from problem
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
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise ProblemFileError(name, f"line {line}, column {column}", shown(text), "a finite number")
    if abs(number) > most:
        raise ProblemFileError(
            name, f"line {line}, column {column}", shown(text), f"a number from {-most:g} to {most:g} (another unit?)"
        )
    return number


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
