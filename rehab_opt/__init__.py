"""rehab_opt: controllers for rehabilitation and assistive robots, each posed as an optimisation problem."""

import importlib
from typing import TYPE_CHECKING, Any

from rehab_opt.control.arm_ik import ArmIK, IKPath, IKSolution
from rehab_opt.control.command import Bound, Command, Status
from rehab_opt.control.pose_tracker import PoseTracker
from rehab_opt.control.smoothing import Smoother, smooth_path
from rehab_opt.errors import ConfigurationError, ProblemFileError, RehabOptError
from rehab_opt.kinematics.chain import DH, SerialChain
from rehab_opt.kinematics.human_arm import human_arm
from rehab_opt.kinematics.ur5 import ur5

if TYPE_CHECKING:
    from rehab_opt.control.assistance import Assistance
    from rehab_opt.field.potential import PotentialField
    from rehab_opt.workspace.mapping import WorkspaceMap
    from rehab_opt.workspace.placement import ShoulderPlacement
    from rehab_opt.workspace.reach import planar_workspace
    from rehab_opt.workspace.region import Workspace
    from rehab_opt.workspace.spline import ThinPlateSpline
    from rehab_opt.workspace.used_range import range_of_motion
    from rehab_opt.workspace.variation import reachability_map

__all__ = [
    "DH",
    "ArmIK",
    "Assistance",
    "Bound",
    "Command",
    "ConfigurationError",
    "IKPath",
    "IKSolution",
    "PoseTracker",
    "PotentialField",
    "ProblemFileError",
    "RehabOptError",
    "SerialChain",
    "ShoulderPlacement",
    "Smoother",
    "Status",
    "ThinPlateSpline",
    "Workspace",
    "WorkspaceMap",
    "human_arm",
    "planar_workspace",
    "range_of_motion",
    "reachability_map",
    "smooth_path",
    "ur5",
]

# Loaded when first named: a controller's process starts in a tenth of a second, and not everyone maps workspaces.
_LATER = {
    "Assistance": "control.assistance",
    "PotentialField": "field.potential",
    "ShoulderPlacement": "workspace.placement",
    "ThinPlateSpline": "workspace.spline",
    "Workspace": "workspace.region",
    "WorkspaceMap": "workspace.mapping",
    "planar_workspace": "workspace.reach",
    "range_of_motion": "workspace.used_range",
    "reachability_map": "workspace.variation",
}


def __getattr__(name: str) -> Any:
    if name not in _LATER:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"{__name__}.{_LATER[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(set(globals()) | set(__all__))
