"""Recordings cut into trials and scored, a row for each measure."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rehab_opt.cli import main
from rehab_opt.errors import ProblemFileError
from rehab_opt.recordings.recording import Recording
from rehab_opt.session.scoring import Scored, score_recordings, trials_between_pauses
from tests.measures.yardstick import noisy, reach
from tests.refusals import refuses

Write = Callable[[str, str | bytes], Path]


def table(time: np.ndarray, points: np.ndarray) -> str:
    rows = "\n".join(f"{t:.6f},{x:.9f},{y:.9f}" for t, (x, y) in zip(time, points, strict=True))
    return f"t_s,x_m,y_m\n{rows}\n"


def to_and_fro(count: int, rest: float) -> tuple[np.ndarray, np.ndarray]:
    """Reaches of 0.2 m to the right and back, in turn, with `rest` seconds before and after each."""
    time, there = reach(100, rest=rest)
    legs = [there if i % 2 == 0 else there[::-1] for i in range(count)]
    return np.arange(count * len(time)) / 100, np.vstack(legs)


def column(scored: Scored, measure: str) -> list[float]:
    return [row.value for row in scored.rows if row.measure == measure]


def test_a_recording_is_cut_where_the_hand_rests(written: Write) -> None:
    file = str(written("a.csv", table(*to_and_fro(3, 0.4))))
    whole, parts = score_recordings([file]), score_recordings([file], pause=0.5)
    assert column(whole, "velocity_peaks") == [3]
    assert column(parts, "velocity_peaks") == [1, 1, 1]
    assert {row.trial for row in parts.rows} == {"1", "2", "3"}
    for value in column(parts, "movement_time"):
        assert value == pytest.approx(math.sqrt(1 - math.sqrt(0.05)), abs=1e-3)
    assert column(score_recordings([file], pause=1.5), "velocity_peaks") == [3]  # it never rests that long


@pytest.mark.parametrize(("rate", "rest", "seeds"), [(20, 0.5, 10), (1000, 0.5, 5), (200, 60.0, 2)])
def test_noise_ends_no_rest_and_is_no_trial(rate: float, rest: float, seeds: int) -> None:
    """0.5 mm: five reaches were any other number of trials, or refused; a minute of noise has fast samples."""
    _, there = reach(rate, rest=rest, axes=3)
    points = np.vstack([there if i % 2 == 0 else there[::-1] for i in range(5)])
    for seed in range(seeds):
        recording = Recording("a", np.arange(len(points)) / rate, noisy(points, 5e-4, seed))
        assert len(trials_between_pauses(recording, pause=0.5)) == 5


def test_repeats_vary_and_targets_are_missed(written: Write) -> None:
    time, points = reach(100, rest=0.3)
    files = [str(written(f"{i}.csv", table(time, points + (0.0, shift)))) for i, shift in enumerate((-0.01, 0, 0.01))]
    scored = score_recordings(files, repeats=True, target=(0.2, 0.0))
    assert column(scored, "path_variability") == [pytest.approx(0.01, abs=1e-6)]
    assert column(scored, "end_error") == pytest.approx([0.01, 0.0, 0.01], abs=1e-6)
    assert [row.trial for row in scored.rows if row.measure == "end_variability"] == ["all"]


def test_a_movement_that_goes_the_other_way_is_no_repeat(written: Write) -> None:
    time, points = reach(100, rest=0.3)
    names = [
        str(written(f"{i}.csv", table(time, path))) for i, path in enumerate((points, points[::-1], points + 0.01))
    ]
    said = [note for note in score_recordings(names, repeats=True).notes if "other way" in note]
    assert [note.partition(":")[0] for note in said] == [f"{names[1]}, trial 1"]
    assert not any("other way" in note for note in score_recordings([names[0], names[2]], repeats=True).notes)


def test_what_cannot_be_scored_is_refused_with_its_file_and_trial(written: Write) -> None:
    time, points = reach(100)
    good = str(written("good.csv", table(time, points)))
    still = str(written("still.csv", table(time, 0 * points)))
    shaken = str(written("shaken.csv", table(time, noisy(0 * points, 5e-4, 1))))
    short = str(written("short.csv", table(time[:5], points[:5])))
    thrown = str(written("thrown.csv", table(time, points).replace("t_s", "t_ms")))
    speeds = str(written("speeds.mot", "Speeds\ninDegrees=yes\nendheader\ntime elbow\n0 1\n1 2\n"))
    refuses(
        lambda *files: score_recordings([*files]),
        ((still,), "still.csv: trial 1, points"),
        ((shaken,), "shaken.csv: trial 1, points"),
        ((short,), "short.csv: trial 1, time = '5 samples'"),
        ((speeds,), "--columns"),
        ((thrown,), "thrown.csv: trial 1, points = 'faster than 36"),
        error=ProblemFileError,
    )
    refuses(
        lambda **how: score_recordings([good], **how),
        ({"target": (1, 2, 3)}, "--target"),
        ({"target": (200, 400)}, "at most 10 m (millimetres"),
        ({"cutoff_hz": 500}, "cutoff_hz"),
        ({"repeats": True}, "--repeats"),
        ({"pause": math.nan}, "pause"),
    )


def test_what_is_refused_names_the_option_that_would_read_it(
    written: Write, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, text, how, says in (
        ("a.csv", "t_s;x_m;y_m\n0;1;2\n", [], "--separator = 'comma': expected 'semicolon'"),
        ("a.csv", "t_s;x_m;y_m\n0;1,5;2\n", ["--separator", "semicolon"], "(a decimal comma? --decimal comma)"),
        ("a.csv", "t_s,x_m,y_m\n0,1,2\n", ["--columns", "x_m,b_m"], "--columns = 'b_m'"),
        ("a.csv", "t_s,x,y\n0,1,2\n", ["--count-mm", "-1"], "--count-mm = -1.0: expected a finite number above zero"),
        ("a.svc", "2\n99000000 1 0 1 0 0 0\n1 1 10 1 0 0 0\n", [], "what a raw count is: --count-mm and --tick-ms"),
    ):
        with pytest.raises(SystemExit) as done:
            main(["score", str(written(name, text)), *how])
        said = capsys.readouterr().err
        assert done.value.code == 2
        assert says in said
        assert "recording." not in said


def test_command_prints_rows_and_writes_no_file_twice(
    written: Write, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, out = str(written("a.csv", table(*reach(100, rest=0.3)))), tmp_path / "new" / "scores.csv"
    with pytest.raises(SystemExit) as done:
        main(["score", file])
    assert done.value.code == 0
    printed = capsys.readouterr()
    assert printed.out.startswith("recording,trial,measure,value,unit\n")
    assert printed.err == ""
    before = Path(file).read_bytes()
    for place, arguments, code in ((out, [], 0), (out, [], 2), (out, ["--force"], 0), (file, ["--force"], 2)):
        with pytest.raises(SystemExit) as done:
            main(["score", file, "--target", "0.2,0.01", "--out", str(place), *arguments])
        assert done.value.code == code
    assert "end_error,0.01" in out.read_text()
    assert Path(file).read_bytes() == before
    for bad in (["--target", "0.2;1"], ["--pause", "-1"], ["--marker", "HAND", "--columns", "a,b"]):
        with pytest.raises(SystemExit) as done:
            main(["score", file, *bad])
        assert done.value.code == 2


@pytest.mark.parametrize(("unit", "scale"), [("s", 1.0), ("ms", 1e3)])
def test_unix_time_stamps_are_times(written: Write, unit: str, scale: float) -> None:
    """As ROS and Python's loggers write them: they were refused as another unit, which seconds in ms still are."""
    time, points = reach(100, rest=0.3)
    plain = score_recordings([str(written("a.csv", table(time, points)))])
    text = table((time + 1.7e9) * scale, points)
    stamped = score_recordings([str(written("b.csv", text.replace("t_s", f"t_{unit}")))])
    np.testing.assert_allclose([row.value for row in stamped.rows], [row.value for row in plain.rows], rtol=1e-4)
    assert not stamped.notes
    with pytest.raises(ProblemFileError, match=r"line 2, column t_s = .*another unit"):
        score_recordings([str(written("c.csv", table((time + 1.7e9) * 1e3, points)))])
