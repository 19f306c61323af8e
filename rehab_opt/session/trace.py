"""The table of a run: one row for each tick, one column for each quantity, with the unit at the end of its name."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

XYZ = ("x_m", "y_m", "z_m")


class Trace(dict[str, NDArray[Any]]):
    """Columns by name; trace.csv gets the arrays (N,) and (N, k) whose names do not begin with _.

    Parameters
    ----------
    columns : all recorded columns; `rows` are the indices of the rows that are written.
    parts : by name of a column (N, k), the names of its k components; default x_m, y_m, z_m.
    """

    def __init__(self, columns: Mapping[str, Any], parts: Mapping[str, Sequence[str]] | None = None) -> None:
        super().__init__({name: np.asarray(values) for name, values in columns.items()})
        self.parts: dict[str, Sequence[str]] = dict(parts or {})
        self.rows: Any = slice(None)

    def written(self) -> Iterator[tuple[str, NDArray[Any]]]:
        """The columns of trace.csv, with one number or text in each row."""
        for name, values in self.items():
            if name.startswith("_") or values.ndim > 2:
                continue
            parts = [""] if values.ndim == 1 else [f"_{part}" for part in self.parts.get(name, XYZ)]
            for part, column in zip(parts, np.atleast_2d(values[self.rows].T), strict=False):
                yield name + part, column.astype(int) if column.dtype.kind == "b" else column


def stacked(traces: Mapping[tuple[Any, ...], Trace], labels: Sequence[str]) -> Iterator[tuple[str, NDArray[Any]]]:
    """Written columns of several traces, one below the other, after a column for each of `labels`.

    The label columns hold the parts of a trace's name. If a trace lacks a column, its cells there are empty.
    """
    tables = {key: dict(trace.written()) for key, trace in traces.items()}
    sizes = [len(table["t_s"]) for table in tables.values()]
    for i, label in enumerate(labels):
        yield label, np.repeat([key[i] for key in traces], sizes)
    for name, column in max(tables.values(), key=len).items():
        parts, empty = zip(tables.values(), sizes, strict=True), "" if column.dtype.kind in "UO" else np.nan
        yield name, np.concatenate([table.get(name, np.full(size, empty)) for table, size in parts])
