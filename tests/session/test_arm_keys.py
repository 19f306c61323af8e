"""Ranges of motion in problem files: as Table I counts, as a goniometer reads, and what is neither."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rehab_opt.cli import main
from rehab_opt.errors import ProblemFileError
from rehab_opt.kinematics.goniometer import arm_posture, goniometer_range
from rehab_opt.kinematics.human_arm import ARM_JOINTS, RANGES_OF_MOTION_DEG
from rehab_opt.session.arm_picture import range_note, stick_arm
from rehab_opt.session.files import load_problem
from rehab_opt.session.run import arms_of, checked
from tests.refusals import refuses

Write = Callable[[str, str | bytes], Path]

WORKSPACE = 'system = "workspace"\ntitle = "t"\n[arm]\nside = "right"\n[arm.range_of_motion]\n'
HEALTHY = {
    "scapular_retraction": (-15, 15), "shoulder_flexion": (-60, 180), "shoulder_abduction": (-30, 180),
    "shoulder_external_rotation": (-70, 90), "elbow_flexion": (0, 150), "forearm_pronation": (-80, 80),
    "wrist_flexion": (-70, 80), "wrist_ulnar_deviation": (-20, 30),
}  # fmt: skip
REGULAR = {name: tuple(pair) for name, pair in RANGES_OF_MOTION_DEG["regular"].items()}


def keys(ranges: dict[str, tuple[float, float]], *, convention: bool, scale: float = 1.0) -> str:
    lines = [f"{name}_deg = [{scale * low}, {scale * high}]" for name, (low, high) in ranges.items()]
    return "\n".join((['convention = "goniometer"'] if convention else []) + lines) + "\n"


def test_goniometer_keys_make_the_arm_that_was_measured(written: Write) -> None:
    config = load_problem(str(written("p.toml", WORKSPACE + keys(HEALTHY, convention=True))))
    (arm,) = arms_of(config).values()
    low = arm_posture({"elbow_flexion": 0.0, "shoulder_external_rotation": np.radians(-70)})
    assert arm.lower[ARM_JOINTS.index("forearm_extension")] == pytest.approx(low[4])
    assert arm.lower[ARM_JOINTS.index("glenohumeral_rotation")] == pytest.approx(low[1])
    note = range_note("own", arm)
    for words in ("elbow: 0 to 150 deg of flexion", "shoulder: 30 deg of adduction to 180 deg of abduction"):
        assert words in note


@pytest.mark.parametrize(
    ("pair", "words"),
    [
        ((60, 150), "60 to 150 deg of flexion (the straight arm is 0: if it was counted as 180, this is 30 to 120)"),
        ((0.52, 2.09), "elbow: 0.5 to 2.1 deg of flexion (so narrow: degrees, not radians?)"),
        ((30, 120), "elbow: 30 to 120 deg of flexion;"),
        ((0, 0), "elbow: locked at 0 deg of flexion;"),
    ],
)
def test_what_a_range_looks_like_is_said_and_the_side(written: Write, pair: tuple[float, float], words: str) -> None:
    text = WORKSPACE + keys(HEALTHY | {"elbow_flexion": pair}, convention=True)
    (arm,) = arms_of(load_problem(str(written("p.toml", text)))).values()
    note = range_note("own", arm, side="right")
    assert words in note
    assert "'own' of the right arm, as" in note
    assert note.count("(") == words.count("(")


def test_the_same_range_in_both_ways_of_counting_is_the_same_arm(written: Write) -> None:
    table = {name: np.deg2rad(pair) for name, pair in REGULAR.items()}
    measured = {name: tuple(np.rad2deg(pair)) for name, pair in goniometer_range(table).items()}
    by_table = arms_of(load_problem(str(written("a.toml", WORKSPACE + keys(REGULAR, convention=False)))))
    by_goniometer = arms_of(load_problem(str(written("b.toml", WORKSPACE + keys(measured, convention=True)))))
    for ends in ("lower", "upper"):
        one, other = (getattr(next(iter(arms.values())), ends) for arms in (by_table, by_goniometer))
        np.testing.assert_allclose(one, other, atol=1e-12)


def test_angles_that_nobody_has_are_refused_with_what_they_look_like(written: Write) -> None:
    bent, turned = {**HEALTHY, "elbow_flexion": (30, 180)}, {**HEALTHY, "forearm_pronation": (10, 170)}
    named = dict(zip(ARM_JOINTS, HEALTHY.values(), strict=True))
    refuses(
        lambda text: checked(load_problem(str(written("p.toml", WORKSPACE + text)))),
        ((keys(HEALTHY, convention=True, scale=np.pi / 180),), "arm.range_of_motion.", "_deg", "look like radians"),
        ((keys(bent, convention=True),), "elbow_flexion_deg", "180 deg at the straight"),
        ((keys(turned, convention=True),), "forearm_pronation_deg", "as ISB does"),
        ((keys(named, convention=False),), "_deg", "goniometer angles"),
        ((keys({**REGULAR, "wrist_supination": (-130, 30)}, convention=False),), "wrist_supination_deg", "goniometer"),
        ((keys(HEALTHY, convention=False),), "shoulder_flexion_deg", "one of the keys"),
        error=ProblemFileError,
    )


def test_a_picture_replaces_none_unasked(written: Write, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = written("p.toml", WORKSPACE + keys(HEALTHY, convention=True))
    old = tmp_path / "arm_1.png"
    old.write_text("of another person")
    ask = ["check", str(file), "--picture", str(tmp_path)]
    for more, code, replaced in (([], 2, False), (["--force"], 0, True)):
        with pytest.raises(SystemExit) as done:
            main([*ask, *more])
        assert done.value.code == code
        assert (old.read_bytes() != b"of another person") is replaced
        said = capsys.readouterr()
        assert replaced or ("--picture" in said.err and str(old) in said.err and "--force" in said.err)
        assert replaced or not said.out  # refused before anything is said to be well


def test_picture_has_the_arm_where_the_goniometer_says(written: Write, tmp_path: Path) -> None:
    file = written("p.toml", WORKSPACE + keys(HEALTHY, convention=True))
    (arm,) = arms_of(load_problem(str(file))).values()
    places = stick_arm(arm, {"elbow_flexion": np.pi / 2})
    expected = [
        (0, 0, 0),
        (0.13, 0, 0),
        (0.13, 0, -0.29),
        (0.13, 0.30, -0.29),
        (0.13, 0.37, -0.29),
        (0.13, 0.37, -0.23),
    ]
    np.testing.assert_allclose(places, expected, atol=1e-12)
    with pytest.raises(SystemExit) as done:
        main(["check", str(file), "--picture", str(tmp_path / "new")])
    assert done.value.code == 0
    assert {path.name for path in (tmp_path / "new").iterdir()} == {"arm_1.png", "arm_1.pdf", "captions.md"}
    with pytest.raises(SystemExit) as done:
        main(["check", "robot/ur5_circle", "--picture", str(tmp_path)])
    assert done.value.code == 2
