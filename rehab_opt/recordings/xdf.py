"""Streams of the Lab Streaming Layer in XDF files, read by pyxdf (extra `xdf`)."""

from __future__ import annotations

import logging
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import ParseError

import numpy as np

from rehab_opt.errors import ConfigurationError, ProblemFileError
from rehab_opt.recordings.recording import Recording
from rehab_opt.recordings.tables import LENGTH, SPELLINGS
from rehab_opt.text_file import FARTHEST, MAX_RECORDING_SIZE, file_content, shown

__all__ = ["read_xdf"]

SPOILT = (
    ValueError, KeyError, IndexError, TypeError, AttributeError, EOFError, OverflowError, MemoryError,
    ZeroDivisionError, AssertionError, NotImplementedError, struct.error, ParseError, np.linalg.LinAlgError,
)  # fmt: skip
"""What pyxdf ends in where a file is no XDF, or one cut short; it promises none of them."""
SPELT = {
    f"{part}met{end}s": unit for part, unit in (("", "m"), ("centi", "cm"), ("milli", "mm")) for end in ("er", "re")
}


def read_xdf(path: Path, *, name: str, columns: Sequence[str] | None) -> Recording:
    """Path (N, 2) or (N, 3) [m] of the channels `columns`, which are x, y (and z) of one stream, by their labels.

    Times are the stream's, on the clock of the recording, without jitter where the stream has a nominal rate.

    Parameters
    ----------
    columns : labels of channels; with the stream's name before a slash where several streams have them.

    Raises
    ------
    ProblemFileError : no XDF; no, or several, streams with such channels; a unit that is no length; a sample that is no
        number; fewer samples than the stream's footer states.
    ConfigurationError : pyxdf is absent.
    """
    try:
        import pyxdf  # noqa: PLC0415
    except ModuleNotFoundError as absent:
        raise ConfigurationError("recording", name, "the extra xdf: pip install 'rehab_opt[xdf]'") from absent
    content = file_content(path, name, max_size=MAX_RECORDING_SIZE)
    if not content.startswith(b"XDF:"):
        raise ProblemFileError(name, "byte 1", shown(repr(content[:4])), "XDF:, as in every XDF file")
    logging.getLogger("pyxdf").setLevel(logging.CRITICAL)
    try:
        streams, _ = pyxdf.load_xdf(str(path))
        known = [(_text(each["info"], "name"), _labels(each["info"]), each) for each in streams]
    except SPOILT as problem:
        raise ProblemFileError(name, "file", type(problem).__name__, "a whole XDF file") from problem
    said = ", ".join(f"{stream}/{label}" for stream, labels, _ in known for label in labels)
    if columns is None:
        raise ProblemFileError(name, "recording.columns", None, f"labels of x, y (and z) among {shown(said, 120)}")
    found = [each for each in known if all(_place(each[0], each[1], column) is not None for column in columns)]
    if len(found) != 1:
        expected = f"channels of one stream, among {shown(said, 120)}"
        raise ProblemFileError(name, "recording.columns", list(columns), expected)
    stream, labels, chosen = found[0]
    places = [_place(stream, labels, column) or 0 for column in columns]
    time, series = np.asarray(chosen["time_stamps"], dtype=np.float64), chosen["time_series"]
    stated = _stated(chosen)
    if stated is None or stated != len(time):
        expected = f"{stated}, which its footer states" if stated is not None else "a footer: the file is cut short"
        raise ProblemFileError(name, f"samples of stream {shown(stream)}", len(time), expected)
    if not isinstance(series, np.ndarray) or series.dtype.kind not in "fiu" or series.shape != (len(time), len(labels)):
        raise ProblemFileError(name, f"stream {shown(stream)}", "other samples", "a number for each channel")
    units = [_unit(chosen["info"], place, name) for place in places]
    points = np.column_stack([series[:, place] * unit for place, unit in zip(places, units, strict=True)])
    for bad, expected in ((~np.isfinite(points), "a finite number"), (np.abs(points) > FARTHEST, "another unit?")):
        if bad.any():
            row, axis = (int(i) for i in np.argwhere(bad)[0])
            raise ProblemFileError(
                name, f"sample {row + 1}, channel {columns[axis]}", float(points[row, axis]), expected
            )
    return Recording(file=name, time=time - time[0] if len(time) else time, points=points)


def _text(table: Any, key: str) -> str:
    """Pyxdf has every element of XML as a list."""
    value = table[key][0]
    return value if isinstance(value, str) else ""


def _channels(info: Any) -> list[Any]:
    return list(info["desc"][0]["channels"][0]["channel"]) if info.get("desc") and info["desc"][0] else []


def _labels(info: Any) -> list[str]:
    return [_text(channel, "label") for channel in _channels(info)]


def _place(stream: str, labels: Sequence[str], column: str) -> int | None:
    found = [i for i, label in enumerate(labels) if column in (label, f"{stream}/{label}")]
    return found[0] if len(found) == 1 else None


def _stated(stream: Any) -> int | None:
    try:
        return int(_text(stream["footer"]["info"], "sample_count"))
    except (KeyError, ValueError, TypeError, IndexError):
        return None


def _unit(info: Any, place: int, name: str) -> float:
    channel = _channels(info)[place]
    unit = _text(channel, "unit") if "unit" in channel else ""
    known = SPELLINGS.get(unit.lower(), SPELT.get(unit.lower(), unit))
    if known not in LENGTH:
        raise ProblemFileError(
            name, f"unit of channel {shown(_text(channel, 'label'))}", unit, f"one of {', '.join(LENGTH)}"
        )
    return LENGTH[known]
