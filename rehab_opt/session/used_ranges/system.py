"""`system = "used_ranges"`: what a session asks of it."""

from __future__ import annotations

from collections.abc import Mapping

from rehab_opt.session.files import ProblemFile
from rehab_opt.session.outcome import Progress
from rehab_opt.session.systems import Needed, System
from rehab_opt.session.used_ranges.outcome import UsedRangesOutcome
from rehab_opt.session.used_ranges.problem import UsedRangesProblem
from rehab_opt.session.used_ranges.run import groups_of, needed_files, run_used_ranges

__all__ = ["UsedRangesSystem"]


class UsedRangesSystem(System[UsedRangesProblem, UsedRangesOutcome]):
    """Ranges used in recorded reaches by two groups, and their workspaces."""

    schema = UsedRangesProblem
    shown = ("rehab_opt.session.used_ranges.shown",)

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
