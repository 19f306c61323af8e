"""The run of `system = "used_ranges"`: ranges from recorded reaches, and the workspaces of arms that have them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag

from rehab_opt.session.arm_keys import ArmInPlane
from rehab_opt.session.files import ProblemFile, recording_path
from rehab_opt.session.outcome import Column, Outcome, Progress, with_progress
from rehab_opt.session.schema import NAME, TABLE, Once, Problem, Section
from rehab_opt.session.systems import Needed, System
from rehab_opt.session.workspaces.reached import Reached, handle_words, plane_of, plane_words, reached
from rehab_opt.session.workspaces.run import boundary_columns, fraction_inside, plane_notes, workspace_metrics
from rehab_opt.workspace.clinical_angles import CLINICAL_ANGLES
from rehab_opt.workspace.cp_reach import ReachGroup, reach_groups
from rehab_opt.workspace.reach_rows import GROUPS, task_title
from rehab_opt.workspace.reachability import ReachabilityMap
from rehab_opt.workspace.variation import reachability_map, varied_ranges

__all__ = ["GroupResult", "UsedRangesOutcome", "UsedRangesProblem", "UsedRangesSystem"]


Zero = Annotated[
    Annotated[Literal["grasp"], Tag(NAME)] | Annotated[float, Field(ge=-180, le=180), Tag(TABLE)],
    Discriminator(lambda value: NAME if isinstance(value, str) else TABLE),
]


TaskName = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9-]{0,19}$")]


class RecordedSection(Section):
    """Whose reaches: the files of Vanmechelen et al. in one folder."""

    folder: str = Field(min_length=1)
    """Folder of the files `RF_MEAN_*.csv` and `RGV_MEAN_*.csv` (Vanmechelen et al.), or of other tasks; beside the
    problem file, or `data:folder`."""
    tasks: Annotated[list[TaskName], Field(min_length=1, max_length=12), Once] = Field(default=["RF", "RGV"])
    """What the names of files begin with; reach forwards, and reach and grasp a vertical object."""
    cover: float = Field(default=0.5, ge=0.5, le=1)
    """Fraction of a group's limbs whose own limits lie within the group's: 0.5 is a typical limb, 1 all of them
    together."""
    pronation_zero_deg: Zero = 0.0
    """The files' pronation where the palm of the hanging arm faces forward; `"grasp"` takes it from the grasp
    itself."""


class VariationSection(Section):
    """People drawn around each group's typical limb, with the spread of its limbs."""

    people: int = Field(ge=2, le=1000)
    """How many people are drawn around each group's range."""
    seed: int = Field(default=0, ge=0, le=2**31)
    """Of the drawing."""
    at_least: float = Field(default=0.5, gt=0, le=1)
    """Fraction of them that reach every point of the outlined region."""
    spacing_mm: float = Field(default=5.0, ge=1, le=50)
    """Of the grid in the figure."""


class UsedRangesProblem(Problem):
    """Ranges used by two groups, and the workspaces of those ranges."""

    system: Literal["used_ranges"]
    recorded: RecordedSection
    """Whose reaches."""
    arm: ArmInPlane
    """The same segments for everybody."""
    variation: VariationSection | None = None
    """People drawn around each group."""


@dataclass(frozen=True, eq=False)
class GroupResult:
    """One group in one task: the range used, its workspace, and how many of drawn people reach what."""

    label: str
    group: ReachGroup
    reached: Reached
    fractions: ReachabilityMap | None


@dataclass(frozen=True, eq=False)
class UsedRangesOutcome(Outcome):
    """Results by task, the groups in the order of `reach_rows.GROUPS`; how people were drawn, if they were."""

    section: ArmInPlane = field(kw_only=True)
    variation: VariationSection | None = field(kw_only=True)
    tasks: Mapping[str, tuple[GroupResult, ...]] = field(kw_only=True)

    def trace(self) -> Iterator[Column]:
        """A row for each vertex of the boundaries."""
        return boundary_columns({of.label: of.reached.workspace for groups in self.tasks.values() for of in groups})


def needed_files(problem: UsedRangesProblem) -> tuple[Needed, ...]:
    """The files of every angle that the model needs."""
    return tuple(
        Needed("recorded.folder", f"{problem.recorded.folder}/{task}_MEAN_{angle.column}.csv")
        for task in problem.recorded.tasks
        for angle in CLINICAL_ANGLES
    )


def groups_of(config: ProblemFile[UsedRangesProblem]) -> dict[tuple[str, str], ReachGroup]:
    """The range used by (task, group); raises as `recording_path` and `reach_groups`."""
    recorded = config.problem.recorded
    files = [recording_path(config, each.reference, key=each.key) for each in needed_files(config.problem)]
    zero = recorded.pronation_zero_deg
    return reach_groups(
        Path(files[0]).parent,
        tasks=recorded.tasks,
        cover=recorded.cover,
        pronation_zero="grasp" if isinstance(zero, str) else math.radians(zero),
    )


def _fractions(section: ArmInPlane, group: ReachGroup, variation: VariationSection | None) -> ReachabilityMap | None:
    if variation is None:
        return None
    drawn = varied_ranges(group.used, spread=group.spread, count=variation.people, seed=variation.seed)
    return reachability_map(
        drawn,
        **variation.arguments("spacing_mm"),
        segments=section.segments.arguments(),
        side=section.side,
        **plane_of(section),
    )


def _group_metrics(of: GroupResult, other: GroupResult, variation: VariationSection | None) -> dict[str, Any]:
    numbers = {
        "range_used": {
            f"{joint}_deg": {"lower": math.degrees(lower), "upper": math.degrees(upper)}
            for joint, (lower, upper) in of.group.used.items()
        },
        "limbs": dict(of.group.rows),
        **workspace_metrics(of.reached.workspace),
        "fraction_inside_other_group": fraction_inside(of.reached.workspace, other.reached.workspace),
        "seconds": of.reached.seconds,
    }
    if of.fractions is not None and variation is not None:
        numbers["reached_by_fraction_of_people"] = variation.at_least
        numbers["area_reached_by_them_m2"] = of.fractions.region(variation.at_least).area
        numbers["people_drawn"] = len(of.fractions.workspaces)
        numbers["people_who_reach_nothing"] = of.fractions.empty
    return numbers


def _notes(problem: UsedRangesProblem, results: dict[str, tuple[GroupResult, ...]]) -> Iterator[str]:
    yield "RANGE USED in one task, not the range possible: a short reach shows little of what an arm can do"
    yield "the same segment lengths for everybody: the files have none, so areas compare ranges, not people"
    spaces = {of.label: of.reached.workspace for of_task in results.values() for of in of_task}
    yield from plane_notes(problem.arm, spaces)
    said = [note for of_task in results.values() for of in of_task for note in of.group.notes[1:]]
    yield from dict.fromkeys(said)
    if problem.variation is not None:
        yield (
            f"{problem.variation.people} people drawn around each group's typical limb, every limit on its own: limits "
            "of one person tend to fall together, so real people may differ more or less than these"
        )


class UsedRangesSystem(System[UsedRangesProblem, UsedRangesOutcome]):
    """Ranges used in recorded reaches by two groups, and their workspaces."""

    schema = UsedRangesProblem

    def figures(self, outcome: Any) -> dict[str, Any]:
        """The figures by file name, without suffix."""
        from rehab_opt.session.used_ranges.shown import figures  # noqa: PLC0415  (draws)

        return figures(outcome)

    def recordings(self, problem: UsedRangesProblem) -> tuple[Needed, ...]:
        """The files of every angle that the model needs."""
        return needed_files(problem)

    def check(self, config: ProblemFile[UsedRangesProblem]) -> tuple[str, ...]:
        """Reads the files."""
        groups = groups_of(config)
        return tuple(dict.fromkeys(note for group in groups.values() for note in group.notes))

    def columns(self, outcome: UsedRangesOutcome) -> Mapping[str, Mapping[str, Any]]:
        """A column for each task and group."""
        groups: Mapping[str, Mapping[str, Any]] = outcome.metrics["groups"]
        return groups

    def caption(self, outcome: UsedRangesOutcome) -> str:
        """Plane and handle."""
        return f"workspace of the range used, plane {plane_words(outcome.section)}, {handle_words(outcome.section)}"

    def run(
        self, config: ProblemFile[UsedRangesProblem], *, options: Mapping[str, str], progress: Progress
    ) -> UsedRangesOutcome:
        """No options."""
        problem = config.problem
        groups = groups_of(config)
        results: dict[str, tuple[GroupResult, ...]] = {}
        for task, name in with_progress(progress, "groups", list(product(problem.recorded.tasks, GROUPS))):
            group = groups[task, name]
            found = GroupResult(
                label=f"{task_title(task)}, {name}",
                group=group,
                reached=reached(problem.arm, group.used, file=config.file, key="arm"),
                fractions=_fractions(problem.arm, group, problem.variation),
            )
            results[task] = (*results.get(task, ()), found)
        return UsedRangesOutcome(
            notes=tuple(_notes(problem, results)),
            metrics={
                "groups": {
                    of.label: _group_metrics(of, other, problem.variation)
                    for of_task in results.values()
                    for of, other in zip(of_task, reversed(of_task), strict=True)
                },
            },
            section=problem.arm,
            variation=problem.variation,
            tasks=results,
        )
