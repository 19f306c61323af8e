"""`system = "used_ranges"`: what a session asks of it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from rehab_opt.session.files import ProblemFile
from rehab_opt.session.outcome import Progress
from rehab_opt.session.systems import Column, Needed
from rehab_opt.session.used_ranges.outcome import UsedRangesOutcome
from rehab_opt.session.used_ranges.problem import UsedRangesProblem
from rehab_opt.session.used_ranges.run import groups_of, needed_files, run_used_ranges

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.table import Table

__all__ = ["UsedRangesSystem"]


class UsedRangesSystem:
    """Ranges used in recorded reaches by two groups, and their workspaces."""

    schema = UsedRangesProblem
    options: frozenset[str] = frozenset()

    def recordings(self, problem: UsedRangesProblem) -> tuple[Needed, ...]:
        """The files of every angle that the model needs."""
        return needed_files(problem)

    def check(self, loaded: ProblemFile[UsedRangesProblem]) -> tuple[str, ...]:
        """Reads the files."""
        groups = groups_of(loaded)
        return tuple(dict.fromkeys(note for group in groups.values() for note in group.notes))

    def run(
        self, loaded: ProblemFile[UsedRangesProblem], *, options: Mapping[str, str], progress: Progress
    ) -> UsedRangesOutcome:
        """No options."""
        return run_used_ranges(loaded, progress=progress)

    def table(self, outcome: UsedRangesOutcome) -> Table:
        """A column for each group in each task."""
        from rehab_opt.session.used_ranges.table import used_ranges_table  # noqa: PLC0415  (loads rich)

        return used_ranges_table(outcome)

    def trace(self, outcome: UsedRangesOutcome) -> Iterator[Column]:
        """A row for each vertex of the boundaries."""
        from rehab_opt.session.workspaces.trace import boundary_columns  # noqa: PLC0415

        return boundary_columns({of.label: of.reached.workspace for groups in outcome.tasks.values() for of in groups})

    def figures(self, outcome: UsedRangesOutcome) -> dict[str, Figure]:
        """Ranges, workspaces, and shares of drawn people where they were asked for."""
        from rehab_opt.session.used_ranges.figures import used_ranges_figures  # noqa: PLC0415  (loads matplotlib)

        return used_ranges_figures(outcome)
