"""What is found of the ranges that groups of people used."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from rehab_opt.session.cp_reach import ReachGroup
from rehab_opt.session.outcome import Column, Outcome
from rehab_opt.session.used_ranges.problem import VariationSection
from rehab_opt.session.workspaces.outcome import boundary_columns
from rehab_opt.session.workspaces.reached import Reached
from rehab_opt.session.workspaces.sections import ArmInPlane
from rehab_opt.workspace.reachability import ReachabilityMap

__all__ = ["GroupResult", "UsedRangesOutcome"]


@dataclass(frozen=True, eq=False)
class GroupResult:
    """One group in one task: the range used, its workspace, and how many of drawn people reach what."""

    label: str
    group: ReachGroup
    reached: Reached
    shares: ReachabilityMap | None


@dataclass(frozen=True, eq=False)
class UsedRangesOutcome(Outcome):
    """Results by task, the groups in the order of `reach_rows.GROUPS`; how people were drawn, if they were."""

    section: ArmInPlane = field(kw_only=True)
    variation: VariationSection | None = field(kw_only=True)
    tasks: Mapping[str, tuple[GroupResult, ...]] = field(kw_only=True)

    def trace(self) -> Iterator[Column]:
        """A row for each vertex of the boundaries."""
        return boundary_columns({of.label: of.reached.workspace for groups in self.tasks.values() for of in groups})
