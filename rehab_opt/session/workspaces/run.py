"""The run of `system = "workspace"`: slices, volumes where asked for, and their numbers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import product
from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.session.arm_keys import AnyTilt, ArmInPlane, ArmOfRanges, RangeOfMotion, ranges_by_name
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.outcome import Column, Outcome, Progress, with_progress
from rehab_opt.session.participant import arm_of
from rehab_opt.session.schema import Once, Problem, Section, refusal
from rehab_opt.session.systems import System
from rehab_opt.session.workspaces.reached import (
    Reached,
    handle_words,
    placement_of,
    plane_words,
    reached,
    tilt_of,
    tilt_words,
)
from rehab_opt.workspace.region import Workspace
from rehab_opt.workspace.volume import ReachableVolume, reachable_volume

__all__ = [
    "WorkspaceOutcome",
    "WorkspaceProblem",
    "WorkspaceSystem",
    "boundary_columns",
    "fraction_inside",
    "plane_notes",
    "rings",
    "workspace_metrics",
]


class TiltsSection(Section):
    """One range of motion again, with other tilts of the handle."""

    range: str
    """A name of `arm.range_of_motion`. A person's own range that takes the place of all names has no such areas."""
    handle_tilt_deg: Annotated[list[AnyTilt], Field(min_length=1, max_length=12), Once]
    """Largest angles between handle and vertical, `"any"` for no such bound."""


class WorkspaceProblem(Problem):
    """Where an arm reaches with one or several ranges of motion."""

    system: Literal["workspace"]
    arm: ArmOfRanges
    """Whose arm."""
    volume: bool = False
    """Also the volumes of Fig. 3(a), with the handle held as above and free."""
    volume_accuracy_mm: float = Field(default=8.0, ge=1, le=50)
    """Of the slices that make up a volume."""
    volume_spacing_mm: float = Field(default=40.0, ge=5, le=500)
    """Distance of these slices."""
    tilts: TiltsSection | None = None
    """The area of one range over the tilt of the handle."""

    @model_validator(mode="after")
    def range_of_tilts_is_there(self) -> Self:
        """Refuse the name of a range that `arm` has none of."""
        there = ranges_by_name(self.arm.range_of_motion)
        own = isinstance(self.arm.range_of_motion, RangeOfMotion)
        if self.tilts is not None and self.tilts.range not in there and not own:
            expected = f"the name of a range of arm.range_of_motion ({', '.join(there)})"
            raise refusal("tilts.range", self.tilts.range, expected)
        return self


@dataclass(frozen=True, eq=False)
class WorkspaceOutcome(Outcome):
    """Workspaces by the name of their range of motion.

    Parameters
    ----------
    section : the arm and the plane they share.
    sets : at least one; empty workspaces say why.
    volumes : by name and by whether the handle is held as in the plane (True) or free (False); none unless asked for.
    """

    section: ArmInPlane = field(kw_only=True)
    sets: Mapping[str, Reached] = field(kw_only=True)
    volumes: Mapping[tuple[str, bool], ReachableVolume] = field(kw_only=True)

    def trace(self) -> Iterator[Column]:
        """A row for each vertex of the boundaries."""
        return boundary_columns({name: of.workspace for name, of in self.sets.items()})


def boundary_columns(spaces: Mapping[str, Workspace]) -> Iterator[Column]:
    """One row a vertex: set, component (from 1), ring (0 is the outline, holes count from 1), x and y."""
    rows = [
        (name, component, ring, x, y)
        for name, workspace in spaces.items()
        for component, ring, points in rings(workspace)
        for x, y in points
    ]
    columns = [list(column) for column in zip(*rows, strict=True)] or [[]] * 5
    return zip(("set", "component", "ring", "x_m", "y_m"), columns, strict=True)


def rings(workspace: Workspace) -> Iterator[tuple[int, int, Any]]:
    """Component, ring and its vertices [m], the first one repeated at the end."""
    if workspace.empty:
        return
    for component, part in enumerate(getattr(workspace.polygon, "geoms", (workspace.polygon,)), start=1):
        for ring, line in enumerate((part.exterior, *part.interiors)):
            yield component, ring, list(line.coords)


WORSE = 1.0001
"""An accuracy this much above the requested one is reported."""


def workspace_metrics(workspace: Workspace) -> dict[str, Any]:
    """Area, shape and extent; the extent of an empty workspace is None."""
    bounds: tuple[float, ...] | tuple[None, ...] = workspace.polygon.bounds if not workspace.empty else (None,) * 4
    return {
        "empty": workspace.empty,
        "reason": workspace.reason,
        "area_m2": workspace.area,
        "components": workspace.components,
        "holes": workspace.holes,
        **dict(zip(("x_min_m", "y_min_m", "x_max_m", "y_max_m"), bounds, strict=True)),
        "accuracy_m": workspace.accuracy,
    }


def fraction_inside(workspace: Workspace, larger: Workspace) -> float | None:
    """Fraction of a workspace's area that lies in another one; None where it has no area."""
    if workspace.empty:
        return None
    return float(workspace.polygon.intersection(larger.polygon).area / workspace.area)


def plane_notes(section: ArmInPlane, spaces: Mapping[str, Workspace]) -> Iterator[str]:
    """What a reader of areas has to know."""
    yield f"the plane lies {plane_words(section)}; {handle_words(section)}"
    yield "what joint limits and segment lengths allow: no muscle, no contact, no effort is part of it"
    for name, workspace in spaces.items():
        if workspace.empty:
            yield f"{name}: EMPTY, {workspace.reason}"
        elif workspace.accuracy > WORSE * 1e-3 * section.accuracy_mm:
            yield (
                f"{name}: its boundary could be confirmed to {1e3 * workspace.accuracy:.3g} mm only, "
                f"{section.accuracy_mm:g} mm were required"
            )
    if any(section.shoulder_m) or section.shoulder_turn_deg:
        place = ", ".join(f"{each:g}" for each in section.shoulder_m)
        yield (
            f"in the robot's frame: the {section.side} shoulder stands at ({place}) m, turned by "
            f"{section.shoulder_turn_deg:g} deg"
        )


def _volume_metrics(volumes: Mapping[tuple[str, bool], ReachableVolume]) -> dict[str, Any]:
    numbers: dict[str, Any] = {}
    for (name, upright), volume in volumes.items():
        numbers.setdefault(name, {})["handle_held" if upright else "handle_free"] = {
            "volume_m3": volume.volume,
            "volume_bound_m3": volume.volume_bound,
            "slices": len(volume.slices),
            "reason": volume.reason,
        }
    return numbers


class WorkspaceSystem(System[WorkspaceProblem, WorkspaceOutcome]):
    """The reachable workspaces of an arm."""

    schema = WorkspaceProblem

    def figures(self, outcome: Any) -> dict[str, Any]:
        """The figures by file name, without suffix."""
        from rehab_opt.session.workspaces.shown import figures  # noqa: PLC0415  (draws)

        return figures(outcome)

    def columns(self, outcome: WorkspaceOutcome) -> Mapping[str, Mapping[str, Any]]:
        """A column for each range of motion; volumes with the handle held as in the plane, or free."""
        sets, volumes = outcome.metrics["sets"], outcome.metrics["volumes"]
        return {name: {**numbers, "volume": volumes.get(name, {})} for name, numbers in sets.items()}

    def caption(self, outcome: WorkspaceOutcome) -> str:
        """Plane and handle."""
        return f"plane {plane_words(outcome.section)}, {handle_words(outcome.section)}"

    def check(self, config: ProblemFile[WorkspaceProblem]) -> tuple[str, ...]:
        """Builds the arms."""
        self.arms(config)
        return ()

    def arms(self, config: ProblemFile[WorkspaceProblem]) -> dict[str, SerialChain]:
        """An arm for each range of motion."""
        arm = config.problem.arm
        return {
            name: arm_of(arm.side, arm.segments, limits, file=config.file)
            for name, limits in ranges_by_name(arm.range_of_motion).items()
        }

    def run(
        self, config: ProblemFile[WorkspaceProblem], *, options: Mapping[str, str], progress: Progress
    ) -> WorkspaceOutcome:
        """No options."""
        problem = config.problem
        ranges = ranges_by_name(problem.arm.range_of_motion)
        sets = {
            name: reached(problem.arm, limits, file=config.file, key="arm")
            for name, limits in with_progress(progress, "workspaces", ranges.items())
        }
        volumes: dict[tuple[str, bool], ReachableVolume] = {}
        if problem.volume:
            held = (True, False) if tilt_of(problem.arm) is not None else (False,)
            for name, upright in with_progress(progress, "volumes", list(product(sets, held))):
                volumes[name, upright] = reachable_volume(
                    sets[name].arm,
                    spacing=1e-3 * problem.volume_spacing_mm,
                    handle_tilt=tilt_of(problem.arm) if upright else None,
                    accuracy=1e-3 * problem.volume_accuracy_mm,
                    placement=placement_of(problem.arm),
                )
        spaces = {name: of.workspace for name, of in sets.items()}
        areas: dict[str, dict[str, Any]] = {}
        if problem.tilts is not None and (name := problem.tilts.range) in ranges:
            for tilt in with_progress(progress, "handle tilts", problem.tilts.handle_tilt_deg):
                held_so = problem.arm.model_copy(update={"handle_tilt_deg": tilt})
                found = reached(held_so, ranges[name], file=config.file, key="arm").workspace
                key = tilt_words(tilt).replace(" ", "_")
                areas.setdefault(name, {})[key] = {"area_m2": found.area, "accuracy_m": found.accuracy}
        return WorkspaceOutcome(
            notes=tuple(plane_notes(problem.arm, spaces)),
            metrics={
                "sets": {
                    name: workspace_metrics(of.workspace)
                    | {
                        "seconds": of.seconds,
                        "fraction_inside": {
                            other: fraction_inside(of.workspace, larger)
                            for other, larger in spaces.items()
                            if other != name
                        },
                    }
                    | ({"tilts": areas[name]} if name in areas else {})
                    for name, of in sets.items()
                },
                "volumes": _volume_metrics(volumes),
            },
            section=problem.arm,
            sets=sets,
            volumes=volumes,
        )
