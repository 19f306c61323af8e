"""`system = "workspace_map"`: maps of one workspace onto another, by our safe rule and by the published rule."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from itertools import product
from typing import Any

import numpy as np

from rehab_opt.measures.path import path_length
from rehab_opt.recordings.recording import Recording, size_note
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.outcome import Array, Names, Outcome, Progress, finite, with_progress
from rehab_opt.session.participant import placed_recording
from rehab_opt.session.systems import NotMet, System
from rehab_opt.session.trace import Trace
from rehab_opt.session.workspace_maps.made import ENDS, Direction, MadeMap, mapped_set
from rehab_opt.session.workspace_maps.problem import WorkspaceMapProblem
from rehab_opt.session.workspaces.reached import reached
from rehab_opt.session.workspaces.scene import plane_notes, workspace_metrics
from rehab_opt.workspace.region import Workspace

Config = ProblemFile[WorkspaceMapProblem]
XY = ("x_m", "y_m")


def placed_trajectory(config: Config, index: int) -> tuple[Recording, Array]:
    """Recording of a trajectory, and its path (N, 2) [m] in the frame of its set; raises as `placed_recording`."""
    trajectory = config.problem.trajectory[index]
    section = mapped_set(config.problem, trajectory.set).section
    recording, path = placed_recording(
        config,
        trajectory.recording,
        trajectory.placement,
        side=section.side,
        rate=trajectory.rate_hz,
        keys=f"trajectory.{index}.",
    )
    return recording, path[:, :2]


class MappedSets:
    """The scene of a `WorkspaceMapProblem`: two sets, and trajectories in them."""

    def __init__(self, config: Config) -> None:
        problem = self.problem = config.problem
        self.file, self.sets = config.file, [mapped_set(problem, end) for end in ENDS]
        self.placed = [placed_trajectory(config, i) for i in range(len(problem.trajectory))]
        self.starts = (0, 1) if problem.map.directions == "both" else (0,)

    def spaces(self, progress: Progress = lambda *_: None) -> list[Workspace]:
        """Compute the workspaces of source and target."""
        return [of.workspace for of in self._found(progress)]

    def _found(self, progress: Progress) -> list[Any]:
        sets = with_progress(progress, "workspaces", self.sets)
        return [reached(of.section, of.ranges, file=self.file, key=of.key) for of in sets]

    def run(self, progress: Progress = lambda *_: None) -> Trace:
        """Trace with one row for each sample of a trajectory; mapped samples are NaN for a rule without a map.

        The column `_map` has the maps, as an array (directions, rules).
        """
        found, rules = self._found(progress), self.problem.map.rules
        spaces = [of.workspace for of in found]
        pairs = list(product(self.starts, rules))
        made = [
            MadeMap(self.problem.map, self.sets, spaces, start=start, rule=rule, file=self.file)
            for start, rule in with_progress(progress, "maps", pairs)
        ]
        maps = np.array(made).reshape(len(self.starts), len(rules))
        order = sorted(range(len(self.placed)), key=lambda i: ENDS.index(self.problem.trajectory[i].set))
        rows = []
        for i in order:
            trajectory, (recording, before) = self.problem.trajectory[i], self.placed[i]
            start = ENDS.index(trajectory.set)
            n, nowhere = len(before), np.full_like(before, math.nan)
            after = [nowhere if each.mapped is None else each.mapped(before) for each in maps[start]]
            names = trajectory.name, self.sets[start].name, self.sets[1 - start].name
            rows.append([*(np.repeat(name, n) for name in names), recording.time, before, *after])
        after_names = [f"{rule}_after" for rule in rules]
        columns_of = ["trajectory", "from", "to", "t_s", "before", *after_names]
        empty = [np.empty(0)] * 4 + [np.empty((0, 2))] * (1 + len(rules))
        columns = [np.concatenate(of) for of in zip(*rows, strict=True)] if rows else empty
        kept = {"_map": maps, "_space": spaces, "_seconds": [of.seconds for of in found]}
        return Trace(dict(zip(columns_of, columns, strict=True)) | kept, dict.fromkeys(["before", *after_names], XY))

    def directions(self, trace: Trace) -> Iterator[Direction]:
        """The maps and paths of a trace for each direction."""
        for start, maps in zip(self.starts, trace["_map"], strict=True):
            end = 1 - start
            names = [each.name for each in self.problem.trajectory if each.set == ENDS[start]]
            rows = {name: trace["trajectory"] == name for name in names}
            known = [each.rule for each in maps if each.mapped is not None]
            yield Direction(
                f"{ENDS[start]}_to_{ENDS[end]}",
                self.sets[start],
                self.sets[end],
                trace["_space"][start],
                trace["_space"][end],
                maps.tolist(),
                {name: trace["before"][at] for name, at in rows.items()},
                {rule: {name: trace[f"{rule}_after"][at] for name, at in rows.items()} for rule in known},
            )

    def numbers(self, trace: Trace) -> dict[str, Any]:
        """Metrics of both sets, of each rule's maps, and of the mapped trajectories."""
        sets = zip(ENDS, self.sets, trace["_space"], trace["_seconds"].tolist(), strict=True)
        return {
            "sets": {end: {"name": of.name, **workspace_metrics(space), "seconds": t} for end, of, space, t in sets},
            "maps": {
                each.key: {
                    "from": each.start.name,
                    "to": each.end.name,
                    **{made.rule: map_metrics(made) for made in each.maps},
                    "trajectories": {name: _path_metrics(name, each) for name in each.before},
                }
                for each in self.directions(trace)
            },
        }

    def notes(self, trace: Trace) -> Iterator[str]:
        """Notes on the plane, on maps that a controller must not use, and on trajectories that leave their set."""
        sections, spaces = [of.section for of in self.sets], trace["_space"]
        for section in sections[:1] if sections[0] == sections[1] else sections:
            of_it = zip(self.sets, spaces, strict=True)
            yield from plane_notes(section, {of.name: space for of, space in of_it if of.section == section})
        for each in self.directions(trace):
            for made in each.maps:
                for reason in made.audit.reasons if made.audit is not None else (made.reason,):
                    where = f"{each.start.name} -> {each.end.name}"
                    yield f"{where}, {made.rule} rule, NOT FOR A CONTROLLER: {reason}"
            for name, path in each.before.items():
                yield from _outside(name, path, each.start.name, each.start_space)
        for recording, _ in self.placed:
            yield from (f"{recording.file}: {note}" for note in recording.notes)


def _outside(name: str, path: Array, start: str, space: Workspace) -> Iterator[str]:
    away = ~np.asarray(space.contains(path))
    if away.any():
        yield NotMet(
            f"{name}: {100 * away.mean():.1f} % of the samples lie outside {start}; for each of them, the nearest "
            "point of the set is mapped"
        )


def map_metrics(made: MadeMap) -> dict[str, Any]:
    """Metrics of a map's audit; stretches are given absolutely and relative to the overall ratio of the two sets."""
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


def _path_metrics(name: str, of: Direction) -> dict[str, Any]:
    before = of.before[name]
    numbers: dict[str, Any] = {
        "samples": len(before),
        "outside_start_fraction": float(np.mean(~np.asarray(of.start_space.contains(before)))),
        "length_before_m": path_length(before),
    }
    for made in of.maps:
        if made.mapped is not None:
            after = of.after[made.rule][name]
            numbers[made.rule] = {
                "length_after_m": path_length(after),
                "outside_end_fraction": float(np.mean(~np.asarray(of.end_space.contains(after)))),
                "folded_fraction": float(np.mean(~(np.linalg.det(made.mapped.jacobian(before)) > 0))),
            }
    return numbers


class WorkspaceMapSystem(System[WorkspaceMapProblem, MappedSets]):
    """System of maps between two workspaces."""

    schema = WorkspaceMapProblem
    drawing = "rehab_opt.session.workspace_maps.figures"

    def scenes(self, config: Config, options: Mapping[str, str]) -> dict[Names, MappedSets]:
        """One scene with both directions; the maps of the two directions are not inverse to each other."""
        return {(): MappedSets(config)}

    def columns(self, outcome: Outcome) -> Mapping[str, Mapping[str, Any]]:
        """Columns of the table, one for each direction and rule."""
        return {
            f"{of['from']} -> {of['to']}\n{rule} rule": numbers
            for of in outcome.metrics["maps"].values()
            for rule, numbers in of.items()
            if rule not in {"from", "to", "trajectories"}
        }

    def caption(self, outcome: Outcome) -> str:
        """Caption of the table: the areas of both sets, and the meaning of "passed"."""
        sets = outcome.metrics["sets"].values()
        areas = "; ".join(f"{numbers['name']} {1e4 * numbers['area_m2']:.4g} cm^2" for numbers in sets)
        return f"{areas}. Passed: a controller may use the map; if not, the notes give the reasons"

    def check(self, config: Config) -> tuple[str, ...]:
        """Read the trajectories and compute both sets; report samples outside their set."""
        scene = MappedSets(config)
        spaces = scene.spaces()
        MadeMap(config.problem.map, scene.sets, spaces, start=0, rule="polar", file=config.file)  # checks the sets
        said = [f"{of.file}: {note}" for of, _ in scene.placed for note in (*of.notes, size_note(of))]
        for trajectory, (_, path) in zip(config.problem.trajectory, scene.placed, strict=True):
            at = ENDS.index(trajectory.set)
            said += _outside(trajectory.name, path, scene.sets[at].name, spaces[at])
        return tuple(said)
