"""Numbers, tables, functions and templates as C text."""

from __future__ import annotations

import importlib.resources
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from string import Template

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rehab_opt.errors import ConfigurationError

__all__ = ["Evaluated", "comment", "filled", "indented", "initialiser", "layout", "number"]


def number(value: float) -> str:
    """C literal that a compiler reads as exactly this number."""
    if math.isnan(value):
        return "NAN"
    if math.isinf(value):
        return "INFINITY" if value > 0 else "-INFINITY"
    return repr(float(value))


def initialiser(values: Iterable[float]) -> str:
    """C initialiser {a, b, c} of the values."""
    return "{" + ", ".join(number(value) for value in values) + "}"


def layout(name: str, places: Mapping[str, slice]) -> str:
    """C constants for a record: offset and size of each of its parts."""
    found = {each: place.start for each, place in places.items()} | {"size": max(at.stop for at in places.values())}
    return ", ".join(f"{name.upper()}_{each.upper()} = {at}" for each, at in found.items())


def comment(text: str) -> str:
    """Text made safe for a C comment: no comment marks and no line breaks."""
    line = "".join(letter if letter.isprintable() else " " for letter in text)
    return line.replace("\\", "/").replace("*/", "* /").replace("/*", "/ *")


def indented(lines: Iterable[str]) -> str:
    """The lines, indented as in the body of a C block."""
    return "\n".join(f"    {line}" for line in lines)


def filled(template: str, values: Mapping[str, str]) -> str:
    """Text of a template, with names replaced by `values` and without an empty line at its end.

    The template is the file `template`.in or, if it exists, the section of that name in parts.in.

    Raises
    ------
    KeyError : a name without a value.
    """
    return Template(_parts()[template] if template in _parts() else _read(template)).substitute(values).rstrip("\n")


@cache
def _parts() -> dict[str, str]:
    """Sections of parts.in by name; the line above each section names it."""
    parts = re.split(r"^=== (.*)\n", _read("parts"), flags=re.MULTILINE)
    return dict(zip(parts[1::2], parts[2::2], strict=True))


def _read(name: str) -> str:
    return (importlib.resources.files("rehab_opt.export") / "templates" / f"{name}.in").read_text(encoding="utf-8")


@dataclass(frozen=True, eq=False, kw_only=True)
class Evaluated:
    """A C function `name(self, result)` that evaluates a CasADi function.

    Parameters
    ----------
    about : short description of the result.
    function : the CasADi function; its first output is the result.
    inputs : C address of each input: in the controller's memory, an argument, or a table.
    tables : columns of numbers (n,), by their name in C; or (n, count), of which a tick selects one column.
    """

    controller: str
    name: str
    about: str
    function: ca.Function
    inputs: Sequence[str]
    tables: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if len(self.inputs) != self.function.n_in():
            raise ConfigurationError("inputs", list(self.inputs), f"{self.function.n_in()} of them")

    @property
    def code(self) -> str:
        """C code of the function."""
        tables = "".join(
            f"static const double {name}[] = {initialiser(table.ravel(order='F'))};\n"
            for name, table in self.tables.items()
        )
        return tables + filled(
            "evaluated.c",
            {
                "about": self.about,
                "name": self.controller,
                "what": self.name,
                "inputs": ", ".join(self.inputs),
            },
        )
