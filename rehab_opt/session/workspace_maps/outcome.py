"""What is found of maps between two workspaces."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rehab_opt.session.arm_keys import ArmInPlane
from rehab_opt.session.outcome import Column, Outcome
from rehab_opt.session.workspaces.reached import Reached
from rehab_opt.workspace.audit import Audit
from rehab_opt.workspace.mapping import WorkspaceMap

__all__ = ["CarriedPath", "MadeMap", "MapDirection", "MapOutcome", "MappedSet"]

Array = NDArray[np.float64]


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
