"""rehab_opt: controllers for rehabilitation and assistive robots, each posed as an optimisation problem."""

from rehab_opt.control.arm_ik import ArmIK, IKPath, IKSolution
from rehab_opt.control.command import Bound, Command, Status
from rehab_opt.control.hand_bounds import KeepOut
from rehab_opt.control.interaction import Interaction
from rehab_opt.control.mirror import MirrorTracker
from rehab_opt.control.pose_tracker import PoseTracker
from rehab_opt.control.smoothing import Smoother, smooth_path
from rehab_opt.errors import ConfigurationError, ProblemFileError, RehabOptError
from rehab_opt.kinematics.chain import DH, SerialChain
from rehab_opt.kinematics.human_arm import human_arm
from rehab_opt.kinematics.ur5 import ur5

__all__ = [
    "DH",
    "ArmIK",
    "Bound",
    "Command",
    "ConfigurationError",
    "IKPath",
    "IKSolution",
    "Interaction",
    "KeepOut",
    "MirrorTracker",
    "PoseTracker",
    "ProblemFileError",
    "RehabOptError",
    "SerialChain",
    "Smoother",
    "Status",
    "human_arm",
    "smooth_path",
    "ur5",
]
