"""Workspaces and maps that several test files look at; each is made once."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from shapely import Polygon, box

from rehab_opt import human_arm
from rehab_opt.session.workspaces import reached
from rehab_opt.workspace.mapping import WorkspaceMap
from rehab_opt.workspace.region import Workspace


def workspace(polygon: Polygon, accuracy: float = 0.0) -> Workspace:
    return Workspace(polygon, accuracy=accuracy)


def crescent() -> Polygon:
    """Two sharp tips; the centroid's rays leave it more than once."""
    angle = np.linspace(0.0, 2.0 * np.pi, 129)[:-1]
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    return Polygon(0.30 * circle).difference(Polygon(0.28 * circle + [0.12, -0.12]))


def blob() -> Polygon:
    angle = np.linspace(0.0, 2.0 * np.pi, 91)[:-1]
    radius = 0.06 * (1.0 + 0.1 * np.cos(2.0 * angle + 1.0) + 0.05 * np.cos(3.0 * angle))
    return Polygon(radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]) + [0.5, 0.2])


def ell() -> Polygon:
    return Polygon([(0.0, 0.0), (0.3, 0.0), (0.3, 0.1), (0.1, 0.1), (0.1, 0.3), (0.0, 0.3)])


def sliver() -> Polygon:
    """Ten times as long as wide."""
    return box(0.0, 0.0, 0.4, 0.04)


@cache
def table_one(name: str) -> Workspace:
    """Asked for where problem files ask, which is searched once in a run: see `workspaces_once`."""
    return reached.planar_workspace(human_arm(range_of_motion=name))


@cache
def shape(name: str) -> Workspace:
    if name in {"regular", "restricted", "figure_3"}:
        return table_one(name)
    return workspace({"crescent": crescent, "blob": blob, "ell": ell, "sliver": sliver}[name]())


@cache
def mapped(source: str, target: str, **options: Any) -> WorkspaceMap:
    return WorkspaceMap.between(shape(source), shape(target), **options)
