"""Streams of XDF: the right channels in metres and seconds, or a refusal that says what is wrong."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rehab_opt.errors import ConfigurationError, ProblemFileError
from rehab_opt.recordings.reading import read_recording
from tests.measures.yardstick import reach
from tests.session.made_xdf import footer, xdf

Write = Callable[[str, str | bytes], Path]
HAND = ["hand_X", "hand_Y"]

pytest.importorskip("pyxdf")


@pytest.mark.parametrize(("unit", "scale"), [("mm", 1e3), ("meters", 1.0), ("cm", 1e2)])
def test_a_stream_is_read_in_metres_and_seconds(written: Write, unit: str, scale: float) -> None:
    time, points = reach(100, rest=0.3)
    path = written("a.xdf", xdf(time, scale * points, unit=unit))
    read = read_recording(path, columns=HAND)
    np.testing.assert_allclose(read.points, points, atol=1e-12)
    np.testing.assert_allclose(read.time, time - time[0], atol=1e-6)
    other = read_recording(path, columns=["head/head_X", "head/head_Y"])
    np.testing.assert_allclose(other.points, -points, atol=1e-12)


def test_what_cannot_be_read_is_refused_with_what_is_wrong(written: Write) -> None:
    time, points = reach(100)
    whole = xdf(time, 1e3 * points)
    cases = [
        (whole, None, "recording.columns"),
        (whole, ["hand_X", "head_Y"], "channels of one stream"),
        (whole, ["hand_X", "hand_Z"], "hand/hand_X, hand/hand_Y"),
        (xdf(time, points, unit="V"), HAND, "unit of channel hand_X = 'V'"),
        (xdf(time, 1e6 * points), HAND, "another unit?"),
        (whole[: -2 * len(footer(1, 100))], HAND, "footer"),
        (whole[: len(whole) // 2], HAND, ""),
        (whole.replace(b"<sample_count>101", b"<sample_count>102"), HAND, "102, which its footer states"),
        (b"PK" + whole, HAND, "XDF:"),
        (b"XDF:", HAND, ""),
    ]
    for content, columns, said in cases:
        with pytest.raises(ProblemFileError) as refused:
            read_recording(written("a.xdf", content), columns=columns)
        assert said in str(refused.value)


def test_without_its_library_the_extra_is_named(written: Write, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "pyxdf", None)
    with pytest.raises(ConfigurationError, match=r"rehab_opt\[xdf\]"):
        read_recording(written("a.xdf", b"XDF:"), columns=HAND)
