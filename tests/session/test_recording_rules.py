"""Rules that hold for every format: joints and hands alike, units that are used, trials that fail alone."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rehab_opt.cli import main
from rehab_opt.errors import ProblemFileError
from rehab_opt.recordings.even_times import even_times
from rehab_opt.recordings.reading import read_recording
from rehab_opt.session.scoring import score_recordings
from tests.measures.yardstick import reach
from tests.refusals import refuses
from tests.session.made_xdf import xdf
from tests.session.test_laboratory_files import moved, same, table, trc

Write = Callable[[str, str | bytes], Path]
Array = np.ndarray


def turned(rate: float = 80) -> tuple[Array, Array]:
    """(N,) [s], and (N, 2) [deg] of an elbow from 20 to 75 and a shoulder from -10 to 12."""
    time, plane = reach(rate, rest=0.4)
    return time, np.column_stack((20 + 275 * plane[:, 0], -10 + 110 * plane[:, 0]))


def motion(time: Array, angles: Array, *, title: str = "Coordinates\n", columns: str = "elbow shoulder") -> str:
    return table(time, angles, f"{title}inDegrees=yes\nendheader\ntime {columns}")


def ends(path: Path, **reading: Any) -> dict[str, float]:
    rows = score_recordings([str(path)], reading=reading).rows
    return {row.measure: round(row.value, 3) for row in rows if row.measure[:6] in {"lower_", "upper_"}}


WHOLE = {"lower_elbow": 20.0, "upper_elbow": 75.0, "lower_shoulder": -10.0, "upper_shoulder": 12.0}


# -------------------- joints
@pytest.mark.parametrize("kind", ["mot", "csv"])
def test_joints_lose_spikes_and_zeros_as_a_hand_does(written: Write, kind: str) -> None:
    time, angles = turned()
    for name, rows, wrong, note in (
        ("spike", slice(61, 62), (angles[61, 0] - 70, angles[61, 1]), "samples left out as spikes: 1"),
        ("zeros", slice(9, 13), (0.0, 0.0), "left out: 4 samples (0.05 s) without joint angles"),
        ("first", slice(0, 3), (0.0, 0.0), "left out: 3 samples (0.0375 s) without joint angles"),
    ):
        spoilt = angles.copy()
        spoilt[rows] = wrong
        text = motion(time, spoilt) if kind == "mot" else table(time, spoilt, "t_s,elbow_deg,shoulder_deg")
        path = written(f"{name}.{kind}", text)
        assert ends(path) == WHOLE
        assert any(each.startswith(note) for each in read_recording(path).notes)


def test_a_joint_that_rests_at_zero_or_turns_past_half_a_turn_loses_no_sample(written: Write) -> None:
    time, angles = turned()
    for shift in ((-20.0, 10.0), (140.0, 185.0)):
        wrapped = (angles + shift + 180) % 360 - 180
        read = read_recording(written("a.mot", motion(time, wrapped)))
        assert (len(read.time), read.notes) == (len(time), ())


def test_a_spike_of_a_joint_beside_a_hand_is_one(written: Write) -> None:
    time, angles = turned()
    points = np.column_stack((angles / 1e3, angles[:, 0]))
    points[50, 2] += 40
    read = read_recording(written("a.csv", table(time, points, "t_s,x_m,y_m,elbow_deg")))
    assert "samples left out as spikes: 1, the first after 0.625 s" in read.notes


def test_a_joint_that_is_never_there_leaves_the_others(written: Write) -> None:
    time, angles = turned()
    angles[:, 1] = np.nan
    path = written("a.mot", motion(time, angles))
    assert [*read_recording(path).joints] == ["elbow"]
    assert read_recording(path).notes == ("angles not read, all of which are missing: shoulder",)


def test_what_is_no_angle_is_read_as_none(written: Write) -> None:
    time, angles = turned()
    rates = motion(time, np.hstack((angles, angles)), columns="elbow shoulder elbow_vel elbow_ddot")
    read = read_recording(written("a.sto", rates))
    assert [*read.joints] == ["elbow", "shoulder"]
    assert read.notes == ("columns not read: elbow_vel, elbow_ddot",)
    refuses(
        lambda name, text: score_recordings([str(written(name, text))]),
        (("b.sto", motion(time, angles, title="EMG envelopes\n")), "--columns", "line 1 says EMG envelopes"),
        (("c.sto", motion(time, angles, title="")), "elbow, shoulder (line 1 has no title"),
        (("c.mot", motion(time, angles, title="Derivatives\n")), "line 1 says Derivatives"),
        (
            ("d.sto", motion(time, angles, title="PointPosition\n", columns="state_0 state_1")),
            "PointPosition: no angles",
        ),
        (("d.sto", motion(time, angles, title="Velocities\n", columns="a_X a_Y")), "line 1 says Velocities"),
        error=ProblemFileError,
    )
    assert ends(written("c.sto", motion(time, angles, title="")), units=["deg"]) == WHOLE


def test_what_a_header_says_of_angles_is_used_however_it_is_spelled(written: Write) -> None:
    time, angles = turned()
    plain = motion(time, angles)
    assert ends(written("a.mot", plain.replace("inDegrees=yes", "Angles are in degrees."))) == WHOLE
    assert ends(written("a.mot", plain.replace("time elbow", "Time elbow"))) == WHOLE
    rates = table(time, np.hstack((angles, angles)), "t_s,elbow_deg,shoulder_deg,elbow_velocity_deg,shoulder_acc_deg")
    read = read_recording(written("a.csv", rates))
    assert [*read.joints] == ["elbow", "shoulder"]
    assert read.notes == ("columns not read: elbow_velocity_deg, shoulder_acc_deg",)


def test_a_range_is_printed_from_a_file_with_a_hand_and_names_no_arm_has_are_said(
    written: Write, capsys: pytest.CaptureFixture[str]
) -> None:
    time, angles = turned()
    text = table(time, np.hstack((angles / 1e3, angles)), "t_s,x_m,y_m,elbow_flexion_deg,swing_deg")
    with pytest.raises(SystemExit):
        main(["score", str(written("a.csv", text)), "--range-of-motion"])
    said = capsys.readouterr().out
    assert said.endswith(
        'arm\'s: swing\n[arm.range_of_motion]\n"elbow_flexion_deg" = [20.0, 75.0]\n"swing_deg" = [-10.0, 12.0]\n'
    )


# -------------------- lost markers written as zeros
@pytest.mark.parametrize(("rate", "near"), [(25, 0.15), (60, 0.06), (100, 0.03)])
def test_zeros_of_a_fast_hand_near_the_origin_are_a_lost_marker(written: Write, rate: int, near: float) -> None:
    time = np.arange(6 * rate) / rate
    points = np.column_stack((0.2 * np.sin(5 * time), near + 0.1 * np.cos(2.5 * time) ** 2, 0.02 + 0 * time))
    points[2 * rate : 2 * rate + 7] = 0
    read = read_recording(written("a.csv", table(time, points)))
    assert len(read.time) == len(time) - 7
    assert read.notes[0].startswith("left out: 7 samples")


@pytest.mark.parametrize("rate", [8, 15, 100])
def test_a_reach_from_the_origin_and_back_keeps_its_rests(written: Write, rate: int) -> None:
    _, there = reach(rate, rest=0.5)
    points = 2 * np.vstack((there - there[0], there[::-1] - there[0], there - there[0]))
    points = np.column_stack((points, points[:, 0] / 3))
    read = read_recording(written("a.csv", table(np.arange(len(points)) / rate, points)))
    assert len(read.time) == len(points)


def in_every_format(written: Write, time: Array, points: Array) -> dict[str, tuple[Path, dict[str, Any]]]:
    hand, axes = {"marker": "HAND"}, {"columns": ["h_tx", "h_ty", "h_tz"]}
    head = "Coordinates\ninDegrees=yes\nendheader\ntime h_tx h_ty h_tz"
    labels = written("a_channels.tsv", "name\tcomponent\ttype\ttracked_point\tunits\n" + "".join(
        f"{axis}\t{axis}\tPOS\tHAND\tm\n" for axis in "xyz"))  # fmt: skip
    rows = "\n".join("\t".join(f"{x:.7f}" for x in row) for row in points)
    labels.with_name("a_motion.json").write_text('{"SamplingFrequency": 100}')
    return {
        "csv": (written("a.csv", table(time, points)), {}),
        "trc": (written("a.trc", trc(time, points)), hand),
        "mot": (written("a.mot", table(time, points, head)), axes),
        "tsv": (written("a_motion.tsv", rows), {}),
        "xdf": (written("a.xdf", xdf(time, points, unit="m")), {"columns": ["hand_X", "hand_Y", "hand_Z"]}),
    }


SPIKES, LOST = (
    "samples left out as spikes: {}, the first after 0.2 s",
    "left out: {} s) without the hand, the first after ",
)


@pytest.mark.parametrize(
    ("wrong", "rows", "note"),
    [
        (np.array([30.0, 0.2, 1.0]), slice(20, 21), SPIKES.format(1)),
        (np.array([[31.0, -40.0, 3.0], [29.0, 0.3, 2.0]]), slice(20, 22), SPIKES.format(2)),
        (np.inf, slice(20, 24), LOST.format("4 samples (0.04") + "0.2 s"),
        (-np.inf, slice(20, 24), LOST.format("4 samples (0.04") + "0.2 s"),
        (-9.999, slice(20, 40), LOST.format("20 samples (0.2") + "0.2 s"),
        (9999999.0, slice(20, 40), LOST.format("20 samples (0.2") + "0.2 s"),
        (np.array([0.2, 9999.0, 0.3]), slice(0, 9), LOST.format("9 samples (0.09") + "0 s"),
    ],
)
def test_spikes_and_the_numbers_of_lost_markers_are_left_out_in_every_format(
    written: Write, wrong: Any, rows: slice, note: str
) -> None:
    time, points = moved()
    kept = np.ones(len(time), dtype=bool)
    spoilt = points.copy()
    spoilt[rows], kept[rows] = wrong, False
    for kind, (path, how) in in_every_format(written, time, spoilt).items():
        read = read_recording(path, **how)
        assert note in read.notes, kind
        np.testing.assert_allclose(read.points, points[kept], atol=1e-6, err_msg=kind)


def test_a_hand_in_millimetres_read_as_metres_is_refused_and_no_gap(written: Write) -> None:
    time, points = moved()
    for many in (1e3, 1e6):
        for offset in (0.0, points.min(axis=0)):
            for path, how in in_every_format(written, time, many * (points - offset)).values():
                with pytest.raises(ProblemFileError, match=r"at most 10 m \(another unit"):
                    read_recording(path, **how)


# -------------------- units and keys
def test_stated_units_of_time_are_used_in_every_format(written: Write) -> None:
    time, points = moved()
    late = trc(time, points).splitlines()
    late[6:] = ["\t".join([n, f"{1e3 * float(t):.3f}", *rest]) for n, t, *rest in (row.split("\t") for row in late[6:])]
    assert "times are read in ms, as stated, not in s" in same(
        written("a.trc", "\n".join(late)), marker="HAND", units=["ms"]
    )
    text = table(1e3 * time, points, "Coordinates\ninDegrees=yes\nendheader\ntime h_tx h_ty h_tz")
    assert same(written("a.mot", text), columns=["h_tx", "h_ty", "h_tz"], units=["ms", "deg"]) == (
        "times are read in ms, as stated, not in s",
        "units that nothing in it has are not used: deg",
    )
    assert same(written("a.csv", table(time, points)), count_mm=5.0) == (
        "recording.count_mm is not used, since the file has a unit of length",
    )


def test_a_key_that_a_format_does_not_have_is_refused(written: Write) -> None:
    time, points = moved()
    files = {"a.csv": table(time, points), "a.trc": trc(time, points), "a.mot": motion(*turned())}
    refuses(
        lambda name, **given: read_recording(written(name, files[name]), **given),
        ({"name": "a.trc", "trials": "x"}, "recording.trials = 'x'", "only a .csv or .c3d"),
        ({"name": "a.trc", "time_column": "q"}, "recording.time_column"),
        ({"name": "a.trc", "columns": [1, 2]}, "recording.columns"),
        ({"name": "a.trc", "tick_ms": 2.0}, "recording.tick_ms"),
        ({"name": "a.mot", "separator": "tab"}, "recording.separator"),
        ({"name": "a.csv", "marker": 1}, "recording.marker"),
        ({"name": "a.csv", "columns": ["x_m", "x_m"]}, "each column once"),
        ({"name": "a.csv", "columns": ["x_m", 2]}, "each column once"),
        ({"name": "a.csv", "rate_hz": 50.0, "time_column": "t_s"}, "rate_hz replaces"),
        ({"name": "a.csv", "units": ["mm"], "count_mm": 2.0}, "either it or a unit"),
        error=ProblemFileError,
    )


# -------------------- trials
def in_trials(*names: str, again: bool, spoil: Callable[[int, Array], Array] = lambda _, points: points) -> str:
    time, points = moved()
    rows = ["trial,t_s,x_m,y_m,z_m"]
    for number, name in enumerate(names):
        begun = 0.0 if again else number * (time[-1] + 0.01)
        for t, p in zip(time, spoil(number, points.copy()), strict=False):
            rows.append(",".join([name, f"{begun + t:.6f}", *(f"{x:.7f}" for x in p)]))
    return "\n".join(rows).replace("nan", "")


def test_a_trial_that_cannot_be_measured_is_named_and_the_others_are_written(written: Write) -> None:
    gone, short = (lambda n, points: points * np.nan if n == 1 else points), lambda n, p: p[:1] if n == 1 else p
    few, far = (lambda n, p: p[:2] if n == 1 else p), lambda n, p: 1e3 * p if n == 1 else p
    for spoil, key, expected in ((few, "time", "at least 10"), (far, "sample 1, y, after 0 s", "at most 10 m")):
        path = str(written("a.csv", in_trials("go", "bad", "end", again=True, spoil=spoil)))
        scored = score_recordings([path], reading={"trials": "trial"})
        assert {row.trial for row in scored.rows} == {"go", "end"}
        (refused,) = scored.refused
        assert refused.key == f"trial bad, {key}"
        assert refused.expected.startswith(expected)
        assert "does not move" not in refused.expected
    with pytest.raises(ProblemFileError, match="at most 10 m"):
        read_recording(Path(path), trials="trial")  # a run follows the whole path
    for again in (False, True):
        for spoil in (gone, short):
            path = str(written("a.csv", in_trials("go", "bad", "end", again=again, spoil=spoil)))
            for pause in (None, 0.5):
                scored = score_recordings([path], reading={"trials": "trial"}, pause=pause)
                assert {row.trial.partition(".")[0] for row in scored.rows} == {"go", "end"}
                (refused,) = scored.refused
                assert refused.key == "trial bad, samples"
    cut = score_recordings([path], reading={"trials": "trial", "window_s": [4.0, 9.0]})
    assert {row.trial for row in cut.rows} == {"end"}
    assert [each.key for each in cut.refused] == ["trial go, samples", "trial bad, samples"]


def test_times_that_start_again_in_each_trial_are_those_of_trials(written: Write) -> None:
    reading = {"trials": "trial"}
    on, again = (
        score_recordings([str(written("a.csv", in_trials("p", "q", "r", again=each)))], reading=reading)
        for each in (False, True)
    )
    assert [row.trial for row in on.rows] == [row.trial for row in again.rows]
    np.testing.assert_allclose([row.value for row in again.rows], [row.value for row in on.rows], rtol=1e-6, atol=1e-9)
    assert any("times that start again: 2" in note for note in again.notes)
    assert not any("gap" in note for note in (*on.notes, *again.notes))


def test_a_gap_within_a_trial_is_noted_and_the_pause_between_trials_is_not(written: Write) -> None:
    def lost(_: int, points: Array) -> Array:
        points[60:80] = np.nan
        return points

    read = read_recording(written("a.csv", in_trials("p", "q", again=True, spoil=lost)), trials="trial")
    assert [round(end - begin, 6) for begin, end in read.gaps] == [0.21, 0.21]
    assert any(note.startswith("gaps bridged by straight lines: 2, the longest of 0.21 s") for note in read.notes)


# -------------------- clocks
@pytest.mark.parametrize(("rate", "tick"), [(110, 0.0125), (70, 0.003), (45, 0.0156), (160, 0.007), (700, 0.001)])
def test_times_of_a_coarse_clock_change_no_smoothness(written: Write, rate: int, tick: float) -> None:
    """Of 16 ms and 100 Hz: samples with the time of the one before were dropped, a jerk of 203 became 5254."""
    time, points = moved(rate)
    exact = written("a.csv", table(time, points))
    read = written("b.csv", table(np.floor(time / tick + 1e-9) * tick, points, clock="{:.4f}".format))
    clocked, plain = ({row.measure: row.value for row in score_recordings([str(each)]).rows} for each in (read, exact))
    for name in ("movement_time", "speed_peak", "dimensionless_jerk"):
        assert clocked[name] == pytest.approx(plain[name], rel=2e-2)
    assert any(note.startswith("times written to ") for note in read_recording(read).notes)


@pytest.mark.parametrize("rate", [60, 80, 120, 240, 250])
@pytest.mark.parametrize("lost", [slice(0), slice(80, 81), slice(80, 120)])
def test_a_stale_rate_does_not_change_times_that_are_exact(rate: float, lost: slice) -> None:
    """A rate of 120 Hz in the header of a file at 100 Hz: gaps were invented, a jerk of 82 became 55760."""
    time = np.delete(np.arange(300) / 100, lost)
    read, notes = even_times(time, rate)
    np.testing.assert_allclose(read, time, atol=1e-9)
    assert notes == (f"its header states {rate} Hz, its times have 100 Hz",)


@pytest.mark.parametrize("seed", range(20))
def test_missing_rows_are_no_beat_of_a_clock(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rate, count = float(rng.choice([40, 64, 110])), int(rng.integers(40, 300))
    rows = np.sort(rng.choice(count, size=int(count * rng.uniform(0.7, 0.95)), replace=False))
    even, _ = even_times(np.round(rows / rate, int(rng.integers(3, 7))), None)
    np.testing.assert_allclose(np.diff(even), np.diff(rows) / rate, atol=1.1e-3)


def test_a_gap_or_lost_samples_of_an_xdf_with_a_rate_stay_where_they_are(written: Write) -> None:
    """pyxdf spreads a gap over the whole stream: a peak of 0.58 m/s became 0.25 m/s."""
    pytest.importorskip("pyxdf")
    time, points = moved()
    hand, kept = ["hand_X", "hand_Y", "hand_Z"], np.random.default_rng(1).random(len(time)) > 0.1
    one = time != time[60]
    for stamps, path in (
        (time + 3 * (time > time[60]), points), (time[kept], points[kept]), (time[one], points[one]),
    ):  # fmt: skip
        read = read_recording(written("a.xdf", xdf(stamps, path, unit="m")), columns=hand)
        np.testing.assert_allclose(read.time, stamps - stamps[0], atol=1e-6)
        assert len(read.gaps) == (len(stamps) == len(time))


def test_stamps_of_an_xdf_that_only_jitter_are_made_even(written: Write) -> None:
    pytest.importorskip("pyxdf")
    time, points = moved()
    late = np.random.default_rng(0).uniform(0, 0.012, len(time))
    bursts = time[np.minimum(np.arange(len(time)) // 4 * 4 + 3, len(time) - 1)] + 1e-5 * np.arange(len(time))
    for stamps in (time + 0.5 * late, time + late, bursts):
        read = read_recording(written("a.xdf", xdf(stamps, points, unit="m")), columns=["hand_X", "hand_Y", "hand_Z"])
        assert len(read.time) == len(time)
        np.testing.assert_allclose(np.diff(read.time), 0.01, rtol=0.01)
        assert [note[:26] for note in read.notes] == ["time stamps with a jitter "]


# -------------------- spellings
@pytest.mark.parametrize("gap", ["-nan", "-NaN(ind)", "1.#QNAN", "-1.#IND", "#N/A"])
def test_gaps_are_known_in_the_spellings_of_other_programs(written: Write, gap: str) -> None:
    time, points = moved()
    points[31:33] = np.nan
    for name, text, how in (("a.csv", table(time, points), {}), ("a.trc", trc(time, points), {"marker": "HAND"})):
        read = read_recording(written(name, text.replace("nan", gap)), **how)
        assert read.notes == ("left out: 2 samples (0.02 s) without the hand, the first after 0.31 s",)


@pytest.mark.parametrize(
    ("head", "reading"),
    [
        ("Time (S),X (M),Y (M),Z (M)", {}),
        ("t,x,y,z\ns,m,m,m", {}),
        ("t,x,y,z\n[s],[m],[m],[m]", {"columns": ["x", "y", "z"]}),
        ("t_s,x,y,z\n,m,m,m", {}),
    ],
)
def test_units_are_read_in_capitals_and_below_the_header(written: Write, head: str, reading: dict[str, Any]) -> None:
    assert same(written("a.csv", table(*moved(), head)), **reading) == ()


def test_a_trc_without_a_unit_or_with_blanks_is_refused_with_keys_that_it_has(written: Write) -> None:
    text = trc(*moved())
    refuses(
        lambda text: read_recording(written("a.trc", text), marker="HAND"),
        ((text.replace("\t", " "),), "line 4", "separated by tabs or commas"),
        ((text.replace("\tmm", "\t"),), "expected one of m, cm, mm, or recording.units"),
        error=ProblemFileError,
    )
    with pytest.raises(ProblemFileError, match=r"or recording\.units$"):
        read_recording(written("a.trc", text.replace("\tmm", "\t")), marker="HAND")


def test_two_markers_of_one_name_are_asked_for_by_number(written: Write) -> None:
    time, points = moved()
    for subject in ("", "S:"):
        text = trc(time, np.hstack((points, points)), names=f"{subject}HAND\t\t\t{subject}HAND\t\t")
        for marker in ("HAND", f"{subject}HAND"):
            with pytest.raises(ProblemFileError, match="a name that one marker has, or its number: 1 or 2"):
                read_recording(written("a.trc", text), marker=marker)


def test_times_of_a_pen_in_milliseconds_are_asked_for_as_such(written: Write) -> None:
    time, points = moved()
    rows = "".join(
        f"{1e3 * x:.4f} {1e3 * y:.4f} {1e3 * t:.0f} 1 9 9 9\n" for t, (x, y, _) in zip(time, points, strict=True)
    )
    with pytest.raises(ProblemFileError) as refused:
        read_recording(written("a.svc", f"{len(time)}\n{rows}"))
    assert "times in whole numbers = '0 10 20 ...'" in str(refused.value)
    assert "what a raw count is: recording.tick_ms, or recording.units (such as ms)" in str(refused.value)


def test_too_many_spikes_are_kept_and_called_so(written: Write) -> None:
    time, points = moved()
    points[10::10, 0] += 0.08
    (note,) = (note for note in read_recording(written("a.csv", table(time, points))).notes if "jump" in note)
    assert note.startswith("jumps are kept, as spikes would be more than 5 % of the samples: 8")
