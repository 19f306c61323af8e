"""The tables as a terminal shows them."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

from bench.solvers.judgement import Judged, Outcome
from bench.solvers.recommendation import recommendation_grid, recommendations
from bench.solvers.summary import Row, row_of
from bench.solvers.table import Grid, as_tables, family_grids, overview_grids, refusal_grid, share_text


def row(family: str, solver: str) -> Row:
    outcomes = [Outcome.SOLVED] * 20 + [Outcome.WRONG] * 17 + [Outcome.NO_ANSWER] * 39
    fair = [(Judged(each, 123.4e-6, 1e-12, 3.4e-5), False) for each in outcomes]
    lost = [(Judged(Outcome.SAID_NO, 55.5e-6, 1.0, float("nan")), True)] * 3
    return row_of(family, solver, "warm", fair + lost, limit=1.0)


ROWS = [row(f"family_{i}", solver) for i in range(8) for solver in ("ladder", "qrqp-virtual", "[b]solver[/b]")]
GRIDS = [*overview_grids(ROWS), *family_grids(ROWS), refusal_grid(ROWS)]


def shown(grid: Grid, width: int) -> list[list[str]]:
    """The cells of every line."""
    screen = Console(file=io.StringIO(), width=width)
    for table in as_tables(grid, width=width):
        screen.print(table)
    text = screen.file.getvalue()  # type: ignore[attr-defined]
    assert max(map(len, text.splitlines())) <= width
    return [[cell.strip() for cell in line.strip("│┃").replace("┃", "│").split("│")] for line in text.splitlines()]


@pytest.mark.parametrize("width", [70, 80, 140])
@pytest.mark.parametrize("grid", GRIDS, ids=lambda grid: grid.title)
def test_no_number_is_folded_or_lost_on_a_narrow_terminal(grid: Grid, width: int) -> None:
    lines = shown(grid, width)
    for told in (grid.columns, *grid.cells):
        names, numbers = list(told[: grid.leading]), list(told[grid.leading :])
        found = [cell for line in lines if line[: grid.leading] == names for cell in line[grid.leading :]]
        where = iter(found)
        assert all(number in where for number in numbers), (told, found)  # each of them, in their order


def test_where_there_is_room_a_table_is_one() -> None:
    assert [len(as_tables(grid, width=200)) for grid in GRIDS] == [1] * len(GRIDS)


def test_all_of_them_is_written_as_all_of_them() -> None:
    assert [share_text(fraction) for fraction in (1.0, 0.99999, 0.145, 0.0)] == ["100 %", "99.99 %", "14.5 %", "0 %"]


def test_a_default_that_solves_nothing_does_not_stay() -> None:
    lost = [(Judged(Outcome.WRONG, 1e-5, 1.0, float("nan")), False)]
    (found,) = recommendations([row_of("f", "ladder", "warm", lost, limit=1.0)])
    assert found.best is None
    assert not found.stays
    assert recommendation_grid([found]).cells[0][-1] == "solves none"
