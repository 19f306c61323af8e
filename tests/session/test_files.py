"""Problem files: the shipped ones are sound, and every fault of others is one line that names it."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import BaseModel, ValidationError

from rehab_opt.errors import ProblemFileError
from rehab_opt.recordings.data_folder import ENVIRONMENT
from rehab_opt.session.files import (
    load_problem,
    problem_path,
    recording_path,
    recording_state,
    schema_error,
)
from rehab_opt.session.run import checked
from rehab_opt.session.systems import SHIPPED, system_named
from rehab_opt.session.upper_limb.problem import UpperLimb
from tests.refusals import refuses

Write = Callable[[str, str | bytes], Path]

ARM = """
system = "upper_limb"
title = "test"
[arm]
side = "left"
range_of_motion = "restricted"
[recording]
file = "path.csv"
hand = "left"
[placement]
centre_m = [-0.172, 0.502]
"""
OWN_RANGE = ARM.replace('range_of_motion = "restricted"\n', "") + "[arm.range_of_motion]\n"
RANGES = """scapular_retraction_deg = [0, 0]
glenohumeral_rotation_deg = [0, 5]
shoulder_adduction_deg = [70, 90]
humeral_flexion_deg = [30, 70]
forearm_extension_deg = [30, 60]
wrist_flexion_deg = [30, 60]
wrist_deviation_deg = [-30, -30]
wrist_supination_deg = [40, 45]
"""
ROBOT = """
system = "pose_tracking"
title = "test"
[robot]
model = "ur5"
start_deg = [0, -90, 90, -90, -90, 0]
[circle]
radius_m = 0.1
duration_s = 5
"""
CSV = "t_s,x_m,y_m\n0,0,0\n0.1,0.01,0\n0.2,0.01,0.01\n"


def test_problem_shipped_for_the_first_run_needs_no_data_folder(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv(ENVIRONMENT, str(tmp_path))
    assert recording_state("upper_limb/figure_eight")[1] == "none to fetch"
    checked(load_problem("upper_limb/figure_eight"))


def test_problem_file_is_found_by_name_and_by_path(monkeypatch: pytest.MonkeyPatch) -> None:
    name, path = problem_path("upper_limb/figure_eight")
    assert problem_path(str(path)) == (name, path)
    monkeypatch.chdir(path.parents[1])
    assert problem_path("upper_limb/figure_eight.toml")[0] == name


def test_every_number_of_the_schema_carries_its_unit_or_has_none() -> None:
    units = r".*_(m|mm|deg|s|hz|deg_s|deg_s2|deg_s3|per_s|kg|N|J|ms|rad)"
    ratios = (
        r"scale|damping|posture_cost|turns|cover|at_least|dead_zone|self_motion|floor|catch_up|patience|pull|gain|speed"
    )
    other = r"normal|towards|speeds"  # directions; m/s or rad/s, as the row next to it says
    for section in {found for name in SHIPPED for found in sections(system_named(name).schema)}:
        for key, field in section.model_fields.items():
            if "float" in str(field.annotation):
                assert re.fullmatch(f"{units}|{ratios}|{other}", key), key


def sections(annotation: Any) -> Iterator[type[BaseModel]]:
    """A section and all that stand in it, however deep in lists, tables and alternatives."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
        for field in annotation.model_fields.values():
            yield from sections(field.annotation)
    for part in get_args(annotation):
        yield from sections(part)


def test_fault_is_refused_with_key_value_and_expectation(written: Write) -> None:
    written("path.csv", CSV)
    refuses(
        lambda content: checked(load_problem(str(written("problem.toml", content)))),
        ((ARM + f"turn_deg = {'9' * 5000}\n",), "line 12", "a number of fewer digits"),
        ((ARM + f"turn_deg = 0x{'f' * 5000}\n",), "placement.turn_deg", ""),
        ((f"system = {'[' * 5000}{']' * 5000}\n",), "file", "tables and lists inside a few others"),
        ((ARM + f"[{'a.' * 5000}b]\n",), "line 12", "at most 32 parts"),
        ((ARM + "[arm.segments]\nhumerus_mm = 0.29\n",), "arm.segments.humerus_mm", "another unit"),
        ((ARM.replace("[placement]", 'marker = "HAND"\n[placement]'),), "recording.marker", "only a .trc"),
        (
            (ARM.replace("path.csv", "a.trc").replace("[placement]", 'columns = ["x_m", "y_m"]\n[placement]'),),
            "recording.columns",
            "only a .csv, .mot, .sto or .xdf",
        ),
        (
            (ARM.replace("[placement]", 'columns = ["x_m", "x_m"]\n[placement]'),),
            "recording.columns",
            "each column once",
        ),
        ((ARM + "[smoothing]\nspeed_deg_s = 0.5\n",), "smoothing.speed_deg_s", "greater than or equal to 1"),
        ((ROBOT.replace("= 5\n", "= 600\n[tracker]\nrate_hz = 10000\n"),), "tracker.rate_hz", "at most 2000000 ticks"),
        ((OWN_RANGE + RANGES.replace("[30, 70]", "[-200, 200]"),), "humeral_flexion_deg", "at most 360 deg apart"),
        ((ARM.replace("side", "sied"),), "arm.sied", "one of the keys side"),
        ((ARM.replace("centre_m", "centre"),), "placement.centre", "centre_m"),
        ((ARM.replace('hand = "left"\n', ""),), "recording.hand", "this key"),
        ((ARM.replace('"restricted"', '"resticted"'),), "arm.range_of_motion", "'regular', 'restricted' or 'figure_3'"),
        (
            (ARM.replace("[-0.172, 0.502]", '["a", 1]'),),
            "placement.centre_m.0",
            "a valid number, without quotation marks",
        ),
        ((ARM.replace("[-0.172, 0.502]", "[-172, 502]"),), "placement.centre_m.0", "greater than or equal to -10"),
        ((ARM + "scale = 1.0\nfit_m = [1, 1]\n",), "placement", "either scale or fit_m"),
        ((ARM + "[run]\nrate_hz = 1e5\n",), "run.rate_hz", "less than or equal to 1000"),
        (
            (OWN_RANGE + RANGES.replace("[70, 90]", "[90, 70]"),),
            "range_of_motion.shoulder_adduction_deg",
            "lower <= upper",
        ),
        (
            (OWN_RANGE + RANGES.replace("wrist_flexion_deg", "wrist_flexion_rad"),),
            "arm.range_of_motion.wrist_flexion_rad",
            "deg",
        ),
        ((OWN_RANGE + RANGES.replace("wrist_supination_deg = [40, 45]", ""),), "wrist_supination_deg", "this key"),
        ((ARM.replace("upper_limb", "lower_limb"),), "system", "one of upper_limb, pose_tracking"),
        (("system = \n",), "line 1", "TOML"),
        (("[a\n",), "line 1", "a table's name between [ and ]"),
        (("a = 3,5\n",), "line 1", "numbers have a point, no comma"),
        (("a = revolute\n",), "line 1", '"text"'),
        (('a = "x\n',), "line 1", "text that ends with its quotation mark"),
        (('a = "C:\\data"\n',), "line 1", "for a backslash"),
        (("",), "file", "not empty"),
        (("a = '\x00'",), "line 1", "UTF-8"),
        ((ROBOT.replace("90, -90, -90, 0]", "90]"),), "robot.start_deg", "6 entries"),
        (
            (ROBOT.replace("90, -90, -90, 0]", "200, -90, -90, 0]"),),
            "robot.start_deg.2",
            "elbow within -180 to 180 deg",
        ),
        ((ROBOT + "normal = [0, 0, 0]\n",), "circle", "neither zero nor parallel"),
        (
            (ARM + "[optimised.posture_cost.rest]\nhumeral_flexion = -1\n",),
            "rest.humeral_flexion",
            "greater than or equal to 0",
        ),
        ((ARM + "[optimised.posture_cost.rest]\nknee = 1\n",), "optimised.posture_cost", "joints among"),
        ((ROBOT.replace('model = "ur5"\n', ""),), "robot.model", "either model = 'ur5', or file"),
        error=ProblemFileError,
    )


@pytest.mark.parametrize("name", ["upper_limb/figure_eigth", "no/such.toml", "a\0b", "x" * 5000])
def test_unknown_problem_is_refused(name: str) -> None:
    with pytest.raises(ProblemFileError, match="not found"):
        load_problem(name)


def test_absent_recording_says_where_it_comes_from(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv(ENVIRONMENT, str(tmp_path))
    config = load_problem("upper_limb/pen_trace")
    assert recording_state("upper_limb/pen_trace")[1].startswith("absent")
    with pytest.raises(ProblemFileError, match="BDALab/handwriting-sample") as refusal:
        checked(config)
    assert refusal.value.key == "recording.file"
    assert ENVIRONMENT in refusal.value.expected


@pytest.mark.parametrize("reference", ["data:../../etc/passwd", "data:/etc/passwd", "data:x", "data:a/\\u0000"])
def test_reference_stays_within_the_data_folder(written: Write, reference: str) -> None:
    config = load_problem(str(written("problem.toml", ARM.replace("path.csv", reference))))
    with pytest.raises(ProblemFileError):
        checked(config)


def test_recording_lies_beside_its_problem_file(written: Write) -> None:
    path = written("problem.toml", ARM)
    with pytest.raises(ProblemFileError, match=f"beside the problem file, in {re.escape(str(path.parent))}"):
        checked(load_problem(str(path)))
    csv = written("path.csv", CSV)
    assert recording_path(load_problem(str(path)), "path.csv") == csv


def test_directory_is_no_recording(written: Write, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "a" / "b.csv").mkdir(parents=True)
    monkeypatch.setenv(ENVIRONMENT, str(tmp_path))
    for reference in (".", "a/b.csv", "data:a/b.csv"):
        config = load_problem(str(written("problem.toml", ARM.replace("path.csv", reference))))
        with pytest.raises(ProblemFileError) as refusal:
            checked(config)
        assert (refusal.value.key, refusal.value.expected) == ("recording.file", "a file, this is a directory")


def values() -> st.SearchStrategy[Any]:
    """Anything TOML can hold."""
    plain = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5)
    return st.recursive(plain, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner))


@given(
    section=st.sampled_from(["arm", "recording", "placement", "run", "optimised", "published", "smoothing"]),
    key=st.sampled_from(
        ["side", "range_of_motion", "segments", "file", "columns", "centre_m", "fit_m", "posture_cost"]
    ),
    value=values(),
)
def test_no_value_ends_in_anything_but_a_problem_or_a_refusal(section: str, key: str, value: Any) -> None:
    content = tomllib.loads(ARM)
    content.setdefault(section, {})[key] = value
    message = ""
    try:
        UpperLimb.model_validate(content)
    except ValidationError as problem:
        message = str(schema_error(problem, "file"))
    assert "\n" not in message
