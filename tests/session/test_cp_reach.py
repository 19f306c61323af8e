"""Ranges used in recorded reaches: what the files hold, what was left out, and what the groups come to."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from rehab_opt import ConfigurationError, ProblemFileError, human_arm
from rehab_opt.kinematics.human_arm import ARM_JOINTS
from rehab_opt.workspace.clinical_angles import WITHOUT_A_JOINT, model_shoulder, model_wrist
from rehab_opt.workspace.cp_reach import grasp_zero, group_range, reach_groups
from rehab_opt.workspace.reach_rows import COLUMNS, GROUPS, TASKS, ReachAngles, flip_suspects, read_cp_reach

Array = NDArray[np.float64]
Recorded = Callable[[str], Path]
TYPICAL = GROUPS[0]


def rows_of(path: Path) -> Array:
    return np.genfromtxt(path, delimiter=",")


# ----------------------------------------------------------------------------------------------------- the real files
@pytest.mark.parametrize("task", list(TASKS))
def test_the_reader_returns_every_row_of_the_files_but_the_suspects(recorded: Recorded, task: str) -> None:
    folder = recorded("cp_dyskinetic_reach")
    groups = read_cp_reach(folder, task)
    for column in COLUMNS:
        path = folder / f"{task}_MEAN_{column}.csv"
        if not path.exists():
            assert column in WITHOUT_A_JOINT
            assert column not in groups[0].angles
            continue
        table = rows_of(path)
        sign = -1 if column == "ShEl" else 1  # ISB counts elevation negative
        for number, group in enumerate(groups):
            raw = table[table[:, 0] == number]
            lines = {s.line for s in group.left_out if s.file == path.name}
            kept = [row for line, row in enumerate(table, start=1) if row[0] == number and line not in lines]
            np.testing.assert_allclose(group.angles[column], sign * np.deg2rad(np.array(kept)[:, 1:]))
            assert len(kept) + len(lines) == len(raw)


def test_a_joint_of_one_clinical_angle_has_the_medians_of_its_rows(recorded: Recorded) -> None:
    folder = recorded("cp_dyskinetic_reach")
    table = rows_of(folder / "RF_MEAN_ElbFlExt.csv")
    elbow = np.deg2rad(table[table[:, 0] == 1, 1:])
    found = group_range(read_cp_reach(folder, "RF")[1])
    expected = (np.median(elbow.min(axis=1)), np.median(elbow.max(axis=1)))
    np.testing.assert_allclose(found.used["forearm_extension"], expected)
    pooled = group_range(read_cp_reach(folder, "RF")[1], cover=1.0)
    np.testing.assert_allclose(pooled.used["forearm_extension"], (elbow.min(), elbow.max()))


def end_pose(reach: ReachAngles, *, zero: float = 0.0) -> Array:
    """(4, 4) hand pose of the median limb at the end of its reach."""
    end = {column: float(np.median(rows[:, -1])) for column, rows in reach.angles.items()}
    shoulder = model_shoulder(end["ShAbd"], end["ShEl"], end["ShRot"])
    wrist = model_wrist(end["ElbProSup"] - zero, end["WristFlExt"], end["WristDev"])
    return human_arm().pose(np.array([np.pi, *shoulder, end["ElbFlExt"], *wrist]))


@pytest.mark.parametrize("group", [0, 1])
def test_the_median_reach_ends_as_the_task_asks(recorded: Recorded, group: int) -> None:
    """What no mapping name by name or of a wrong sign would do: in front, at the shoulder's height, palm down."""
    folder = recorded("cp_dyskinetic_reach")
    forwards, grasp = (end_pose(read_cp_reach(folder, task)[group]) for task in ("RF", "RGV"))
    for hand in (forwards, grasp):
        assert hand[1, 3] > 0.55
        assert abs(hand[0, 3]) < 0.10
        assert abs(hand[2, 3]) < 0.15
    assert abs(forwards[2, 0]) < np.sin(np.deg2rad(15))  # the thumb points inwards (a left arm: to the right)
    assert forwards[0, 0] > 0.9
    assert grasp[2, 0] > forwards[2, 0] + 0.4  # it rises to grasp what is vertical


def test_a_grasp_of_something_vertical_calibrates_pronation(recorded: Recorded) -> None:
    folder = recorded("cp_dyskinetic_reach")
    typical = read_cp_reach(folder, "RGV")[0]
    zero = grasp_zero(typical)
    assert np.rad2deg(zero) == pytest.approx(42, abs=5)
    heights = [end_pose(typical, zero=zero + shift)[2, 0] for shift in (-0.02, 0.0, 0.02)]
    assert heights[1] == max(heights) > np.cos(np.deg2rad(15))
    found = reach_groups(folder, pronation_zero="grasp")
    assert all("pronation counted from" in group.notes[-1] for group in found.values())
    plain = group_range(typical).used["wrist_supination"]
    np.testing.assert_allclose(found["RGV", TYPICAL].used["wrist_supination"], np.array(plain) - zero, atol=0.1)
    with pytest.raises(ConfigurationError):
        group_range(typical, pronation_zero=np.nan)


# -------------------------------------------------------------------------------------------------------- made-up files
def test_a_row_turned_round_is_found_and_an_unusual_one_is_not() -> None:
    rng = np.random.default_rng(1)
    rows = 1.2 + 0.1 * rng.standard_normal((20, 1)) + np.linspace(0, 0.3, 101)
    assert not flip_suspects(rows).any()
    rows[4] *= -1
    rows[7] = 0.0  # flat, unusual
    rows[9] -= 3.5  # of the other sign, but not the mirror image of the others
    assert np.flatnonzero(flip_suspects(rows)).tolist() == [4]
    assert not flip_suspects(rows - np.median(rows)).any()  # near zero a sign says nothing
    assert not flip_suspects(rows[3:6]).any()  # too few to say what is usual


def folder_with(tmp_path: Path, **changed: str) -> Path:
    rng = np.random.default_rng(2)
    for column in COLUMNS:
        rows = [[group, *(20 + 50 * rng.random() + np.linspace(0, 9, 101))] for group in (0, 0, 0, 1, 1, 1)]
        text = "\n".join(",".join(f"{cell:.6g}" for cell in row) for row in rows)
        (tmp_path / f"RF_MEAN_{column}.csv").write_text(changed.get(column, text + "\n"))
    return tmp_path


ROW = ",".join(["1", *["10"] * 101])


@pytest.mark.parametrize(
    ("text", "where"),
    [
        ("0,1,2\n", "line 1"),
        (f"{ROW}\n2{ROW[1:]}\n", "line 2, column 1"),
        (f"{ROW}\n{ROW[:-2]}ten\n", "line 2, column 102"),
        (f"{ROW}\n", "column 1"),  # nobody in group 0
    ],
)
def test_a_bad_file_is_named_with_the_place(tmp_path: Path, text: str, where: str) -> None:
    folder = folder_with(tmp_path, ElbFlExt=text)
    with pytest.raises(ProblemFileError) as caught:
        read_cp_reach(folder, "RF")
    assert caught.value.file.endswith("RF_MEAN_ElbFlExt.csv")
    assert caught.value.key == where


def test_a_missing_file_matters_where_the_model_needs_it(tmp_path: Path) -> None:
    folder = folder_with(tmp_path)
    (folder / "RF_MEAN_ScRot.csv").unlink()
    typical, _ = read_cp_reach(folder, "RF")
    assert typical.notes == ("RF: no file of ScRot",)
    assert tuple(group_range(typical).used) == ARM_JOINTS
    (folder / "RF_MEAN_ShEl.csv").unlink()
    with pytest.raises(ProblemFileError, match="ShEl"):
        read_cp_reach(folder, "RF")
    with pytest.raises(ProblemFileError, match="task"):
        read_cp_reach(folder, "RS")
