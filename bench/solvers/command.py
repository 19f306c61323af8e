"""What `python -m bench.solvers` does."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any

from rich.console import Console

from bench.solvers.entrants import entrants_named
from bench.solvers.passes import Rules
from bench.solvers.run import Comparison, chosen_sequences, compare, header, write_comparison
from bench.solvers.table import as_tables
from rehab_opt.errors import ConfigurationError

__all__ = ["Interruption", "bench_command"]

WIDEST = 140
LONGEST_LIMIT = 120.0
"""[s] of a solve: a worker lives longer than this."""
Progress = Callable[[str, int, int], None]


class Interruption:
    """Handler of Ctrl-C that remembers it: where it comes during a solve, CasADi makes a failed solve of it."""

    def __init__(self) -> None:
        self._came = False

    def __call__(self, *_: Any) -> None:
        """It comes."""
        self._came = True
        raise KeyboardInterrupt

    def checked(self, progress: Progress) -> Progress:
        """`progress`, which raises what was swallowed before."""

        def told(what: str, done: int, whole: int) -> None:
            if self._came:
                raise KeyboardInterrupt
            progress(what, done, whole)

        return told


def bench_command(
    families: Sequence[str] | None,
    solvers: Sequence[str] | None,
    *,
    time_limit: float,
    out: Path,
    progress: Progress,
    writing: AbstractContextManager[None] | None = None,
) -> None:
    """Compare, print and write; interrupted, it writes what there is before the interruption goes on.

    Parameters
    ----------
    writing : entered while files are written.

    Raises
    ------
    ConfigurationError : a name that is none, a time limit that is no time.
    """
    if not 1e-3 <= time_limit <= LONGEST_LIMIT:
        raise ConfigurationError("--time-limit", time_limit, f"seconds from 0.001 to {LONGEST_LIMIT:g}")
    sequences, taking_part = chosen_sequences(families), entrants_named(solvers)
    if not {each.kind for each in sequences} & {each.kind for each in taking_part}:
        able = ", ".join(each.name for each in entrants_named(None) if each.kind == sequences[0].kind)
        raise ConfigurationError("--solver", ", ".join(solvers or ()), f"one that can solve these families: {able}")
    found: Comparison | None = None
    try:
        for found in compare(sequences, taking_part, out=out, rules=Rules(limit=time_limit), progress=progress):  # noqa: B007
            pass
    finally:
        if found is not None:
            with writing or nullcontext():
                written = write_comparison(found, out)
            _told(found, out, written)


def _told(found: Comparison, out: Path, written: Sequence[Path]) -> None:
    console = Console()
    if console.width < WIDEST and not console.is_terminal:
        console = Console(width=WIDEST)
    console.print(header(found), highlight=False, markup=False)
    for grid in found.grids:
        console.print(f"\n{grid.title}", style="bold", highlight=False, markup=False)
        for table in as_tables(grid, width=console.width):
            console.print(table)
    names = ", ".join(path.name for path in written)
    console.print(f"written to {out}: {names}", highlight=False, markup=False, soft_wrap=True)
