"""Columns with named parts, for inputs and outputs of a tick's functions."""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["Record", "Values"]


class Values:
    """Expressions of a record by name, as in `values.level`; `column` holds all of them."""

    def __init__(self, column: ca.SX, parts: dict[str, ca.SX]) -> None:
        self.column = column
        self.__dict__.update(parts)

    def __getattr__(self, name: str) -> ca.SX:
        raise AttributeError(f"no number named {name}")


class Record:
    """Names and sizes of the parts of a column.

    sizes : name -> length of the part.
    """

    def __init__(self, **sizes: int) -> None:
        self.places: dict[str, slice] = {}
        """Name -> slice of the column."""
        at = 0
        for name, size in sizes.items():
            self.places[name] = slice(at, at + size)
            at += size
        self.size = at

    def __getitem__(self, name: str) -> int:
        """Index where the part `name` begins in the column."""
        return int(self.places[name].start)

    def symbols(self, name: str) -> Values:
        """Two results: a column of symbols, and its parts."""
        return self.parts(ca.SX.sym(name, self.size))

    def parts(self, column: ca.SX) -> Values:
        """Split a column (size,) into its parts."""
        return Values(column, {each: column[place] for each, place in self.places.items()})

    def changed(self, values: Values, **others: ca.SX) -> Values:
        """The values, with some of the parts replaced."""
        parts = {each: others.pop(each, getattr(values, each)) for each in self.places}
        if others:
            raise KeyError(*others)
        return self.parts(self.of(**parts))

    def numbers(self, **parts: ArrayLike) -> NDArray[np.float64]:
        """Column (size,) of numbers, given for each part; a scalar fills its part."""
        column = np.empty(self.size)
        for name in self.places.keys() | parts.keys():
            column[self.places[name]] = parts[name]
        return column

    def of(self, **parts: ca.SX) -> ca.SX:
        """Column (size,) made of these parts."""
        if parts.keys() != self.places.keys():
            raise KeyError(*(parts.keys() ^ self.places.keys()))
        column = ca.densify(ca.vertcat(*(ca.vec(ca.SX(parts[name])) for name in self.places)))
        if column.numel() != self.size:
            raise ValueError({name: ca.SX(parts[name]).numel() for name in self.places})
        return column
