"""A CasADi function as a C function of a controller, with the tables that it reads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.export.c_text import filled, initialiser

__all__ = ["Evaluated"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Evaluated:
    """What stands in C as `name(self, ..., result)`.

    Parameters
    ----------
    about : what it returns, in a few words.
    function : evaluated; its first output is the result.
    inputs : of each of its inputs the address in C: what the controller remembers, an argument, a table.
    tables : columns of numbers by their name in C, (n,), or (n, count) where one of them is chosen in a tick.
    arguments : C of further arguments, each with a comma behind it.
    """

    controller: str
    name: str
    about: str
    function: ca.Function
    inputs: Sequence[str]
    tables: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    arguments: str = ""

    def __post_init__(self) -> None:
        """Check that every input has an address.

        Raises
        ------
        ConfigurationError : it has not.
        """
        if len(self.inputs) != self.function.n_in():
            raise ConfigurationError("inputs", list(self.inputs), f"{self.function.n_in()} of them")

    @property
    def code(self) -> str:
        """Its C."""
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
                "more": self.arguments,
                "inputs": ", ".join(self.inputs),
            },
        )
