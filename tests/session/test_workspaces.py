"""Workspaces of problem files: numbers, boundaries and figures of one arm with any ranges of motion."""

from __future__ import annotations

import io
import json
import re
from pathlib import Path
from typing import Any

import pytest

from rehab_opt.errors import ProblemFileError
from rehab_opt.session.files import load_problem, problem_of
from rehab_opt.session.outcome import Outcome
from rehab_opt.session.report import metrics_json
from rehab_opt.session.run import checked, run_problem
from rehab_opt.session.systems import system_named
from rehab_opt.session.workspaces.figures import SET_STYLES
from rehab_opt.session.workspaces.figures import figures as workspace_figures
from tests.refusals import refuses

COARSE = {"side": "left", "accuracy_mm": 5.0}


def run(**arm: object) -> Outcome:
    content = {"system": "workspace", "title": "test", "arm": {**COARSE, **arm}}
    return run_problem(problem_of(content, name="test", file="test.toml", path=Path("test.toml")))


@pytest.fixture(scope="module")
def shipped() -> Outcome:
    return run_problem(load_problem("upper_limb/workspace"))


def test_shipped_problem_gives_table_i_and_the_other_reading_of_figure_3(shipped: Outcome) -> None:
    numbers = shipped.metrics["sets"]
    assert numbers["regular"]["area_m2"] == pytest.approx(0.1037, rel=0.01)
    assert numbers["restricted"]["area_m2"] == pytest.approx(0.00331, rel=0.02)
    assert numbers["restricted"]["fraction_inside"]["regular"] == pytest.approx(1.0, abs=1e-3)
    assert numbers["regular"]["fraction_inside"]["restricted"] == pytest.approx(0.0319, abs=1e-3)
    assert numbers["figure_3"]["area_m2"] == pytest.approx(0.0332, rel=0.01)
    assert numbers["figure_3"]["fraction_inside"]["regular"] == pytest.approx(0.948, abs=0.005)
    assert numbers["restricted"]["fraction_inside"]["figure_3"] == pytest.approx(0.139, abs=0.01)
    assert [of["components"] for of in numbers.values()] == [1, 1, 1]
    areas = {tilt: 1e4 * of["area_m2"] for tilt, of in numbers["restricted"]["tilts"].items()}
    assert areas == pytest.approx(
        {"2_deg": 33.1, "5_deg": 44.2, "10_deg": 63.3, "20_deg": 102.0, "any": 107.3}, rel=0.01
    )
    json.loads(metrics_json(shipped), parse_constant=pytest.fail)


def test_empty_set_is_an_answer_with_its_reason_in_table_note_and_figure() -> None:
    outcome = run(range_of_motion={"person [bold]7": "restricted"}, handle_tilt_deg=0.1)
    of = outcome.metrics["sets"]["person [bold]7"]
    assert (of["empty"], of["area_m2"], of["x_min_m"]) == (True, 0.0, None)
    assert any("EMPTY, no posture holds the handle within 0.1 deg" in note for note in outcome.notes)
    printed = shown(outcome)
    assert re.search(r"empty +│ +yes", printed)
    assert "person [bold]7" in printed
    legend = workspace_figures(outcome)["workspace"].legends[0]
    assert any("no posture holds the handle" in text.get_text() for text in legend.get_texts())
    axes = workspace_figures(outcome)["workspace"].axes[0]
    assert axes.get_ylim()[1] > 60.0  # [mm] the arrow of the shoulder is to be seen, and no grid of micrometres
    assert axes.get_xlim()[1] < 500.0
    assert not len(dict(outcome.trace())["x_m"])


def test_volumes_come_with_and_without_the_handle() -> None:
    content = {
        "system": "workspace",
        "title": "test",
        "volume": True,
        "volume_accuracy_mm": 20.0,
        "volume_spacing_mm": 120.0,
        "arm": {**COARSE, "range_of_motion": "restricted"},
    }
    outcome = run_problem(problem_of(content, name="test", file="f", path=Path("f")))
    of = outcome.metrics["volumes"]["restricted"]
    assert 0 < of["handle_held"]["volume_m3"] < of["handle_free"]["volume_m3"]
    drawn = workspace_figures(outcome)
    assert set(drawn) == {"workspace", "volume"}
    assert "volume: handle free" in shown(outcome)


def shown(outcome: Outcome) -> str:
    from rich.console import Console  # noqa: PLC0415

    text = io.StringIO()
    Console(file=text, width=160).print(system_named("workspace").table(outcome))
    return text.getvalue()


def test_fault_is_refused_with_its_key() -> None:
    def read(arm: dict[str, Any], tilts: dict[str, Any] | None = None) -> None:
        content = {"system": "workspace", "title": "test", "arm": {"side": "left", "range_of_motion": "regular", **arm}}
        content |= {} if tilts is None else {"tilts": tilts}
        checked(problem_of(content, name="test", file="test.toml", path=Path("test.toml")))

    own = {"scapular_retraction_deg": [0, 0]}
    refuses(
        read,
        (({"range_of_motion": "normal"},), "arm.range_of_motion", "'regular', 'restricted' or 'figure_3'"),
        (({"range_of_motion": {"a": "normal"}},), "arm.range_of_motion.a", "'regular', 'restricted' or 'figure_3'"),
        (({"range_of_motion": {"a": {"wrist_deg": [0, 1]}}},), "arm.range_of_motion.a.wrist_deg", "one of the keys"),
        (({"range_of_motion": own},), "arm.range_of_motion.glenohumeral_rotation_deg", "this key"),
        (({"range_of_motion": {"x" * 41: "regular"}},), "arm.range_of_motion", "1 to 40 printable characters"),
        (({"range_of_motion": {" ": "regular"}},), "arm.range_of_motion", "1 to 40 printable characters"),
        (({"handle_tilt_deg": "none"},), "arm.handle_tilt_deg", "'any'"),
        (({"joint_speed_deg_s": 90.0},), "arm.joint_speed_deg_s", "one of the keys"),
        (({}, {"range": "figure_3", "handle_tilt_deg": [2]}), "tilts.range", "the name of a range"),
        (({}, {"range": "regular", "handle_tilt_deg": [2.0, 2.0]}), "tilts.handle_tilt_deg", "each one once"),
        (({}, {"range": "regular", "handle_tilt_deg": ["none"]}), "tilts.handle_tilt_deg.0", "'any'"),
        error=ProblemFileError,
    )


def test_as_many_sets_as_may_be_compared_look_different() -> None:
    assert len({style["facecolor"] for style in SET_STYLES}) == len(SET_STYLES) >= 12
    assert len({(style["linestyle"], style.get("hatch")) for style in SET_STYLES}) == len(SET_STYLES)
