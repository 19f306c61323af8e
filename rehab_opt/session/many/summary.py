"""What became of many people, for the terminal."""

from __future__ import annotations

from collections.abc import Sequence

from rich.table import Table
from rich.text import Text

from rehab_opt.session.many.results import Row

__all__ = ["counted", "failed_table"]

MOST_LISTED = 20


def counted(rows: Sequence[Row]) -> str:
    """How many are done, and how many of them were so before."""
    failed, kept = sum(bool(row.error) for row in rows), sum(row.kept for row in rows)
    said = f"{len(rows) - failed} of {len(rows)} participants done"
    return f"{said}, {kept} of them from an earlier run" if kept else said


def failed_table(rows: Sequence[Row]) -> Table:
    """Those that are not done and why, the first ones of them."""
    failed = [row for row in rows if row.error]
    more = len(failed) - MOST_LISTED
    table = Table(caption=f"{more} more are not done: see results.csv" if more > 0 else None)
    for column in ("participant", "status", "error"):
        table.add_column(column, overflow="fold")
    for row in failed[:MOST_LISTED]:
        table.add_row(Text(row.participant), row.status, Text(row.error))
    return table
