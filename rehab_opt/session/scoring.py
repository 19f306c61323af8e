"""Scoring: cuts recordings into trials and measures them; one row for each measure of each trial (long format)."""

from __future__ import annotations

import csv
import io
import itertools
import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple, TextIO

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from rehab_opt.errors import ConfigurationError, ProblemFileError
from rehab_opt.measures.path import end_variability, path_variability
from rehab_opt.measures.samples import CUT_OFF_HZ
from rehab_opt.measures.score import Measure, Score, hand_motion, score
from rehab_opt.recordings.data_folder import PREFIX, data_file
from rehab_opt.recordings.reading import read_recording
from rehab_opt.recordings.recording import Recording, strange_sizes, within_reach
from rehab_opt.session.arm_keys import GoniometerRange, TableOneRange
from rehab_opt.session.files import recording_description, schema_error
from rehab_opt.session.outcome import Array
from rehab_opt.session.schema import RecordingSection
from rehab_opt.text_file import FARTHEST, shown, write_whole

__all__ = [
    "HEADER",
    "Described",
    "ScoreRow",
    "Scored",
    "described",
    "range_of_motion_keys",
    "score_recordings",
    "trials_between_pauses",
    "write_rows",
]

HEADER = ("recording", "trial", "measure", "value", "unit")
ALL = "all"
"""Stands in place of a trial's number for a measure over all trials."""


class ScoreRow(NamedTuple):
    """One measure of one trial; `value` is NaN if there is none."""

    recording: str
    trial: str
    measure: str
    value: float
    unit: str


class Described(NamedTuple):
    """A recording: its path or `data:folder/file`, and the arguments of `read_recording`."""

    file: str
    reading: dict[str, Any]

    @property
    def path(self) -> Path:
        """Path of the recording; raises as `data_file`."""
        return data_file(self.file, problem=self.file, key="file") if self.file.startswith(PREFIX) else Path(self.file)


class Scored(NamedTuple):
    """Scores and notes; each trial has a source, its number in the source, samples and a score.

    `refused` has the reason for each recording or trial that cannot be read or measured.
    """

    rows: tuple[ScoreRow, ...]
    notes: tuple[str, ...]
    trials: tuple[tuple[Described, int, Recording, Score], ...]
    refused: tuple[ProblemFileError, ...] = ()


def score_recordings(
    files: Sequence[str],
    *,
    reading: Mapping[str, Any] = MappingProxyType({}),
    target: Sequence[float] | None = None,
    pause: float | None = None,
    repeats: bool = False,
    cutoff_hz: float = CUT_OFF_HZ,
    threshold: float = 0.05,
) -> Scored:
    """Measures of every trial of some recordings.

    Parameters
    ----------
    files : recordings or descriptions of them (`.toml`), as paths or `data:folder/file`.
    reading : arguments of `read_recording` (`columns`, `marker`, `separator`, ...); a description's keys override them.
    target : [m] position where each movement should end, in the recordings' own frame.
    pause : [s] a rest of this length ends a trial; by default each recording is one trial.
    repeats : whether all trials repeat one movement; if so, their variability is measured, too.
    cutoff_hz, threshold : as in `measures.score`.

    Raises
    ------
    ProblemFileError : no recording can be read and measured; single failures are in `refused`.
    ConfigurationError : a target of the wrong dimension, or fewer than two repeats.
    """
    if target is not None and not all(abs(x) <= FARTHEST for x in target):
        expected = f"coordinates of at most {FARTHEST:g} m (millimetres taken for metres?)"
        raise ConfigurationError("--target", ",".join(f"{x:g}" for x in target), expected)
    rows: list[ScoreRow] = []
    notes: list[str] = []
    measured: list[tuple[Described, int, Recording, Score]] = []
    refused: list[ProblemFileError] = []
    how = {"cutoff_hz": cutoff_hz, "threshold": threshold}
    for given in files:
        source = described(given, reading)
        file = source.file
        try:
            recording = _read(source, undescribed=given == file)
            trials = [*_trials(recording, pause, how)]
        except ProblemFileError as problem:
            refused.append(problem)
            continue
        if target is not None and len(target) != recording.points.shape[1]:
            expected = f"{recording.points.shape[1]} coordinates, as {file} has"
            raise ConfigurationError("--target", ",".join(f"{x:g}" for x in target), expected)
        notes += (f"{file}: {note}" for note in recording.notes)
        for number, (name, trial) in enumerate(trials, start=1):
            try:
                if isinstance(trial, ProblemFileError):
                    raise trial
                with _refused(trial, f"trial {name}, "):
                    scored = _scored(trial, target, how)
            except ProblemFileError as problem:
                refused.append(problem)
                continue
            measured.append((source, number, trial, scored))
            rows += (ScoreRow(file, name, *measure) for measure in scored.measures)
            notes += (f"{file}, trial {name}: {note}" for note in scored.notes)
    if refused and not measured:
        raise refused[0]
    if repeats:
        rows += (ScoreRow(ALL, ALL, *measure) for measure in _variability([scored.movement for *_, scored in measured]))
        first = measured[0][-1].movement
        for source, number, _, scored in measured[1:]:
            there, back = (path_variability([first, scored.movement[::step]]) for step in (1, -1))
            if back < there / 2:
                notes.append(f"{source.file}, trial {number}: goes the other way than the first; repeats do not")
    return Scored(tuple(rows), tuple(notes), tuple(measured), tuple(refused))


def _read(source: Described, *, undescribed: bool) -> Recording:
    file = source.file
    with _options_named(undescribed):
        recording = read_recording(source.path, name=file, by_trial=True, **source.reading)
        if recording.points.shape[1] < 2 and not recording.joints:
            expected = "; ".join(("the columns that hold the hand's x and y", *recording.notes))
            raise ProblemFileError(file, "recording.columns", source.reading.get("columns"), expected)
    if undescribed:
        recording = replace(recording, joints=dict(recording.joints), notes=tuple(map(_options_in, recording.notes)))
    if recording.points.shape[1] >= 2:
        return recording
    return recording.noting("no columns of the hand's x and y are named: its joints' angles alone are measured")


def _scored(trial: Recording, target: Sequence[float] | None, how: Mapping[str, float]) -> Score:
    """Every measure of a trial; for joint angles only the range of each."""
    if trial.points.shape[1]:
        return score(trial.time, trial.points, target=target, joints=trial.joints, **how)
    measures = [Measure("duration", trial.duration, "s")]
    for name, (low, high) in _ends(trial).items():
        measures += (Measure(f"{what}_{name}", value, "deg") for what, value in (("lower", low), ("upper", high)))
        measures.append(Measure(f"range_{name}", high - low, "deg"))
    return Score(tuple(measures), np.zeros((1, 2)), ())


def _ends(trial: Recording) -> dict[str, tuple[float, float]]:
    """[deg] Lowest and highest angle of each joint."""
    turned = {name: np.degrees(np.unwrap(angles)) for name, angles in trial.joints.items()}
    return {name: (float(angles.min()), float(angles.max())) for name, angles in turned.items()}


def range_of_motion_keys(scored: Scored) -> list[str]:
    """Lines for a problem file's arm: the lowest and highest angle [deg] of each joint over all trials."""
    ends: dict[str, list[float]] = {}
    for _, _, trial, _ in scored.trials:
        for joint, both in _ends(trial).items():
            ends.setdefault(joint.removesuffix("/value").rpartition("/")[2], []).extend(both)
    if not ends:
        raise ConfigurationError("--range-of-motion", "no joint angles", "recordings with joints' angles")
    known = {*TableOneRange.model_fields, *GoniometerRange.model_fields}
    own = [joint for joint in ends if f"{joint}_deg" not in known]
    lines = ["# range used in these recordings, not the range possible"]
    if own:
        lines.append(f"# the recording's names, which no arm has; write the arm's: {shown(', '.join(own), 120)}")
    lines.append("[arm.range_of_motion]")
    lines += (f"{json.dumps(f'{joint}_deg')} = [{min(of):.1f}, {max(of):.1f}]" for joint, of in ends.items())
    return lines


def _trials(
    recording: Recording, pause: float | None, how: Mapping[str, float]
) -> Iterator[tuple[str, Recording | ProblemFileError]]:
    """Name and samples of each trial as separated by the file; with `pause`, also cut where the hand rests."""
    for name, first, last in recording.trials or (("", -math.inf, math.inf),):
        kept = (recording.time >= first) & (recording.time <= last)
        try:
            piece = within_reach(replace(recording, trials=(), joints=dict(recording.joints)).part(kept))
            parts = [piece] if pause is None else trials_between_pauses(piece, pause=pause, **how)
        except ProblemFileError as refused:
            if not name:
                raise
            yield name, ProblemFileError(refused.file, f"trial {name}, {refused.key}", refused.value, refused.expected)
            continue
        for number, part in enumerate(parts, start=1):
            yield (f"{name}.{number}" if name and pause is not None else name or str(number)), part


def described(file: str, reading: Mapping[str, Any] = MappingProxyType({})) -> Described:
    """A recording given directly or by its description (`.toml`), whose keys override `reading`."""
    named = Described(file, dict(reading))
    if not file.endswith(".toml"):
        return named
    said = recording_description(named.path, file)["recording"]
    if "fingers" in said:  # a recording of hand poses, as for `mirror`
        kept = ("file", "hand", "separator", "decimal")
        said = {"columns": ["x_m", "y_m", "z_m"], **{key: said[key] for key in kept if key in said}}
    try:
        section = RecordingSection.model_validate(said)
    except ValidationError as refused:
        raise schema_error(refused, file) from refused
    own = {key: value for key, value in section.reading().items() if key in section.model_fields_set}
    return Described(section.file, {**reading, **own})


def trials_between_pauses(
    recording: Recording, *, pause: float, cutoff_hz: float = CUT_OFF_HZ, threshold: float = 0.05
) -> list[Recording]:
    """The recording, cut in the middle of each rest of at least `pause` [s].

    The hand rests while it is slower than `threshold` times its largest speed, or below the noise (`HandMotion.goes`).
    A rest at either end belongs to the first or last trial.
    """
    if not 0 < pause < math.inf:
        raise ConfigurationError("pause", pause, "seconds above zero")
    with _refused(recording):
        motion = hand_motion(recording.time, recording.points, cutoff_hz=cutoff_hz, threshold=threshold)
    moving, count = np.flatnonzero(motion.speed >= motion.threshold * motion.speed.max()), len(motion.speed)
    parts = np.split(moving, np.flatnonzero(np.diff(moving) >= pause * motion.even.rate_hz) + 1)
    pieces = itertools.pairwise([0, *_middles(parts), count])
    parts = [part for part, (first, last) in zip(parts, pieces, strict=True) if motion.goes(slice(first, last))]
    cuts = motion.even.time[_middles(parts)]
    places = np.searchsorted(recording.time, cuts)
    bounds = [0, *places.tolist(), len(recording.time)]
    return [_part(recording, first, last) for first, last in itertools.pairwise(bounds)]


def write_rows(rows: Sequence[ScoreRow], file: TextIO | Path) -> None:
    """Write the rows as comma-separated values under `HEADER`; a missing value is an empty cell."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(HEADER)
    for row in rows:
        writer.writerow(row._replace(value="" if math.isnan(row.value) else f"{row.value:.9g}"))  # type: ignore[arg-type]
    if isinstance(file, Path):
        write_whole(file, text.getvalue().encode())
    else:
        file.write(text.getvalue())


def _middles(parts: Sequence[NDArray[np.int_]]) -> list[int]:
    """Indices of the samples in the middle of each rest between two movements."""
    return [int(a[-1] + b[0] + 1) // 2 for a, b in itertools.pairwise(parts)]


def _part(recording: Recording, first: int, last: int) -> Recording:
    return Recording(
        file=recording.file,
        time=recording.time[first:last],
        points=recording.points[first:last],
        joints={name: angles[first:last] for name, angles in recording.joints.items()},
    )


KEY = re.compile(r"recording\.(\w+)(?: = '(\w+)')?")


@contextmanager
def _options_named(undescribed: bool) -> Iterator[None]:
    """Context in which errors name the command's options instead of keys, if a recording has no description."""
    try:
        yield
    except ProblemFileError as refused:
        if not undescribed:
            raise
        key, expected = map(_options_in, (refused.key, refused.expected))
        raise ProblemFileError(refused.file, key, refused.value, expected) from refused


def _options_in(text: str) -> str:
    """A text with options of the command instead of keys."""
    return KEY.sub(lambda found: " ".join(("--" + found[1].replace("_", "-"), found[2] or "")).strip(), text)


@contextmanager
def _refused(recording: Recording, where: str = "") -> Iterator[None]:
    """Context in which an error names the recording, and the unit that the recording's sizes suggest."""
    try:
        yield
    except ConfigurationError as refused:
        if refused.argument in ("cutoff_hz", "threshold", "target"):
            raise
        sizes = () if refused.argument == "time" else strange_sizes(recording)  # too few samples have no size
        expected = "; ".join((refused.expected, *sizes))
        raise ProblemFileError(recording.file, f"{where}{refused.argument}", refused.value, expected) from refused


def _variability(movements: Sequence[Array]) -> Iterator[Measure]:
    if len(movements) < 2:
        raise ConfigurationError("--repeats", f"{len(movements)} trial", "two or more trials of one movement")
    if min(map(len, movements)) < 2:
        raise ConfigurationError("--repeats", "joints' angles alone", "recordings of a hand's path")
    if len({movement.shape[1] for movement in movements}) > 1:
        raise ConfigurationError("--repeats", "recordings in the plane and in space", "one or the other")
    yield Measure("path_variability", path_variability(movements), "m")
    yield Measure("end_variability", end_variability(movements), "m")
