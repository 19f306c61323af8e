"""Files as laboratories write them: read with the value of a plain sibling, asked about, or refused as no place."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rehab_opt.cli import main
from rehab_opt.errors import ProblemFileError
from rehab_opt.recordings.reading import read_recording
from rehab_opt.session.scoring import score_recordings
from tests.measures.yardstick import reach
from tests.refusals import refuses
from tests.session.made_c3d import c3d, parameter
from tests.session.made_xdf import CLOCK, chunk, xdf

Write = Callable[[str, str | bytes], Path]
Array = np.ndarray


def moved(rate: float = 100) -> tuple[Array, Array]:
    """(N,) [s] and (N, 3) [m] of a reach by 0.2 m to the right and 50 mm up, at y = 0.2 m."""
    time, plane = reach(rate, rest=0.3)
    return time, np.column_stack((plane[:, 0], plane[:, 1] + 0.2, 1.0 + plane[:, 0] / 4))


def table(
    time: Array, points: Array, head: str = "t_s,x_m,y_m,z_m", clock: Callable[[float], str] = "{:.6f}".format
) -> str:
    mark = "," if "," in head else " "
    return (
        head
        + "\n"
        + "".join(mark.join([clock(t), *(f"{x:.7f}" for x in p)]) + "\n" for t, p in zip(time, points, strict=True))
    )


def trc(time: Array, points: Array, *, names: str = "HAND\t\t", rate: float = 100, digits: int = 6) -> str:
    """One marker's frames under names; more columns of `points` are other markers'."""
    above = f"PathFileType\t4\t(X/Y/Z)\ta.trc\nDataRate\tNumFrames\tUnits\n{rate:.1f}\t{len(time)}\tmm\n"
    above += f"Frame#\tTime\t{names}\n\t\tX1\tY1\tZ1\n\n"
    cells = ([str(i), f"{t:.{digits}f}", *(f"{1e3 * x:.5f}" for x in points[i - 1])] for i, t in enumerate(time, 1))
    return above + "\n".join("\t".join(row) for row in cells) + "\n"


def measured(path: Path, **reading: Any) -> dict[str, float]:
    return {row.measure: row.value for row in score_recordings([str(path)], reading=reading).rows}


def same(path: Path, points: Array | None = None, *, rate: float = 100, **reading: Any) -> tuple[str, ...]:
    """Check that a file has the reach's samples, or some coordinates of them, at its times; its notes."""
    time, true = moved(rate)
    true = true if points is None else points
    read = read_recording(path, **reading)
    np.testing.assert_allclose(read.time - read.time[0], time, atol=2e-5)
    np.testing.assert_allclose(read.points, true[:, : read.points.shape[1]], atol=2e-6)
    return read.notes


# -------------------- tables of numbers
@pytest.mark.parametrize(
    ("head", "clock", "reading"),
    [
        ("timestamp_s,x_m,y_m,z_m", "{:.5f}".format, {}),
        ("sep=,\nt_s,x_m,y_m,z_m", "{:.5f}".format, {}),
        ('"t_s","x_m","y_m","z_m"', '"1",{:.5f}'.format, {}),
        ("# t_s,x_m,y_m,z_m", "{:.5f}".format, {}),
        ("# made by numpy\n# t_s,x_m,y_m,z_m", "{:.5f}".format, {}),
        ("# version 2\nt_s,x_m,y_m,z_m", "{:.5f}".format, {}),
        (",t_s,x_m,y_m,z_m", "7,{:.5f}".format, {}),
        ("time_us,x_m,y_m,z_m", lambda t: f"{1e6 * t:.0f}", {}),
        ("Timestamp [ns],x_m,y_m,z_m", lambda t: f"{1.7e18 + 1e9 * t:.0f}", {}),
        ("timestamp,x_m,y_m,z_m", lambda t: f"{1.7e12 + 1e3 * t:.2f}", {"units": ["ms"]}),
        ("clock,x_m,y_m,z_m", "{:.5f}".format, {"time_column": "clock", "units": ["s"]}),
        ("clock_s,x_m,y_m,z_m", "{:.5f}".format, {"time_column": 1, "columns": ["2", "y_m", 4]}),
        ("t,wristX,wristY,wristZ", "{:.5f}".format, {"columns": ["wristX", "wristY", "wristZ"], "units": ["m", "s"]}),
        ("t,wX,wY,wZ", "{:.5f}".format, {"columns": ["wX", "wY"], "count_mm": 1e3, "tick_ms": 1e3}),
        ("frame,x_m,y_m,z_m", "{:.5f}".format, {"rate_hz": 100.0}),
        ("t_s x_m y_m z_m", "{:.5f}".format, {"separator": "blank"}),
    ],
)
def test_a_table_is_read_as_programs_write_it(
    written: Write, head: str, clock: Callable[[float], str], reading: dict[str, Any]
) -> None:
    same(written("a.csv", table(*moved(), head, clock)), **reading)


def test_a_table_without_a_header_is_read_by_numbers(written: Write) -> None:
    path = written("a.csv", table(*moved()).partition("\n")[2])
    same(path, time_column=1, columns=[2, 3, 4], units=["s", "m"])
    with pytest.raises(SystemExit) as done:
        main(["score", str(path), "--time-column", "1", "--columns", "2,3", "--units", "s,m"])
    assert done.value.code == 0


def test_a_header_of_numbers_is_no_sample(written: Write) -> None:
    """As pandas writes columns without names."""
    path = written("a.csv", table(*moved(), "0,1,2,3"))
    same(path, time_column="0", columns=["1", "2", "3"], units=["s", "m"])
    same(path, time_column=1, columns=[2, 3, 4], units=["s", "m"])


def test_what_a_table_does_not_say_is_asked_for(written: Write) -> None:
    time, points = moved()
    refuses(
        lambda head, **reading: read_recording(written("a.csv", table(time, points, head)), **reading),
        ({"head": "timestamp,x_m,y_m,z_m"}, "column timestamp", "recording.units", "recording.tick_ms"),
        ({"head": "clock_s,x_m,y_m,z_m"}, "recording.time_column or recording.rate_hz"),
        ({"head": "t_s,a,b,c", "columns": ["a", "b"]}, "recording.columns = 'a'", "recording.units"),
        ({"head": "t_s,x_m,y_m,z"}, "column z", "recording.units"),
        ({"head": "t_s,a_deg,b_m,c_m", "columns": ["a_deg", "b_m"], "units": ["m"]}, "recording.columns = 'a_deg'"),
        ({"head": "t_s x_m y_m z_m"}, "recording.separator", "'blank'"),
        ({"head": "t_s,x_m,y_m,z_m", "units": ["mm", "cm"]}, "recording.units", "one of each"),
        ({"head": "t_s,x_m,y_m,z_m", "units": ["inch"]}, "recording.units", "m, cm, mm"),
        ({"head": "t_s,x_m,y_m,z_m", "rate_hz": 0.0}, "recording.rate_hz"),
        ({"head": "t_s,x_m,y_m,z_m", "up": "w"}, "recording.up"),
        ({"head": "t_s,x_m,y_m,z_m", "window_s": [9.0, 10.0]}, "recording.window_s"),
        ({"head": "t_s,x_m,y_m,z_m", "columns": [2, 9]}, "recording.columns = 9"),
        error=ProblemFileError,
    )


def test_a_stated_unit_goes_before_the_files_and_is_noted(written: Write) -> None:
    time, points = moved()
    notes = same(written("a.csv", table(time, 1e3 * points)), units=["mm"])
    assert notes == ("lengths are read in mm, as stated, not in m",)


# -------------------- times
@pytest.mark.parametrize(("rate", "digits"), [(240, 3), (240, 2), (400, 3), (120, 2), (1200, 3)])
@pytest.mark.parametrize("kind", ["trc", "csv"])
def test_rounded_times_change_no_smoothness(written: Write, rate: int, digits: int, kind: str) -> None:
    """240 Hz with three decimals: a jerk of 83 became 144."""
    time, points = moved(rate)
    paths = []
    for name, places in (("rounded", digits), ("exact", 6)):
        text = (
            trc(time, points, rate=rate, digits=places)
            if kind == "trc"
            else table(time, points, clock=f"{{:.{places}f}}".format)
        )
        paths.append(written(f"{name}.{kind}", text))
    marker = {"marker": "HAND"} if kind == "trc" else {}
    assert any(
        f"times written to {10 ** (3 - digits):g} ms" in note for note in read_recording(paths[0], **marker).notes
    )
    rounded, exact = (measured(path, **marker) for path in paths)
    for name in ("movement_time", "speed_peak", "dimensionless_jerk", "sparc"):
        assert rounded[name] == pytest.approx(exact[name], rel=2e-3)


def test_a_rate_that_the_times_contradict_is_told(written: Write) -> None:
    time, points = moved(240)
    notes = same(written("a.trc", trc(time, points, rate=100)), rate=240, marker="HAND")
    assert notes == ("its header states 100 Hz, its times have 240 Hz",)


def test_a_missing_row_is_no_rounding(written: Write) -> None:
    time, points = moved()
    kept = np.arange(len(time)) != 70
    for name, text in (("a.trc", trc(time[kept], points[kept], digits=2)), ("a.csv", table(time[kept], points[kept]))):
        read = read_recording(written(name, text), marker="HAND" if name == "a.trc" else None)
        np.testing.assert_allclose(read.time, time[kept], atol=1e-9)


# -------------------- gaps and spikes
FORMATS = ("csv", "trc", "c3d", "sto", "tsv", "xdf")


def written_as(kind: str, points: Array, zeros: bool, write: Write) -> tuple[Path, dict[str, Any]]:
    """A file of a reach in which NaN marks frames without the hand, as that format has it or as zeros."""
    time, lost = moved()[0], np.isnan(points[:, 0])
    shown = np.where(lost[:, None], 0.0, points) if zeros else points
    if kind == "c3d":
        frames = np.zeros((len(time), 1, 4))
        frames[:, 0, :3], frames[:, 0, 3] = np.nan_to_num(1e3 * shown), 0 if zeros else -1.0 * lost
        return write("a.c3d", c3d(frames, ["HAND"])), {"marker": "HAND"}
    if kind == "xdf":
        return write("a.xdf", xdf(time, shown, unit="m")), {"columns": ["hand_X", "hand_Y", "hand_Z"]}
    if kind == "trc":
        return write("a.trc", trc(time, shown).replace("nan", "")), {"marker": "HAND"}
    if kind == "sto":
        head = "Positions\ninDegrees=no\nendheader\ntime hand_X hand_Y hand_Z"
        return write("a.sto", table(time, shown, head)), {"columns": ["hand_X", "hand_Y", "hand_Z"]}
    if kind == "tsv":
        rows = "".join("\t".join("n/a" if np.isnan(x) else f"{x:.6f}" for x in p) + "\n" for p in shown)
        names = "".join(f"h{axis}\t{axis}\tPOS\thand\tm\n" for axis in "xyz")
        write("a_channels.tsv", "name\tcomponent\ttype\ttracked_point\tunits\n" + names)
        write("a_motion.json", '{"SamplingFrequency": 100}')
        return write("a_motion.tsv", rows), {}
    return write("a.csv", table(time, shown).replace("nan", "")), {}


@pytest.mark.parametrize("kind", FORMATS)
@pytest.mark.parametrize("zeros", [False, True])
@pytest.mark.parametrize(("first", "count"), [(80, 3), (80, 50), (0, 20)])
def test_a_gap_is_the_same_in_every_format(written: Write, kind: str, zeros: bool, first: int, count: int) -> None:
    """Missing or written as zeros, of three samples or half a second: left out, told in seconds, never refused."""
    if kind == "xdf":
        pytest.importorskip("pyxdf")
    time, points = moved()
    points[first : first + count] = np.nan
    path, reading = written_as(kind, points, zeros, written)
    read = read_recording(path, **reading)
    kept = ~np.isnan(points[:, 0])
    np.testing.assert_allclose(read.time - read.time[0], time[kept] - time[kept][0], atol=1e-6)
    np.testing.assert_allclose(read.points, points[kept], atol=2e-6)
    many = f"{count} samples ({count / 100:g} s)"
    assert read.notes[0] == f"left out: {many} without the hand, the first after {first / 100:g} s"
    gaps = [(first / 100 - 0.01, (first + count) / 100)] if count == 50 else []
    np.testing.assert_allclose(np.reshape(read.gaps, (-1, 2)) - time[0], np.reshape(gaps, (-1, 2)), atol=1e-6)
    assert any(
        note.startswith("gaps bridged by straight lines: 1, the longest of 0.51 s") for note in read.notes
    ) == bool(gaps)


def test_a_hand_that_rests_at_the_origin_is_seen(written: Write) -> None:
    time, points = moved()
    assert same(written("a.csv", table(time, points - points[0])), points - points[0]) == ()


def test_a_stretch_of_seconds_is_never_dropped(written: Write) -> None:
    """1.9 s of a reach were left out as spikes where the sensor's frame jumped by 60 mm behind them."""
    time = np.arange(4000) / 100
    points = np.column_stack([0.2 - 0.2 * np.cos(time), 0.1 * np.sin(time), 0 * time])
    points[190:, 0] += 0.3
    read = read_recording(written("a.csv", table(time, points)))
    assert len(read.time) == len(time)
    (note,) = read.notes
    assert note.startswith("a jump that is no spike: 30")
    assert "after 1.9 s; speed and smoothness there are not the hand's" in note


def test_a_sample_without_its_force_is_left_out_and_a_joint_that_is_not_always_seen_is_unread(written: Write) -> None:
    time, points = moved()
    wide = np.column_stack((points[:, :2], np.ones((len(time), 3))))
    wide[5, 3] = wide[9, 4] = np.nan
    text = table(time, wide, "t_s,x_m,y_m,fx_N,fy_N,elbow_deg").replace("nan", "")
    read = read_recording(written("a.csv", text))
    assert (len(read.time), np.isfinite(read.forces).all(), dict(read.joints)) == (len(time) - 1, True, {})
    assert read.notes[0].startswith("left out: 1 sample (0.01 s) without the hand or a force on it")
    assert "elbow" in read.notes[1]


def test_the_same_time_twice_is_dropped_with_a_note(written: Write) -> None:
    rows = table(*moved()).splitlines()
    for at in (1, 50, len(rows) - 1):
        notes = same(written("a.csv", "\n".join([*rows[: at + 1], rows[at], *rows[at + 1 :]])))
        assert notes == (
            f"left out: 1 sample (0.01 s) at the time of the one before, the first after {(at - 1) / 100:.3g} s",
        )


# -------------------- OpenSim
STATES = (
    "hand_tx hand_ty elbow_flexion biceps.activation biceps.fiber_length elbow_flexion_u elbow_moment hand_force_vx"
)
MOCO = (
    "/jointset/g/tx/value /jointset/g/hand_ty/value /jointset/e/elbow/value /jointset/e/elbow/speed "
    "/forceset/b/activation"
)


def storage(columns: str, above: str) -> str:
    time, points = moved()
    wide = np.column_stack((points[:, :2], np.tile(points[:, :1], (1, len(columns.split()) - 2))))
    return table(time, wide, f"{above}endheader\ntime {columns}")


def test_states_of_opensim_are_places_and_angles_alone(written: Write) -> None:
    for columns, elbow in ((STATES, "elbow_flexion"), (MOCO, "/jointset/e/elbow/value")):
        names = columns.split()
        path = written("a.sto", storage(columns, "states\ninDegrees=no\n"))
        assert [*read_recording(path, columns=names[:2]).joints] == [elbow]
        same(path, columns=names[:2])
        for name in names[3:]:
            for units in (None, ["m"]):
                with pytest.raises(ProblemFileError, match=r"expected a length"):
                    read_recording(path, columns=[names[0], name], units=units)


def test_rates_of_change_and_forces_in_line_1_are_neither(written: Write) -> None:
    for title in ("Velocities", "Accelerations", "Speeds"):
        path = written("a.sto", storage("hand_X hand_Y elbow", f"{title}\ninDegrees=yes\n"))
        with pytest.raises(ProblemFileError, match=f"a place; line 1 says {title}"):
            read_recording(path, columns=["hand_X", "hand_Y"])
    for title in ("Static Optimization", "Inverse Dynamics Generalized Forces", "Joint Reaction Loads", "Controls"):
        path = written("a.sto", storage("hand_tx hand_ty biceps", f"{title}\ninDegrees=no\n"))
        read = read_recording(path, columns=["hand_tx", "hand_ty"])
        assert not read.joints
        assert read.notes == (f"its line 1 says {title}: no angles are read",)


@pytest.mark.parametrize("end", ["sto", "mot"])
def test_angles_of_an_unknown_unit_are_asked_for_and_places_are_read(written: Write, end: str) -> None:
    path = written(f"a.{end}", storage("hand_tx hand_ty elbow", "Coordinates\n"))
    assert "nothing of inDegrees" in same(path, columns=["hand_tx", "hand_ty"])[0]
    with pytest.raises(ProblemFileError, match=r"inDegrees = None: expected yes or no, or recording\.units"):
        read_recording(path)
    turned = read_recording(path, units=["deg"]).joints["elbow"]
    np.testing.assert_allclose(np.degrees(turned), moved()[1][:, 0], atol=1e-6)


def test_joint_angles_alone_are_scored(written: Write, capsys: pytest.CaptureFixture[str]) -> None:
    path = written("a.mot", storage("hand_tx hand_ty elbow", "Coordinates\ninDegrees=yes\n"))
    values = measured(path)
    assert [values[f"{end}_elbow"] for end in ("lower", "upper", "range")] == pytest.approx([0.0, 0.2, 0.2], abs=1e-6)
    with pytest.raises(SystemExit):
        main(["score", str(path)])
    assert "joints' angles alone are measured" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["score", str(path), "--range-of-motion"])
    assert '[arm.range_of_motion]\n"elbow_deg" = [0.0, 0.2]\n' in capsys.readouterr().out


# -------------------- TRC layouts
@pytest.mark.parametrize("layout", ["double tabs", "every second", "unnamed behind", "unnamed before", "number"])
def test_a_marker_is_found_in_every_layout(written: Write, layout: str) -> None:
    time, points = moved()
    other, marker = 0 * points + (0.1, 0.2, 0.3), {"marker": "HAND"}
    text = {
        "double tabs": trc(time, points).replace(f"100.0\t{len(time)}\tmm", f" 100.0\t\t {len(time)}\t\t mm"),
        "every second": trc(time, np.hstack((points, other)), names="\tHAND\t\tWRIST"),
        "unnamed behind": trc(time, np.hstack((points, other))),
        "unnamed before": trc(time, np.hstack((other, points)), names="\t\t\tHAND\t\t"),
        "number": trc(time, np.hstack((other, points))),
    }[layout]
    assert same(written("a.trc", text), **({"marker": "2"} if layout == "number" else marker)) == ()


# -------------------- C3D
def frames(points: Array, others: int = 1) -> Array:
    made = np.zeros((len(points), others + 1, 4))
    made[:, 0, :3] = 1e3 * points
    made[:, 1:, :3] = (10.0, 20.0, 90.0)
    return made


@pytest.mark.parametrize("key", ["ANGLES", "MOMENTS", "POWERS"])
def test_what_a_c3d_lists_as_no_place_is_no_marker(written: Write, key: str) -> None:
    more = parameter(key, -1, [12, 1], b"RElbowAngles")
    path = written("a.c3d", c3d(frames(moved()[1]), ["Anna:HAND", "Anna:RElbowAngles"], more=more))
    for marker in ("RElbowAngles", "Anna:RElbowAngles", 2):
        with pytest.raises(ProblemFileError, match=f"POINT:{key} lists it"):
            read_recording(path, marker=marker)
    with pytest.raises(ProblemFileError, match=r"expected one of HAND$"):
        read_recording(path, marker="FOOT")
    same(path, marker="HAND")
    same(path, marker=1)


def test_a_c3d_of_many_markers_and_of_zero_bytes_without_a_rate_is_read(written: Write) -> None:
    points, names = moved()[1], [f"M{number:03}" for number in range(599, -1, -1)]
    first, *others = (names[i : i + 255] for i in range(0, 600, 255))
    more = b"".join(
        parameter(f"LABELS{number}", -1, [4, len(some)], "".join(some).encode())
        for number, some in enumerate(others, 2)
    )
    path = written("a.c3d", c3d(frames(points, 599)[:, ::-1], first, more=more, count=600))
    same(path, marker="M000")
    whole = c3d(frames(points), ["HAND\0\0", "LONGER"]).replace(b"RATE", b"RATX")
    same(written("b.c3d", whole), marker="HAND")


@pytest.mark.parametrize("said", ["FRAMES", "LONG_FRAMES", "TRIAL", "wrapped", ""])
def test_a_c3d_of_more_frames_than_its_header_can_state_is_read_whole(written: Write, said: str) -> None:
    count, last = 70000, 65535
    points = np.zeros((count, 1, 4))
    points[:, 0, 0] = np.linspace(0, 300, count)
    more = parameter("FRAMES" if said == "FRAMES" else "LONG_FRAMES", 4, [], struct.pack("<f", count)) if said else b""
    if said == "TRIAL":
        ends = (("START", (1, 0)), ("END", (count - 65536, 1)))
        more = b"".join(parameter(f"ACTUAL_{end}_FIELD", 2, [2], struct.pack("<2H", *at), group=2) for end, at in ends)
    content = c3d(points, ["HAND"], more=more, rate=1000.0, last=count - 65536 if said == "wrapped" else last)
    read = read_recording(written("a.c3d", content), marker="HAND")
    assert len(read.time) == (count if said else last)
    assert any("more may be there" in note for note in read.notes) == (not said)


def test_a_dec_file_is_refused_with_the_conversion(written: Write) -> None:
    content = c3d(frames(moved()[1]), ["HAND", "HEAD"])
    with pytest.raises(ProblemFileError, match=r"DEC: convert it, in Python by ezc3d\.c3d"):
        read_recording(written("a.c3d", content[:515] + b"U" + content[516:]), marker="HAND")


def test_events_and_columns_tell_trials_apart(written: Write) -> None:
    time, points = moved()
    texts = parameter("LABELS", -1, [5, 3], b"StartEnd  Start", group=2)
    moments = parameter("TIMES", 4, [2, 3], struct.pack("<6f", 0, 0.2, 0, 1.0, 0, 1.1), group=2)
    path = written("a.c3d", c3d(frames(points), ["HAND", "HEAD"], more=texts + moments, group=b"EVENT"))
    for asked, ends in (("Start,End", [(0.2, 1.0)]), ("Start", [(0.2, 1.1), (1.1, time[-1])])):
        found = read_recording(path, marker="HAND", trials=asked).trials
        np.testing.assert_allclose([trial[1:] for trial in found], ends, atol=1e-6)
    with pytest.raises(ProblemFileError, match=r"recording\.trials = 'Go': expected .*Start, End"):
        read_recording(path, marker="HAND", trials="Go")
    back = np.vstack((points, points[::-1], points))
    rows = table(np.arange(len(back)) / 100, back, "t_s,x_m,y_m,z_m").splitlines()
    labels = np.repeat(["reach 1", "reach 2", ""], len(points))
    text = "\n".join([f"{rows[0]},trial", *(f"{row},{label}" for row, label in zip(rows[1:], labels, strict=True))])
    scored = score_recordings([str(written("a.csv", text))], reading={"trials": "trial"})
    assert {row.trial for row in scored.rows} == {"reach 1", "reach 2"}
    assert [row.value for row in scored.rows if row.measure == "velocity_peaks"] == [1, 1]


# -------------------- pen traces, XDF, Motion-BIDS
def test_raw_counts_of_a_pen_are_asked_for(written: Write) -> None:
    time, points = moved()
    rows = "".join(
        f"{1e4 * x:.0f} {1e4 * y:.0f} {5000 + 1e3 * t:.0f} 1 9 9 9\n" for t, (x, y, _) in zip(time, points, strict=True)
    )
    path = written("a.svc", f"{len(time)}\n{rows}")
    for given, asked in (({}, "recording.count_mm and recording.tick_ms"), ({"tick_ms": 1.0}, "recording.count_mm")):
        with pytest.raises(ProblemFileError, match=f"what a raw count is: {asked}, or"):
            read_recording(path, **given)
    read = read_recording(path, count_mm=0.1, tick_ms=1.0)
    np.testing.assert_allclose(read.points, points[:, :2], atol=5.1e-5)
    assert read.notes == ()


def test_other_streams_of_an_xdf_do_not_matter(written: Write) -> None:
    pytest.importorskip("pyxdf")
    time, points = moved()
    whole = xdf(time, points, unit="m")
    hand = ["hand_X", "hand_Y", "hand_Z"]
    for about in ("", "<name/>", "<desc/>", "<desc><maker>A</maker></desc>", "<desc><channels/></desc>"):
        name = "" if "<name" in about else "<name>Marks</name>"
        text = f"<info>{name}<channel_count>1</channel_count><nominal_srate>0</nominal_srate>{about}"
        text += "<channel_format>string</channel_format></info>"
        mark = b"\x01\x01\x08" + struct.pack("<d", CLOCK + 0.1) + b"\x01\x02go"
        other = chunk(2, struct.pack("<I", 3) + text.encode()) + chunk(3, struct.pack("<I", 3) + mark)
        assert same(written("a.xdf", whole + other), columns=hand) == ()
    same(written("b.xdf", whole), columns=["hand/1", "hand/2", "hand/3"])
    same(written("c.xdf", xdf(time, points, unit="")), columns=hand, units=["m"])


def test_sidecars_higher_up_and_spelled_units_are_read(tmp_path: Path) -> None:
    time, points = moved()
    folder = tmp_path / "sub-01" / "ses-1" / "motion"
    folder.mkdir(parents=True)
    (tmp_path / "task-reach_motion.json").write_text('{"SamplingFrequency": 100}')
    (tmp_path / "task-lift_motion.json").write_text('{"SamplingFrequency": 7}')
    channels = "name\tcomponent\ttype\ttracked_point\tunits\n" + "".join(
        f"h{axis}\t{axis}\tPOS\thand\tmeters\n" for axis in "xyz"
    )
    (tmp_path / "sub-01" / "sub-01_task-reach_channels.tsv").write_text(channels)
    rows = ["\t".join(f"{x:.7f}" for x in p) for p in points]
    file = folder / "sub-01_ses-1_task-reach_tracksys-imu_motion.tsv"
    file.write_text("\n".join(rows))
    assert same(file) == ()
    (folder / "sub-01_ses-1_task-reach_tracksys-imu_channels.tsv").write_text(
        channels + "t\tn/a\tLATENCY\tn/a\tseconds\n"
    )
    file.write_text("\n".join(f"{row}\t{t:.6f}" for row, t in zip(rows, time, strict=True)))
    assert same(file) == ()


# -------------------- options of all formats
def test_an_up_axis_makes_a_lift_height_and_a_window_cuts(written: Write) -> None:
    time, points = moved()
    path = written("a.trc", trc(time, points[:, [1, 0, 2]]))
    for up, height in (("y", points[:, 0]), ("-y", -points[:, 0]), ("z", points[:, 2]), ("x", points[:, 1])):
        read = read_recording(path, marker="HAND", up=up)
        np.testing.assert_allclose(read.points[:, 2], height, atol=1e-8)
        np.testing.assert_allclose(np.ptp(read.points, axis=0).prod(), np.ptp(points, axis=0).prod(), atol=1e-8)
    cut = read_recording(path, marker="HAND", window_s=[0.2, 0.7])
    np.testing.assert_allclose(cut.time, time[20:71], atol=1e-9)


def test_a_batch_goes_on_and_names_what_was_not_measured(written: Write, capsys: pytest.CaptureFixture[str]) -> None:
    time, points = moved()
    files = [str(written("a.csv", table(time, points))), str(written("b.csv", table(time, 0 * points))), "absent.csv"]
    with pytest.raises(SystemExit) as done:
        main(["score", *files])
    said = capsys.readouterr()
    assert done.value.code == 1
    assert "a.csv,1,movement_time,0.88" in said.out
    assert "b.csv" not in said.out
    assert said.err.count("not measured") == 2
    assert "b.csv: trial 1, points" in said.err
