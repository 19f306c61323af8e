"""Every code block of the README and of the pages runs as it stands there."""

from __future__ import annotations

import shlex
import shutil
import tomllib
from collections.abc import Iterator
from itertools import groupby
from pathlib import Path
from typing import Any

import pytest
import typer

from rehab_opt.cli import app
from rehab_opt.session.files import shipped_problems
from rehab_opt.session.robot_file import RobotFile
from rehab_opt.session.systems import system_named
from tests.docs.pages import ROOT, Block, blocks, name, pages

WITH_PYTHON = [page for page in pages() if any(blocks(page, "python"))]
SHELL = [block for page in pages() for language in ("sh", "bash") for block in blocks(page, language)]
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


def commands(block: Block) -> Iterator[list[str]]:
    """The arguments of each `rehab-opt` of a block."""
    for line in block.code.replace("\\\n", " ").splitlines():
        words = shlex.split(line, comments=True)
        for is_and, part in groupby(words, key="&&".__eq__):
            program, *arguments = part
            if not is_and and Path(program).name == "rehab-opt":
                yield arguments


def parsed(command: Any, arguments: list[str], above: Any = None) -> dict[str, object]:
    """What the last command of a command line is given; typer has a click of its own, or not: no type is asked."""
    context = command.make_context(command.name, arguments, parent=above)
    if not hasattr(command, "resolve_command"):
        given: dict[str, object] = context.params
        return given
    _, inner, rest = command.resolve_command(context, [*context._protected_args, *context.args])
    return parsed(inner, rest, context)


@pytest.mark.parametrize("block", SHELL, ids=lambda block: f"{name(block.page)}:{block.line}")
def test_the_commands_of_a_page_are_ones_that_there_are(block: Block) -> None:
    """Parsed to the last option, not run: `live` waits for somebody, and a bench takes minutes."""
    kinds = {problem.partition("/")[0] for problem in shipped_problems()}
    for arguments in commands(block):
        for value in parsed(typer.main.get_command(app), arguments).values():
            if isinstance(value, str) and value.count("/") == 1 and value.partition("/")[0] in kinds:
                assert value in shipped_problems(), f"no such problem: {value}"


def test_a_command_that_is_none_would_be_seen() -> None:
    page = ROOT / "README.md"
    test = test_the_commands_of_a_page_are_ones_that_there_are
    test(Block(page, 1, "sh", hardware=False, code="true && .venv/bin/rehab-opt run robot/ur5_circle --plant mujoco"))
    for wrong in ("runs x", "run robot/ur5_circle --plan mujoco", "run robot/ur6_circle", "study shows x"):
        with pytest.raises(Exception, match=r"[Nn]o such (command|option|problem)"):
            test(Block(page, 1, "sh", hardware=False, code=f"rehab-opt {wrong}"))
