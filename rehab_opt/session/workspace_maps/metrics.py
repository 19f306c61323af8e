"""Numbers of maps between workspaces."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rehab_opt.session.metrics import finite
from rehab_opt.session.workspace_maps.outcome import CarriedPath, MadeMap, MapDirection, MappedSet
from rehab_opt.session.workspaces.run import workspace_metrics

__all__ = ["direction_metrics", "map_metrics", "mapped_set_metrics"]

Array = NDArray[np.float64]


def mapped_set_metrics(of: MappedSet) -> dict[str, Any]:
    """A set and its name."""
    return {"name": of.name, **workspace_metrics(of.reached.workspace), "seconds": of.reached.seconds}


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
        "folded_share": audit.folded,
        "outside_share": audit.outside,
        "stretch_max": finite(audit.largest_stretch),
        "stretch_min": finite(audit.smallest_stretch),
        "overall_ratio": audit.overall_ratio,
        "stretch_max_relative": finite(audit.largest_stretch / audit.overall_ratio),
        "stretch_min_relative": finite(audit.smallest_stretch / audit.overall_ratio),
        "round_trip_max_m": finite(audit.round_trip),
        "coverage_share": audit.coverage,
        "target_accuracy_m": audit.target_accuracy,
        "landmarks": len(made.mapped.spline.source),
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
        "outside_start_share": float(np.mean(~inside)),
        "length_before_m": _length(path.before),
    }
    for made in direction.maps:
        if made.mapped is None:
            continue
        after = path.after[made.rule]
        numbers[made.rule] = {
            "length_after_m": _length(after),
            "outside_end_share": float(np.mean(~np.asarray(direction.end.reached.workspace.contains(after)))),
            "folded_share": float(np.mean(~(np.linalg.det(made.mapped.jacobian(path.before)) > 0))),
        }
    return numbers


def _length(points: Array) -> float:
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
