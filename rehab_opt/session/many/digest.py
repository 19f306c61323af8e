"""What a result depends on, as one number: equal ones need no second computation."""

from __future__ import annotations

import hashlib
import importlib.metadata
import importlib.resources
import json
from functools import cache

from rehab_opt.session.file_limits import LARGEST_RECORDING
from rehab_opt.session.files import ProblemFile, recording_path
from rehab_opt.session.robot_file import robot_text
from rehab_opt.session.schema import Problem
from rehab_opt.session.systems import ROBOT_FILE, system_named
from rehab_opt.text_file import file_content

__all__ = ["inputs_digest", "software_digest"]

NUMERICS = ("casadi", "numpy", "scipy", "shapely")


def inputs_digest(loaded: ProblemFile[Problem]) -> str:
    """SHA-256 of a problem, its recordings, this library's source and the versions of what it computes with.

    Raises
    ------
    ProblemFileError : a recording is absent or cannot be read.
    """
    digest = hashlib.sha256(software_digest().encode())
    problem = loaded.problem
    said = {"name": loaded.name, "problem": problem.model_dump(mode="json")}
    digest.update(json.dumps(said, sort_keys=True).encode())
    for needed in system_named(problem.system).recordings(problem):
        if needed.key == ROBOT_FILE:
            digest.update(robot_text(loaded, needed.reference).encode())
            continue
        path = recording_path(loaded, needed.reference, key=needed.key)
        digest.update(file_content(path, needed.reference, largest=LARGEST_RECORDING))
    return digest.hexdigest()


@cache
def software_digest() -> str:
    """The source itself, not its version: a checkout changes without one."""
    digest = hashlib.sha256()
    with importlib.resources.as_file(importlib.resources.files("rehab_opt")) as package:
        for path in sorted(package.rglob("*.py")):
            digest.update(path.relative_to(package).as_posix().encode())
            digest.update(path.read_bytes())
    return " ".join([digest.hexdigest(), *(f"{name} {importlib.metadata.version(name)}" for name in NUMERICS)])
