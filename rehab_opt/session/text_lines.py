"""The text of a file within its limits, and the numbers in it, with errors that say where."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path

from rehab_opt.errors import ProblemFileError
from rehab_opt.text_file import number_in, shown, whole_text

__all__ = [
    "DEEPEST_KEY",
    "FARTHEST",
    "LARGEST_PROBLEM",
    "LARGEST_RECORDING",
    "LARGEST_TABLE",
    "LATEST",
    "MOST_COLUMNS",
    "brief",
    "check_key_depth",
    "finite_number",
    "header_cells",
    "text_lines",
]


LARGEST_PROBLEM = 256_000
"""[byte] The shipped problem files have 3000 at most."""
LARGEST_TABLE = 4_000_000
"""[byte] of a table of participants: 10 000 people with 40 cells each."""
LARGEST_RECORDING = 50_000_000
"""[byte] An hour at 100 Hz with ten columns has 36 million."""
MOST_COLUMNS = 5000
DEEPEST_KEY = 32
"""Parts of a dotted key. Reading one takes time that grows with their square."""

_TEXT_OR_COMMENT = re.compile(
    r'"""(?:[^\\]|\\.)*?(?:"""|\Z)|'
    r"'''.*?(?:'''|\Z)|"
    r'"(?:[^"\\\n]|\\.)*"?|'
    r"'[^'\n]*'?|"
    r"#[^\n]*",
    re.DOTALL,
)
"""Of TOML; each alternative matches wherever it begins, so that a text is gone through once."""
_DEEP_KEY = re.compile(rf"(?<![\w-])(?:[\w-]+[ \t]*\.[ \t]*){{{DEEPEST_KEY},}}")


def check_key_depth(text: str, *, name: str) -> None:
    """Refuse TOML with a key of too many parts; `name` is what the error calls the file.

    Raises
    ------
    ProblemFileError : a dotted key has more than `DEEPEST_KEY` parts.
    """
    # A text that is part of a key becomes a word; lines stay where they are.
    bare = _TEXT_OR_COMMENT.sub(lambda found: "_" + "\n" * found[0].count("\n"), text)
    deep = _DEEP_KEY.search(bare)
    if deep is not None:
        line = bare.count("\n", 0, deep.start()) + 1
        value, expected = f"a key of {deep[0].count('.') + 1} parts", f"at most {DEEPEST_KEY} parts between dots"
        raise ProblemFileError(name, f"line {line}", value, expected)


def header_cells(cells: Sequence[str], *, name: str, line: int) -> list[str]:
    """Cells of a header without the blanks around them.

    Raises
    ------
    ProblemFileError : more than `MOST_COLUMNS`.
    """
    if len(cells) > MOST_COLUMNS:
        expected = f"at most {MOST_COLUMNS} columns: leave out those that are not needed"
        raise ProblemFileError(name, f"line {line}", f"{len(cells)} columns", expected)
    return [cell.strip() for cell in cells]


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
    """The number written in one cell; `line` counts from 1, `point` stands before the decimals.

    `beyond` is what a message asks of a number larger than `most`.

    Raises
    ------
    ProblemFileError : not a number, NaN, infinite, or beyond `most` in size.
    """
    # Where a comma stands before decimals, a point stands between thousands: 1.828 may be either, and is refused.
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


def brief(value: object, most: int = 60) -> object:
    """`value`, or a text in its place where writing it out would be long or, as Python has it, refused."""
    try:
        written = str(value)
    except (ValueError, RecursionError):
        return "too long to be shown"
    return value if len(written) <= most else shown(written, most)
