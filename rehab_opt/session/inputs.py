"""Input files of a problem, and their digest; while the digest stays the same, an earlier result is still valid."""

from __future__ import annotations

import hashlib
import importlib.metadata
import importlib.resources
import inspect
import json
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

from rehab_opt.session.files import ProblemFile, recording_path
from rehab_opt.session.robot_file import robot_text
from rehab_opt.session.schema import Problem
from rehab_opt.session.systems import ROBOT_FILE, Needed, needed_files, system_named
from rehab_opt.text_file import MAX_RECORDING_SIZE, file_content

__all__ = ["input_files", "inputs_digest", "software_digest"]

NUMERICS = ("casadi", "numpy", "scipy", "shapely")


def input_files(config: ProblemFile[Any]) -> dict[str, dict[str, str]]:
    """The files of a problem, by key: each file's name in the problem and the SHA-256 of its content.

    A robot file refers to other files; its SHA-256 is computed from the arm's numerical data, as in `inputs_digest`.

    Raises
    ------
    ProblemFileError : a recording is missing or cannot be read.
    """
    contents = [(each.key, each.reference, content) for each, content in _contents(config)]
    if config.path.is_file():
        contents.insert(0, ("problem", config.file, config.path.read_bytes()))
    return {key: {"file": file, "sha256": hashlib.sha256(content).hexdigest()} for key, file, content in contents}


def inputs_digest(config: ProblemFile[Problem]) -> str:
    """SHA-256 of a problem, its recordings, the source code that runs it, and the numerical libraries' versions.

    Raises
    ------
    ProblemFileError : a recording is missing or cannot be read.
    """
    digest = hashlib.sha256(software_digest().encode())
    problem = config.problem
    digest.update(_source_outside(type(system_named(problem.system))))
    said = {"name": config.name, "problem": problem.model_dump(mode="json")}
    digest.update(json.dumps(said, sort_keys=True).encode())
    for _, content in _contents(config):
        digest.update(content)
    return digest.hexdigest()


def _contents(config: ProblemFile[Any]) -> Iterator[tuple[Needed, bytes]]:
    for needed in needed_files(config.problem):
        if needed.key == ROBOT_FILE:
            yield needed, robot_text(config, needed.reference).encode()
        else:
            path = recording_path(config, needed.reference, key=needed.key)
            yield needed, file_content(path, needed.reference, max_size=MAX_RECORDING_SIZE)


def _source_outside(kind: type) -> bytes:
    """Source code of a problem kind that another distribution provides: its module, or the whole package around it."""
    package = kind.__module__.partition(".")[0]
    if package == __name__.partition(".")[0]:
        return b""
    file = Path(inspect.getfile(sys.modules[package]))
    sources = sorted(file.parent.rglob("*.py")) if file.name == "__init__.py" else [file]
    return b"".join(path.read_bytes() for path in sources)


@cache
def software_digest() -> str:
    """Digest of this library's source code, which can change while the version number stays the same."""
    digest = hashlib.sha256()
    with importlib.resources.as_file(importlib.resources.files("rehab_opt")) as package:
        for path in sorted(package.rglob("*.py")):
            digest.update(path.relative_to(package).as_posix().encode())
            digest.update(path.read_bytes())
    return " ".join([digest.hexdigest(), *(f"{name} {importlib.metadata.version(name)}" for name in NUMERICS)])
