"""Small files after public bug reports, beside the data folder: each is read with the value of its sibling."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rehab_opt.errors import ProblemFileError
from rehab_opt.recordings.reading import read_recording
from rehab_opt.session.files import load_problem
from rehab_opt.session.run import checked
from rehab_opt.session.scoring import score_recordings

Recorded = Callable[[str], Path]
HAND, COUNTS = {"marker": "HAND"}, {"count_mm": 0.1, "tick_ms": 1.0}
SIBLINGS: dict[str, tuple[dict[str, Any], str, dict[str, Any]]] = {
    "B01_with_marker_stream.xdf": ({"columns": ("X", "Y", "Z")}, "B01_alone.xdf", {"columns": ("X", "Y", "Z")}),
    "B07_240Hz_3decimals.trc": (HAND, "B07_240Hz_6decimals.trc", HAND),
    "B07_400Hz_3decimals.trc": (HAND, "B07_400Hz_6decimals.trc", HAND),
    "B11_double_tabs.trc": (HAND, "B11_ok.trc", HAND),
    "B11_every_second.trc": (HAND, "B11_ok.trc", HAND),
    "B11_unnamed_marker.trc": (HAND, "B11_ok.trc", HAND),
    "B14_numpy.csv": ({}, "B14_timestamp.csv", {}),
    "B14_pandas.csv": ({}, "B14_timestamp.csv", {}),
    "B25_named_counts.csv": (COUNTS | {"columns": ("wristX", "wristY")}, "B25_ok.csv", COUNTS),
    "sub-01_task-reach_tracksys-seconds_motion.tsv": ({}, "sub-01_task-reach_tracksys-s_motion.tsv", {}),
}
"""Each file and how it is read; that of the same movement which was always read."""


@pytest.fixture
def case(recorded: Recorded) -> Recorded:
    return lambda name: recorded(f"../cases/recordings/{name}")


def measured(path: Path, **reading: Any) -> dict[str, float]:
    return {row.measure: row.value for row in score_recordings([str(path)], reading=reading).rows}


@pytest.mark.parametrize("name", SIBLINGS)
def test_a_file_has_the_value_of_its_sibling(name: str, case: Recorded) -> None:
    how, sibling, its = SIBLINGS[name]
    read, plain = measured(case(name), **how), measured(case(sibling), **its)
    assert read.keys() == plain.keys()
    np.testing.assert_allclose([*read.values()], [*plain.values()], rtol=0.02, atol=1e-9)


@pytest.mark.parametrize(("name", "turned"), [("B04_moco.sto", 68.7549), ("B04_states.sto", 68.7549)])
def test_of_opensim_states_angles_alone_are_angles(name: str, turned: float, case: Recorded) -> None:
    found = measured(case(name))
    assert [value for key, value in found.items() if key.startswith("range_")] == [pytest.approx(turned, abs=1e-3)]


def test_what_a_c3d_lists_as_angles_is_no_place(case: Recorded) -> None:
    path = case("B06_angles.c3d")
    assert len(read_recording(path, marker="HAND").time) > 1
    with pytest.raises(ProblemFileError, match="ANGLES lists it"):
        read_recording(path, marker="RElbowAngles")


@pytest.mark.parametrize(
    ("name", "marker", "frames"), [("B17_long.c3d", "HAND", 65536), ("B17_600_markers.c3d", "M599", 2)]
)
def test_long_c3d_files_are_read_to_their_end(name: str, marker: str, frames: int, case: Recorded) -> None:
    assert len(read_recording(case(name), marker=marker).time) >= frames


def test_raw_counts_are_asked_for_what_they_are(case: Recorded) -> None:
    with pytest.raises(ProblemFileError, match="what a raw count is"):
        read_recording(case("B08_raw.svc"))


def test_seconds_of_a_real_reach_are_kept(case: Recorded) -> None:
    assert measured(case("B03_reset.csv"))["duration"] == pytest.approx(39.99)


@pytest.mark.parametrize(("name", "left_out"), [("B12_same_time_twice.sto", "1 sample"), ("B15_gap.csv", "3 samples")])
def test_what_is_left_out_is_noted(name: str, left_out: str, case: Recorded) -> None:
    scored = score_recordings([str(case(name))])
    assert any(f"left out: {left_out}" in note for note in scored.notes)
    assert {row.measure: row.value for row in scored.rows}["duration"] == pytest.approx(1.19)


def test_poses_have_the_gaps_of_places(case: Recorded) -> None:
    places, poses = measured(case("B15_gap.csv")), measured(case("B15_poses.toml"))
    assert places == pytest.approx(poses, rel=1e-9)


def test_a_lift_with_y_up_is_noted_or_turned(case: Recorded) -> None:
    assert measured(case("B21_y_up.trc"), **HAND, up="y")["range_z"] == pytest.approx(0.4, abs=0.01)
    assert any(" up" in str(each) for each in checked(load_problem(str(case("B21.toml")))))
