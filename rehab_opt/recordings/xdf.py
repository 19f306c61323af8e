"""Read streams of the Lab Streaming Layer from XDF files with pyxdf (extra `xdf`)."""

from __future__ import annotations

import logging
import struct
from collections.abc import Callable, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any
from xml.etree.ElementTree import ParseError

import numpy as np
from numpy.typing import NDArray

from rehab_opt.errors import ConfigurationError, ProblemFileError
from rehab_opt.recordings.recording import LONG_STEP, Samples
from rehab_opt.recordings.units import Reading, each_once, place_of
from rehab_opt.text_file import MAX_COLUMNS, MAX_RECORDING_SIZE, file_content, number_in, shown

__all__ = ["read_xdf"]

SPOILT = (
    ValueError, KeyError, IndexError, TypeError, AttributeError, EOFError, OverflowError, MemoryError,
    ZeroDivisionError, AssertionError, NotImplementedError, struct.error, ParseError, np.linalg.LinAlgError,
)  # fmt: skip
"""Exceptions that pyxdf raises for an invalid or truncated file; pyxdf does not document them."""

RAW = MappingProxyType({"dejitter_timestamps": False})
"""pyxdf would spread a gap over all samples."""
AROUND, LATE, NO_JITTER = 25, 0.75, 1e-2
"""Jitter averages out over `AROUND` samples. If the average lateness varies by `LATE` steps, a sample may be lost (one
varies it by 1). Below a lateness of `NO_JITTER` steps, the stamps are even already."""


def read_xdf(path: Path, *, name: str, how: Reading) -> Samples:
    """Path (N, 2) or (N, 3) [m] from the channels `how.columns`, which are x, y (and z) of one stream.

    A channel is named by its label or number; if several streams have such a channel, the name of the stream and a
    slash stand before it. Times are those of the stream on the recording's clock. Stamps of a stream with a nominal
    rate that only jitter about even times are made even, with a note; stamps with gaps stay as they are.

    Raises
    ------
    ProblemFileError : the file is not an XDF file, no stream or several have the channels, a unit is not a length, a
        sample is not a number, or samples are fewer than the stream's footer states.
    ConfigurationError : pyxdf is not installed.
    """
    try:
        import pyxdf  # noqa: PLC0415
    except ModuleNotFoundError as absent:
        raise ConfigurationError("recording", name, "the extra xdf: pip install 'rehab_opt[xdf]'") from absent
    content = file_content(path, name, max_size=MAX_RECORDING_SIZE)
    if not content.startswith(b"XDF:"):
        raise ProblemFileError(name, "byte 1", shown(repr(content[:4])), "XDF:, as in every XDF file")
    logging.getLogger("pyxdf").setLevel(logging.CRITICAL)
    streams, problem = _streams(pyxdf, str(path))
    if not streams:
        raise ProblemFileError(name, "file", problem or "no streams", "a whole XDF file")
    known = [(_text(each, "info", "name"), _labels(each), each) for each in streams]
    said = ", ".join(f"{stream}/{label}" for stream, labels, _ in known for label in labels)
    if how.columns is None:
        raise ProblemFileError(name, "recording.columns", None, f"labels of x, y (and z) among {shown(said, 120)}")
    places_in = [[_place(stream, labels, column) for column in how.columns] for stream, labels, _ in known]
    found = [i for i, places in enumerate(places_in) if None not in places]
    if len(found) != 1:
        expected = f"channels of one stream, among {shown(said, 120)}"
        raise ProblemFileError(name, "recording.columns", list(how.columns), expected)
    (stream, labels, chosen), places = (
        known[found[0]],
        each_once([place or 0 for place in places_in[found[0]]], how, name),
    )
    time, series = np.asarray(chosen["time_stamps"], dtype=np.float64), chosen["time_series"]
    stated = _stated(chosen)
    if stated is None or stated != len(time):
        expected = f"{stated}, which its footer states" if stated is not None else "a footer: the file is cut short"
        raise ProblemFileError(name, f"samples of stream {shown(stream)}", len(time), expected)
    if not isinstance(series, np.ndarray) or series.dtype.kind not in "fiu" or series.shape != (len(time), len(labels)):
        raise ProblemFileError(name, f"stream {shown(stream)}", "other samples", "a number for each channel")
    units = [
        how.factor("length", _unit(chosen, place), name=name, where=f"unit of channel {shown(labels[place])}")
        for place in places
    ]
    points = np.column_stack([series[:, place] * unit for place, unit in zip(places, units, strict=True)])
    second = how.factor("time", "s", name=name, where="time stamps")
    time, notes = _unjittered(time, chosen)
    return Samples(second * (time - time[0]) if len(time) else time, points, notes=notes)


def _unjittered(time: NDArray[np.float64], stream: Any) -> tuple[NDArray[np.float64], tuple[str, ...]]:
    """Two results: the stamps (N,) [s], made even if a constant rate and jitter explain all of them; and a note."""
    from scipy.ndimage import uniform_filter1d  # noqa: PLC0415  (loaded when used)

    if number_in(_text(stream, "info", "nominal_srate")) > 0 and len(time) > 2:
        rows = np.arange(len(time))
        even = np.polynomial.Polynomial.fit(rows, time, 1)(rows)
        late, step = time - even, (even[-1] - even[0]) / rows[-1]
        lasting = np.ptp(uniform_filter1d(late, min(AROUND, 1 + len(time) // 4), mode="reflect"))
        gap = np.diff(time).max() > max(LONG_STEP[0], LONG_STEP[1] * step)
        if not gap and lasting < LATE * step and (spread := np.ptp(late)) > NO_JITTER * step:
            return even, (f"time stamps with a jitter of {1e3 * spread:.2g} ms are made even: {1 / step:.5g} Hz",)
    return time, ()


def _streams(pyxdf: Any, path: str) -> tuple[list[Any], str]:
    """Two results: all readable streams; and the reason if a stream is unreadable."""
    try:
        return list(pyxdf.load_xdf(path, **RAW)[0]), ""
    except SPOILT as problem:
        said = type(problem).__name__
    streams: list[Any] = []
    for each in _tried(pyxdf.resolve_streams, path):
        streams += next(iter(_tried(pyxdf.load_xdf, path, select_streams=[each["stream_id"]], **RAW)), [])
    return streams, said


def _tried(call: Callable[..., Any], *arguments: object, **named: object) -> list[Any]:
    try:
        return list(call(*arguments, **named))
    except SPOILT:
        return []


def _text(of: Any, *keys: str) -> str:
    """Text of a nested XML element, or "" if the element is missing; pyxdf returns XML elements as lists."""
    for key in keys:
        try:
            of = of[key]
        except (KeyError, TypeError, IndexError):
            return ""
        of = of[0] if isinstance(of, list) and of else of
    return of if isinstance(of, str) else ""


def _channels(stream: Any) -> list[Any]:
    try:
        return list(stream["info"]["desc"][0]["channels"][0]["channel"])
    except (KeyError, TypeError, IndexError):
        return []


def _labels(stream: Any) -> list[str]:
    """Labels of a stream's channels; a channel without a label is named by its number."""
    labels = [_text(channel, "label") or str(number) for number, channel in enumerate(_channels(stream), start=1)]
    count = _text(stream, "info", "channel_count")
    return labels or [str(number) for number in range(1, 1 + min(int(count) if count.isdecimal() else 0, MAX_COLUMNS))]


def _place(stream: str, labels: Sequence[str], column: str | int) -> int | None:
    name = str(column)
    return place_of(name.removeprefix(f"{stream}/") if name not in labels else name, labels)


def _stated(stream: Any) -> int | None:
    said = _text(stream, "footer", "info", "sample_count")
    return int(said) if said.isascii() and said.isdecimal() else None


def _unit(stream: Any, place: int) -> str:
    channels = _channels(stream)
    return _text(channels[place], "unit") if place < len(channels) else ""
