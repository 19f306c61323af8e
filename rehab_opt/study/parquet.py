"""Measures and traces of a study as Parquet, for programs that read columns (extra `parquet`)."""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from rehab_opt.errors import ConfigurationError
from rehab_opt.text_file import write_whole

__all__ = ["COLUMNS", "kept_as_parquet", "write_parquet", "write_trace"]

COLUMNS = ("person", "group", "session", "visit", "date", "trial", "condition", "status", "measure", "value", "unit")
"""Of measures.csv."""
WHOLE, REAL = ("visit", "trial"), ("value",)


def write_parquet(table: Path) -> Path:
    """Write measures.csv as measures.parquet beside it; every column but visit, trial and value is text.

    Raises
    ------
    ConfigurationError : pyarrow is absent.
    """
    try:
        import pyarrow  # noqa: PLC0415
        import pyarrow.csv  # noqa: PLC0415
        import pyarrow.parquet  # noqa: PLC0415
    except ModuleNotFoundError as absent:
        needed = "csv, or the extra parquet: pip install 'rehab_opt[parquet]'"
        raise ConfigurationError("--format", "parquet", needed) from absent
    types = {name: pyarrow.string() for name in COLUMNS}  # declared, not inferred: a pseudonym 007 is no 7
    types |= dict.fromkeys(WHOLE, pyarrow.int64()) | dict.fromkeys(REAL, pyarrow.float64())
    how = pyarrow.csv.ConvertOptions(column_types=types, null_values=[""], strings_can_be_null=True)
    file = table.with_suffix(".parquet")
    with (
        pyarrow.csv.open_csv(table, convert_options=how) as rows,
        pyarrow.parquet.ParquetWriter(file, rows.schema) as written,
    ):
        for part in rows:
            written.write_batch(part)
    file.chmod(0o600)
    return file


@cache
def kept_as_parquet() -> bool:
    """Whether pyarrow is there, without which a study keeps no samples, only where they lie."""
    return importlib.util.find_spec("pyarrow") is not None


def write_trace(trace: Path | Mapping[str, Any], file: Path, **about: str) -> Path:
    """Write samples into a Parquet file of their owner alone, whole or not at all, and onto the disk.

    Parameters
    ----------
    trace : a .csv with a header, or columns by name, their units at the end.
    about : columns that say the same in every row, such as `person`.
    """
    import pyarrow  # noqa: PLC0415
    import pyarrow.csv  # noqa: PLC0415
    import pyarrow.parquet  # noqa: PLC0415

    table = pyarrow.csv.read_csv(trace) if isinstance(trace, Path) else pyarrow.table(dict(trace))
    for place, (name, value) in enumerate(about.items()):
        column = pyarrow.DictionaryArray.from_arrays(pyarrow.array([0] * len(table), pyarrow.int8()), [value])
        table = table.add_column(place, name, column)
    for folder in (file.parent.parent, file.parent):  # parents=True would make the first one readable by all
        folder.mkdir(exist_ok=True, mode=0o700)
    written = pyarrow.BufferOutputStream()
    pyarrow.parquet.write_table(table, written, compression="zstd")
    return write_whole(file, written.getvalue(), mode=0o600)
