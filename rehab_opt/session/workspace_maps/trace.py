"""The columns of trace.csv of maps: trajectories before and after."""

from __future__ import annotations

import math
from collections.abc import Iterator

from rehab_opt.session.systems import Column
from rehab_opt.session.workspace_maps.outcome import MapOutcome

__all__ = ["trajectory_columns"]


def trajectory_columns(outcome: MapOutcome) -> Iterator[Column]:
    """One row a sample; a rule without a map has NaN."""
    paths = [(direction, path) for direction in outcome.directions for path in direction.paths]
    yield "trajectory", tuple(path.name for _, path in paths for _ in path.time)
    yield "from", tuple(direction.start.name for direction, path in paths for _ in path.time)
    yield "to", tuple(direction.end.name for direction, path in paths for _ in path.time)
    yield "t_s", [t for _, path in paths for t in path.time.tolist()]
    for k, axis in enumerate("xy"):
        yield f"before_{axis}_m", [value for _, path in paths for value in path.before[:, k].tolist()]
    for rule in sorted({made.rule for direction in outcome.directions for made in direction.maps}, reverse=True):
        for k, axis in enumerate("xy"):
            cells: list[float] = []
            for _, path in paths:
                after = path.after.get(rule)
                cells += after[:, k].tolist() if after is not None else [math.nan] * len(path.time)
            yield f"{rule}_after_{axis}_m", cells
