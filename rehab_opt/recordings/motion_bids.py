"""Motion-BIDS: samples without a header (_motion.tsv), what their columns are (_channels.tsv), their rate (json)."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rehab_opt.errors import ProblemFileError
from rehab_opt.recordings.markers import seen_marker
from rehab_opt.recordings.recording import Recording
from rehab_opt.recordings.tables import ANGLE, LENGTH, TIME
from rehab_opt.text_file import (
    FARTHEST,
    LATEST,
    MAX_PROBLEM_SIZE,
    finite_number,
    header_cells,
    shown,
    text_lines,
    whole_text,
)

__all__ = ["MISSING", "MOTION", "REQUIRED", "read_motion"]

Array = NDArray[np.float64]

MOTION = "_motion.tsv"
REQUIRED = ("name", "component", "type", "tracked_point", "units")
"""Columns of a _channels.tsv, in the order that the standard asks for."""
MISSING = "n/a"


def read_motion(path: Path, *, name: str, marker: str | None) -> Recording:
    """Path of one tracked point, (N, 2) or (N, 3) [m], and every joint angle (`JNTANG`).

    Times are the channel `LATENCY`, or come from `SamplingFrequency`. Samples without the point are left out, with a
    note.

    Parameters
    ----------
    marker : the tracked point; may be left out where there is one alone.

    Raises
    ------
    ProblemFileError : no _channels.tsv or _motion.json beside it, no such point, a unit that is none of its type, a row
        of the wrong length, a cell that is no number, a point hidden for more than 0.2 s.
    """
    if not path.name.endswith(MOTION):
        raise ProblemFileError(name, "file", shown(path.name, 80), f"a recording of Motion-BIDS, ending in {MOTION}")
    channels = _channels(path, name)
    points = list(dict.fromkeys(each["tracked_point"] for each in channels if each["type"] == "POS"))
    if marker is None and len(points) == 1:
        marker = points[0]
    if marker not in points:
        raise ProblemFileError(name, "recording.marker", marker, f"one of {shown(', '.join(points), 120)}")
    axes = [_channel(channels, name, type="POS", tracked_point=marker, component=axis) for axis in "xyz"]
    places = [place for place in axes if place is not None]
    if places != [place for place in axes[: len(places)] if place is not None] or len(places) < 2:
        raise ProblemFileError(name, f"channels of {marker}", len(places), "components x, y and, if there is one, z")
    joints = [i for i, each in enumerate(channels) if each["type"] == "JNTANG"]
    latency = _channel(channels, name, type="LATENCY")
    scale = [_unit(channels, place, LENGTH, name) for place in places]
    wanted = [*([] if latency is None else [latency]), *places, *joints]
    most = dict(zip(places, (FARTHEST / each for each in scale), strict=True))
    rows = _numbers(path, name, channels, wanted, most, {*places})
    values = dict(zip(wanted, rows.T, strict=True))
    if latency is None:
        time = np.arange(len(rows)) / _rate(path, name)
    else:
        time = values[latency] * _unit(channels, latency, TIME, name)
    position = np.column_stack([values[place] * each for place, each in zip(places, scale, strict=True)])
    seen = ~np.isnan(position).any(axis=1)
    position[~seen] = math.nan
    moved = seen_marker(np.column_stack((time, position)), name, marker, 1.0, str(len(rows)))
    angles = {channels[i]["name"]: values[i][seen] * _unit(channels, i, ANGLE, name) for i in joints}
    return Recording(name, moved.time.copy(), moved.points.copy(), joints=angles, notes=moved.notes)


def _beside(path: Path, end: str) -> Path:
    return path.with_name(path.name.removesuffix(MOTION) + end)


def _channels(path: Path, name: str) -> list[dict[str, str]]:
    """The channels in their order; `name` is what errors call the recording, and the file beside it after its end."""
    beside = _beside(path, "_channels.tsv")
    said = f"{name}, {beside.name}"
    lines = text_lines(beside, said)
    header = header_cells(lines[0].split("\t"), name=said, line=1)
    missing = [column for column in REQUIRED if column not in header]
    if missing or len(set(header)) < len(header):
        raise ProblemFileError(said, "line 1", shown(", ".join(header)), f"each once: {', '.join(REQUIRED)}")
    channels = []
    for number, line in enumerate(lines[1:], start=2):
        cells = [cell.strip() for cell in line.split("\t")]
        if len(cells) != len(header):
            raise ProblemFileError(said, f"line {number}", f"{len(cells)} cells", f"{len(header)}, as in the header")
        channels.append(dict(zip(header, cells, strict=True)))
    names = [each["name"] for each in channels]
    if len(set(names)) < len(names):
        raise ProblemFileError(said, "name", shown(", ".join(names)), "each channel once")
    return channels


def _channel(channels: list[dict[str, str]], name: str, **facts: str) -> int | None:
    """Place of the channel of which `facts` hold; None where there is none."""
    found = [i for i, each in enumerate(channels) if all(each[key] == value for key, value in facts.items())]
    if len(found) > 1:
        raise ProblemFileError(name, "channels", " and ".join(channels[i]["name"] for i in found), f"one of {facts}")
    return found[0] if found else None


def _unit(channels: list[dict[str, str]], place: int, units: Any, name: str) -> float:
    said = channels[place]["units"]
    if said not in units:
        raise ProblemFileError(
            name, f"units of channel {shown(channels[place]['name'])}", said, f"one of {', '.join(units)}"
        )
    return float(units[said])


def _numbers(  # noqa: PLR0917  (a table, and what is wanted of it)
    path: Path, name: str, channels: list[dict[str, str]], wanted: list[int], most: dict[int, float], may_miss: set[int]
) -> Array:
    rows = []
    for number, line in enumerate(text_lines(path, name), start=1):
        cells = line.split("\t")
        if len(cells) != len(channels):
            raise ProblemFileError(name, f"line {number}", f"{len(cells)} cells", f"{len(channels)}, one a channel")
        row = []
        for place in wanted:
            cell, said = cells[place].strip(), channels[place]["name"]
            hidden = cell == MISSING and place in may_miss
            limit = most.get(place, LATEST)
            row.append(math.nan if hidden else finite_number(cell, name=name, line=number, column=said, most=limit))
        rows.append(row)
    return np.array(rows)


def _rate(path: Path, name: str) -> float:
    beside = _beside(path, "_motion.json")
    said = f"{name}, {beside.name}"
    try:
        content = json.loads(whole_text(beside, said, max_size=MAX_PROBLEM_SIZE))
    except (ValueError, RecursionError) as problem:
        if isinstance(problem, ProblemFileError):
            raise
        raise ProblemFileError(said, "file", shown(str(problem)), "JSON") from problem
    rate = content.get("SamplingFrequency") if isinstance(content, dict) else None
    if isinstance(rate, bool) or not isinstance(rate, int | float) or not 0 < rate < math.inf:
        raise ProblemFileError(said, "SamplingFrequency", shown(str(rate)), "samples a second, above zero")
    return float(rate)
