"""The columns of trace.csv of workspaces: their boundaries, vertex by vertex."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from rehab_opt.session.systems import Column
from rehab_opt.workspace.region import Workspace

__all__ = ["boundary_columns", "rings"]


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
