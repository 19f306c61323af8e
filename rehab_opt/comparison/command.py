"""What `rehab-opt bench` does."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from rich.console import Console

from rehab_opt.comparison.entrants import entrants_named
from rehab_opt.comparison.passes import Rules
from rehab_opt.comparison.run import Comparison, chosen_sequences, compare, header, write_comparison
from rehab_opt.comparison.table import as_table
from rehab_opt.errors import ConfigurationError

__all__ = ["bench_command"]

WIDEST = 140


def bench_command(
    families: Sequence[str] | None,
    solvers: Sequence[str] | None,
    *,
    time_limit: float,
    out: Path,
    progress: Callable[[str, int, int], None],
) -> None:
    """Compare, print and write; interrupted, it writes what there is before the interruption goes on.

    Raises
    ------
    ConfigurationError : a name that is none, a time limit that is no time.
    """
    if not 1e-3 <= time_limit <= 3600.0:
        raise ConfigurationError("--time-limit", time_limit, "seconds from 0.001 to 3600")
    sequences, taking_part = chosen_sequences(families), entrants_named(solvers)
    found: Comparison | None = None
    try:
        for found in compare(sequences, taking_part, out=out, rules=Rules(limit=time_limit), progress=progress):  # noqa: B007
            pass
    finally:
        if found is not None:
            _told(found, out)


def _told(found: Comparison, out: Path) -> None:
    written = write_comparison(found, out)
    console = Console()
    if console.width < WIDEST and not console.is_terminal:
        console = Console(width=WIDEST)
    console.print(header(found), highlight=False, markup=False)
    for grid in found.grids:
        console.print(as_table(grid))
    names = ", ".join(path.name for path in written)
    console.print(f"written to {out}: {names}", highlight=False, markup=False, soft_wrap=True)
