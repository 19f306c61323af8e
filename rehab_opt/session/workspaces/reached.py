"""Reachable workspace of a problem's arm, and texts that describe the plane and the handle."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from typing import Any, NamedTuple

from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.session.arm_keys import ArmInPlane
from rehab_opt.session.participant import AnyRange, arm_of
from rehab_opt.session.refusals import refused_as
from rehab_opt.session.trace import Trace
from rehab_opt.workspace.placement import ShoulderPlacement
from rehab_opt.workspace.reach import planar_workspace
from rehab_opt.workspace.region import Workspace

KEYS = {"height": "plane_height_m", "handle_tilt": "handle_tilt_deg", "accuracy": "accuracy_mm"}


class Reached(NamedTuple):
    """A reachable workspace, the arm, and the computing time [s]."""

    arm: SerialChain
    workspace: Workspace
    seconds: float


def reached(section: ArmInPlane, ranges: AnyRange, *, file: str, key: str) -> Reached:
    """Reachable workspace of an arm with a range of motion; error messages call the arm's table `key`.

    Raises
    ------
    ProblemFileError : a value of the problem file is invalid.
    """
    arm = arm_of(section.side, section.segments, ranges, file=file, key=key)
    began = time.perf_counter()
    with refused_as(file, lambda name: f"{key}.{KEYS.get(name, name)}"):
        workspace = planar_workspace(arm, **plane_of(section))
    return Reached(arm, workspace, time.perf_counter() - began)


def plane_of(section: ArmInPlane) -> dict[str, Any]:
    """Arguments of `planar_workspace`: the plane, the handle's tilt, the shoulder's position and the accuracy."""
    return {
        "height": section.plane_height_m,
        "handle_tilt": tilt_of(section),
        "placement": placement_of(section),
        **section.arguments("accuracy_mm"),
    }


def tilt_of(section: ArmInPlane) -> float | None:
    """Largest tilt of the handle [rad]; None for no limit."""
    return None if isinstance(section.handle_tilt_deg, str) else math.radians(section.handle_tilt_deg)


def placement_of(section: ArmInPlane) -> ShoulderPlacement:
    """Position and rotation of the shoulder in the robot's frame."""
    x, y, z = section.shoulder_m
    return ShoulderPlacement((x, y, z), math.radians(section.shoulder_turn_deg))


def plane_words(section: ArmInPlane) -> str:
    """Text with the height of the plane relative to the shoulder."""
    height = section.plane_height_m
    return f"{abs(height):g} m {'above' if height > 0 else 'below'} the shoulder"


def handle_words(section: ArmInPlane) -> str:
    """Text with the limit of the handle's tilt."""
    tilt = section.handle_tilt_deg
    return (
        "the handle may tilt freely" if isinstance(tilt, str) else f"the handle within {tilt_words(tilt)} of vertical"
    )


def tilt_words(tilt: str | float) -> str:
    """Text with the largest tilt [deg] of the handle."""
    return "any" if isinstance(tilt, str) else f"{tilt:g} deg"


def sets_of(trace: Trace) -> dict[str, Workspace]:
    """The workspaces of a trace, by the name of their range of motion."""
    return dict(zip(trace["_range"].tolist(), trace["_workspace"], strict=True))


def rings(workspace: Workspace) -> Iterator[tuple[int, int, Any]]:
    """Component, ring and vertices [m] of each closed boundary line; the first vertex is repeated at the end."""
    if workspace.empty:
        return
    for component, part in enumerate(getattr(workspace.polygon, "geoms", (workspace.polygon,)), start=1):
        for ring, line in enumerate((part.exterior, *part.interiors)):
            yield component, ring, list(line.coords)
