"""Names of what a hand can be asked for, and of the frames to ask in."""

from __future__ import annotations

from collections.abc import Sequence

from rehab_opt.errors import ConfigurationError

__all__ = ["FRAMES", "ROWS", "checked_rows", "frame_number"]

ROWS = ("x", "y", "z", "rx", "ry", "rz", "roll7")
"""Task rows: hand velocity along and about the axes of the chosen frame, and about the wrist's own axis z7."""
FRAMES = {"chassis": 0.0, "world": 1.0}


def frame_number(frame: str) -> float:
    """The parameter that says in which frame rows are meant: 0 in the chassis frame, 1 in the world's."""
    world = FRAMES.get(frame) if isinstance(frame, str) else None
    if world is None:
        raise ConfigurationError("frame", frame, "chassis or world")
    return world


def checked_rows(rows: Sequence[str], argument: str = "rows") -> tuple[str, ...]:
    """Rows that can be asked for together; `argument` is whose they are, one set of them where it has several."""
    names = tuple(rows) if isinstance(rows, (tuple, list)) else ()
    known = all(isinstance(name, str) and name in ROWS for name in names)
    if not names or not known or len(set(names)) != len(names):
        raise ConfigurationError(argument, rows, f"a tuple of different ones of {', '.join(ROWS)}")
    if {"rx", "ry", "rz", "roll7"} <= set(names):
        raise ConfigurationError(argument, rows, "roll7, or all of rx, ry and rz, which say it already")
    return names
