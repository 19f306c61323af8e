"""Ranges used in recorded reaches, as a problem file: what is asked for, and that it is called what it is."""

from __future__ import annotations

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
from rehab_opt.workspace.cp_reach import reach_groups
from tests.refusals import refuses

CONTENT: dict[str, Any] = {
    "system": "used_ranges",
    "title": "test",
    "recorded": {"folder": "data:cp_dyskinetic_reach", "tasks": ["RGV"]},
    "arm": {"side": "left", "handle_tilt_deg": "any", "accuracy_mm": 10.0},
}
FOLDER = "cp_dyskinetic_reach"


def run(content: dict[str, Any]) -> UsedRangesOutcome:
    outcome = run_problem(problem_of(content, name="test", file="test.toml", path=Path("test.toml")))
    assert isinstance(outcome, UsedRangesOutcome)
    return outcome


def test_range_used_is_that_of_the_recorded_reaches_and_one_that_holds_no_handle_upright_is_empty(
    recorded: Callable[[str], Path],
) -> None:
    folder = recorded(f"{FOLDER}/RF_MEAN_ShEl.csv").parent
    outcome = run({**CONTENT, "arm": {**CONTENT["arm"], "handle_tilt_deg": 2.0}})
    assert len(outcome.metrics["groups"]) == 2
    for label, numbers in outcome.metrics["groups"].items():
        for joint, (lower, upper) in reach_groups(folder)["RGV", label.partition(", ")[2]].used.items():
            assert numbers["range_used"][f"{joint}_deg"]["lower"] == pytest.approx(math.degrees(lower))
            assert numbers["range_used"][f"{joint}_deg"]["upper"] == pytest.approx(math.degrees(upper))
        assert numbers["empty"]
    assert outcome.notes[0].startswith("RANGE USED in one task, not the range possible")
    assert sum("EMPTY, no posture holds the handle" in note for note in outcome.notes) == 2
    assert {"range_used", "workspace_of_range_used"} == set(used_ranges_figures(outcome))


def test_fault_is_refused_with_its_key() -> None:
    def read(recorded_section: dict[str, Any]) -> None:
        content = {**CONTENT, "recorded": recorded_section}
        checked(problem_of(content, name="test", file="test.toml", path=Path("test.toml")))

    refuses(
        read,
        (({"folder": "x", "tasks": ["RF", "RF"]},), "recorded.tasks"),
        (({"folder": "x", "tasks": ["R S"]},), "recorded.tasks.0"),
        (({"folder": "x", "pronation_zero_deg": "thumb"},), "recorded.pronation_zero_deg"),
        (({"folder": "nowhere"},), "recorded.folder"),
        error=ProblemFileError,
    )
