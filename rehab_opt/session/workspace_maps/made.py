"""Sets of a `workspace_map` problem, the maps between them, and mapped paths."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from typing import Literal, NamedTuple

from rehab_opt.errors import ConfigurationError, ProblemFileError
from rehab_opt.session.arm_keys import ArmInPlane, RangeOfMotion, ranges_by_name
from rehab_opt.session.outcome import Array
from rehab_opt.session.workspace_maps.problem import MapSection, WorkspaceMapProblem
from rehab_opt.workspace.audit import Audit
from rehab_opt.workspace.mapping import WorkspaceMap
from rehab_opt.workspace.region import Workspace

End = Literal["source", "target"]
ENDS: tuple[End, ...] = ("source", "target")


class MappedSet(NamedTuple):
    """One of the two sets: name, arm, range of motion, and the arm's key in the problem file."""

    name: str
    section: ArmInPlane
    ranges: str | RangeOfMotion
    key: str


def mapped_set(problem: WorkspaceMapProblem, end: End) -> MappedSet:
    """The source or the target set of a problem."""
    said = problem.source if end == "source" else problem.target
    if not isinstance(said, str):
        return MappedSet(end, said, said.range_of_motion, end)
    assert problem.arm is not None  # the schema refuses a name without an arm
    return MappedSet(said, problem.arm, ranges_by_name(problem.arm.range_of_motion)[said], "arm")


class MadeMap:
    """A map by one rule, with its audit; if the rule finds no map, both are None and `reason` says why.

    `seconds` is the computing time of the map without the audit.
    """

    def __init__(
        self,
        how: MapSection,
        sets: Sequence[MappedSet],
        spaces: Sequence[Workspace],
        *,
        start: int,
        rule: str,
        file: str,
    ) -> None:
        began = time.perf_counter()
        self.rule, self.reason, self.mapped, self.audit = rule, "", None, None
        try:
            self.mapped = WorkspaceMap.between(
                spaces[start],
                spaces[1 - start],
                rule=rule,  # type: ignore[arg-type]
                landmarks=how.polar_landmarks if rule == "polar" else None,
                rotation="best" if isinstance(how.rotation_deg, str) else math.radians(how.rotation_deg),
            )
        except ConfigurationError as refused:
            if refused.argument in ENDS:
                at = start if refused.argument == "source" else 1 - start
                value = f"{sets[at].name}: {refused.value}"
                raise ProblemFileError(file, ENDS[at], value, refused.expected) from refused
            self.reason = f"no map: {refused}"
        self.seconds = time.perf_counter() - began
        if self.mapped is not None:
            self.audit = self.mapped.audit(how.audit_points, how.seed)

    mapped: WorkspaceMap | None
    audit: Audit | None


class Direction(NamedTuple):
    """Maps from one set to the other, one for each rule, and the paths (N, 2) [m] before and after."""

    key: str
    start: MappedSet
    end: MappedSet
    start_space: Workspace
    end_space: Workspace
    maps: list[MadeMap]
    before: dict[str, Array]
    """Paths by the name of their trajectory."""
    after: dict[str, dict[str, Array]]
    """Mapped paths by rule and by the name of their trajectory, for rules with a map."""
