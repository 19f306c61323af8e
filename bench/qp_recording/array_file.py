"""Arrays of numbers in an .npz beside one JSON text: written compressed, read with nothing taken on trust."""

from __future__ import annotations

import io
import json
import lzma
import math
import struct
import zipfile
import zlib
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rehab_opt.errors import ConfigurationError, ProblemFileError

__all__ = ["META", "ArrayFile", "read_arrays", "versions_now", "write_arrays"]

Array = NDArray[np.float64]


def versions_now() -> dict[str, str]:
    """Of the library and of what its numbers depend on; a checkout that is not installed has none."""
    found = {}
    for name in ("rehab_opt", "casadi", "numpy"):
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "a checkout"
    return found


META = "meta"
"""Key of the JSON text; every other key holds float64 numbers."""
SUFFIX = ".npy"
MAX_BYTES = 500_000_000
"""Of an unpacked file: a small one may claim to hold more than any memory."""
UNREADABLE = (
    OSError, EOFError, NotImplementedError, RuntimeError, UnicodeDecodeError, struct.error,
    zipfile.BadZipFile, zlib.error, lzma.LZMAError,
)  # fmt: skip
"""What Python's zipfile raises, by whatever is wrong with the bytes."""


class ArrayFile(NamedTuple):
    """What stands in such a file."""

    meta: dict[str, Any]
    arrays: dict[str, Array]


def write_arrays(path: Path, meta: Mapping[str, Any], arrays: Mapping[str, Array], *, argument: str = "path") -> None:
    """Write `arrays` (float64) and `meta` as JSON; the same content makes the same bytes.

    Parameters
    ----------
    argument : what the user calls the path.

    Raises
    ------
    ConfigurationError : the file cannot be written there.
    """
    text = np.array(json.dumps(meta, allow_nan=False, ensure_ascii=False, sort_keys=True))
    content = io.BytesIO()
    np.savez_compressed(content, allow_pickle=False, **{META: text}, **{k: np.asarray(v) for k, v in arrays.items()})
    part = path.with_name(f".{path.name}.part")  # what is interrupted leaves no half of a file
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        part.write_bytes(content.getvalue())
        part.replace(path)
    except (OSError, ValueError) as problem:
        if part.is_file():
            part.unlink()
        raise ConfigurationError(argument, str(path), f"a file that can be written ({problem})") from problem


def read_arrays(path: Path | str) -> ArrayFile:
    """What `write_arrays` wrote.

    Raises
    ------
    ProblemFileError : it is no such file: not a zip, a member that is no array of float64, a claim of more numbers
        than there are bytes, no JSON.
    """
    arrays: dict[str, Array] = {}
    meta: dict[str, Any] | None = None
    try:
        with zipfile.ZipFile(path) as archive:
            whole = sum(member.file_size for member in archive.infolist())
            if whole > MAX_BYTES:
                raise ProblemFileError(path, "file", f"{whole} bytes unpacked", f"at most {MAX_BYTES}")
            for member in archive.infolist():
                key = member.filename.removesuffix(SUFFIX)
                with archive.open(member) as stream:
                    content = io.BytesIO(stream.read(member.file_size))
                if key == META:
                    meta = _json_object(_array_of(content, path, key, "U"), path)
                else:
                    arrays[key] = _array_of(content, path, key, "f")
    except UNREADABLE as problem:
        found = str(problem) or type(problem).__name__
        raise ProblemFileError(path, "file", found, "an .npz file that is whole") from problem
    if meta is None:
        raise ProblemFileError(path, META, None, "a JSON text")
    return ArrayFile(meta, arrays)


def _array_of(content: BinaryIO, path: Path | str, key: str, kind: str) -> NDArray[Any]:
    """One member; its header is held against its length before anything is made of it."""
    expected = "an array of float64" if kind == "f" else "a JSON text"
    try:
        version = np.lib.format.read_magic(content)
        reader = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, dtype = reader(content)
    except (ValueError, EOFError) as problem:
        raise ProblemFileError(path, key, str(problem), expected) from problem
    if dtype.kind != kind or (kind == "f" and dtype != np.float64):
        raise ProblemFileError(path, key, str(dtype), expected)
    start = content.tell()
    there = content.seek(0, io.SEEK_END) - start
    if math.prod(shape) * dtype.itemsize != there:
        raise ProblemFileError(path, key, f"shape {shape} in {there} bytes", "as many numbers as its shape says")
    content.seek(0)
    array: NDArray[Any] = np.lib.format.read_array(content, allow_pickle=False)
    return array


def _json_object(text: NDArray[Any], path: Path | str) -> dict[str, Any]:
    expected = "one JSON object"
    if text.shape != ():
        raise ProblemFileError(path, META, f"shape {text.shape}", expected)
    try:
        meta = json.loads(str(text))
    except (ValueError, RecursionError) as problem:
        raise ProblemFileError(path, META, str(problem) or "nested too deeply", expected) from problem
    if not isinstance(meta, dict):
        raise ProblemFileError(path, META, type(meta).__name__, expected)
    return meta
