"""A seat for a recording that nobody has placed: what is promised is what a run achieves, and a file says it."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench.unseen.hands import reach_recording
from rehab_opt import MirrorTracker, ur5
from rehab_opt.cli import main
from rehab_opt.control.seats import Seats
from rehab_opt.errors import ProblemFileError
from rehab_opt.session.files import load_problem, shipped_problems
from rehab_opt.session.mirror import placing
from rehab_opt.session.mirror.placing import found_place, replaced_keys

SHIPPED = shipped_problems()["mirror/vr_hand"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two seconds of reaches, with everything else as the shipped recording has it."""
    made = tmp_path_factory.mktemp("placing")
    recording = reach_recording(made, 901, seconds=2.0)
    text, begin = SHIPPED.read_text(), SHIPPED.read_text().index("[recording]")
    lines = "\n".join(f'{key} = "{value}"' for key, value in recording.items())
    rest = text[text.index("[placement]") :].replace("recorded_arm_m = 0.98", "").replace("arm_m = 0.59", "")
    (made / "reaches.toml").write_text(f"{text[:begin]}[recording]\n{lines}\n\n{rest}")
    return made


@pytest.fixture(scope="module")
def placed(folder: Path) -> Path:
    """What the command writes; it replaces no file unasked, nor ever its input."""
    out = folder / "placed.toml"
    source = folder / "reaches.toml"
    before = source.read_bytes()
    for code, where, force in ((0, out, []), (2, out, []), (2, source, []), (2, source, ["--force"])):
        with pytest.raises(SystemExit) as end:
            main(["place", str(source), "--out", str(where), "--seats", "20", *force])
        assert end.value.code == code
    assert source.read_bytes() == before
    return out


def content(path: Path) -> dict[str, Any]:
    return tomllib.loads(path.read_text())


def test_what_is_patients_moves_as_one_and_the_rest_of_the_file_stays(folder: Path, placed: Path) -> None:
    before, after = content(folder / "reaches.toml"), content(placed)
    turned = [after["placement"]["turn_deg"] - before["placement"]["turn_deg"],
              after["patient"]["facing_deg"] - before["patient"]["facing_deg"]]  # fmt: skip
    assert turned[0] % 360 == pytest.approx(turned[1] % 360, abs=0.2)
    points = []
    for each in (before, after):
        patient = each["patient"]
        points.append(
            np.array([each["placement"]["origin_m"], patient["sagittal_point_m"], patient["arm"]["shoulder_m"]])
        )
    c, s = math.cos(math.radians(turned[0])), math.sin(math.radians(turned[0]))
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    np.testing.assert_allclose(np.diff(points[1], axis=0), np.diff(points[0], axis=0) @ turn.T, atol=3e-3)
    assert np.linalg.norm(points[1][:, :2], axis=1).min() > 0.44  # nobody sits in the robot
    assert placing.HEIGHT[0] - 1e-3 <= points[1][2, 2] <= placing.HEIGHT[1] + 1e-3  # [m] of a seated shoulder
    for each in (before, after):
        for section, keys in (("placement", ("origin_m", "turn_deg")), ("robot", ("start_deg", "grip_deg")),
                              ("patient", ("sagittal_point_m", "facing_deg", "arm"))):  # fmt: skip
            for key in keys:
                del each[section][key]
    assert before == after
    assert "# a table top" in placed.read_text() or "[[tracker.keep_out]]" in placed.read_text()


def test_a_section_without_a_header_and_a_measured_frame_are_refused() -> None:
    with pytest.raises(ProblemFileError, match=r"placement\.calibration_file"):
        found_place(load_problem("mirror/pick_fruit"), progress=lambda *_: None)
    with pytest.raises(ProblemFileError, match="placement"):
        replaced_keys("placement.turn_deg = 3.0\n", {"placement": {"turn_deg": 4.0}}, file="x.toml")
    text = "[a]\nb = [1.0,  # one\n 2.0]\nc = 2 # two\n[d]\nb = 3\n"
    new = replaced_keys(text, {"a": {"b": [0.5], "c": 7.0, "e": "word"}}, file="x.toml")
    assert tomllib.loads(new) == {"a": {"b": [0.5], "c": 7.0, "e": "word"}, "d": {"b": 3}}
    assert "c = 7.0 # two" in new


@pytest.mark.parametrize("wrist_deg", [-170.0, 20.0])
@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_wrist_begins_a_turn_earlier_where_the_path_would_wind_it_up(wrist_deg: float, way: float) -> None:
    arm = ur5()
    seats = Seats(MirrorTracker(arm, dt=0.005, max_manipulability=0.1, compile=False))
    at = np.array([0.3, -1.2, 1.5, -1.8, -1.57, math.radians(wrist_deg)])
    joints = np.tile(at, (61, 1))
    joints[:, 5] += way * np.radians(np.linspace(-90.0, 450.0, 61))  # one and a half turns, of the two it has
    poses = np.array([arm.pose(q) for q in joints])[:, None]
    walk = seats.walk(poses, at[None], 10)
    assert walk.done.all() == (abs((wrist_deg + way * 180.0 + 180.0) % 360.0 - 180.0) <= 90.0)
    turns = (walk.q[:, 0] - joints) / (2 * math.pi)
    np.testing.assert_allclose(turns, np.round(turns), atol=1e-3)
    done = walk.done[:, 0]
    assert np.all((walk.q[done] >= arm.lower) & (walk.q[done] <= arm.upper))
    assert done[0] or not done.any()


def test_a_wrist_without_ends_is_walked_as_it_is() -> None:
    """Its ends were added to each other, with a warning of Python's on the terminal."""
    endless = np.where(np.arange(6) == 5, np.inf, ur5().upper)
    arm, at = ur5().with_limits(lower=-endless, upper=endless), np.array([0.3, -1.2, 1.5, -1.8, -1.57, 0.0])
    seats = Seats(MirrorTracker(arm, dt=0.005, max_manipulability=0.1, compile=False))
    joints = np.tile(at, (61, 1))
    joints[:, 5] += np.radians(np.linspace(0.0, 900.0, 61))
    walk = seats.walk(np.array([arm.pose(q) for q in joints])[:, None], at[None], 0)
    assert walk.done.all()
    np.testing.assert_allclose(walk.q[:, 0], joints, atol=1e-3)


def test_a_pose_that_a_seat_only_comes_near_is_none_that_it_has() -> None:
    """A seat with 0.913 of what others have in reach came within 3 mm and 3 deg of the rest, and was taken."""
    at = np.array([0.3, -1.2, 1.5, -1.8, -1.57, 0.0])
    arm = ur5().with_limits(lower=at - 1e-4, upper=at + 1e-4)
    seats = Seats(MirrorTracker(arm, dt=0.005, max_manipulability=0.1, compile=False))
    poses = np.tile(arm.pose(at), (3, 1, 1, 1))
    poses[1, 0, 2, 3] += 2e-3
    assert seats.walk(poses, at[None], 0).done[:, 0].tolist() == [True, False, True]
