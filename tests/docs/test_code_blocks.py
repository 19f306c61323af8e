"""Every code block of the README and of the pages runs as it stands there."""

from __future__ import annotations

import shutil
import tomllib
from pathlib import Path

import pytest

from rehab_opt.session.robot_file import RobotFile
from rehab_opt.session.systems import system_named
from tests.docs.pages import ROOT, Block, blocks, name, pages

WITH_PYTHON = [page for page in pages() if any(blocks(page, "python"))]
TOML = [block for page in pages() for block in blocks(page, "toml")]
OWN_ROBOT = ROOT / "problems" / "robots" / "kinova_gen3" / "gen3.urdf"
"""The reader's robot."""


@pytest.mark.parametrize("page", WITH_PYTHON, ids=name)
def test_the_python_of_a_page_runs_from_top_to_bottom(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copy(OWN_ROBOT, tmp_path)
    names: dict[str, object] = {"__name__": "__main__"}
    for block in blocks(page, "python"):
        code = compile(block.placed, name(page), "exec")
        if not block.hardware:
            exec(code, names)


@pytest.mark.parametrize("block", TOML, ids=lambda block: f"{name(block.page)}:{block.line}")
def test_a_problem_or_robot_file_of_a_page_says_what_may_be_said(block: Block) -> None:
    content = tomllib.loads(block.code)
    if "system" in content:
        system_named(content["system"]).schema.model_validate(content)
    elif content.keys() & {"urdf", "mjcf"}:
        RobotFile.model_validate(content)
    else:  # some tables of a file
        assert all(isinstance(value, dict | list) for value in content.values())


def test_each_of_the_promised_kinds_of_pages_has_code() -> None:
    there = {name(page) for page in WITH_PYTHON}
    assert "README.md" in there
    assert sum(page.startswith("docs/capabilities/") for page in there) >= 12
    assert sum(page.startswith("docs/howto/") for page in there) >= 6
