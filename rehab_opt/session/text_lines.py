"""The text of a file, and the numbers in it, with errors that say where."""

from __future__ import annotations

import math
from pathlib import Path

from rehab_opt.errors import ProblemFileError
from rehab_opt.session.file_limits import LARGEST_RECORDING
from rehab_opt.text_file import number_in, shown, whole_text

__all__ = ["FARTHEST", "LATEST", "brief", "finite_number", "text_lines"]


def text_lines(path: Path, name: str) -> list[str]:
    """Lines of a text file without their ends and without empty ones at the end; raises as `whole_text`."""
    lines = whole_text(path, name, largest=LARGEST_RECORDING).splitlines()
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
        expected = "a finite number"
        if math.isfinite(number_in(text.replace(",", "."))):
            expected += " (a decimal comma? recording.decimal = 'comma')"
        raise ProblemFileError(name, f"line {line}, column {shown(column)}", shown(text), expected)
    if abs(number) > most:
        raise ProblemFileError(
            name,
            f"line {line}, column {shown(column)}",
            shown(text),
            f"a number from {-most:g} to {most:g} (another unit?)",
        )
    return number


def brief(value: object, most: int = 60) -> object:
    """`value`, or a text in its place where writing it out would be long or, as Python has it, refused."""
    try:
        written = str(value)
    except (ValueError, RecursionError):
        return "too long to be shown"
    return value if len(written) <= most else shown(written, most)
