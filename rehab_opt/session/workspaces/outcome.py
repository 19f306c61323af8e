"""What is found of where an arm reaches, and the boundaries as columns of trace.csv."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from rehab_opt.session.outcome import Column, Outcome
from rehab_opt.session.workspaces.reached import Reached
from rehab_opt.session.workspaces.sections import ArmInPlane
from rehab_opt.workspace.region import Workspace
from rehab_opt.workspace.volume import ReachableVolume

__all__ = ["WorkspaceOutcome", "boundary_columns", "rings"]


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
    yield "set", tuple(row[0] for row in rows)
    yield "component", [row[1] for row in rows]
    yield "ring", [row[2] for row in rows]
    yield "x_m", [row[3] for row in rows]
    yield "y_m", [row[4] for row in rows]


def rings(workspace: Workspace) -> Iterator[tuple[int, int, Any]]:
    """Component, ring and its vertices [m], the first one repeated at the end."""
    if workspace.empty:
        return
    for component, part in enumerate(getattr(workspace.polygon, "geoms", (workspace.polygon,)), start=1):
        for ring, line in enumerate((part.exterior, *part.interiors)):
            yield component, ring, list(line.coords)
