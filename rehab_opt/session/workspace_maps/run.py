"""The run of `system = "workspace_map"`: both sets, a map for each rule and direction, and what it does to paths."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import product
from typing import Any, Literal, NamedTuple

import numpy as np

from rehab_opt.errors import ConfigurationError, ProblemFileError
from rehab_opt.measures.path import path_length
from rehab_opt.recordings.recording import Recording, size_note
from rehab_opt.session.arm_keys import ArmInPlane, RangeOfMotion, ranges_by_name
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.outcome import Array, Column, Outcome, Progress, finite, with_progress
from rehab_opt.session.participant import placed_recording
from rehab_opt.session.systems import Needed, NotMet, System
from rehab_opt.session.workspace_maps.problem import MapSection, TrajectorySection, WorkspaceMapProblem
from rehab_opt.session.workspaces.reached import Reached, reached
from rehab_opt.session.workspaces.run import plane_notes, workspace_metrics
from rehab_opt.workspace.audit import Audit
from rehab_opt.workspace.mapping import WorkspaceMap

__all__ = ["ENDS", "MadeMap", "MapDirection", "MapOutcome", "WorkspaceMapSystem"]

End = Literal["source", "target"]
Rule = Literal["safe", "polar"]

ENDS: tuple[End, ...] = ("source", "target")
OTHER: dict[End, End] = {"source": "target", "target": "source"}


@dataclass(frozen=True, eq=False)
class MappedSet:
    """One of the two sets: what it is called, the arm it belongs to, its workspace."""

    name: str
    section: ArmInPlane
    reached: Reached


@dataclass(frozen=True, eq=False)
class MadeMap:
    """A map with its audit, or why there is none.

    Parameters
    ----------
    mapped, audit : both None where the rule found no map.
    reason : then why; "" otherwise.
    seconds : what making it took [s], the audit not counted.
    """

    rule: str
    mapped: WorkspaceMap | None
    audit: Audit | None
    reason: str
    seconds: float


@dataclass(frozen=True, eq=False)
class CarriedPath:
    """A trajectory before and after.

    Parameters
    ----------
    time : (N,) [s].
    before : (N, 2) [m] in the frame of the set where it starts.
    after : by rule, (N, 2) [m]; no entry for a rule without a map.
    """

    name: str
    time: Array
    before: Array
    after: Mapping[str, Array]


@dataclass(frozen=True, eq=False)
class MapDirection:
    """From one set into the other: a map for each rule, and the trajectories that it carries."""

    key: str
    start: MappedSet
    end: MappedSet
    maps: tuple[MadeMap, ...]
    paths: tuple[CarriedPath, ...]


@dataclass(frozen=True, eq=False)
class MapOutcome(Outcome):
    """Maps in one direction, or there and back (two maps of their own: one is not the inverse of the other)."""

    directions: tuple[MapDirection, ...] = field(kw_only=True)

    def trace(self) -> Iterator[Column]:
        """One row a sample of a trajectory; a rule without a map has NaN."""
        paths = [(direction, path) for direction in self.directions for path in direction.paths]
        yield "trajectory", tuple(path.name for _, path in paths for _ in path.time)
        yield "from", tuple(direction.start.name for direction, path in paths for _ in path.time)
        yield "to", tuple(direction.end.name for direction, path in paths for _ in path.time)
        yield "t_s", [t for _, path in paths for t in path.time.tolist()]
        for k, axis in enumerate("xy"):
            yield f"before_{axis}_m", [value for _, path in paths for value in path.before[:, k].tolist()]
        for rule in sorted({made.rule for direction in self.directions for made in direction.maps}, reverse=True):
            for k, axis in enumerate("xy"):
                cells: list[float] = []
                for _, path in paths:
                    after = path.after.get(rule)
                    cells += after[:, k].tolist() if after is not None else [math.nan] * len(path.time)
                yield f"{rule}_after_{axis}_m", cells


class ArmOfSet(NamedTuple):
    """One of the sets as the file states it: its name, arm and range, and the key that speaks of the arm."""

    name: str
    section: ArmInPlane
    ranges: str | RangeOfMotion
    key: str


def arm_of_set(problem: WorkspaceMapProblem, end: End) -> ArmOfSet:
    """What the file says of one of the sets."""
    said = problem.source if end == "source" else problem.target
    if not isinstance(said, str):
        return ArmOfSet(end, said, said.range_of_motion, end)
    assert problem.arm is not None  # the schema refuses a name without an arm
    return ArmOfSet(said, problem.arm, ranges_by_name(problem.arm.range_of_motion)[said], "arm")


def placed_trajectory(config: ProblemFile[WorkspaceMapProblem], index: int) -> tuple[Recording, Array]:
    """A trajectory's recording, and its path (N, 2) [m] in the frame of its set; raises as `placed_recording`."""
    trajectory = config.problem.trajectory[index]
    section = arm_of_set(config.problem, trajectory.set).section
    recording, path = placed_recording(
        config,
        trajectory.recording,
        trajectory.placement,
        side=section.side,
        rate=trajectory.rate_hz,
        keys=f"trajectory.{index}.",
    )
    return recording, path[:, :2]


def _made(rule: Rule, start: End, sets: dict[End, MappedSet], how: MapSection, *, file: str) -> MadeMap:
    source, target = (sets[end].reached.workspace for end in (start, OTHER[start]))
    began = time.perf_counter()
    try:
        mapped = WorkspaceMap.between(
            source,
            target,
            rule=rule,
            landmarks=how.polar_landmarks if rule == "polar" else None,
            rotation="best" if isinstance(how.rotation_deg, str) else math.radians(how.rotation_deg),
        )
    except ConfigurationError as refused:
        if refused.argument in OTHER:
            key = start if refused.argument == "source" else OTHER[start]
            value = f"{sets[key].name}: {refused.value}"
            raise ProblemFileError(file, key, value, refused.expected) from refused
        return MadeMap(rule, None, None, f"no map: {refused}", time.perf_counter() - began)
    seconds = time.perf_counter() - began
    return MadeMap(rule, mapped, mapped.audit(how.audit_points, how.seed), "", seconds)


def _carried(trajectory: TrajectorySection, recording: Recording, before: Array, maps: list[MadeMap]) -> CarriedPath:
    after = {made.rule: made.mapped(before) for made in maps if made.mapped is not None}
    return CarriedPath(trajectory.name, recording.time, before, after)


def _notes(sets: dict[End, MappedSet], directions: list[MapDirection], recordings: list[Recording]) -> Iterator[str]:
    sections = [sets["source"].section, sets["target"].section]
    for section in sections[:1] if sections[0] == sections[1] else sections:
        yield from plane_notes(
            section, {of.name: of.reached.workspace for of in sets.values() if of.section == section}
        )
    for direction in directions:
        where = f"{direction.start.name} -> {direction.end.name}"
        for made in direction.maps:
            for reason in made.audit.reasons if made.audit is not None else (made.reason,):
                yield f"{where}, {made.rule} rule, NOT FOR A CONTROLLER: {reason}"
        for path in direction.paths:
            yield from _outside(path.name, path.before, direction.start)
    for recording in recordings:
        yield from (f"{recording.file}: {note}" for note in recording.notes)


def _outside(name: str, path: Array, start: MappedSet) -> Iterator[str]:
    away = ~np.asarray(start.reached.workspace.contains(path))
    if away.any():
        yield NotMet(
            f"{name}: {100 * away.mean():.1f} % of its samples lie outside {start.name}; the nearest point of the set "
            "is mapped in their place"
        )


def _sets(config: ProblemFile[WorkspaceMapProblem], progress: Progress) -> dict[End, MappedSet]:
    said = {end: arm_of_set(config.problem, end) for end in ENDS}
    return {
        end: MappedSet(of.name, of.section, reached(of.section, of.ranges, file=config.file, key=of.key))
        for end, of in with_progress(progress, "workspaces", list(said.items()))
    }


def direction_metrics(direction: MapDirection) -> dict[str, Any]:
    """Each rule's map, and what it does to the trajectories."""
    return {
        "from": direction.start.name,
        "to": direction.end.name,
        **{made.rule: map_metrics(made) for made in direction.maps},
        "trajectories": {path.name: _path_metrics(path, direction) for path in direction.paths},
    }


def map_metrics(made: MadeMap) -> dict[str, Any]:
    """The audit of a map; the stretches also relative to the pair's overall ratio."""
    if made.mapped is None or made.audit is None:
        return {"passed": False, "reasons": [made.reason]}
    audit, proof = made.audit, made.audit.certificate
    return {
        "passed": audit.passed,
        "reasons": list(audit.reasons),
        "samples": audit.samples,
        "folded_fraction": audit.folded,
        "outside_fraction": audit.outside,
        "stretch_max": finite(audit.max_stretch),
        "stretch_min": finite(audit.min_stretch),
        "overall_ratio": audit.overall_ratio,
        "stretch_max_relative": finite(audit.max_stretch / audit.overall_ratio),
        "stretch_min_relative": finite(audit.min_stretch / audit.overall_ratio),
        "round_trip_max_m": finite(audit.round_trip),
        "coverage_fraction": audit.coverage,
        "target_accuracy_m": audit.target_accuracy,
        "coefficients": made.mapped.spline.parameters,
        "rotation_deg": math.degrees(made.mapped.rotation),
        "certificate": {
            "valid": bool(proof.valid),
            "determinant_min": finite(proof.determinant),
            "margin_m": finite(proof.margin),
            "outline_simple": bool(proof.outline_simple),
            "cells": proof.cells,
            "reason": proof.reason,
        },
        "seconds": made.seconds,
    }


def _path_metrics(path: CarriedPath, direction: MapDirection) -> dict[str, Any]:
    inside = np.asarray(direction.start.reached.workspace.contains(path.before))
    numbers: dict[str, Any] = {
        "samples": len(path.before),
        "outside_start_fraction": float(np.mean(~inside)),
        "length_before_m": path_length(path.before),
    }
    for made in direction.maps:
        if made.mapped is None:
            continue
        after = path.after[made.rule]
        numbers[made.rule] = {
            "length_after_m": path_length(after),
            "outside_end_fraction": float(np.mean(~np.asarray(direction.end.reached.workspace.contains(after)))),
            "folded_fraction": float(np.mean(~(np.linalg.det(made.mapped.jacobian(path.before)) > 0))),
        }
    return numbers


class WorkspaceMapSystem(System[WorkspaceMapProblem, MapOutcome]):
    """Maps between two workspaces."""

    schema = WorkspaceMapProblem

    def figures(self, outcome: Any) -> dict[str, Any]:
        """The figures by file name, without suffix."""
        from rehab_opt.session.workspace_maps.shown import figures  # noqa: PLC0415  (draws)

        return figures(outcome)

    def recordings(self, problem: WorkspaceMapProblem) -> tuple[Needed, ...]:
        """The trajectories."""
        return tuple(
            Needed(f"trajectory.{i}.recording.file", trajectory.recording.file)
            for i, trajectory in enumerate(problem.trajectory)
        )

    def columns(self, outcome: MapOutcome) -> Mapping[str, Mapping[str, Any]]:
        """A column for each direction and rule."""
        return {
            f"{direction.start.name} -> {direction.end.name}\n{made.rule} rule": outcome.metrics["maps"][direction.key][
                made.rule
            ]
            for direction in outcome.directions
            for made in direction.maps
        }

    def caption(self, outcome: MapOutcome) -> str:
        """The sets; the notes say why a map is refused."""
        sets = outcome.metrics["sets"].values()
        areas = "; ".join(f"{numbers['name']} {1e4 * numbers['area_m2']:.4g} cm^2" for numbers in sets)
        return f"{areas}. Passed: the map may go to a controller; the notes say why one is refused"

    def check(self, config: ProblemFile[WorkspaceMapProblem]) -> tuple[str, ...]:
        """Reads the trajectories, finds the sets."""
        problem = config.problem
        placed = [placed_trajectory(config, i) for i in range(len(problem.trajectory))]
        sets = _sets(config, lambda *_: None)
        _made("polar", "source", sets, problem.map, file=config.file)  # refuses sets
        return (
            *(f"{of.file}: {note}" for of, _ in placed for note in (*of.notes, size_note(of))),
            *(
                note
                for trajectory, (_, path) in zip(problem.trajectory, placed, strict=True)
                for note in _outside(trajectory.name, path, sets[trajectory.set])
            ),
        )

    def run(
        self, config: ProblemFile[WorkspaceMapProblem], *, options: Mapping[str, str], progress: Progress
    ) -> MapOutcome:
        """No options."""
        problem = config.problem
        placed = [placed_trajectory(config, i) for i in range(len(problem.trajectory))]
        sets = _sets(config, progress)
        starts = ENDS if problem.map.directions == "both" else ENDS[:1]
        made: dict[End, list[MadeMap]] = {start: [] for start in starts}
        for start, rule in with_progress(progress, "maps", list(product(starts, problem.map.rules))):
            made[start].append(_made(rule, start, sets, problem.map, file=config.file))
        directions: list[MapDirection] = []
        for start, maps in made.items():
            paths = [
                _carried(trajectory, *recorded, maps)
                for trajectory, recorded in zip(problem.trajectory, placed, strict=True)
                if trajectory.set == start
            ]
            directions.append(
                MapDirection(f"{start}_to_{OTHER[start]}", sets[start], sets[OTHER[start]], tuple(maps), tuple(paths))
            )
        return MapOutcome(
            notes=tuple(_notes(sets, directions, [recording for recording, _ in placed])),
            metrics={
                "sets": {
                    end: {"name": of.name, **workspace_metrics(of.reached.workspace), "seconds": of.reached.seconds}
                    for end, of in sets.items()
                },
                "maps": {direction.key: direction_metrics(direction) for direction in directions},
            },
            directions=tuple(directions),
        )
