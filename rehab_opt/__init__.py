"""rehab_opt: controllers for rehabilitation and assistive robots, each posed as an optimisation problem."""

from rehab_opt.control.command import Bound, Command, Status
from rehab_opt.control.pose_tracker import PoseTracker
from rehab_opt.errors import ConfigurationError, ProblemFileError, RehabOptError
from rehab_opt.kinematics.chain import DH, SerialChain
from rehab_opt.kinematics.human_arm import human_arm
from rehab_opt.kinematics.ur5 import ur5

__all__ = [
    "DH",
    "Bound",
    "Command",
    "ConfigurationError",
    "PoseTracker",
    "ProblemFileError",
    "RehabOptError",
    "SerialChain",
    "Status",
    "human_arm",
    "ur5",
]
