"""The one table of a run: a row a tick, a column a quantity, each name ending in its unit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["Trace", "stacked"]

XYZ = ("x_m", "y_m", "z_m")


class Trace(dict[str, NDArray[Any]]):
    """Columns by name: (N,) and (N, k) are written; larger ones, and those whose name begins with _, are only kept.

    Parameters
    ----------
    columns : what was recorded, all of which is kept; `rows` are the indices of what is written.
    parts : names of the k numbers of a column, by its name; x_m, y_m, z_m by default.
    """

    def __init__(self, columns: Mapping[str, Any], parts: Mapping[str, Sequence[str]] | None = None) -> None:
        super().__init__({name: np.asarray(values) for name, values in columns.items()})
        self.parts: dict[str, Sequence[str]] = dict(parts or {})
        self.rows: Any = slice(None)

    def written(self) -> Iterator[tuple[str, NDArray[Any]]]:
        """The columns of trace.csv, one number or text a row."""
        for name, values in self.items():
            if name.startswith("_") or values.ndim > 2:
                continue
            parts = [""] if values.ndim == 1 else [f"_{part}" for part in self.parts.get(name, XYZ)]
            for part, column in zip(parts, np.atleast_2d(values[self.rows].T), strict=False):
                yield name + part, column.astype(int) if column.dtype.kind == "b" else column


def stacked(traces: Mapping[tuple[Any, ...], Trace], labels: Sequence[str]) -> Iterator[tuple[str, NDArray[Any]]]:
    """Written columns of traces, one below the other, below a column for each label; 0 where a trace has no such."""
    tables = {key: dict(trace.written()) for key, trace in traces.items()}
    sizes = [len(table["t_s"]) for table in tables.values()]
    for i, label in enumerate(labels):
        yield label, np.repeat([key[i] for key in traces], sizes)
    for name in max(tables.values(), key=len):
        parts = zip(tables.values(), sizes, strict=True)
        yield name, np.concatenate([table.get(name, np.zeros(size)) for table, size in parts])
