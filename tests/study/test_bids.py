"""Recordings of a study as Motion-BIDS: its own validator finds no error, and they read back as they were."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rehab_opt.errors import ConfigurationError, ProblemFileError
from rehab_opt.recordings.reading import read_recording
from rehab_opt.session.scoring import score_recordings
from rehab_opt.study.bids import write_bids
from rehab_opt.study.record import score_trials
from rehab_opt.study.store import Study
from rehab_opt.study.trial import Session
from tests.measures.yardstick import reach
from tests.refusals import refuses

VALIDATOR = "bids-validator-deno"
PINNED = "3.0.2"


def recording(path: Path, *, spatial: bool = False) -> str:
    time, points = reach(100, rest=0.3)
    head, z = ("t_s,x_m,y_m,z_mm,elbow_deg", ",{:.3f},{:.3f}") if spatial else ("t_s,x_m,y_m", "")
    rows = [f"{t:.6f},{x:.9f},{0.1 * t:.9f}" + z.format(30 * t, 10 + t) for t, (x, _) in zip(time, points, strict=True)]
    path.write_text("\n".join([head, *rows]) + "\n")
    return str(path)


@pytest.fixture
def study(tmp_path: Path) -> Study:
    how = {"reading": {"separator": "comma"}, "pause": None}
    with Study(tmp_path / "arm.db") as opened:
        for person, session, spatial in (("P-01", "week 1", False), ("P-01", "week 2", True), ("Ann", "1", True)):
            files = [recording(tmp_path / f"{person}{session}{i}.csv", spatial=spatial) for i in range(2)]
            place = Session(person, session, group=None if person == "Ann" else "stroke", visit=1)
            opened.add(place, score_trials(score_recordings(files), how))
    return Study(tmp_path / "arm.db")


def validator() -> str:
    """The validator's command; the test says what is missing where it is not there."""
    beside = Path(sys.executable).with_name(VALIDATOR)
    found = str(beside) if beside.exists() else shutil.which(VALIDATOR)
    if found is None:
        pytest.skip(f"{VALIDATOR} is not installed: pip install {VALIDATOR}=={PINNED}")
    return found


def test_the_standards_validator_finds_no_error(study: Study, tmp_path: Path) -> None:
    with study:
        write_bids(study, tmp_path / "bids")
    done = subprocess.run(
        [validator(), "--json", str(tmp_path / "bids")], capture_output=True, text=True, timeout=120, check=False
    )
    issues = json.loads(done.stdout)["issues"]["issues"]
    assert [issue for issue in issues if issue["severity"] == "error"] == []
    assert len(list((tmp_path / "bids").rglob("*_motion.tsv"))) == 6


def test_what_is_written_reads_back(study: Study, tmp_path: Path) -> None:
    with study:
        write_bids(study, tmp_path / "bids")
        with pytest.raises(ConfigurationError, match="empty"):
            write_bids(study, tmp_path / "bids")
    (there,) = (tmp_path / "bids" / "sub-P01" / "ses-week2").rglob("*run-02_motion.tsv")
    before, after = read_recording(tmp_path / "P-01week 21.csv"), read_recording(there)
    np.testing.assert_allclose(after.time, before.time - before.time[0], atol=1e-8)
    np.testing.assert_allclose(after.points, before.points, atol=1e-8)
    np.testing.assert_allclose(after.joints["elbow"], before.joints["elbow"], rtol=1e-8)
    people = (tmp_path / "bids" / "participants.tsv").read_text()
    assert people == "participant_id\tpseudonym\tgroup\nsub-P01\tP-01\tstroke\nsub-Ann\tAnn\tn/a\n"


def test_names_that_lose_their_difference_are_refused(study: Study, tmp_path: Path) -> None:
    with study:
        study.add(Session("P01", "1"), score_trials(score_recordings([recording(tmp_path / "x.csv")]), {"reading": {}}))
        with pytest.raises(ConfigurationError, match="P01"):
            write_bids(study, tmp_path / "bids")
        assert not (tmp_path / "bids").exists()
        assert len(write_bids(study, tmp_path / "bids", person="P01")) == 9
        with pytest.raises(ConfigurationError, match="--task"):
            write_bids(study, tmp_path / "other", task="a b")


CHANNELS = "name\tcomponent\ttype\ttracked_point\tunits\nx\tx\tPOS\thand\tmm\ny\ty\tPOS\thand\tmm\n"
JSON = '{"SamplingFrequency": 100, "TaskName": "reach"}'
ROWS = "100\t200\n110\tn/a\n120\t220\n130\t230\n"


def motion(written: Callable[[str, str | bytes], Path], rows: str, channels: str, text: str) -> Path:
    written("sub-1_channels.tsv", channels)
    written("sub-1_motion.json", text)
    return written("sub-1_motion.tsv", rows)


def test_a_motion_is_read_in_metres_and_seconds(written: Callable[[str, str | bytes], Path]) -> None:
    read = read_recording(motion(written, ROWS, CHANNELS, JSON))
    np.testing.assert_allclose(read.time, [0, 0.02, 0.03])
    np.testing.assert_allclose(read.points, [[0.1, 0.2], [0.12, 0.22], [0.13, 0.23]])
    assert any("1 frames without marker hand" in note for note in read.notes)


def test_a_spoilt_motion_is_refused_with_its_place(written: Callable[[str, str | bytes], Path]) -> None:
    refuses(
        lambda rows, channels, text: read_recording(motion(written, rows, channels, text)),
        ((ROWS + "1\t2\t3\n", CHANNELS, JSON), "line 5"),
        ((ROWS + "1\tx\n", CHANNELS, JSON), "line 5, column y"),
        ((ROWS + "1\t1e9\n", CHANNELS, JSON), "another unit"),
        ((ROWS, CHANNELS.replace("units", "unit"), JSON), "line 1"),
        ((ROWS, CHANNELS.replace("\ny\ty", "\nx\ty"), JSON), "each channel once"),
        ((ROWS, CHANNELS, '{"SamplingFrequency": "100"}'), "SamplingFrequency"),
        ((ROWS, CHANNELS, '{"SamplingFrequency": 1' + "0" * 5000 + "}"), "JSON"),
        error=ProblemFileError,
    )


def test_a_table_that_is_no_motion_is_refused(written: Callable[[str, str | bytes], Path]) -> None:
    with pytest.raises(ProblemFileError, match=r"_motion\.tsv"):
        read_recording(written("table.tsv", "a\tb\n1\t2\n"))
    with pytest.raises(ProblemFileError, match=r"_channels\.tsv"):
        read_recording(written("alone_motion.tsv", ROWS))
