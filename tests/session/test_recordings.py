"""What is read from a recording, and what is said of the ones that cannot be read."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from rehab_opt.errors import ProblemFileError
from rehab_opt.recordings.reading import read_recording, resampled
from rehab_opt.recordings.recording import Recording
from tests.refusals import refuses

Write = Callable[[str, str | bytes], Path]

SVC = "4\n0 0 0.0 0 9 9 9\n1 2 0.1 1 9 9 9\n2 2 0.1 1 9 9 9\n3 4 0.2 1 9 9 9\n"
TRC = (
    "PathFileType\t4\t(X/Y/Z)\tx.trc\nDataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\n100\t100\t3\t2\tmm\n"
    "Frame#\tTime\tWRIST\t\t\tHAND\t\t\n\t\tX1\tY1\tZ1\tX2\tY2\tZ2\n\n"
    "1\t0.00\t1\t2\t3\t10\t20\t30\n2\t0.01\t1\t2\t3\t\t\t\n3\t0.02\t1\t2\t3\t30\t20\t30\n"
)
MOT = (
    "trial\nnRows=9\nnColumns=4\ninDegrees=yes\nendheader\ntime elbow box_tx box_ty\n0.0 90 0.1 0.2\n0.1 180 0.3 0.4\n"
)


def test_pen_trace_says_how_many_samples_it_dropped(written: Write) -> None:
    recording = read_recording(written("pen.svc", SVC))
    np.testing.assert_allclose(recording.time, [0.1, 0.2])
    np.testing.assert_allclose(recording.points, [[0.001, 0.002], [0.003, 0.004]])
    assert recording.notes[:2] == (
        "dropped: 1 samples with the pen up at the ends",
        "left out: 1 sample (0.05 s) at the time of the one before, the first after 0 s",
    )


def test_a_marker_may_be_named_without_its_subject_who_is_told_to_nobody(written: Write) -> None:
    of_anna = TRC.replace("HAND", "Anna:HAND").replace("WRIST", "Anna:WRIST")
    for marker in ("HAND", "Anna:HAND"):
        recording = read_recording(written("lift.trc", of_anna), marker=marker)
        np.testing.assert_allclose(recording.points, [[0.01, 0.02, 0.03], [0.03, 0.02, 0.03]])
    two = of_anna.replace("Anna:WRIST", "Ben:HAND")
    np.testing.assert_allclose(read_recording(written("two.trc", two), marker="Ben:HAND").points[0], [1e-3, 2e-3, 3e-3])
    for text, marker in ((two, "HAND"), (of_anna, "FOOT"), (TRC.replace("WRIST", "HAND"), "HAND")):
        with pytest.raises(ProblemFileError, match=r"recording\.marker") as refusal:
            read_recording(written("odd.trc", text), marker=marker)
        assert not {"Anna", "Ben"} & {*str(refusal.value).replace(":", " ").split()}


def test_unusable_recording_is_refused_by_its_place(written: Write) -> None:
    """Cells gone or twice, rows out of order, bytes that are no text: `malformed.py`."""
    refuses(
        lambda name, content: read_recording(
            written(name, content), name="the recording", marker="HAND" if name.endswith((".trc", ".c3d")) else None
        ),
        (("a.csv", "\n\n  \n"), "file", "not empty"),
        (("a.csv", "0,1,2\n1,2,3\n"), "line 1", "header"),
        (("a.csv", "t_s,x_m,y_m\n"), "line 2", "rows of numbers"),
        (("a.csv", "t_s,x_m,y_m\n0,1,2\n"), "samples", "at least 2"),
        (("a.csv", "t_s,x_inch,y_m\n0,1,2\n"), "column x", "x_m, x_cm, x_mm"),
        (("a.csv", "t_s,x_m,x_mm,y_m\n0,1,1,2\n"), "column x", "one of"),
        (("a.csv", "t_s,x_m,y_m\n0,1,2\n1,1,3\n0.5,2,3\n"), "time of sample 3", "more than"),
        (("a.csv", "t_s,x_mm,y_m\n0,1,2\n1,10001,2\n"), "sample 2, x, after 1 s", "at most 10 m"),
        (("a.csv", "t_s,x_m,y_m\n-1e300,1,2\n1e308,1,2\n"), "line 2, column t_s", "from -1e+10 to 1e+10"),
        (("a.svc", "9" * 5000 + "\n0 0 0 1\n"), "line 1", "the number of samples"),
        (("a.svc", "x\n" + SVC.partition("\n")[2]), "line 1", "the number of samples"),
        (("a.svc", SVC.replace("3 4 0.2", "3 4 0.05")), "line 5, column t_s", "not before"),
        (("a.svc", SVC.replace("0.2 1", "0.2 7")), "line 5, column pen_down", "0 or 1"),
        (("a.svc", "1\n1 2 3\n"), "line 2", "at least"),
        (("a.svc", "1\n1 2 3 0\n"), "pen_down", "at least once"),
        (("a.mot", MOT.replace("endheader", "end")), "header", "endheader"),
        (("a.mot", MOT.replace("inDegrees=yes\n", "")), "inDegrees", "yes or no"),
        (("a.trc", TRC.replace("\tmm\n", "\tinch\n")), "Units", "mm"),
        (("a.trc", TRC.replace("HAND", "FOOT")), "recording.marker", "WRIST, FOOT"),
        (("a.trc", TRC.replace("WRIST\t\t\tHAND", "\t\tHAND\t")), "line 4", "above each x"),
        (("a.trc", "PathFileType\n"), "line 1", "header"),
        (("a.png", "x"), "file", ".csv, .svc, .mot, .sto, .trc, .c3d"),
        error=ProblemFileError,
    )


@given(
    steps=st.lists(st.floats(1e-3, 0.5), min_size=1, max_size=30),
    rate=st.floats(1, 500),
    slope=st.floats(-2, 2),
)
@example(steps=[0.001, 0.001], rate=500, slope=0.0)
def test_resampling_keeps_a_straight_line_straight(steps: list[float], rate: float, slope: float) -> None:
    time = 7.0 + np.concatenate(([0.0], np.cumsum(steps)))
    recording = Recording("line", time, np.column_stack((slope * (time - 7.0), 0 * time)))
    if recording.duration * rate < 1 - 1e-9:  # one period less rounding is one period
        with pytest.raises(ProblemFileError, match="1 to"):
            resampled(recording, rate)
        return
    even = resampled(recording, rate)
    np.testing.assert_allclose(np.diff(even.time), 1 / rate, rtol=1e-9)
    np.testing.assert_allclose(even.points[:, 0], slope * even.time, atol=1e-9)
    assert recording.duration - 1 / rate - 1e-9 <= even.duration <= recording.duration + 1e-9


def test_times_in_milliseconds_taken_for_seconds_are_refused() -> None:
    time = np.arange(0.0, 11_000.0, 7.0)
    with pytest.raises(ProblemFileError, match="are the times in seconds"):
        resampled(Recording("pen", time, np.zeros((len(time), 2))), 100.0)


def test_uneven_sampling_is_said(written: Write) -> None:
    recording = read_recording(written("path.csv", "t_s,x_m,y_m\n0,0,0\n0.01,0.01,0\n0.05,0.05,0\n"))
    assert resampled(recording, 100.0).notes == (
        "sampled unevenly, 10 to 40 ms apart; resampled to 100 Hz by linear interpolation",
    )
