"""The rows of a comparison as text: on the terminal, and in Markdown."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from rich.markup import escape
from rich.table import Table

from bench.solvers.judgement import Outcome
from bench.solvers.programmes import PREFIX
from bench.solvers.summary import Row

__all__ = ["Grid", "as_markdown", "as_tables", "family_grids", "overview_grids", "refusal_grid", "share_text"]

SHORT = {
    Outcome.WRONG: "wrong",
    Outcome.NO_ANSWER: "none",
    Outcome.TOO_LATE: "late",
    Outcome.RAISED: "raised",
    Outcome.NOT_TRIED: "not tried",
}


BORDER = 3
"""Characters of a column beside its text."""


class Grid(NamedTuple):
    """A table before it is drawn."""

    title: str
    columns: tuple[str, ...]
    cells: list[tuple[str, ...]]
    leading: int = 1
    """How many columns say what a row is of."""


def family_grids(rows: Sequence[Row]) -> list[Grid]:
    """A grid for each family: warm solvers by their mean time, then cold ones."""
    columns = (
        "solver", "mode", "solved", "failures", "median", "p99", "p99.9", "largest", "mean", "error", "largest error",
    )  # fmt: skip
    grids = []
    for family in dict.fromkeys(row.family for row in rows):
        own = sorted(
            (row for row in rows if row.family == family and row.ticks), key=lambda row: (row.mode != "warm", row.mean)
        )
        if own:
            title = f"{family}: {own[0].ticks} instances, times in us"
            grids.append(Grid(title, columns, [_cells(row) for row in own], leading=2))
    return grids


def overview_grids(rows: Sequence[Row]) -> list[Grid]:
    """Solvers by families: QPs warm, and programmes, which are only ever cold."""
    grids = []
    for title, mode, programmes in (
        ("QPs of consecutive ticks, warm", "warm", False),
        ("NLPs", "cold", True),
    ):
        own = [row for row in rows if row.mode == mode and row.ticks and row.family.startswith(PREFIX) is programmes]
        families, solvers = (tuple(dict.fromkeys(getattr(row, key) for row in own)) for key in ("family", "solver"))
        by_name = {(row.solver, row.family): row for row in own}
        cells = [(solver, *(_overview(by_name.get((solver, family))) for family in families)) for solver in solvers]
        if cells:
            grids.append(Grid(f"{title}: mean time in us, and fraction solved", ("solver", *families), cells))
    return grids


def _overview(row: Row | None) -> str:
    if row is None:
        return "-"
    if row.solved == 1.0:
        return _microseconds(row.mean)
    return (
        f"{_microseconds(row.mean)} ({share_text(row.solved)})" if row.solved >= 0.9 else f"({share_text(row.solved)})"
    )


def refusal_grid(rows: Sequence[Row]) -> Grid:
    """Infeasible and NaN instances: who says no, and when."""
    columns = (
        "family", "solver", "mode", "instances", "said no", "claimed an answer", "hung", "raised",
        "median time to say no, us", "largest",
    )  # fmt: skip
    cells: list[tuple[str, ...]] = [
        (
            row.family, row.solver, row.mode, str(row.hopeless), str(row.said_no), str(row.claimed), str(row.hung),
            str(row.raised), _microseconds(row.no_median), _microseconds(row.no_largest),
        )
        for row in rows if row.hopeless
    ]  # fmt: skip
    return Grid("Instances without an answer: infeasible ones, and NaN", columns, cells, leading=3)


def as_tables(grid: Grid, *, width: int) -> list[Table]:
    """For a terminal so wide: as many tables as it takes, since a number that is folded is read as another one.

    The title is left out: a table of few columns would fold it.
    """
    return [_drawn(part) for part in _parts(grid, width)]


def _parts(grid: Grid, width: int) -> list[Grid]:
    """The grid, its columns dealt out to several of the same rows where it is too wide."""
    wide = [max(map(len, column)) + BORDER for column in zip(grid.columns, *grid.cells, strict=True)]
    first = list(range(grid.leading))
    chosen = [first.copy()]
    for column in range(grid.leading, len(wide)):
        if len(chosen[-1]) > len(first) and 1 + sum(wide[i] for i in (*chosen[-1], column)) > width:
            chosen.append(first.copy())
        chosen[-1].append(column)
    return [
        grid._replace(
            columns=tuple(grid.columns[i] for i in each), cells=[tuple(row[i] for i in each) for row in grid.cells]
        )
        for each in chosen
    ]


def _drawn(grid: Grid) -> Table:
    table = Table()
    for i, column in enumerate(grid.columns):
        table.add_column(column, justify="left" if i < grid.leading else "right", no_wrap=True)
    for cells in grid.cells:
        table.add_row(*(escape(cell) for cell in cells))
    return table


def as_markdown(grid: Grid) -> str:
    """The same as a table of GitHub's kind."""
    lines = [f"### {grid.title}", "", _line(grid.columns), _line(["---"] * len(grid.columns))]
    return "\n".join([*lines, *(_line(cells) for cells in grid.cells), ""])


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _cells(row: Row) -> tuple[str, ...]:
    failed = ", ".join(f"{row.failures[kind.value]} {word}" for kind, word in SHORT.items() if row.failures[kind.value])
    times = (row.median, row.p99, row.p999, row.largest, row.mean)
    errors = (row.error, row.largest_error)
    return (
        row.solver, row.mode, share_text(row.solved), failed or "-", *(_microseconds(each) for each in times),
        *(f"{each:.0e}" if math.isfinite(each) else "-" for each in errors),
    )  # fmt: skip


def share_text(fraction: float) -> str:
    """In per cent, and 100 only for all of them."""
    return f"{math.floor(1e4 * fraction) / 100:g} %"


def _microseconds(seconds: float) -> str:
    if math.isnan(seconds):
        return "-"
    if math.isinf(seconds):
        return "failed"
    value = 1e6 * seconds
    return f"{value:.1f}" if value < 99.5 else f"{float(f'{value:.3g}'):.0f}"
