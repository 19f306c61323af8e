"""Whether only this user or root can have put what lies in a folder there: code is loaded from nowhere else."""

from __future__ import annotations

import os
import stat
from pathlib import Path

__all__ = ["exposed", "make_private", "owned"]

OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH
MODES = hasattr(os, "geteuid")  # Windows has neither owners nor modes that would tell; nothing is judged there


def make_private(folder: Path) -> None:
    """Make a folder, and those it is in, for this user alone."""
    for each in (*reversed(folder.parents), folder):
        each.mkdir(mode=0o700, exist_ok=True)


def exposed(folder: Path) -> str:
    """Why others could put code into an existing folder without links in its path (`Path.resolve`), or nothing.

    Others must be able to write neither to it nor to a folder above, where they could exchange it; above, a sticky one
    will do, as /tmp is. Then nothing they do between this check and the loading of a library makes a difference.
    """
    if not MODES:
        return ""
    for each in (folder, *folder.parents):
        state = each.lstat()
        if not stat.S_ISDIR(state.st_mode):
            return f"{each} is no folder"
        if not _own(state):
            return f"{each} belongs to user {state.st_uid}"
        if state.st_mode & OTHERS_WRITE and (each == folder or not state.st_mode & stat.S_ISVTX):
            return f"{each} may be written by others (mode {stat.S_IMODE(state.st_mode):04o})"
    return ""


def owned(file: int) -> bool:
    """Whether an open file is a plain one that this user or root wrote, and nobody else may change."""
    state = os.fstat(file)
    return stat.S_ISREG(state.st_mode) and (not MODES or (_own(state) and not state.st_mode & OTHERS_WRITE))


def _own(state: os.stat_result) -> bool:
    return state.st_uid in {0, os.geteuid()}
