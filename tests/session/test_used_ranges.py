"""Ranges used in recorded reaches, as a problem file: what is asked for, and that it is called what it is."""

from __future__ import annotations

import io
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from rehab_opt.errors import ProblemFileError
from rehab_opt.session.files import problem_of
from rehab_opt.session.run import checked, run_problem
from rehab_opt.session.used_ranges.run import UsedRangesOutcome
from rehab_opt.session.used_ranges.shown import figures as used_ranges_figures
from rehab_opt.session.used_ranges.shown import table as used_ranges_table
from rehab_opt.workspace.cp_reach import reach_groups

CONTENT: dict[str, Any] = {
    "system": "used_ranges",
    "title": "test",
    "recorded": {"folder": "data:cp_dyskinetic_reach", "tasks": ["RGV"]},
    "arm": {"side": "left", "handle_tilt_deg": "any", "accuracy_mm": 10.0},
    "variation": {"people": 2, "spacing_mm": 20.0},
}
FOLDER = "cp_dyskinetic_reach"


def run(content: dict[str, Any]) -> UsedRangesOutcome:
    outcome = run_problem(problem_of(content, name="test", file="test.toml", path=Path("test.toml")))
    assert isinstance(outcome, UsedRangesOutcome)
    return outcome


def test_groups_stand_side_by_side_and_the_words_are_range_used(recorded: Callable[[str], Path]) -> None:
    from rich.console import Console  # noqa: PLC0415

    folder = recorded(f"{FOLDER}/RF_MEAN_ShEl.csv").parent
    outcome = run(CONTENT)
    groups = outcome.metrics["groups"]
    assert len(groups) == 2
    for label, numbers in groups.items():
        task, _, name = label.partition(", ")
        assert task == "reach and grasp vertical"
        used = reach_groups(folder)["RGV", name].used
        for joint, (lower, upper) in used.items():
            assert numbers["range_used"][f"{joint}_deg"]["lower"] == pytest.approx(math.degrees(lower))
            assert numbers["range_used"][f"{joint}_deg"]["upper"] == pytest.approx(math.degrees(upper))
        assert numbers["area_m2"] > 0.03
        assert numbers["people_drawn"] == 2
    assert outcome.notes[0].startswith("RANGE USED in one task, not the range possible")
    text = io.StringIO()
    Console(file=text, width=120).print(used_ranges_table(outcome))
    assert "workspace of the range used" in text.getvalue()
    drawn = used_ranges_figures(outcome)
    assert set(drawn) == {"range_used", "workspace_of_range_used", "fraction_of_people"}
    assert all("ange used" in figure.get_suptitle() for figure in drawn.values())


def test_range_that_holds_no_handle_upright_is_an_answer(recorded: Callable[[str], Path]) -> None:
    recorded(f"{FOLDER}/RF_MEAN_ShEl.csv")
    content = {**CONTENT, "arm": {**CONTENT["arm"], "handle_tilt_deg": 2.0}, "variation": None}
    outcome = run(content)
    assert all(numbers["empty"] for numbers in outcome.metrics["groups"].values())
    assert sum("EMPTY, no posture holds the handle" in note for note in outcome.notes) == 2
    assert "fraction_of_people" not in used_ranges_figures(outcome)


@pytest.mark.parametrize(
    ("recorded_section", "key"),
    [
        ({"folder": ""}, "recorded.folder"),
        ({"folder": "x", "tasks": ["RF", "RF"]}, "recorded.tasks"),
        ({"folder": "x", "tasks": ["R S"]}, "recorded.tasks.0"),
        ({"folder": "x", "cover": 0.2}, "recorded.cover"),
        ({"folder": "x", "pronation_zero_deg": "thumb"}, "recorded.pronation_zero_deg"),
        ({"folder": "nowhere"}, "recorded.folder"),
    ],
)
def test_fault_is_one_line_with_its_key(recorded_section: dict[str, Any], key: str) -> None:
    content = {**CONTENT, "recorded": recorded_section}
    with pytest.raises(ProblemFileError) as refusal:
        checked(problem_of(content, name="test", file="test.toml", path=Path("test.toml")))
    assert refusal.value.key == key
    assert "\n" not in str(refusal.value)
