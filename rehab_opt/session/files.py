"""Find problem files by path or by the name of a shipped problem, read them, and validate them."""

from __future__ import annotations

import difflib
import importlib.resources
import os
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from rehab_opt.errors import ProblemFileError
from rehab_opt.recordings.data_folder import ENVIRONMENT, PREFIX, data_file
from rehab_opt.session.schema import FORMS, Problem
from rehab_opt.session.systems import ROBOT_FILE, SHIPPED, ProblemFile, system_named, systems
from rehab_opt.text_file import MAX_PROBLEM_SIZE, brief, check_key_depth, shown, whole_text

__all__ = [
    "ProblemFile",
    "load_problem",
    "problem_content",
    "problem_of",
    "problem_path",
    "recording_description",
    "recording_path",
    "recording_state",
    "schema_error",
    "shipped_folder",
    "shipped_problems",
]

DESCRIPTION, DESCRIBED = "description", ("recording", "placement")
"""Key that names the description of a recording, and the tables that a description may have."""

TOML = {
    "Expected '='": "key = value",
    "Invalid statement": "key = value, or a table's [name]",
    "Invalid initial character": "a key of letters, digits, _ and -",
    "Expected newline": "one key = value a line; numbers have a point, no comma",
    "Invalid value": 'a value: a number with a point, "text", true, false, or a list in [ ]',
    "Unterminated string": "text that ends with its quotation mark",
    "Illegal character": "text that ends with its quotation mark, on the same line",
    "Unescaped": "\\\\ for a backslash in a text",
    "Unclosed array": "a list that ends with ]",
    "Unclosed inline table": "a table that ends with }",
    "Expected ']": "a table's name between [ and ]",
    "Cannot": "each key and table once",
    "Duplicate": "each key and table once",
}
"""Beginnings of error messages of Python's TOML reader, and plainer words for each."""


def load_problem(file: str) -> ProblemFile[Any]:
    """Read and validate a problem file.

    Parameters
    ----------
    file : a path, or the name of a shipped problem.

    Raises
    ------
    ProblemFileError : one line naming the file, the dotted key, its value and what was expected.
    """
    name, path = problem_path(file)
    return problem_of(problem_content(path, file), name=name, file=file, path=path)


def problem_content(path: Path, file: str) -> dict[str, Any]:
    """Content of a problem file with the recordings' descriptions inserted; raises as `load_problem`.

    Parameters
    ----------
    file : name of the file in errors.
    """
    content: dict[str, Any] = _with_descriptions(_toml_content(path, file), path.parent, file)
    return content


def recording_description(path: Path, file: str) -> dict[str, Any]:
    """Description of one recording, for problems and for `score`: a table `recording` and, if needed, `placement`.

    Both tables have the keys of a problem file; the path `recording.file` is relative to the description's folder.

    Raises
    ------
    ProblemFileError : the file cannot be read, has other tables, or has no `recording.file`.
    """
    content = _toml_content(path, file)
    for key, value in content.items():
        if key not in DESCRIBED or not isinstance(value, dict):
            raise ProblemFileError(file, shown(key), brief(value), "the tables recording and placement alone")
    named = content.get("recording", {}).get("file")
    if not isinstance(named, str) or not named:
        raise ProblemFileError(
            file, "recording.file", brief(named), "the recording, beside this file or data:folder/file"
        )
    if not named.startswith(PREFIX):
        folder, slash, _ = file.rpartition("/")
        content["recording"]["file"] = named if Path(named).is_absolute() else f"{folder}{slash}{named}"
    return content


def _with_descriptions(content: Any, folder: Path, file: str) -> Any:
    """Content of a problem, with the tables of the recording descriptions that it names.

    A problem names a description by `recording = "NAME.toml"` or `recording = {description = "NAME.toml", ...}`. The
    problem's own keys and placement override those of the description.
    """
    if isinstance(content, list):
        return [_with_descriptions(each, folder, file) for each in content]
    if not isinstance(content, dict):
        return content
    content = {key: _with_descriptions(value, folder, file) for key, value in content.items()}
    recording = content.get("recording")
    own = {key: value for key, value in recording.items() if key != DESCRIPTION} if isinstance(recording, dict) else {}
    named = recording.get(DESCRIPTION) if isinstance(recording, dict) else recording
    if not isinstance(named, str):
        return content
    if not named.isprintable():  # no file can have this name
        raise ProblemFileError(file, "recording", brief(named), "a table, or the description of a recording: NAME.toml")
    path = data_file(named, problem=file, key="recording") if named.startswith(PREFIX) else folder / named
    said = recording_description(path, named)
    return said | content | {"recording": said["recording"] | own}


def _toml_content(path: Path, file: str) -> dict[str, Any]:
    text = whole_text(path, file, max_size=MAX_PROBLEM_SIZE)
    check_key_depth(text, name=file)
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as problem:
        line = _line_of(problem, text)
        value = shown(text.splitlines()[line - 1]) if line <= len(text.splitlines()) else "end of file"
        expected = next((f"TOML: {ours}" for its, ours in TOML.items() if str(problem).startswith(its)), "TOML")
        raise ProblemFileError(file, f"line {line}", value, expected) from problem
    except ValueError as problem:  # Python refuses to read integers of thousands of digits
        longest = max(text.splitlines(), key=len)
        line = text.splitlines().index(longest) + 1
        raise ProblemFileError(file, f"line {line}", shown(longest), "a number of fewer digits") from problem
    except RecursionError as problem:
        raise ProblemFileError(file, "file", "nested too deeply", "tables and lists inside a few others") from problem


def problem_of(content: dict[str, Any], *, name: str, file: str, path: Path) -> ProblemFile[Any]:
    """The problem defined by a file's content, with every key validated.

    Parameters
    ----------
    name, file, path : as in `ProblemFile`.

    Raises
    ------
    ProblemFileError : an unknown system or key, or a value out of range.
    """
    system = content.get("system")
    if not isinstance(system, str) or (system not in SHIPPED and system not in systems()):
        raise ProblemFileError(file, "system", brief(system), f"one of {', '.join(systems())}")
    try:
        return ProblemFile(name=name, file=file, path=path, problem=system_named(system).schema.model_validate(content))
    except ValidationError as problem:
        raise schema_error(problem, file) from problem


def problem_path(file: str) -> tuple[str, Path]:
    """Name and path of a problem file; an existing path takes precedence over the name of a shipped problem.

    Raises
    ------
    ProblemFileError : there is no such file and no such shipped problem.
    """
    path = Path(file)
    shipped = shipped_problems()
    if os.path.exists(path):  # unlike `path.exists()`, it raises no error for an impossible name
        own = {shipped_path.resolve(): name for name, shipped_path in shipped.items()}
        return own.get(path.resolve(), path.stem), path
    name = file.removesuffix(".toml")
    if name in shipped:
        return name, shipped[name]
    near = difflib.get_close_matches(name, shipped, n=1)
    hint = f", such as {near[0]}" if near else ""
    raise ProblemFileError(shown(file, 200), "file", "not found", f"a problem file, or a shipped problem{hint}")


def shipped_problems() -> dict[str, Path]:
    """Name and file of every shipped problem, in alphabetical order."""
    folder = shipped_folder()
    return {str(path.relative_to(folder).with_suffix("").as_posix()): path for path in sorted(folder.glob("*/*.toml"))}


def recording_path(config: ProblemFile[Problem], reference: str, *, key: str = "recording.file") -> Path:
    """Path of the recording that a problem names under `key`: relative to its file, or in the data folder (`data:`).

    Raises
    ------
    ProblemFileError : the recording does not exist.
    """
    if reference.startswith(PREFIX):
        return data_file(reference, problem=config.file, key=key)
    path = config.path.parent / reference
    if not os.path.exists(path):
        kind = "robot file" if key == ROBOT_FILE else "recording"
        expected = f"a {kind} beside the problem file, in {path.parent.resolve()}, or data:folder/file"
        raise ProblemFileError(config.file, key, reference, expected)
    if path.is_dir():
        raise ProblemFileError(config.file, key, reference, "a file, this is a directory")
    return path


def recording_state(file: str) -> tuple[str, str]:
    """Two texts: a problem file's title, and whether its recordings are present in the data folder.

    Raises
    ------
    ProblemFileError : the problem file cannot be read.
    """
    content = problem_content(problem_path(file)[1], file)
    named = [each for each in _texts(content) if each.startswith(PREFIX)]
    for each in named:
        try:
            data_file(each, problem=file, key="recording.file")
        except ProblemFileError:
            return content["title"], f"absent: {each} (set {ENVIRONMENT})"
    return content["title"], "present" if named else "none to fetch"


def _texts(content: object) -> Iterator[str]:
    if isinstance(content, str):
        yield content
    elif isinstance(content, dict | list):
        for each in content.values() if isinstance(content, dict) else content:
            yield from _texts(each)


def shipped_folder() -> Path:
    """Folder `problems` in the installed package (a wheel), or at the top of the checkout."""
    package = importlib.resources.files("rehab_opt")
    with importlib.resources.as_file(package) as root:
        installed = root / "problems"
        return installed if installed.is_dir() else root.parent / "problems"


def schema_error(problem: ValidationError, file: str) -> ProblemFileError:
    """The first validation error of pydantic, in this project's words."""
    first = problem.errors(include_url=False)[0]
    keys = [str(part) for part in first["loc"] if part not in FORMS]
    context: dict[str, Any] = first.get("ctx", {})
    value, expected = first["input"], first["msg"].removeprefix("Input should be ").removeprefix("Value should ")
    if "key" in context:  # an error that a validator of the schema raised
        keys.append(shown(context["key"]))
        value, expected = context["value"], context["expected"]
    elif first["type"] == "missing":
        value, expected = None, "this key"
    elif first["type"] in ("float_type", "int_type") and isinstance(value, str):
        expected += ", without quotation marks"
    elif first["type"] == "model_type":
        expected = "a table of keys"
    elif first["type"] in ("too_short", "too_long"):
        least = context.get("min_length")
        expected = f"at most {context['max_length']} entries" if least is None else f"at least {least} entries"
    dotted = ".".join(map(shown, keys))
    return ProblemFileError(file, dotted or "file", brief(value), expected)


def _line_of(problem: tomllib.TOMLDecodeError, text: str) -> int:
    """Line of a TOML error, counted from 1; before Python 3.14, only the text of the error contains it."""
    _, found, rest = str(problem).partition("(at line ")
    return int(rest.split(",")[0]) if found else text.count("\n") + 1
