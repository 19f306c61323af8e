"""Motion-capture markers of a C3D file (c3d.org), of Intel and MIPS processors, in integers or floats.

Every length and offset that such a file states is checked against its size before it is used.
"""

from __future__ import annotations

import math
import struct
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rehab_opt.errors import ProblemFileError
from rehab_opt.recordings.markers import LENGTH, marker_place, seen_marker
from rehab_opt.recordings.recording import Recording
from rehab_opt.text_file import FARTHEST, MAX_RECORDING_SIZE, file_content

__all__ = ["read_c3d"]

Array = NDArray[np.float64]

BLOCK = 512
"""[byte] What a C3D file is counted in."""
MAGIC = 0x50
BYTE_ORDERS = {84: "<", 86: ">"}
"""By processor; 85 is DEC, whose floats are none of IEEE's."""
TEXT, BYTE, INTEGER, REAL = -1, 1, 2, 4


class _Header(NamedTuple):
    points: int
    analog: int
    frames: int
    scale: float
    start: int
    order: str


def read_c3d(path: Path, *, name: str, marker: str | None, count_mm: float | None = None) -> Recording:
    """Path of one marker, (N, 3) [m] in the laboratory's frame; frames without it are left out, with a note.

    Raises
    ------
    ProblemFileError : no C3D or one cut short, no such marker, unit or rate, a marker hidden for more than 0.2 s.
    """
    content = file_content(path, name, max_size=MAX_RECORDING_SIZE)
    header, parameters = _read_header(content, name)
    labels = [label for key in ("LABELS", "LABELS2") for label in _texts(parameters.get(f"POINT:{key}"))]
    unit = next(iter(_texts(parameters.get("POINT:UNITS"))), None)
    rate = _number(parameters.get("POINT:RATE"))
    place = marker_place(marker, labels[: header.points], name)
    if not unit and count_mm is not None:
        unit, metres = "counts", 1e-3 * count_mm
    elif unit in LENGTH:
        metres = LENGTH[unit]
    else:
        expected = f"one of {', '.join(LENGTH)}" + ("" if unit else ", or recording.count_mm, its unit in mm")
        raise ProblemFileError(name, "POINT:UNITS", unit, expected)
    if not 0 < rate < math.inf:
        raise ProblemFileError(name, "POINT:RATE", rate, "frames a second, above zero")
    points = _marker(content, header, place)
    far = np.abs(points) > FARTHEST / metres
    if far.any():
        frame, axis = (int(i) for i in np.argwhere(far)[0])
        expected = f"at most {FARTHEST / metres:g} {unit} (another unit?)"
        where, value = f"frame {frame + 1}, marker {marker} {'XYZ'[axis]}", float(points[frame, axis])
        raise ProblemFileError(name, where, value, expected)
    rows = np.column_stack((np.arange(len(points)) / rate, points))
    return seen_marker(rows, name, str(marker), metres, str(len(points)))


def _read_header(content: bytes, name: str) -> tuple[_Header, dict[str, object]]:
    if len(content) < 2 * BLOCK or content[1] != MAGIC:
        value = content[1] if len(content) > 1 else None
        raise ProblemFileError(name, "byte 2", value, f"{MAGIC}, as in every C3D")
    at = (content[0] - 1) * BLOCK
    processor = content[at + 3] if 0 < at < len(content) - 3 else None
    if processor not in BYTE_ORDERS:
        expected = f"{' or '.join(map(str, BYTE_ORDERS))}, Intel or MIPS (85 is DEC: convert the file first)"
        raise ProblemFileError(name, "processor of the parameters", processor, expected)
    order = BYTE_ORDERS[processor]
    points, analog, first, last, _, scale, start = struct.unpack_from(f"{order}5HfH", content, 2)
    parameters = _parameters(content[at : at + max(content[at + 2], 1) * BLOCK], order)
    frames = (last - first + 1) % 65536
    stated = _number(parameters.get("POINT:FRAMES"))
    if stated > 65535:  # more than the header can hold
        frames = int(min(stated, len(content)))
    header = _Header(points, analog, frames, scale, (start - 1) * BLOCK, order)
    needed = header.start + frames * _frame_bytes(header)
    if not (math.isfinite(scale) and scale and start > 1 and points and frames and needed <= len(content)):
        expected = f"{needed} bytes, for the {frames} frames of {points} markers that its header states"
        raise ProblemFileError(name, "file size", f"{len(content)} bytes", expected)
    return header, parameters


def _frame_bytes(header: _Header) -> int:
    return (4 if header.scale < 0 else 2) * (4 * header.points + header.analog)


def _marker(content: bytes, header: _Header, number: int) -> Array:
    """(frames, 3) in the file's unit, NaN where the marker was not seen."""
    kind = f"{header.order}f4" if header.scale < 0 else f"{header.order}i2"
    words = np.frombuffer(content, kind, count=header.frames * (4 * header.points + header.analog), offset=header.start)
    with np.errstate(invalid="ignore"):  # a signalling NaN becomes a quiet one
        seen = words.reshape(header.frames, -1)[:, 4 * number : 4 * number + 4].astype(np.float64)
    points = seen[:, :3] * (1.0 if header.scale < 0 else header.scale)
    points[(seen[:, 3] < 0) | ~np.isfinite(points).all(axis=1)] = math.nan
    return points


def _parameters(section: bytes, order: str) -> dict[str, object]:
    """Values by `GROUP:NAME`: texts as a list, numbers as an array. What is cut off is left out."""
    groups: dict[int, str] = {}
    found: list[tuple[int, str, object]] = []
    at = 4
    while at + 2 <= len(section):
        length, group = abs(struct.unpack_from("b", section, at)[0]), struct.unpack_from("b", section, at + 1)[0]
        body = at + 2 + length
        if not length or not group or body + 2 > len(section):
            break
        label = section[at + 2 : body].decode("latin-1").strip().upper()
        (onward,) = struct.unpack_from(f"{order}H", section, body)
        if group < 0:
            groups[-group] = label
        else:
            found.append((group, label, _value(section[body + 2 :], order)))
        if onward < 2:  # the last one; less would go back, and round
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
        return [text.decode("latin-1").strip() for text in texts]
    types = {BYTE: "u1", INTEGER: f"{order}u2", REAL: f"{order}f4"}
    return np.frombuffer(body, types[kind], count=count)


def _texts(value: object) -> list[str]:
    return value if isinstance(value, list) else []


def _number(value: object) -> float:
    return float(value[0]) if isinstance(value, np.ndarray) and value.size else math.nan
