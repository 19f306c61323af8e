"""What became of many people, as a table for the terminal."""

from __future__ import annotations

from collections.abc import Sequence

from rich.table import Table
from rich.text import Text

from rehab_opt.session.many.results import Row

__all__ = ["summary_table"]

MOST_LISTED = 20


def summary_table(rows: Sequence[Row]) -> Table:
    """Those that are not done and why, the first ones of them; the caption counts all."""
    failed = [row for row in rows if row.error]
    kept = sum(row.kept for row in rows)
    counted = f"{len(rows) - len(failed)} of {len(rows)} participants done"
    counted += f", {kept} of them from an earlier run" if kept else ""
    if len(failed) > MOST_LISTED:
        counted += f"; {len(failed) - MOST_LISTED} more are not done, see results.csv"
    table = Table(caption=Text(counted), caption_justify="left", box=None if not failed else Table().box)
    if failed:
        for column in ("participant", "status", "error"):
            table.add_column(column, overflow="fold")
    for row in failed[:MOST_LISTED]:
        table.add_row(Text(row.participant), row.status, Text(row.error))
    return table
