"""The reference of problem files is made of the schema: each key of each system, with a meaning."""

from __future__ import annotations

import importlib
import re
import sys
from collections.abc import Iterator

import pytest
from pydantic import BaseModel

from rehab_opt.session import keys
from rehab_opt.session.systems import SHIPPED, system_named
from tests.docs.pages import ROOT

sys.path.insert(0, str(ROOT / "docs" / "extensions"))
keys_markdown = importlib.import_module("from_package").keys_markdown
REFERENCE = (ROOT / "docs" / "reference" / "problem_files.md").read_text(encoding="utf-8")
SCHEMAS = {name: system_named(name).schema for name in SHIPPED}


def sections(schema: type[BaseModel]) -> Iterator[type[BaseModel]]:
    """The schema and every table in it."""
    yield schema
    for field in schema.model_fields.values():
        for section in keys.sections_within(field.annotation):
            yield from sections(section)


@pytest.mark.parametrize("system", SHIPPED)
def test_every_key_has_a_meaning_below_it(system: str) -> None:
    for section in dict.fromkeys(sections(SCHEMAS[system])):
        said = keys.attribute_docstrings(section)
        missing = [key for key in section.model_fields if not said.get(key)]
        assert not missing, f"{section.__module__}.{section.__name__}: a docstring below {', '.join(missing)}"
        assert section.__doc__


@pytest.mark.parametrize("system", SHIPPED)
def test_the_reference_names_every_system(system: str) -> None:
    schema = SCHEMAS[system]
    assert re.search(rf"^```\{{keys\}} {schema.__module__}\.{schema.__name__}$", REFERENCE, re.MULTILINE)
    assert f'system = "{system}"' in REFERENCE


def test_a_table_tells_type_bounds_default_and_meaning() -> None:
    text = keys_markdown("rehab_opt.session.ardis.problem.ArdisProblem", without=["plant"])
    text += keys_markdown("rehab_opt.session.robot_file.RobotFile", without=[])
    text += keys_markdown("rehab_opt.session.pose_tracking.PoseTracking", without=["plant"])
    assert "| `circle.radius_m` | number, > 0, ≤ 1 | required | Radius of the tool's path. |" in text
    assert "| `robot.start_deg` | list of 1 to 100: number, ≥ -360, ≤ 360 | required |" in text
    for key in ("goals[].hand_m", "stick.modes[].rows", "joints.NAME.locked_deg", "capsules[].radius_m"):
        assert f"| `{key}` |" in text
