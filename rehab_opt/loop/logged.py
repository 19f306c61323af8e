"""Read a log of a loop, also a log that a full disk or a killed process truncated."""

from __future__ import annotations

import json
import re
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rehab_opt.errors import ProblemFileError
from rehab_opt.loop.cdr import records_of
from rehab_opt.loop.log_file import ABOUT, TICK, mcap_module
from rehab_opt.loop.records import state_layout
from rehab_opt.text_file import regular_file

__all__ = ["Logged", "operator_of", "read_log"]

KIND, MOST = re.compile(r"<f8|<u8|\|?S\d{1,4}"), 1000
"""Two checks of a record's field: its allowed data types, and its largest size in each dimension."""


@dataclass(frozen=True, eq=False)
class Logged:
    """Content of a log.

    Parameters
    ----------
    records : records (N,) of the ticks in order, with the fields of `state_layout`.
    names : names of the joints. about : metadata and versions. files : contents of the problem's files by name.
    whole : whether the log was closed properly; otherwise at most the last 0.1 s are lost.
    """

    records: NDArray[np.void]
    names: tuple[str, ...]
    about: Mapping[str, str]
    files: Mapping[str, bytes]
    whole: bool


ENDS = b"\x89MCAP0\r\n"
"""Last bytes of a complete file."""


def read_log(path: Path | str) -> Logged:
    """Read the log in a file.

    Raises
    ------
    ProblemFileError : the file is unreadable, is not the log of a loop, or was altered.
    ConfigurationError : mcap is not installed.
    """
    stream, records, errors = (mcap_module(name) for name in ("stream_reader", "records", "exceptions"))
    about: dict[str, str] = {}
    files: dict[str, bytes] = {}
    ticks: list[bytes] = []
    schemas: dict[int, str] = {}
    channels: set[int] = set()
    whole, damaged = False, ""
    with regular_file(Path(path), str(path)) as file:
        try:
            for each in stream.StreamReader(file, validate_crcs=True).records:
                if isinstance(each, records.Message) and each.channel_id in channels:
                    ticks.append(each.data)
                elif isinstance(each, records.Schema):
                    schemas[each.id] = each.name
                elif isinstance(each, records.Channel) and schemas.get(each.schema_id) == TICK:
                    channels.add(each.id)
                elif isinstance(each, records.Metadata) and each.name == ABOUT:
                    about = dict(each.metadata)
                elif isinstance(each, records.Attachment):
                    files[each.name] = each.data
                whole = whole or isinstance(each, records.Footer)
        except (errors.EndOfFile, struct.error, EOFError):
            whole = False
            file.seek(-min(len(ENDS), file.seek(0, 2)), 2)
            damaged = "it ends before its end" if file.read() == ENDS else ""
        except (errors.McapError, ValueError, MemoryError, import_module("zstandard").ZstdError) as wrong:
            damaged = str(wrong) or "a length"
    if not {"layout", "names"} <= set(about):
        raise ProblemFileError(path, "metadata", sorted(about), f"an MCAP file with the metadata {ABOUT!r}, by a loop")
    if damaged:
        raise ProblemFileError(path, "bytes", damaged, "those that were written: the log was altered since")
    try:
        layout = _layout(json.loads(about["layout"]))
        return Logged(records_of(layout, ticks), tuple(map(str, json.loads(about["names"]))), about, files, whole)
    except (ValueError, TypeError, RecursionError, struct.error) as wrong:
        raise ProblemFileError(
            path, "metadata", str(wrong), "what was written there: the log was altered since"
        ) from wrong


def _layout(told: list[tuple[Any, ...]]) -> np.dtype[Any]:
    """Layout of the records; raises ValueError or TypeError if the description `told` is invalid."""
    for _, kind, *shape in told:
        if not (KIND.fullmatch(kind) and all(0 < size <= MOST for sizes in shape for size in sizes)):
            raise ValueError(f"{kind} {shape}")
    layout = np.dtype([(name, kind, *map(tuple, shape)) for name, kind, *shape in told])
    if missing := set(state_layout(1).names or ()) - {"wheels"} - set(layout.names or ()):
        raise ValueError(f"no {', '.join(sorted(missing))}")
    return layout


def operator_of(layout: np.dtype[Any]) -> np.dtype[Any]:
    """`operator_layout` of the loop that wrote records of this layout; no fields if it had no operator."""
    prefix = "operator_"
    fields = dict(layout.fields or {})
    return np.dtype([(name.removeprefix(prefix), kind[0]) for name, kind in fields.items() if name.startswith(prefix)])
