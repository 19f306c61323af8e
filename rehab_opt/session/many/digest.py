"""What a result depends on, as one number: equal ones need no second computation."""

from __future__ import annotations

import hashlib
import importlib.metadata
import importlib.resources
import inspect
import json
import sys
from functools import cache
from pathlib import Path

from rehab_opt.session.files import ProblemFile, recording_path
from rehab_opt.session.robot_file import robot_text
from rehab_opt.session.schema import Problem
from rehab_opt.session.systems import ROBOT_FILE, system_named
from rehab_opt.session.text_lines import LARGEST_RECORDING
from rehab_opt.text_file import file_content

__all__ = ["inputs_digest", "software_digest"]

NUMERICS = ("casadi", "numpy", "scipy", "shapely")


def inputs_digest(loaded: ProblemFile[Problem]) -> str:
    """SHA-256 of a problem, its recordings, the source of its kind and of this library, and versions of its numerics.

    Raises
    ------
    ProblemFileError : a recording is absent or cannot be read.
    """
    digest = hashlib.sha256(software_digest().encode())
    problem = loaded.problem
    system = system_named(problem.system)
    digest.update(_source_outside(type(system)))
    said = {"name": loaded.name, "problem": problem.model_dump(mode="json")}
    digest.update(json.dumps(said, sort_keys=True).encode())
    for needed in system.recordings(problem):
        if needed.key == ROBOT_FILE:
            digest.update(robot_text(loaded, needed.reference).encode())
            continue
        path = recording_path(loaded, needed.reference, key=needed.key)
        digest.update(file_content(path, needed.reference, largest=LARGEST_RECORDING))
    return digest.hexdigest()


def _source_outside(kind: type) -> bytes:
    """The source of a kind of problem of another distribution: its module, or all of the package that it is in."""
    package = kind.__module__.partition(".")[0]
    if package == __name__.partition(".")[0]:
        return b""
    file = Path(inspect.getfile(sys.modules[package]))
    sources = sorted(file.parent.rglob("*.py")) if file.name == "__init__.py" else [file]
    return b"".join(path.read_bytes() for path in sources)


@cache
def software_digest() -> str:
    """The source itself, not its version: a checkout changes without one."""
    digest = hashlib.sha256()
    with importlib.resources.as_file(importlib.resources.files("rehab_opt")) as package:
        for path in sorted(package.rglob("*.py")):
            digest.update(path.relative_to(package).as_posix().encode())
            digest.update(path.read_bytes())
    return " ".join([digest.hexdigest(), *(f"{name} {importlib.metadata.version(name)}" for name in NUMERICS)])
