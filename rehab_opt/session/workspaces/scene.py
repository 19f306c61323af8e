"""`system = "workspace"`: reachable workspaces and volumes of an arm with one or several ranges of motion."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.session.arm_keys import AnyTilt, ArmInPlane, ArmOfRanges, RangeOfMotion, ranges_by_name
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.outcome import Names, Outcome, Progress, with_progress
from rehab_opt.session.participant import arm_of
from rehab_opt.session.schema import Once, Problem, Section, refusal
from rehab_opt.session.systems import System
from rehab_opt.session.trace import Trace
from rehab_opt.session.workspaces.reached import (
    handle_words,
    placement_of,
    plane_words,
    reached,
    rings,
    sets_of,
    tilt_of,
    tilt_words,
)
from rehab_opt.workspace.region import Workspace
from rehab_opt.workspace.volume import ReachableVolume, reachable_volume


class TiltsSection(Section):
    """Other limits of the handle's tilt, for which the area of one range of motion is computed, too."""

    range: str
    """Name of a range of motion in `arm.range_of_motion`."""
    handle_tilt_deg: Annotated[list[AnyTilt], Field(min_length=1, max_length=12), Once]
    """Largest angles between handle and vertical; `"any"` for no limit."""


class WorkspaceProblem(Problem):
    """The reachable workspace of an arm with one or several ranges of motion."""

    system: Literal["workspace"]
    arm: ArmOfRanges
    """The participant's arm."""
    volume: bool = False
    """If true, the reachable volumes are also computed, with the handle's tilt limited as in the plane, and without a
    limit."""
    volume_accuracy_mm: float = Field(default=8.0, ge=1, le=50)
    """Accuracy of the horizontal slices of a volume."""
    volume_spacing_mm: float = Field(default=40.0, ge=5, le=500)
    """Distance between two slices of a volume."""
    tilts: TiltsSection | None = None
    """Other limits of the handle's tilt."""

    @model_validator(mode="after")
    def range_of_tilts_is_there(self) -> Self:
        """Refuse a `tilts.range` that `arm.range_of_motion` does not have."""
        there = ranges_by_name(self.arm.range_of_motion)
        own = isinstance(self.arm.range_of_motion, RangeOfMotion)
        if self.tilts is not None and self.tilts.range not in there and not own:
            expected = f"the name of a range of arm.range_of_motion ({', '.join(there)})"
            raise refusal("tilts.range", self.tilts.range, expected)
        return self


Config = ProblemFile[WorkspaceProblem]


class ReachedSets:
    """The scene of a `WorkspaceProblem`: reachable sets of an arm for each range of motion."""

    def __init__(self, config: Config) -> None:
        self.problem, self._file = config.problem, config.file
        self.ranges = ranges_by_name(self.problem.arm.range_of_motion)
        tilted = tilt_of(self.problem.arm) is not None
        self.held = ((True, False) if tilted else (False,)) if self.problem.volume else ()
        """For each volume of a set: whether the handle's tilt is limited as in the plane."""

    def run(self, progress: Progress = lambda *_: None) -> Trace:
        """Trace with one row for each vertex: set, component from 1, ring (0: outline; 1, 2, ...: holes), x and y.

        Columns that are not written to files are the sets `_workspace`, their names `_range`, times `_seconds` [s],
        volumes `_volume` (sets, values of `held`), and the sets `_tilted` for other tilts.
        """
        arm, file = self.problem.arm, self._file
        found = {
            name: reached(arm, limits, file=file, key="arm")
            for name, limits in with_progress(progress, "workspaces", self.ranges.items())
        }
        rows = [
            (name, component, ring, x, y)
            for name, of in found.items()
            for component, ring, points in rings(of.workspace)
            for x, y in points
        ]
        names = ("set", "component", "ring", "x_m", "y_m")
        trace = Trace(dict(zip(names, zip(*rows, strict=True) if rows else [()] * len(names), strict=True)))
        trace["_range"] = np.array(list(found))
        trace["_workspace"] = np.array([of.workspace for of in found.values()])
        trace["_seconds"] = np.array([of.seconds for of in found.values()])
        volumes = with_progress(progress, "volumes", found.values() if self.held else ())
        trace["_volume"] = np.array([[self._volume(of.arm, held) for held in self.held] for of in volumes])
        tilts = self.problem.tilts
        if tilts is not None and tilts.range in self.ranges:
            own = self.ranges[tilts.range]
            tilted = [
                reached(arm.model_copy(update={"handle_tilt_deg": tilt}), own, file=file, key="arm")
                for tilt in with_progress(progress, "handle tilts", tilts.handle_tilt_deg)
            ]
            trace["_tilted"] = np.array([of.workspace for of in tilted])
        return trace

    def _volume(self, arm: SerialChain, held: bool) -> ReachableVolume:
        problem = self.problem
        return reachable_volume(
            arm,
            spacing=1e-3 * problem.volume_spacing_mm,
            handle_tilt=tilt_of(problem.arm) if held else None,
            accuracy=1e-3 * problem.volume_accuracy_mm,
            placement=placement_of(problem.arm),
        )

    def numbers(self, trace: Trace) -> dict[str, Any]:
        """Metrics: area, shape, extent and volumes of each set, and its overlap with each other set."""
        spaces, tilts = sets_of(trace), self.problem.tilts
        sets = {name: workspace_metrics(of) for name, of in spaces.items()}
        for (name, numbers), seconds in zip(sets.items(), trace["_seconds"].tolist(), strict=True):
            others = {other: larger for other, larger in spaces.items() if other != name}
            inside = {other: fraction_inside(spaces[name], larger) for other, larger in others.items()}
            numbers |= {"seconds": seconds, "fraction_inside": inside}
        if tilts is not None and "_tilted" in trace:
            keys = (tilt_words(tilt).replace(" ", "_") for tilt in tilts.handle_tilt_deg)
            areas = ({"area_m2": of.area, "accuracy_m": of.accuracy} for of in trace["_tilted"])
            sets[tilts.range]["tilts"] = dict(zip(keys, areas, strict=True))
        names = ["handle_held" if held else "handle_free" for held in self.held]
        volumes = {
            name: dict(zip(names, map(volume_metrics, of), strict=True))
            for name, of in zip(spaces, trace["_volume"], strict=bool(names))
        }
        return {"sets": sets, "volumes": volumes}

    def notes(self, trace: Trace) -> Iterator[str]:
        """Notes on the plane and the sets, from `plane_notes`."""
        return plane_notes(self.problem.arm, sets_of(trace))


WORSE = 1.0001
"""Ratio of achieved to required accuracy above which a note reports the achieved accuracy."""


def workspace_metrics(workspace: Workspace) -> dict[str, Any]:
    """Metrics of a workspace: area, shape and extent; an empty workspace has the extent None."""
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
    """Fraction of a workspace's area that lies in `larger`; None for an empty workspace."""
    if workspace.empty:
        return None
    return float(workspace.polygon.intersection(larger.polygon).area / workspace.area)


def plane_notes(section: ArmInPlane, spaces: Mapping[str, Workspace]) -> Iterator[str]:
    """Notes on the plane, the handle, empty workspaces, missed accuracies and the robot's frame."""
    yield f"the plane lies {plane_words(section)}; {handle_words(section)}"
    yield "computed from joint limits and segment lengths alone, without muscles, contact and effort"
    for name, workspace in spaces.items():
        if workspace.empty:
            yield f"{name}: EMPTY, {workspace.reason}"
        elif workspace.accuracy > WORSE * 1e-3 * section.accuracy_mm:
            yield (
                f"{name}: the boundary was confirmed to {1e3 * workspace.accuracy:.3g} mm only, "
                f"{section.accuracy_mm:g} mm were required"
            )
    if any(section.shoulder_m) or section.shoulder_turn_deg:
        place = ", ".join(f"{each:g}" for each in section.shoulder_m)
        yield (
            f"in the robot's frame: the {section.side} shoulder stands at ({place}) m, turned by "
            f"{section.shoulder_turn_deg:g} deg"
        )


def volume_metrics(volume: ReachableVolume) -> dict[str, Any]:
    """Metrics of a reachable volume: size, error bound and number of slices."""
    return {
        "volume_m3": volume.volume,
        "volume_bound_m3": volume.volume_bound,
        "slices": len(volume.slices),
        "reason": volume.reason,
    }


class WorkspaceSystem(System[WorkspaceProblem, ReachedSets]):
    """System of the reachable workspaces of an arm."""

    schema = WorkspaceProblem
    drawing = "rehab_opt.session.workspaces.figures"

    def scenes(self, config: Config, options: Mapping[str, str]) -> dict[Names, ReachedSets]:
        """One scene with all ranges of motion."""
        return {(): ReachedSets(config)}

    def columns(self, outcome: Outcome) -> Mapping[str, Mapping[str, Any]]:
        """Columns of the table, one for each range of motion, with areas and volumes."""
        sets, volumes = outcome.metrics["sets"], outcome.metrics["volumes"]
        return {name: {**numbers, "volume": volumes.get(name, {})} for name, numbers in sets.items()}

    def caption(self, outcome: Outcome) -> str:
        """Caption of the table: plane and handle."""
        (scene,) = outcome.scenes.values()
        return f"plane {plane_words(scene.problem.arm)}, {handle_words(scene.problem.arm)}"

    def check(self, config: Config) -> tuple[str, ...]:
        """Build the arms, which checks their segments and ranges of motion."""
        self.arms(config)
        return ()

    def arms(self, config: Config) -> dict[str, SerialChain]:
        """An arm for each range of motion."""
        arm = config.problem.arm
        return {
            name: arm_of(arm.side, arm.segments, limits, file=config.file)
            for name, limits in ranges_by_name(arm.range_of_motion).items()
        }
