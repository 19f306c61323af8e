"""Who takes part: tables and folders, and every fault of theirs named by row and column."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rehab_opt.errors import ConfigurationError, ProblemFileError
from rehab_opt.kinematics.human_arm import ARM_JOINTS, RANGES_OF_MOTION_DEG
from rehab_opt.session.many.participant import Participant
from rehab_opt.session.many.participants import cell_value, participants_of, replaced
from rehab_opt.session.upper_limb.problem import UpperLimb
from rehab_opt.session.workspaces.scene import WorkspaceProblem
from tests.refusals import refuses

Write = Callable[[str, str | bytes], Path]


def people(written: Write, table: str, problem: str | None = None) -> tuple[Participant, ...]:
    return participants_of(written("people.csv", table), problem=problem)


def ranges_of(person: Participant) -> Any:
    problem = person.problem().problem
    assert isinstance(problem, WorkspaceProblem)
    return problem.arm.range_of_motion


def test_cells_replace_what_the_problem_says_and_empty_ones_do_not(written: Write) -> None:
    first, second = people(
        written, 'participant,arm.side,arm.segments.humerus_mm,arm.shoulder_m\nA,right,310,\nB,,290,"[0.1, 0, 0.9]"\n'
    )
    a, b = (person.problem().problem.arm for person in (first, second))
    assert (a.side, a.segments.humerus_mm, a.shoulder_m) == ("right", 310.0, [0.0, 0.0, 0.0])
    assert (b.side, b.segments.humerus_mm, b.shoulder_m) == ("left", 290.0, [0.1, 0.0, 0.9])
    assert a.segments.forearm_mm == b.segments.forearm_mm == 300.0
    assert first.problem().problem.title.startswith("A: Regular and restricted")


def test_one_end_of_a_limit_can_be_replaced_in_a_range_that_has_a_name(written: Write) -> None:
    (person,) = people(written, "participant,arm.range_of_motion.restricted.forearm_extension_deg.upper\nA,45\n")
    ranges = ranges_of(person)
    assert ranges["regular"] == "regular"
    assert ranges["restricted"].forearm_extension_deg == [30, 45]
    for joint in ARM_JOINTS:
        if joint != "forearm_extension":
            assert getattr(ranges["restricted"], f"{joint}_deg") == list(RANGES_OF_MOTION_DEG["restricted"][joint])


def test_own_range_in_part_is_refused_rather_than_filled_with_another_persons(written: Write) -> None:
    (person,) = people(written, 'participant,arm.range_of_motion.forearm_extension_deg\nA,"[0, 50]"\n')
    with pytest.raises(ProblemFileError, match=r"people.csv, line 2: arm.range_of_motion.scapular_retraction_deg"):
        person.problem()


def test_one_joint_is_enough_where_the_problem_has_one_range(written: Write) -> None:
    table = "participant,arm.range_of_motion.forearm_extension_deg.lower,title\nA,10,mine\n"
    (person,) = people(written, table, "upper_limb/mocap_box")
    problem = person.problem().problem
    assert isinstance(problem, UpperLimb)
    assert problem.arm.range_of_motion.forearm_extension_deg == [10, 70]  # type: ignore[union-attr]
    assert problem.title == "mine"


def test_lists_are_entered_by_number(written: Write) -> None:
    table = "participant,trajectory.1.placement.scale,arm.side\nA,0.5,left\n"
    (person,) = people(written, table, "upper_limb/workspace_map")
    assert [each.placement.scale for each in person.problem().problem.trajectory] == [None, 0.5]


def test_fault_of_one_row_is_said_of_that_row_alone(written: Write) -> None:
    for rows, said in (
        ("arm.side\nA,up\nB,left", "line 2: arm.side = 'up'"),
        ("arm.side\nA,left,right\nB,left", "line 2: cells = 3: expected 2"),
        ("arm.segments.humerus_mm\nA,wide\nB,300", "line 2: arm.segments.humerus_mm = 'wide'"),
        ('arm.segments.humerus_mm\nA,"29,5"\nB,300', "line 2: arm.segments.humerus_mm = '29,5'"),
        ("arm.range_of_motion.mine.forearm_extension_deg.upper\nA,50\nB,", "forearm_extension_deg.lower = None"),
        ("arm.range_of_motion.restricted.forearm_extension_deg.upper\nA,20\nB,", "[30, 20]: expected [lower, upper]"),
        ("system\nA,nothing\nB,", "line 2: system = 'nothing'"),
    ):
        first, second = people(written, f"participant,{rows}\n")
        message = first.error
        if not message:
            with pytest.raises(ProblemFileError) as refusal:
                first.problem()
            message = str(refusal.value)
        assert said in message
        assert "people.csv, line 2" in message
        assert second.problem().problem.arm.side == "left"


def test_fault_of_the_table_names_row_and_column(written: Write) -> None:
    refuses(
        lambda table: participants_of(written("people.csv", table)),
        (("name,arm.side\nA,left\n",), "line 1", "a column participant"),
        (("participant;arm.side\nA;left\n",), "line 1", "cells are separated by commas"),
        (("participant,arm.side,arm.side\nA,left,left\n",), "line 1, column 3", "each column once"),
        (("participant,\nA,left\n",), "line 1, column 2", "a name"),
        (('participant,arm.side\n"A,left\n',), "line 2", "comma-separated cells"),
        error=ProblemFileError,
    )


def test_a_name_that_cannot_be_used_is_its_own_row(written: Write) -> None:
    names = ["A", "", "B", "../A", "b", "C", "x" * 101, "groups.csv", "=1+1", "-x", "-1", "Results.Parquet"]
    found = people(written, "participant,arm.side\n" + "".join(f"{name},left\n" for name in names))
    assert [person.error == "" for person in found] == [name in ("A", "C", "-1") for name in names]
    assert "line 6, column participant has it, too" in found[2].error
    assert "line 4, column participant has it, too" in found[4].error
    assert found[2].error.partition("people.csv")[2].startswith(": line 4, column participant = 'B'")
    assert "1 to 100 characters" in found[1].error
    assert "people.csv: line 5, column participant = '../A'" in found[3].error
    assert len({person.name for person in found}) == len(names)
    assert not any("/" in person.name for person in found)


@pytest.mark.parametrize("segment", ["hand_mm", "humerus_mm"])
def test_an_empty_segment_is_nobody_elses(written: Write, segment: str) -> None:
    table = f"participant,arm.segments.{segment}\nA,\nB,90\n"
    first, second = people(written, table)
    assert f"people.csv, line 2: arm.segments.{segment} = ''" in first.error
    assert getattr(second.problem().problem.arm.segments, segment) == 90
    base = written(
        "base.toml",
        f"""system = "workspace"
title = "t"
[arm]
side = "left"
range_of_motion = "regular"
segments = {{{segment} = 80.0}}
""",
    )
    first, _ = people(written, table, str(base))
    assert first.error == ""
    assert getattr(first.problem().problem.arm.segments, segment) == 80


def test_covariates_are_no_keys_of_a_problem(written: Write) -> None:
    (person,) = people(written, "participant,group,visit,arm.side\nA,stroke,,right\n")
    assert person.covariates == {"group": "stroke", "visit": ""}
    assert person.inputs == {"arm.side": "right"}
    assert person.problem().problem.arm.side == "right"


def test_folder_has_a_person_in_each_problem_file(written: Write, tmp_path: Path) -> None:
    with pytest.raises(ProblemFileError, match="a problem file for each participant"):
        participants_of(tmp_path)
    written("b.toml", 'system = "workspace"\n')
    written("a.toml", "system = \n")
    written("notes.txt", "x")
    first, second = participants_of(tmp_path)
    assert (first.name, second.name) == ("a", "b")
    assert "a.toml: line 1" in first.error
    with pytest.raises(ConfigurationError, match="no such option with a folder"):
        participants_of(tmp_path, problem="upper_limb/workspace")


@pytest.mark.parametrize(
    ("cell", "value"),
    [("290", 290), (" 2.5 ", 2.5), ("true", True), ("left", "left"), ('"12"', "12"),
     ("1\nx=2", "1\nx=2"),
     ("29,5", "29,5"),
     ("[1, 2] # ?", "[1, 2] # ?"), ('"P #1"', "P #1"),
     ("1], [2", "1], [2")],
)  # fmt: skip
def test_cell_is_a_number_where_it_reads_as_one_and_else_a_text(cell: str, value: object) -> None:
    assert cell_value(cell) == value
    assert type(cell_value(cell)) is type(value)


@given(
    key=st.text("abc.01_deg", max_size=12) | st.sampled_from(["arm.side.lower", "list.0", "list.9.x", "arm..x", "."]),
    cell=st.text(max_size=8),
)
def test_any_key_and_cell_end_in_content_or_a_refusal_and_leave_the_base_alone(key: str, cell: str) -> None:
    base: dict[str, Any] = {"arm": {"side": "left", "range_of_motion": {"regular": "regular"}}, "list": [{"x": [1, 2]}]}
    copy = repr(base)
    try:
        replaced(base, {key: cell}, file="f")
    except ProblemFileError as refused:
        assert refused.file == "f"  # noqa: PT017  (either end is fine)
    assert repr(base) == copy
