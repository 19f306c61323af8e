"""Recordings as other people and other devices write them: European tables, raw counts, storage files, C3D."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rehab_opt.errors import ProblemFileError
from rehab_opt.recordings.reading import read_recording
from rehab_opt.recordings.tables import canonical_name
from rehab_opt.session.files import load_problem
from rehab_opt.session.mirror.hand_poses import calibration_points, read_hand_poses
from rehab_opt.session.mirror.problem import PoseRecordingSection
from rehab_opt.session.run import checked
from rehab_opt.session.systems import NotMet
from tests.refusals import refuses
from tests.session.made_c3d import c3d, parameter

Write = Callable[[str, str | bytes], Path]
Array = np.ndarray


# ------------------------------------------------------------------------------------------------------------ tables
@pytest.mark.parametrize(
    ("cell", "name"),
    [
        ("x_mm", "x_mm"), ("X [mm]", "x_mm"), ("Y/cm", "y_cm"), ('"x_m"', "x_m"),

        ("Elbow (°)", "Elbow_deg"), ("x [inch]", "x [inch]"),
        ("pressure", "pressure"), ("a/b/c", "a/b/c"), ("(" * 9999, "(" * 9999),
    ],
)  # fmt: skip
def test_a_header_says_its_units_in_many_ways(cell: str, name: str) -> None:
    assert canonical_name(cell) == name


HAND = {"hand": "right", "frame": "robot", "fingers": "+x", "back": "+z"}
NUMBERED = {"position_columns": [2, 3, 4], "quaternion_columns": [5, 6, 7, 8], "rate_hz": 2.0}
HEADED = ["\ufefft_s;x_m;y_m;z_m;qx;qy;qz;qw"]
POSES = ["0,0;1,5;-2,0;0,1;0;0;0;1", "0,5;2,5e-1;3;0,2;0;0;0,6;0,8", "1;;nan;0;0;0;0;1"]


@pytest.mark.parametrize(("separator", "mark"), [("semicolon", ";"), ("tab", "\t")])
def test_a_european_table_of_places_or_of_poses_is_read(written: Write, separator: str, mark: str) -> None:
    rows = ["\ufeffZeit;t [s];x [mm];y [mm];", "a.m.;0,0;1,5;-2,0;", "b;0,5;2,5e1;3;"]
    path = written("a.csv", "\r\n".join(rows).replace(";", mark))
    recording = read_recording(path, separator=separator, decimal="comma")
    np.testing.assert_allclose(recording.time, [0, 0.5])
    np.testing.assert_allclose(recording.points, [[0.0015, -0.002], [0.025, 0.003]])
    assert recording.notes == ("columns not read: Zeit",)
    for columns, above in (({}, HEADED), (NUMBERED, [])):
        path = written("b.csv", "\r\n".join(above + POSES).replace(";", mark))
        section = PoseRecordingSection(file="b.csv", separator=separator, decimal="comma", **HAND, **columns)
        seen = read_hand_poses(path, section, file="b.toml")
        np.testing.assert_allclose(seen.times, [0, 0.5, 1])
        np.testing.assert_allclose(seen.positions, [[1.5, -2, 0.1], [0.25, 3, 0.2], [math.nan, math.nan, 0]])
        np.testing.assert_allclose(seen.quaternions[1], [0, 0, 0.6, 0.8])
        if mark == ";":
            with pytest.raises(ProblemFileError, match="'semicolon', which line 1 has 7 times"):
                read_hand_poses(path, PoseRecordingSection(file="b.csv", **HAND, **columns), file="b.toml")


@pytest.mark.parametrize("mark", [",", ";", "\t"])
@pytest.mark.parametrize("number", ["1.5", "1,5"])
def test_calibration_points_are_separated_as_their_own_header_is(written: Write, mark: str, number: str) -> None:
    """Not as the recording: whoever had one of each could say `recording.separator` as they would, one was refused."""
    header = mark.join(f"{frame}_{axis}_m" for frame in ("vr", "robot") for axis in "xyz")
    path = written("points.csv", f"{header}\n" + f"{mark.join([number, *'23456'])}\n" * 3)
    if mark in number:
        with pytest.raises(ProblemFileError, match=r"line 2 = '7 cells'.*decimal commas\? then other separators"):
            calibration_points(path, name="points.csv")
    else:
        source, target = calibration_points(path, name="points.csv")
        np.testing.assert_array_equal(source, [[1.5, 2, 3]] * 3)
        np.testing.assert_array_equal(target, [[4, 5, 6]] * 3)


def test_calibration_point_that_is_no_number_is_named_by_its_line_and_one_of_10_m_is_usable(written: Write) -> None:
    header = ",".join(f"{frame}_{axis}_m" for frame in ("vr", "robot") for axis in "xyz")
    path = written("points.csv", f"{header}\n-10,10,3,4,5,6\n1,2,3,4,5,6\n1,2,10.01,4,5,6\n")
    with pytest.raises(ProblemFileError, match="line 4"):
        calibration_points(path, name="points.csv")


def test_quoted_cells_and_columns_by_either_name_are_read(written: Write) -> None:
    path = written("a.csv", '"t_s","hand x [mm]","hand y [mm]"\n"0","1","2"\n"1","30","40"\n')
    for columns in (["hand x [mm]", "hand y [mm]"], ["hand x_mm", "hand y_mm"]):
        np.testing.assert_allclose(read_recording(path, columns=columns).points, [[0.001, 0.002], [0.03, 0.04]])


def test_raw_counts_are_scaled(written: Write) -> None:
    table = written("a.csv", "time,x,y,z\n0,100,200,0\n5,1100,200,100\n")
    recording = read_recording(table, count_mm=0.01, tick_ms=7.5)
    np.testing.assert_allclose(recording.time, [0, 0.0375])
    np.testing.assert_allclose(recording.points, [[0.001, 0.002, 0], [0.011, 0.002, 0.001]])
    pen = written("a.svc", "2\n100000 200000 0 1\n100000 300000 1000 1\n")
    recording = read_recording(pen, count_mm=0.001, tick_ms=1.0)
    np.testing.assert_allclose(recording.points, [[0.1, 0.2], [0.1, 0.3]])
    np.testing.assert_allclose(recording.time, [0, 1.0])


def test_other_units_are_noticed_by_size(written: Write) -> None:
    for table, says in (
        ("t_s,x_mm,y_mm\n0,0,0\n1,0.3,0.2\n", "0.3 mm large: is its unit larger?"),
        ("t_s,x_m,y_m\n0,0,0\n0.01,0.5,0\n0.02,1,0\n", "faster than 50 m/s"),
        ("t_s,x_m,y_m\n0,0,0\n0.2,1,0\n0.4,2,0\n", "faster than 5 m/s"),  # 2 mm, at 5 mm/s
        ("t_s,x_mm,y_mm\n0,0,0\n2,3e3,0\n4,6e3,0\n", "6000 mm large: is its unit smaller?"),
        ("t_s,x_mm,y_mm\n0,3,4\n1,3,4\n", "does not move at all: is it another column or marker?"),
        ("t_s,x_m,y_m\n0,0,0\n1000,0.1,0\n2000,0.2,0\n", "milliseconds taken for seconds"),
        ("t_s,x_m,y_m,elbow_rad\n0,0,0,20\n1,0.3,0,90\n", "elbow reads up to 90 rad, 5157 deg: degrees taken for rad"),
        ("t_s,x_m,y_m,elbow_deg,wrist_deg\n0,0,0,0.3,1\n1,0.3,0,1.6,1\n", "more than 1.3 deg: radians taken for deg"),
    ):
        assert says in " ".join(read_recording(written("a.csv", table)).notes)


@pytest.mark.parametrize("angles", ["20,1\n1,0.3,0,90,1", "0.3,1\n1,0.3,0,0.3,1"])
def test_angles_of_an_arm_and_joints_that_are_still_are_no_other_unit(written: Write, angles: str) -> None:
    table = f"t_s,x_m,y_m,elbow_deg,wrist_deg\n0,0,0,{angles}\n"
    assert read_recording(written("a.csv", table)).notes == ()


def test_refusal_names_the_cause(written: Write) -> None:
    refuses(
        lambda name, content, reading: read_recording(written(name, content), **reading),
        (("a.csv", "t_s;x_m;y_m\n0;1;2\n", {}), "recording.separator", "'semicolon', which line 1 has 2 times"),
        (("a.csv", "t_s\tx_m\ty_m\n0\t1\t2\n", {}), "recording.separator", "'tab'"),
        (("a.csv", "t_s;x_m;y_m\n0;1,5;2\n", {"separator": "semicolon"}), "line 2, column x_m", "decimal = 'comma'"),
        (("a.csv", "t_s,x_m,y_m\n0,1,2\n", {"decimal": "comma"}), "recording.separator", "decimals are commas"),
        (("a.csv", "t_s\tx_m\ty_m\n0\t1.0,5\t2\n", {"separator": "tab", "decimal": "comma"}), "line 2", "thousands"),
        (("a.csv", "t,x,y\n0,1,2\n", {}), "line 1, column t", "recording.tick_ms"),
        (("a.csv", "t_s,x,y\n0,1,2\n", {}), "line 1, column x", "recording.count_mm"),
        (("a.csv", "t_s,x_m,y_m\n0,1,2\n".encode("utf-16"), {}), "file", "CSV UTF-8"),
        (("a.svc", "2\n20000 0 0 1\n20001 0 1 1\n", {}), "whole numbers", "count_mm"),
        (
            ("a.sto", "x\nendheader\ntime hand_X hand_Y\n0 1 1\n1 20 1\n", {"columns": ["hand_X", "hand_Y"]}),
            "sample 2, x",
            "at most 10 m",
        ),
        error=ProblemFileError,
    )


def test_storage_file_holds_places_and_maybe_angles(written: Write) -> None:
    text = "Position\nnRows=2\nendheader\ntime\thand_X\thand_Y\thand_Ox\n0\t0.1\t0.2\t90\n1\t0.3\t0.2\t90\n"
    recording = read_recording(written("a.sto", text), columns=["hand_X", "hand_Y"])
    np.testing.assert_allclose(recording.points, [[0.1, 0.2], [0.3, 0.2]])
    assert not recording.joints
    assert "nothing of inDegrees" in recording.notes[0]
    told = read_recording(written("b.sto", text.replace("nRows=2", "inDegrees=yes")), columns=["hand_X", "hand_Y"])
    np.testing.assert_allclose(told.joints["hand_Ox"], math.pi / 2)


# --------------------------------------------------------------------------------------------------------------- C3D
def markers(frames: int = 30) -> Array:
    points = np.zeros((frames, 2, 4))
    points[:, 1, :3] = np.linspace((0, 50, -10), (300, 100, 20), frames).round(1)
    points[7, 1, 3] = -1
    return points


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("floats", [True, False])
def test_marker_of_a_c3d_is_read(written: Write, order: str, floats: bool) -> None:
    points = markers()
    path = written("a.c3d", c3d(points, ["WRIST", "HAND"], order=order, floats=floats))
    recording = read_recording(path, marker="HAND")
    seen = np.arange(30) != 7
    np.testing.assert_allclose(recording.points, 1e-3 * points[seen, 1, :3], atol=1e-8)
    np.testing.assert_allclose(recording.time, np.flatnonzero(seen) / 100)
    assert recording.notes == ("left out: 1 sample (0.01 s) without the hand, the first after 0.07 s",)


def test_ezc3d_and_this_library_see_the_same(tmp_path: Path) -> None:
    ezc3d = pytest.importorskip("ezc3d")
    file = ezc3d.c3d()
    file["parameters"]["POINT"]["RATE"]["value"] = [120]
    file["parameters"]["POINT"]["LABELS"]["value"] = ("WRIST", "HAND")
    file["parameters"]["POINT"]["UNITS"]["value"] = ["m"]
    points = np.ones((4, 2, 40))
    points[:3] = np.random.default_rng(4).normal(0, 0.3, (3, 2, 1)) + np.linspace(0, 0.2, 40)
    file["data"]["points"] = points
    file.write(str(tmp_path / "a.c3d"))
    recording = read_recording(tmp_path / "a.c3d", marker="HAND")
    np.testing.assert_allclose(recording.points, points[:3, 1].T, atol=1e-6)
    np.testing.assert_allclose(recording.time, np.arange(40) / 120)


@pytest.mark.parametrize("seed", range(8))
def test_generated_c3d_files_are_those_that_ezc3d_sees(written: Write, seed: int) -> None:
    """Floats and integers, markers that are lost for single frames; ezc3d reads no MIPS."""
    ezc3d, rng = pytest.importorskip("ezc3d"), np.random.default_rng(seed)
    count, used, floats = int(rng.integers(12, 80)), int(rng.integers(1, 7)), seed % 2 == 0
    points = np.zeros((count, used, 4))
    points[..., :3] = 200 + np.cumsum(rng.normal(0, 1, (count, used, 3)), axis=0)
    points[rng.random((count, used)) < 0.05, 3] = -1
    numbers = (("USED", 2, "h", used), ("FRAMES", 2, "h", count), ("SCALE", 4, "f", -0.1 if floats else 0.1))
    more = b"".join(parameter(name, kind, [], struct.pack(f"<{code}", value)) for name, kind, code, value in numbers)
    path = written("a.c3d", c3d(points, [f"M{i}" for i in range(used)], floats=floats, more=more))
    theirs = ezc3d.c3d(str(path))["data"]["points"]
    for i in range(used):
        seen = np.isfinite(theirs[:3, i]).all(axis=0)
        ours = read_recording(path, marker=f"M{i}", clean=False)
        np.testing.assert_allclose(ours.points, 1e-3 * theirs[:3, i, seen].T, atol=1e-7)
        np.testing.assert_allclose(ours.time, np.flatnonzero(seen) / 100, atol=1e-9)


@pytest.mark.parametrize("line", ["root:$6$hash:19000:0:99999", "token=hunter2,x", "hunter2"])
def test_a_file_named_by_mistake_is_not_quoted(tmp_path: Path, line: str) -> None:
    path = tmp_path / "secret.csv"
    path.write_text(f"{line}\n{line}\n")
    with pytest.raises(ProblemFileError, match=r"among \d, which are no header") as refused:
        read_recording(path)
    assert not {"hunter2", "hash"} & {*str(refused.value).replace("$", " ").replace("=", " ").split()}
    path.write_text("when,across,up\n0,0,0\n")
    with pytest.raises(ProblemFileError, match="when, across, up"):
        read_recording(path)


# ---------------------------------------------------------------------------------------------------------- problems
PROBLEM = """system = "upper_limb"
title = "t"
[arm]
side = "left"
range_of_motion = "restricted"
[recording]
file = "a.csv"
hand = "left"
{more}
[placement]
centre_m = [{x}, 0.502]
"""


def test_check_says_size_and_how_much_is_in_reach(written: Write) -> None:
    written("a.csv", "t [s];x [mm];y [mm]\n0,0;0;0\n1,0;10;10\n2,0;20;0\n")
    more = 'separator = "semicolon"\ndecimal = "comma"\nspeed = 0.5'
    notes = checked(load_problem(str(written("in.toml", PROBLEM.format(more=more, x=-0.172)))))
    assert "played at 0.5 of its recorded speed" in notes
    assert any(note.startswith("401 samples over 4 s; 20 x 10 mm large, 28.28 mm long") for note in notes)
    assert "in reach: 40 of 40 samples looked at (100 %)" in notes
    halved = checked(load_problem(str(written("half.toml", PROBLEM.format(more=more, x=-0.172) + "scale = 0.5\n"))))
    assert any("; 10 x 5 mm large, 14.14 mm long; mean speed 3.54 mm/s" in note for note in halved)
    assert not any(isinstance(note, NotMet) for note in notes)
    for x, share in ((0.5, "0 of 40 samples looked at (0 %)"), (-0.2, "14 of 40 samples looked at (35 %)")):
        notes = checked(load_problem(str(written("out.toml", PROBLEM.format(more=more, x=x)))))
        (note,) = (note for note in notes if isinstance(note, NotMet))
        assert note.startswith(f"in reach: {share}; from the others the hand stays")


def test_a_c3d_without_a_unit_is_read_in_that_of_count_mm(tmp_path: Path) -> None:
    points = np.zeros((20, 1, 4))
    points[:, 0, 0] = np.arange(20)
    path = tmp_path / "a.c3d"
    path.write_bytes(c3d(points, ["HAND"]).replace(b"UNITS", b"OTHER"))
    with pytest.raises(ProblemFileError, match=r"POINT:UNITS = None: expected .* recording\.count_mm, its unit in mm"):
        read_recording(path, marker="HAND")
    assert read_recording(path, marker="HAND", count_mm=10.0).points[-1, 0] == pytest.approx(0.19)
    path.write_bytes(c3d(points, ["HAND"]))  # one that names its unit is read in that
    assert read_recording(path, marker="HAND", count_mm=10.0).points[-1, 0] == pytest.approx(0.019)
