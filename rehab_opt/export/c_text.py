"""Numbers, tables and templates as C text."""

from __future__ import annotations

import importlib.resources
import math
from collections.abc import Iterable, Mapping
from string import Template

__all__ = ["comment", "filled", "indented", "initialiser", "number"]


def number(value: float) -> str:
    """A double of C that reads back as the same number."""
    if math.isnan(value):
        return "NAN"
    if math.isinf(value):
        return "INFINITY" if value > 0 else "-INFINITY"
    return repr(float(value))


def initialiser(values: Iterable[float]) -> str:
    """{a, b, c}"""
    return "{" + ", ".join(number(value) for value in values) + "}"


def comment(text: str) -> str:
    """Text that neither ends a C comment, nor begins one in it, nor breaks its line."""
    line = "".join(letter if letter.isprintable() else " " for letter in text)
    return line.replace("\\", "/").replace("*/", "* /").replace("/*", "/ *")


def indented(lines: Iterable[str]) -> str:
    """Lines of a block."""
    return "\n".join(f"    {line}" for line in lines)


def filled(template: str, values: Mapping[str, str]) -> str:
    """The file `template`.in of this package with its names replaced, without an empty line at its end.

    Raises
    ------
    KeyError : a name that nothing is given for.
    """
    text = (importlib.resources.files("rehab_opt.export") / "templates" / f"{template}.in").read_text(encoding="utf-8")
    return Template(text).substitute(values).rstrip("\n")
