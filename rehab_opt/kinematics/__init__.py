"""What moves: serial chains from Denavit-Hartenberg rows, the human arm, the UR5."""

from typing import Literal, get_args

DriveName = Literal["mecanum", "differential", "omnidirectional", "fixed"]
"""Of a base; here, since problem files are read without CasADi."""
DRIVES: tuple[DriveName, ...] = get_args(DriveName)
