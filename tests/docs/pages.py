"""What the README and the pages hold that can be run or followed: code blocks, links."""

from __future__ import annotations

import re
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
FENCE = re.compile(r"^( *)```(\w+)( hardware)?\n(.*?)^ *```$", re.DOTALL | re.MULTILINE)


class Block(NamedTuple):
    """Code of a page."""

    page: Path
    line: int
    """Of its first line, from 1."""
    language: str
    hardware: bool
    """Needs a robot: its types are checked, it is not run."""
    code: str

    @property
    def placed(self) -> str:
        """The code below so many empty lines that a traceback names its line of the page."""
        return "\n" * (self.line - 1) + self.code


def pages() -> list[Path]:
    """The README and every page."""
    return [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def name(page: Path) -> str:
    """What a page is called."""
    return page.relative_to(ROOT).as_posix()


def blocks(page: Path, language: str) -> Iterator[Block]:
    """Its code in that language, from its beginning."""
    text = page.read_text(encoding="utf-8")
    for found in FENCE.finditer(text):
        if found[2] == language:
            line = text.count("\n", 0, found.start(4)) + 1
            yield Block(page, line, language, bool(found[3]), textwrap.dedent(found[4]))


def write_hardware_blocks(folder: Path) -> None:
    """A file for each block that needs a robot, for a check of its types: `python -m tests.docs.pages FOLDER`."""
    for page in pages():
        for block in blocks(page, "python"):
            if block.hardware:
                (folder / f"{page.stem}_{block.line}.py").write_text(block.placed, encoding="utf-8")


if __name__ == "__main__":
    write_hardware_blocks(Path(sys.argv[1]))
