"""The boundary of a workspace as a table of C, and what brings a hand back into it."""

from __future__ import annotations

from rehab_opt.errors import ConfigurationError
from rehab_opt.export.c_text import filled, initialiser, number
from rehab_opt.workspace.edge_table import doubtful_edges, edge_table
from rehab_opt.workspace.region import Workspace

__all__ = ["edge_rows", "pull_back"]

NEAR = 1e-9
"""[m] Edges nearer than this to one another may be mistaken for each other."""


def edge_rows(workspace: Workspace, argument: str) -> str:
    """Initialisers of its edges.

    Raises
    ------
    ConfigurationError : rings that touch, slivers or spikes, of which Python asks shapely on which side a point is.
    """
    table = edge_table(workspace.polygon)
    if doubtful_edges(table, NEAR).any():
        raise ConfigurationError(argument, workspace.polygon.wkt[:60], "no rings that touch, no slivers, no spikes")
    return ",\n".join(f"    {initialiser(row)}" for row in table.tolist())


def pull_back(stiffness: float, force: float, *, name: str) -> str:
    """C of the function `pull_back`: of a stiffness [N/m] and at most a force [N]."""
    bounds = {"return_stiffness": number(stiffness), "return_force": number(force)}
    return filled("pull_back.c", {"name": name, **bounds})
