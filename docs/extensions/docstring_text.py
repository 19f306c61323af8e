"""A public name with its docstring as Markdown: what it is, how it is called, its methods and attributes."""

from __future__ import annotations

import enum
import importlib
import inspect
import re
import textwrap
from collections.abc import Iterator
from types import FunctionType, MappingProxyType
from typing import Any

from rehab_opt.session.keys import attribute_docstrings

__all__ = ["api_markdown", "docstring_markdown"]

SECTIONS = ("Parameters", "Attributes", "Returns", "Raises", "Notes", "Yields", "Examples")
FORMULA = re.compile(r"^(min |max |s\.t\.|subject to)|\S {2,}\S|^[A-Za-z_']{1,12}\S*\(?.* (=|>=|<=) ")
SEVERAL = re.compile(r"(?<=[.\]]) (?=[A-Za-z_][\w, ]* : )")
"""Between two entries that share a line."""
PROSE = re.compile(r"[a-z]{2,} [a-z]{2,} [a-z]{2,}")


def api_markdown(module: str, name: str) -> str:
    """Heading, signature and docstring of `module.name`, then of its public methods."""
    item = getattr(importlib.import_module(module), name)
    parts = [f"### {name}", _signature(module, name, item), docstring_markdown(inspect.getdoc(item) or "")]
    if inspect.isclass(item):
        parts += _members(item)
    return "\n\n".join(part for part in parts if part)


def docstring_markdown(text: str) -> str:
    """A docstring of the house as Markdown: formulas keep their lines, sections become lists."""
    blocks, section = [], ""
    for block in re.split(r"\n\s*\n", text.strip()):
        lines = block.splitlines()
        if len(lines) > 1 and lines[0] in SECTIONS and set(lines[1]) == {"-"}:
            section, lines = lines[0], lines[2:]
            blocks.append(f"**{section}**")
        blocks.append(_list(lines) if section and section not in ("Notes", "Examples") else _paragraph(lines))
    return "\n\n".join(block for block in blocks if block)


def _paragraph(lines: list[str]) -> str:
    lines = textwrap.dedent("\n".join(lines)).splitlines()
    formula = all(line.startswith(" ") or (FORMULA.search(line) and not PROSE.search(line)) for line in lines)
    if formula:
        return "```text\n" + "\n".join(lines) + "\n```"
    return "\n".join(line if line.startswith(("- ", "  ")) else escaped(line) for line in lines)


def _list(lines: list[str]) -> str:
    """The entries of a section: one begins where a line is not indented."""
    entries: list[str] = []
    for line in lines:
        if line.startswith(" ") and entries:
            entries[-1] += f" {line.strip()}"
        else:
            entries += SEVERAL.split(line.strip())
    return "\n".join(f"- {_entry(entry)}" for entry in entries)


def _entry(entry: str) -> str:
    names, colon, meaning = entry.partition(" : ")
    return f"`{names.strip('`')}`: {escaped(meaning)}" if colon else escaped(entry)


def escaped(text: str) -> str:
    """Text in which no sign but backticks means something in Markdown."""
    parts = re.split(r"(`[^`]*`)", text)
    return "".join(part if part.startswith("`") else re.sub(r"([*_$<>\[\]|~#])", r"\\\1", part) for part in parts)


def _signature(module: str, name: str, item: Any) -> str:
    if isinstance(item, enum.EnumType) or not callable(item):
        return ""
    return f"```text\nfrom {module} import {name}\n\n{_call(name, item)}\n```"


def _call(name: str, item: Any) -> str:
    try:
        parameters = list(inspect.signature(item).parameters.values())
    except (TypeError, ValueError):
        return name
    words, starred = [], False
    for each in parameters:
        if each.name in ("self", "cls"):
            continue
        if each.kind is each.KEYWORD_ONLY and not starred:
            words.append("*")
            starred = True
        starred = starred or each.kind is each.VAR_POSITIONAL
        stars = "*" if each.kind is each.VAR_POSITIONAL else "**" if each.kind is each.VAR_KEYWORD else ""
        value = "" if each.default is each.empty else f"={_shown(each.default)}"
        words.append(f"{stars}{each.name}{value}")
    line = f"{name}({', '.join(words)})"
    return line if len(line) <= 100 else f"{name}(\n    " + ",\n    ".join(words) + ",\n)"


def _shown(value: Any) -> str:
    text = "{}" if isinstance(value, MappingProxyType) and not value else repr(value)
    return "..." if len(text) > 40 or " at 0x" in text or text.startswith("<") else text


def _members(item: type) -> Iterator[str]:
    if issubclass(item, enum.Enum):
        comments = _comments(item)
        yield "\n".join(f"- `{each.name}`: {escaped(comments.get(each.name or '', ''))}" for each in item)
        return
    attributes = {name: text for name, text in attribute_docstrings(item).items() if not name.startswith("_")}
    if attributes:
        yield "**Attributes**\n\n" + "\n".join(f"- `{name}`: {escaped(text)}" for name, text in attributes.items())
    for name in _own_names(item):
        member = inspect.getattr_static(item, name)
        documented = getattr(item, name) if isinstance(member, classmethod | staticmethod) else member
        text = inspect.getdoc(documented) or ""
        if not text:
            continue
        if isinstance(member, property) or not callable(documented):
            yield f"`{name}`: {_indented(text)}"
        else:
            yield f"```text\n{_call(f'{item.__name__}.{name}', documented)}\n```\n\n{docstring_markdown(text)}"


def _indented(text: str) -> str:
    return docstring_markdown(text)


def _own_names(item: type) -> list[str]:
    """Public methods and properties, in the order they are written, those of the package's own bases first."""
    owners = [each for each in item.__mro__ if each.__module__.startswith("rehab_opt")]
    names = [name for owner in owners for name in vars(owner)]
    return [
        name
        for name in dict.fromkeys(names)
        if not name.startswith("_")
        and isinstance(inspect.getattr_static(item, name), FunctionType | property | classmethod | staticmethod)
    ]


def _comments(item: type) -> dict[str, str]:
    """What stands behind `#:` beside each value of an enumeration, and in lines of comment below it."""
    found = re.findall(r"^\s+(\w+) = .*?#: (.*(?:\n +# .*)*)$", inspect.getsource(item), re.MULTILINE)
    return {name: re.sub(r"\n +# ", " ", text) for name, text in found}
