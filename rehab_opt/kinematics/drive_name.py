"""The drives of a base by name; apart, since problem files are read without CasADi."""

from __future__ import annotations

from typing import Literal, get_args

__all__ = ["DRIVES", "DriveName"]

DriveName = Literal["mecanum", "differential", "omnidirectional", "fixed"]
DRIVES: tuple[DriveName, ...] = get_args(DriveName)
