"""The boundary of a workspace as a table of C."""

from __future__ import annotations

from rehab_opt.errors import ConfigurationError
from rehab_opt.export.c_text import initialiser
from rehab_opt.workspace.edge_table import doubtful_edges, edge_table
from rehab_opt.workspace.region import Workspace

__all__ = ["edge_rows"]

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
