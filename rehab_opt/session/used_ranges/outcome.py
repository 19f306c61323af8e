"""What is found of the ranges that groups of people used."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from rehab_opt.session.cp_reach import ReachGroup
from rehab_opt.session.outcome import Outcome
from rehab_opt.session.used_ranges.problem import VariationSection
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
