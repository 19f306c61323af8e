"""What is found of where an arm reaches."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from rehab_opt.session.outcome import Outcome
from rehab_opt.session.workspaces.reached import Reached
from rehab_opt.session.workspaces.sections import ArmInPlane
from rehab_opt.workspace.volume import ReachableVolume

__all__ = ["WorkspaceOutcome"]


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
