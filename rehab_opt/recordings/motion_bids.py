"""Read Motion-BIDS recordings: samples (_motion.tsv), columns (_channels.tsv), and sampling rate (_motion.json)."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np

from rehab_opt.errors import ProblemFileError
from rehab_opt.recordings.recording import Samples
from rehab_opt.recordings.tables import MISSING, numbers_below
from rehab_opt.recordings.units import Reading, place_of
from rehab_opt.text_file import LATEST, MAX_PROBLEM_SIZE, header_cells, shown, text_lines, whole_text

__all__ = ["MOTION", "REQUIRED", "read_motion"]

MOTION = "_motion.tsv"
REQUIRED = ("name", "component", "type", "tracked_point", "units")
"""Required columns of a _channels.tsv file, in the order of the standard."""


def read_motion(path: Path, *, name: str, how: Reading) -> Samples:
    """Path (N, 2) or (N, 3) [m] of one tracked point, and all joint angles (`JNTANG`); NaN for cells `n/a`.

    Times come from the channel `LATENCY` or from `SamplingFrequency`. If there is a single tracked point, the user need
    not name it. Sidecar files may be in a folder above and name fewer entities, as the standard allows.

    Raises
    ------
    ProblemFileError : a sidecar file or the tracked point is missing, a unit does not fit the channel's type, a row has
        the wrong length, or a cell is not a number.
    """
    if not path.name.endswith(MOTION):
        raise ProblemFileError(name, "file", shown(path.name, 80), f"a recording of Motion-BIDS, ending in {MOTION}")
    channels = _channels(path, name)
    places = _places(channels, name, how)
    joints = [i for i, each in enumerate(channels) if each["type"] == "JNTANG"]
    latency = _channel(channels, name, type="LATENCY") if how.rate_hz is None else None
    times = [] if latency is None else [latency]
    scale = {
        i: how.factor(kind, channels[i]["units"], name=name, where=f"units of channel {shown(channels[i]['name'])}")
        for kind, some in (("time", times), ("length", places), ("angle", joints))
        for i in some
    }
    wanted = [*times, *places, *joints]
    most = {i: LATEST / scale[i] for i in times}
    names = [str(i) for i in range(len(channels))]
    rows = numbers_below(
        text_lines(path, name), names, [names[i] for i in wanted], {names[i]: most[i] for i in most}, name=name,
        first=1, separator="\t", missing=dict.fromkeys((names[i] for i in wanted[len(times) :]), MISSING),
        called={names[i]: each["name"] for i, each in enumerate(channels)},
    )  # fmt: skip
    values = {i: scale[i] * column for i, column in zip(wanted, rows.T, strict=True)}
    time = values[times[0]] if times else np.arange(len(rows)) / (how.rate_hz or _rate(path, name))
    angles = {channels[i]["name"]: values[i] for i in joints}
    return Samples(time, np.column_stack([values[i] for i in places]) if places else np.empty((len(rows), 0)), angles)


def _places(channels: list[dict[str, str]], name: str, how: Reading) -> list[int]:
    """Indices of the channels with x, y and, if present, z of the tracked point; empty without tracked points."""
    points = list(dict.fromkeys(each["tracked_point"] for each in channels if each["type"] == "POS"))
    if not points and how.marker is None and any(each["type"] == "JNTANG" for each in channels):
        return []
    place = 0 if how.marker is None and len(points) == 1 else place_of(str(how.marker), points)
    if place is None:
        expected = f"one of {shown(', '.join(points), 120)}" if points else "no such key: no channel has the type POS"
        raise ProblemFileError(name, "recording.marker", how.marker, expected)
    axes = [_channel(channels, name, type="POS", tracked_point=points[place], component=axis) for axis in "xyz"]
    found = [each for each in axes if each is not None]
    if found != [each for each in axes[: len(found)] if each is not None] or len(found) < 2:
        raise ProblemFileError(
            name, f"channels of {points[place]}", len(found), "components x, y and, if there is one, z"
        )
    return found


def _sidecars(path: Path, end: str) -> list[Path]:
    """Sidecar files of a recording with this ending, nearest first; their entities are a subset of the recording's."""
    own = {*path.name.removesuffix(MOTION).split("_")}
    found = []
    for folder in path.absolute().parents:
        try:
            here = [each for each in folder.iterdir() if each.name.endswith(end) or each.name == end[1:]]
        except OSError:  # a folder that cannot be read
            break
        fits = [each for each in here if {*each.name.removesuffix(end[1:]).rstrip("_").split("_")} - {""} <= own]
        found += sorted(fits, key=lambda each: -len(each.name))
        if not any(each.startswith(("sub-", "ses-")) for each in (folder.name, folder.parent.name)):
            break  # folders above the participants' folders are not part of the dataset
    return found or [path.with_name(path.name.removesuffix(MOTION) + end)]


def _channels(path: Path, name: str) -> list[dict[str, str]]:
    """Rows of the _channels.tsv file in order; `name` is the recording's name in error messages."""
    beside = _sidecars(path, "_channels.tsv")[0]
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
        channel = dict(zip(header, cells, strict=True))
        channels.append(channel | {"type": channel["type"].upper(), "component": channel["component"].lower()})
    names = [each["name"] for each in channels]
    if len(set(names)) < len(names):
        raise ProblemFileError(said, "name", shown(", ".join(names)), "each channel once")
    return channels


def _channel(channels: list[dict[str, str]], name: str, **facts: str) -> int | None:
    """Index of the channel whose cells have these values; None without such a channel."""
    found = [i for i, each in enumerate(channels) if all(each[key] == value for key, value in facts.items())]
    if len(found) > 1:
        raise ProblemFileError(name, "channels", " and ".join(channels[i]["name"] for i in found), f"one of {facts}")
    return found[0] if found else None


def _rate(path: Path, name: str) -> float:
    rate, said = None, name
    for beside in _sidecars(path, "_motion.json"):
        said = f"{name}, {beside.name}"
        try:
            content = json.loads(whole_text(beside, said, max_size=MAX_PROBLEM_SIZE))
        except (ValueError, RecursionError) as problem:
            if isinstance(problem, ProblemFileError):
                raise
            raise ProblemFileError(said, "file", shown(str(problem)), "JSON") from problem
        rate = content.get("SamplingFrequency") if isinstance(content, dict) else None
        if rate is not None:
            break
    if isinstance(rate, bool) or not isinstance(rate, int | float) or not 0 < rate < math.inf:
        raise ProblemFileError(said, "SamplingFrequency", shown(str(rate)), "samples a second, above zero")
    return float(rate)
