"""Scripts after public bug reports, beside the data folder: what each prints is judged here."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from rehab_opt.errors import RobotFileError
from tests.session.conftest import recorded  # noqa: F401  (a fixture)

GONE = (r"JointFeedback, ", ""), (r", feedback=JointFeedback\([^)]*\)", "")
"""What the scripts pass that every controller of joints does by itself now."""


@pytest.fixture
def printed(recorded, monkeypatch, capsys, pytestconfig):  # noqa: F811
    def run(name: str) -> str:
        text = Path(recorded(f"../cases/control/{name}.py")).read_text()
        for old, new in GONE:
            text = re.sub(old, new, text)
        monkeypatch.chdir(pytestconfig.rootpath)
        exec(compile(text, name, "exec"), {"__name__": name})
        return str(capsys.readouterr().out)

    return run


def numbers(text: str, pattern: str) -> list[float]:
    return [float(each) for each in re.findall(pattern, text)]


@pytest.mark.parametrize("name", ["fail_1_wrapped_encoder", "fail_3_one_zero_packet"])
def test_positions_of_another_turn_and_one_packet_of_zeros_keep_accelerations(name: str, printed) -> None:
    said = printed(name)
    (times,) = numbers(said, r"up to (\S+) of" if "1_" in name else r"(\S+) times its acceleration")
    assert times <= 1.0
    assert said.startswith("Status.OK" if "1_" in name else "Status.BRAKING 'no joint can have come")


def test_a_message_of_other_joints_is_waited_out(printed) -> None:
    assert "Lost" not in printed("fail_4_partial_joint_state")


def test_a_robot_at_half_its_speed_is_followed(printed) -> None:
    assert printed("fail_5_speed_slider").startswith("2.0 s: Status.OK")


def test_global_coordinates_are_refused(printed) -> None:
    with pytest.raises(RobotFileError, match="global coordinates"):
        printed("fail_6_mjcf_global")


def test_stamps_since_1970_and_held_or_rounded_samples_leave_a_path_as_it_is(printed) -> None:
    assert all(jerk <= 20.0 for jerk in numbers(printed("fail_7_unix_stamps"), r"up to (\S+) of 20"))
    plain, *others = numbers(printed("fail_8_held_samples"), r"takes (\S+) s")
    assert others == pytest.approx([plain] * 2, rel=0.05)


def test_after_a_pause_joints_start_from_rest(printed) -> None:
    assert numbers(printed("fail_10_after_a_pause"), r"at once: (\S+) rad/s") == [0.0]
