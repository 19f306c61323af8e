"""rehab_opt: controllers for rehabilitation and assistive robots, each posed as an optimisation problem."""

from rehab_opt.control.arm_ik import ArmIK, IKPath, IKSolution
from rehab_opt.control.command import Bound, Command, Status
from rehab_opt.control.joystick import Joystick
from rehab_opt.control.pose_tracker import PoseTracker
from rehab_opt.control.redundancy import RedundancyResolver
from rehab_opt.control.smoothing import Smoother, smooth_path
from rehab_opt.errors import ConfigurationError, ProblemFileError, RehabOptError
from rehab_opt.kinematics.ardis import ardis
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
    "Joystick",
    "PoseTracker",
    "ProblemFileError",
    "RedundancyResolver",
    "RehabOptError",
    "SerialChain",
    "Smoother",
    "Status",
    "ardis",
    "human_arm",
    "smooth_path",
    "ur5",
]
