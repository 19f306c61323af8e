"""rehab_opt: controllers for rehabilitation and assistive robots, each posed as an optimisation problem."""

from rehab_opt.control.arm_ik import ArmIK, IKPath, IKSolution
from rehab_opt.control.command import Bound, Command, Status
from rehab_opt.control.pose_tracker import PoseTracker
from rehab_opt.control.smoothing import Smoother, smooth_path
from rehab_opt.errors import ConfigurationError, ProblemFileError, RehabOptError
from rehab_opt.kinematics.chain import DH, SerialChain
from rehab_opt.kinematics.human_arm import human_arm
from rehab_opt.kinematics.ur5 import ur5
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
    "Bound",
    "Command",
    "ConfigurationError",
    "IKPath",
    "IKSolution",
    "PoseTracker",
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
