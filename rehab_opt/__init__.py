"""rehab_opt: controllers for rehabilitation and assistive robots, each posed as an optimisation problem."""

import importlib
from typing import TYPE_CHECKING, Any

from rehab_opt.control.arm_ik import ArmIK, IKPath, IKSolution
from rehab_opt.control.command import Command, Relaxed, Status
from rehab_opt.control.pose_tracker import PoseTracker
from rehab_opt.control.smoother import Smoother
from rehab_opt.control.smoothing import smooth_path
from rehab_opt.errors import (
    ConfigurationError,
    DeviceLostError,
    ProblemFileError,
    RehabOptError,
    RobotFileError,
    SharingError,
)
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.kinematics.denavit_hartenberg import DH
from rehab_opt.kinematics.human_arm import human_arm
from rehab_opt.kinematics.link import Link
from rehab_opt.kinematics.link_capsules import Capsule, CapsuleOnLink, LinkCapsule
from rehab_opt.kinematics.ur5 import ur5
from rehab_opt.version import __version__ as __version__

if TYPE_CHECKING:
    from rehab_opt import measures as measures
    from rehab_opt.control.assistance import Assistance
    from rehab_opt.control.bilateral import Bilateral
    from rehab_opt.control.bilateral_sides import HelperSide, ParticipantSide
    from rehab_opt.control.bounded_force import BoundedForce
    from rehab_opt.control.clearance import Clearance
    from rehab_opt.control.interaction import Interaction
    from rehab_opt.control.joystick import Joystick
    from rehab_opt.control.limit import Limit
    from rehab_opt.control.mirror import MirrorTracker
    from rehab_opt.control.path_assistance import PathAssistance
    from rehab_opt.control.redundancy import RedundancyResolver
    from rehab_opt.export.export_c import export_c
    from rehab_opt.field.demonstration import Demonstration
    from rehab_opt.field.potential import PotentialField
    from rehab_opt.kinematics.ardis import ardis
    from rehab_opt.kinematics.arm_on_chair import arm_on_chair
    from rehab_opt.kinematics.goniometer import (
        arm_posture,
        arm_range_of_motion,
        goniometer_angles,
        goniometer_range,
    )
    from rehab_opt.kinematics.room import Box, KeepOut, MovingCapsule, arm_capsules
    from rehab_opt.loop.log import Log
    from rehab_opt.loop.loop import Loop
    from rehab_opt.loop.records import Tick
    from rehab_opt.loop.shared_ring import SharedRing
    from rehab_opt.workspace.mapping import WorkspaceMap
    from rehab_opt.workspace.placement import ShoulderPlacement
    from rehab_opt.workspace.reach import planar_workspace
    from rehab_opt.workspace.region import Workspace
    from rehab_opt.workspace.spline import ThinPlateSpline
    from rehab_opt.workspace.used_range import range_of_motion
    from rehab_opt.workspace.variation import reachability_map
    from rehab_opt.workspace.volume import reachable_volume

__all__ = [
    "DH",
    "ArmIK",
    "Assistance",
    "Bilateral",
    "BoundedForce",
    "Box",
    "Capsule",
    "CapsuleOnLink",
    "Clearance",
    "Command",
    "ConfigurationError",
    "Demonstration",
    "DeviceLostError",
    "HelperSide",
    "IKPath",
    "IKSolution",
    "Interaction",
    "Joystick",
    "KeepOut",
    "Limit",
    "Link",
    "LinkCapsule",
    "Log",
    "Loop",
    "MirrorTracker",
    "MovingCapsule",
    "ParticipantSide",
    "PathAssistance",
    "PoseTracker",
    "PotentialField",
    "ProblemFileError",
    "RedundancyResolver",
    "RehabOptError",
    "Relaxed",
    "RobotFileError",
    "SerialChain",
    "SharedRing",
    "SharingError",
    "ShoulderPlacement",
    "Smoother",
    "Status",
    "ThinPlateSpline",
    "Tick",
    "Workspace",
    "WorkspaceMap",
    "ardis",
    "arm_capsules",
    "arm_on_chair",
    "arm_posture",
    "arm_range_of_motion",
    "export_c",
    "goniometer_angles",
    "goniometer_range",
    "human_arm",
    "measures",
    "planar_workspace",
    "range_of_motion",
    "reachability_map",
    "reachable_volume",
    "smooth_path",
    "ur5",
]

# Loaded when first named: a controller's process starts in a tenth of a second, and not everyone needs all of it.
_LATER = {
    "Assistance": "control.assistance",
    "Bilateral": "control.bilateral",
    "BoundedForce": "control.bounded_force",
    "Box": "kinematics.room",
    "Clearance": "control.clearance",
    "Demonstration": "field.demonstration",
    "HelperSide": "control.bilateral_sides",
    "Interaction": "control.interaction",
    "Joystick": "control.joystick",
    "KeepOut": "kinematics.room",
    "Limit": "control.limit",
    "Log": "loop.log",
    "Loop": "loop.loop",
    "MirrorTracker": "control.mirror",
    "MovingCapsule": "kinematics.room",
    "ParticipantSide": "control.bilateral_sides",
    "PathAssistance": "control.path_assistance",
    "PotentialField": "field.potential",
    "RedundancyResolver": "control.redundancy",
    "SharedRing": "loop.shared_ring",
    "ShoulderPlacement": "workspace.placement",
    "ThinPlateSpline": "workspace.spline",
    "Tick": "loop.records",
    "Workspace": "workspace.region",
    "WorkspaceMap": "workspace.mapping",
    "ardis": "kinematics.ardis",
    "arm_capsules": "kinematics.room",
    "arm_on_chair": "kinematics.arm_on_chair",
    "arm_posture": "kinematics.goniometer",
    "arm_range_of_motion": "kinematics.goniometer",
    "export_c": "export.export_c",
    "goniometer_angles": "kinematics.goniometer",
    "goniometer_range": "kinematics.goniometer",
    "planar_workspace": "workspace.reach",
    "range_of_motion": "workspace.used_range",
    "reachability_map": "workspace.variation",
    "reachable_volume": "workspace.volume",
}


def __getattr__(name: str) -> Any:
    if name == "measures":  # a package of functions that are told by its name
        return importlib.import_module(f"{__name__}.measures")
    if name not in _LATER:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"{__name__}.{_LATER[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(set(globals()) | set(__all__))
