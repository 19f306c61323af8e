"""A table of a study as Parquet, for programs that read columns."""

from __future__ import annotations

from pathlib import Path

from rehab_opt.errors import ConfigurationError
from rehab_opt.study.person import COLUMNS

__all__ = ["write_parquet"]

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
    types = {name: pyarrow.string() for name in COLUMNS}  # said, not guessed: a pseudonym 007 is no 7
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
