"""Folder of recordings that are not shipped with rehab_opt, and the error message if a recording is missing."""

from __future__ import annotations

import os
from pathlib import Path, PurePosixPath

from rehab_opt.errors import ProblemFileError

__all__ = ["ENVIRONMENT", "PREFIX", "data_file", "data_folder"]

ENVIRONMENT = "REHAB_OPT_DATA"
PREFIX = "data:"

ORIGINS = {
    "pen_trace": "BDALab/handwriting-sample (MIT), folder examples/svc_data",
    "upper_limb_mocap": "pyomeca/pyomeca (Apache-2.0), folder tests/data",
    "bids_examples": "bids-standard/bids-examples (CC0), folder emg_Multimodal/sub-01/motion",
    "cp_dyskinetic_reach": "IntiVM/SPM_UL_DyskineticCP (MIT), folder PART 2_NON-LINEAR_SPM",
    "vr_hand_tracker": "hai-vr/hvr-ik (Apache-2.0), folder Tooling/Training/Data",
}
"""GitHub repository, licence and source folder of each folder of recordings."""


def data_folder() -> Path:
    """Path of the folder of recordings, which may be missing: $REHAB_OPT_DATA or, by default, `../shared/data`."""
    named = os.environ.get(ENVIRONMENT)
    if named:
        return Path(named)
    return Path(__file__).resolve().parents[2].parent / "shared" / "data"


def data_file(reference: str, *, problem: str, key: str) -> Path:
    """Path of the file for a reference `data:folder/name`.

    Raises
    ------
    ProblemFileError : the file is missing (the message names its source), or the reference leads out of the folder.
    """
    inside = PurePosixPath(reference.removeprefix(PREFIX))
    if inside.is_absolute() or ".." in inside.parts or len(inside.parts) < 2:
        raise ProblemFileError(problem, key, reference, f"{PREFIX}folder/file")
    path = data_folder() / inside
    try:
        present = path.exists()
    except (OSError, ValueError):  # the name is invalid for a file
        present = False
    if not present:
        origin = ORIGINS.get(inside.parts[0])
        source = f" (from github.com/{origin})" if origin else ""
        expected = f"{inside}{source} in the folder named by {ENVIRONMENT}, or in ../shared/data beside the checkout"
        raise ProblemFileError(problem, key, reference, expected)
    if path.is_dir():
        raise ProblemFileError(problem, key, reference, "a file, this is a directory")
    return path
