"""The recordings of a study as a data set of Motion-BIDS."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rehab_opt.errors import ConfigurationError
from rehab_opt.recordings.motion_bids import MISSING, REQUIRED
from rehab_opt.recordings.reading import read_recording
from rehab_opt.recordings.recording import Recording
from rehab_opt.study.person import RECORDING, new_folder, private_text
from rehab_opt.study.store import Study
from rehab_opt.study.summary import FROM, IN_ORDER, of_person
from rehab_opt.version import __version__

__all__ = ["write_bids"]

VERSION = "1.10.0"
SYSTEM = "hand"


def write_bids(study: Study, folder: Path, *, person: str | None = None, task: str = "movement") -> tuple[Path, ...]:
    """Write the recordings whose trials were scored, each once: hand [m], joint angles [deg] and times [s].

    Names of people and sessions keep letters and digits alone, as the standard asks; participants.tsv and sessions.tsv
    have the originals. Forces are left out: the standard has no such channel.

    Parameters
    ----------
    folder : new or empty.
    task : what was done, letters and digits.

    Raises
    ------
    ConfigurationError : a task of other characters, two people or sessions that lose their difference, a folder with
        something in it, no recordings.
    ProblemFileError : a recording cannot be read any more.
    """
    if not re.fullmatch(r"[A-Za-z0-9]+", task):
        raise ConfigurationError("--task", task, "letters and digits")
    of, who = of_person(person)
    question = (
        f'SELECT DISTINCT p.name, p."group", s.name, s.visit, s.date, f.path, b.text {FROM} '
        "JOIN files f ON f.trial = t.id JOIN problems b ON b.id = t.problem "
        f"WHERE {of} AND f.kind = ? AND t.kind = 'score' ORDER BY p.id, {IN_ORDER}, t.number"
    )
    rows = study.rows(question, (*who, RECORDING))
    if not rows:
        raise ConfigurationError("study", str(study.file), "trials of recordings, which `rehab-opt score --study` adds")
    people = _labels([row[0] for row in rows], "person")
    new_folder(folder)
    description = {
        "Name": study.file.stem,
        "BIDSVersion": VERSION,
        "DatasetType": "raw",
        "GeneratedBy": [{"Name": "rehab_opt", "Version": __version__}],
    }
    written = [
        _json(folder / "dataset_description.json", description),
        private_text(
            folder / "README", f"{study.file.stem}: movements of hands, written by rehab_opt {__version__}.\n"
        ),
    ]
    groups = dict(row[:2] for row in rows)
    table = [(f"sub-{people[name]}", name, group or MISSING) for name, group in groups.items()]
    written.append(_tsv(folder / "participants.tsv", ("participant_id", "pseudonym", "group"), table))
    columns = {"pseudonym": {"Description": "In the study"}, "group": {"Description": "Of the study"}}
    written.append(_json(folder / "participants.json", columns))
    for name in groups:
        mine = [row for row in rows if row[0] == name]
        written += _write_person(study, folder, f"sub-{people[name]}", mine, task)
    return tuple(written)


def _write_person(study: Study, folder: Path, subject: str, rows: Sequence[Any], task: str) -> list[Path]:
    sessions = _labels([row[2] for row in rows], "session")
    table = {f"ses-{sessions[row[2]]}": (row[2], str(row[3] if row[3] is not None else MISSING)) for row in rows}
    home = folder / subject
    home.mkdir()
    head = ("session_id", "name", "visit")
    written = [_tsv(home / f"{subject}_sessions.tsv", head, [(key, *values) for key, values in table.items()])]
    columns = {"name": {"Description": "In the study"}, "visit": {"Description": "Number of the visit"}}
    written.append(_json(home / f"{subject}_sessions.json", columns))
    runs: dict[str, int] = {}
    for *_, session, _visit, _date, path, how in rows:
        place = f"ses-{sessions[session]}"
        runs[place] = runs.get(place, 0) + 1
        recording = read_recording(study.place(path), name=path, clean=False, **json.loads(how)["reading"])
        (home / place / "motion").mkdir(parents=True, exist_ok=True)
        stem = f"{subject}_{place}_task-{task}_tracksys-{SYSTEM}_run-{runs[place]:02}"
        written += _write_motion(home / place / "motion" / stem, recording, task)
    return written


def _write_motion(stem: Path, recording: Recording, task: str) -> list[Path]:
    rate = 1 / float(np.median(np.diff(recording.time)))
    channels = [("latency", MISSING, "LATENCY", MISSING, "s")]
    channels += [(f"hand_{axis}", axis, "POS", "hand", "m") for axis in "xyz"[: recording.points.shape[1]]]
    channels += [(name, MISSING, "JNTANG", name, "deg") for name in recording.joints]
    angles = [np.degrees(values) for values in recording.joints.values()]
    samples = np.column_stack([recording.time - recording.time[0], recording.points, *angles])
    rows = [[f"{value:.9g}" for value in row] for row in samples.tolist()]
    said = {
        "TaskName": task,
        "TaskDescription": "; ".join(recording.notes) or "a movement of a hand",
        "SamplingFrequency": rate,
        "SamplingFrequencyEffective": (len(samples) - 1) / recording.duration,
        "TrackingSystemName": SYSTEM,
        "TrackedPointsCount": 1,
        "MotionChannelCount": len(channels),
        "POSChannelCount": recording.points.shape[1],
        "JNTANGChannelCount": len(angles),
        "LATENCYChannelCount": 1,
        "RecordingDuration": recording.duration,
    }
    return [
        _tsv(stem.with_name(f"{stem.name}_motion.tsv"), None, rows),
        _json(stem.with_name(f"{stem.name}_motion.json"), said),
        _tsv(stem.with_name(f"{stem.name}_channels.tsv"), REQUIRED, channels),
    ]


def _labels(names: Sequence[str], what: str) -> dict[str, str]:
    """Letters and digits of each name, which must tell them apart."""
    labels = {name: re.sub(r"[^A-Za-z0-9]", "", name) for name in names}
    taken: dict[str, str] = {}
    for name, label in labels.items():
        other = taken.setdefault(label.casefold(), name)
        if not label or other != name:
            raise ConfigurationError(
                what, name, f"letters and digits of its own, unlike {other!r}: Motion-BIDS has no others"
            )
    return labels


def _tsv(path: Path, head: Sequence[str] | None, rows: Sequence[Sequence[str]]) -> Path:
    lines = [*([] if head is None else [head]), *rows]
    return private_text(path, "".join("\t".join(cells) + "\n" for cells in lines))


def _json(path: Path, content: dict[str, Any]) -> Path:
    return private_text(path, json.dumps(content, indent=1, allow_nan=False) + "\n")
