"""Pages with text from elsewhere in the checkout: fences become Markdown before the page is parsed.

```{keys} SCHEMA   the keys of a problem file, from its schema; tables named below it stand elsewhere
```{api} MODULE    the names below it, from their docstrings
```{file} PATH     a text of the checkout, which has links of its own
"""

from __future__ import annotations

import importlib
import re
from pathlib import Path
from typing import Any

from docstring_text import api_markdown

from rehab_opt.session.keys import keys_of

ROOT = Path(__file__).parents[2]
FENCE = re.compile(r"^```\{(keys|api|file)\} *(\S*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
PAGES = {
    "bench/README.md": "/reference/bench.md",
    "bench/RESULTS.md": "/reference/results.md",
    "bench/solvers/README.md": "/reference/recorded_qps.md",
    "bench/solvers/TABLE.md": "/reference/solver_table.md",
    "CONTRIBUTING.md": "/contributing.md",
    "INTENDED_USE.md": "/intended_use.md",
    "CHANGELOG.md": "/changelog.md",
}
"""Texts of the checkout that are pages here, too: who reads the checkout follows a link to the file itself."""


def filled(text: str) -> str:
    """The page with its fences replaced."""
    text = FENCE.sub(_content, text)
    for file, page in PAGES.items():
        text = re.sub(rf"\]\((?:\.\./)*{re.escape(file)}", f"]({page}", text)
    return text


def with_all_named(text: str, folder: str) -> str:
    """The page with the pages of a folder that it does not name, in place of `folder/*`."""
    others = [f"{folder}/{page.stem}" for page in sorted((ROOT / "docs" / folder).glob("*.md"))]
    return text.replace(f"{folder}/*", "\n".join(each for each in others if f"\n{each}\n" not in text))


def _content(fence: re.Match[str]) -> str:
    kind, argument, body = (str(group) for group in fence.groups())
    if kind == "keys":
        return keys_markdown(argument, without=body.split())
    if kind == "file":
        return _linked_from_here((ROOT / argument).read_text(encoding="utf-8"))
    return "\n\n".join(api_markdown(argument, name) for name in body.split())


def keys_markdown(schema: str, *, without: list[str]) -> str:
    """A table for each section of a schema, `module.Class`; of sections named in `without` only their name."""
    module, _, name = schema.rpartition(".")
    parts: list[str] = []
    for each in keys_of(getattr(importlib.import_module(module), name), without=frozenset(without)):
        rows = ["| " + " | ".join((f"`{key}`", *more)) + " |" for key, *more in each.rows]
        table = "\n".join(["| key | values | default | meaning |", "|---|---|---|---|", *rows]) if rows else ""
        parts += filter(None, (each.head, table, each.refused))
    return "\n\n".join(parts)


def _linked_from_here(text: str) -> str:
    """A text of the checkout's root whose links lead from these pages: to pages, or said in words."""
    text = re.sub(r"\]\(docs/", "](/", text)
    return re.sub(rf"\[([^\]]*)\]\((?!/|#|\w+:|{'|'.join(map(re.escape, PAGES))})([^)]*)\)", r"\1 (`\2`)", text)


def _fill(app: Any, docname: str, source: list[str]) -> None:
    source[0] = with_all_named(filled(source[0]), "capabilities")


def setup(app: Any) -> dict[str, bool]:
    """Fill every page as it is read; what fences name is not watched, so each build is a whole one."""
    app.connect("source-read", _fill)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
