"""Kinematics: serial chains from Denavit-Hartenberg rows, the human arm, the UR5."""

from typing import Literal, get_args

DriveName = Literal["mecanum", "differential", "omnidirectional", "fixed"]
"""Kind of drive under a base. Defined here so that problem files can be read without CasADi."""
DRIVES: tuple[DriveName, ...] = get_args(DriveName)
