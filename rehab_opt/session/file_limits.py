"""What a problem file, a table of participants and a recording may have at most, so that none of them takes minutes."""

from __future__ import annotations

import re
from collections.abc import Sequence

from rehab_opt.errors import ProblemFileError

__all__ = [
    "DEEPEST_KEY",
    "LARGEST_PROBLEM",
    "LARGEST_RECORDING",
    "LARGEST_TABLE",
    "MOST_COLUMNS",
    "check_key_depth",
    "header_cells",
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
