"""Read motion-capture markers from C3D files (c3d.org) of Intel and MIPS processors, with integers or floats.

All lengths and offsets in a file are checked against the file's size before use.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rehab_opt.errors import ProblemFileError
from rehab_opt.recordings.markers import marker_place
from rehab_opt.recordings.recording import Samples
from rehab_opt.recordings.units import Reading
from rehab_opt.text_file import MAX_RECORDING_SIZE, file_content, shown

__all__ = ["read_c3d"]

Array = NDArray[np.float64]

BLOCK = 512
"""Block size [byte] of a C3D file."""
MAGIC = 0x50
BYTE_ORDERS, DEC = {84: "<", 86: ">"}, 85
"""Byte orders by the number of the processor; DEC is not supported, because its floats are not IEEE floats."""
MOST_FRAMES = 65535
"""Largest number of frames that the header of a C3D file can state."""
TEXT, BYTE, INTEGER, REAL = -1, 1, 2, 4


NO_PLACES = ("ANGLES", "MOMENTS", "POWERS", "FORCES", "SCALARS", "REACTIONS")
"""Names of POINT parameters; each lists entries that are stored like markers but are not positions."""


class _Header(NamedTuple):
    points: int
    analog: int
    first: int
    frames: int
    scale: float
    start: int
    rate: float
    order: str


def read_c3d(path: Path, *, name: str, how: Reading) -> Samples:
    """Read the path (N, 3) [m] of one marker in the laboratory's frame, and the trials between events.

    The path is NaN where the marker is missing.

    Raises
    ------
    ProblemFileError : the file is not a C3D file or is truncated, the marker, the unit or the rate is missing, or the
        entry is not a marker.
    """
    content = file_content(path, name, max_size=MAX_RECORDING_SIZE)
    header, parameters, notes = _read_header(content, name)
    labels = _numbered(parameters, "LABELS")[: header.points]
    listed = {_own(each): key for key in NO_PLACES for each in _numbered(parameters, key)}
    number = marker_place(how.marker, labels, name, count=header.points, but=listed)
    if number < len(labels) and _own(labels[number]) in listed:
        expected = f"a marker: POINT:{listed[_own(labels[number])]} lists it, which are no places"
        raise ProblemFileError(name, "recording.marker", how.marker, expected)
    unit = next(iter(_texts(parameters.get("POINT:UNITS"))), None)
    metres = how.factor("length", unit or None, name=name, where="POINT:UNITS")
    rate = next((each for each in (_number(parameters.get("POINT:RATE")), header.rate) if each > 0), 0.0)
    rate = how.rate_hz or rate
    if not 0 < rate < math.inf:
        raise ProblemFileError(name, "POINT:RATE", rate, "frames a second, above zero (or recording.rate_hz)")
    points = _marker(content, header, number)
    asked = None if how.trials is None else str(how.trials)
    trials = _trials(parameters, asked, rate, header.first, len(points), name) if asked else ()
    return Samples(np.arange(len(points)) / rate, metres * points, notes=notes, trials=trials)


def _own(label: str) -> str:
    """Label of a marker without the subject's name."""
    return label.rpartition(":")[2]


def _numbered(parameters: Mapping[str, object], key: str) -> list[str]:
    """All texts of the parameters POINT:KEY, POINT:KEY2, POINT:KEY3 and so on."""
    names = [f"POINT:{key}", *(f"POINT:{key}{number}" for number in range(2, 256))]
    return [text for name in names for text in _texts(parameters.get(name))]


def _trials(  # noqa: PLR0917  (events, and the frames that they are among)
    parameters: Mapping[str, object], asked: str, rate: float, first: int, count: int, name: str
) -> tuple[tuple[str, int, int], ...]:
    """Trials (name, first row, last row) between events: each from one event named `asked` to the next one.

    For `asked` = "begin,end", a trial lasts from each event "begin" to the next event "end". Events have times
    [minutes, s] since frame 1; `first` is the number of the first stored frame.
    """
    labels, moments = _texts(parameters.get("EVENT:LABELS")), parameters.get("EVENT:TIMES")
    pairs = moments[: 2 * len(labels)].reshape(-1, 2) if isinstance(moments, np.ndarray) else np.empty((0, 2))
    rows = [float(np.rint((60.0 * minutes + seconds) * rate)) + 1 - first for minutes, seconds in pairs]
    begins, _, ends = (part.strip() for part in asked.partition(","))
    over = [row for row, label in zip(rows, labels, strict=False) if label == (ends or begins)] + [count - 1] * (
        not ends
    )
    found = [
        (int(row), int(min((end for end in over if end > row), default=row)))
        for row, label in sorted(zip(rows, labels, strict=False))
        if label == begins and 0 <= row < count
    ]
    trials = [(row, min(end, count - 1)) for row, end in found if end > row]
    if not trials:
        known = shown(", ".join(dict.fromkeys(labels)), 120) or "none"
        raise ProblemFileError(name, "recording.trials", asked, f"events of it, or two with a comma between: {known}")
    return tuple((str(number), *trial) for number, trial in enumerate(trials, start=1))


def _read_header(content: bytes, name: str) -> tuple[_Header, dict[str, object], tuple[str, ...]]:
    if len(content) < 2 * BLOCK or content[1] != MAGIC:
        value = content[1] if len(content) > 1 else None
        raise ProblemFileError(name, "byte 2", value, f"{MAGIC}, as in every C3D")
    at = (content[0] - 1) * BLOCK
    processor = content[at + 3] if 0 < at < len(content) - 3 else None
    if processor not in BYTE_ORDERS:
        expected = f"{' or '.join(map(str, BYTE_ORDERS))}, Intel or MIPS"
        if processor == DEC:
            expected += "; this is DEC: convert it, in Python by ezc3d.c3d('old.c3d').write('new.c3d')"
        raise ProblemFileError(name, "processor of the parameters", processor, expected)
    order = BYTE_ORDERS[processor]
    points, analog, first, last, _, scale, start, _, rate = struct.unpack_from(f"{order}5HfHHf", content, 2)
    parameters = _parameters(content[at : at + max(content[at + 2], 1) * BLOCK], order)
    frames = _frames(parameters, first, last)
    header = _Header(points, analog, first, frames, scale, (start - 1) * BLOCK, rate, order)
    needed = header.start + frames * _frame_bytes(header)
    if not (math.isfinite(scale) and scale and start > 1 and points and frames and needed <= len(content)):
        expected = f"{needed} bytes, for the {frames} frames of {points} markers that its header states"
        raise ProblemFileError(name, "file size", f"{len(content)} bytes", expected)
    more = (len(content) - needed) // _frame_bytes(header)
    unread = frames == MOST_FRAMES and more * _frame_bytes(header) > BLOCK
    return header, parameters, (f"its header states {frames} frames, {more} more may be there",) if unread else ()


def _frames(parameters: Mapping[str, object], first: int, last: int) -> int:
    """Number of frames, from the header or, if the header cannot state such a large number, from the parameters."""
    frames = (last - first + 1) % (MOST_FRAMES + 1)
    ends = [parameters.get(f"TRIAL:ACTUAL_{end}_FIELD") for end in ("START", "END")]
    low, high = (
        float(each[0]) + (MOST_FRAMES + 1) * float(each[1])
        if isinstance(each, np.ndarray) and each.size > 1
        else math.nan
        for each in ends
    )
    stated = [high - low + 1, *(_number(parameters.get(f"POINT:{key}")) for key in ("LONG_FRAMES", "FRAMES"))]
    full = MOST_FRAMES in (last, frames)
    longer = [int(each) for each in stated if MOST_FRAMES < each < 1e9 and (full or each % (MOST_FRAMES + 1) == frames)]
    return longer[0] if longer else frames


def _frame_bytes(header: _Header) -> int:
    return (4 if header.scale < 0 else 2) * (4 * header.points + header.analog)


def _marker(content: bytes, header: _Header, number: int) -> Array:
    """Positions (frames, 3) of a marker in the file's unit, NaN where the marker is missing."""
    kind = f"{header.order}f4" if header.scale < 0 else f"{header.order}i2"
    words = np.frombuffer(content, kind, count=header.frames * (4 * header.points + header.analog), offset=header.start)
    with np.errstate(invalid="ignore"):  # conversion of a signalling NaN would warn
        seen = words.reshape(header.frames, -1)[:, 4 * number : 4 * number + 4].astype(np.float64)
    points = seen[:, :3] * (1.0 if header.scale < 0 else header.scale)
    points[(seen[:, 3] < 0) | ~np.isfinite(points).all(axis=1)] = math.nan
    return points


def _parameters(section: bytes, order: str) -> dict[str, object]:
    """Parameters by `GROUP:NAME`, texts as a list and numbers as an array; truncated parameters are left out."""
    groups: dict[int, str] = {}
    found: list[tuple[int, str, object]] = []
    at = 4
    while at + 2 <= len(section):
        length, group = abs(struct.unpack_from("b", section, at)[0]), struct.unpack_from("b", section, at + 1)[0]
        body = at + 2 + length
        if not length or not group or body + 2 > len(section):
            break
        label = section[at + 2 : body].decode("latin-1").strip(" \0").upper()
        (onward,) = struct.unpack_from(f"{order}H", section, body)
        if group < 0:
            groups[-group] = label
        else:
            found.append((group, label, _value(section[body + 2 :], order)))
        if onward < 2:  # 0 marks the last parameter; 1 would not move forward
            break
        at = body + onward
    return {f"{groups.get(group, '')}:{label}": value for group, label, value in found}


def _value(data: bytes, order: str) -> object:
    if len(data) < 2 or len(data) < 2 + data[1]:
        return None
    kind, sizes = struct.unpack_from("b", data)[0], list(data[2 : 2 + data[1]])
    count, body = math.prod(sizes), data[2 + len(sizes) :]
    if abs(kind) not in (BYTE, INTEGER, REAL) or count * abs(kind) > len(body):
        return None
    if kind == TEXT:
        width = sizes[0] if len(sizes) > 1 else count
        texts = [body[i : i + width] for i in range(0, count, width)] if width else []
        return [text.decode("latin-1").strip(" \0") for text in texts]
    types = {BYTE: "u1", INTEGER: f"{order}u2", REAL: f"{order}f4"}
    return np.frombuffer(body, types[kind], count=count)


def _texts(value: object) -> list[str]:
    return value if isinstance(value, list) else []


def _number(value: object) -> float:
    return float(value[0]) if isinstance(value, np.ndarray) and value.size else math.nan
