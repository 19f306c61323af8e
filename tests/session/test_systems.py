"""One place knows the systems; what reads, runs, reports and lists them knows none by name."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, get_args

import pytest
from matplotlib.figure import Figure
from rich.table import Table

import rehab_opt.session
from rehab_opt.cli import main
from rehab_opt.errors import ConfigurationError
from rehab_opt.session import files, systems
from rehab_opt.session.files import ProblemFile, load_problem, shipped_problems
from rehab_opt.session.outcome import Outcome, Progress
from rehab_opt.session.run import run_problem
from rehab_opt.session.schema import Problem
from rehab_opt.session.systems import SYSTEMS, Column, Needed, system_named

SHARED = ("files", "run", "report", "cells", "outcome", "many/run", "many/work", "many/digest", "many/pools")


@pytest.mark.parametrize("name", SYSTEMS)
def test_system_reads_files_that_call_it_by_its_name(name: str) -> None:
    assert get_args(system_named(name).schema.model_fields["system"].annotation) == (name,)


def test_every_system_has_a_shipped_problem() -> None:
    assert {load_problem(name).problem.system for name in shipped_problems()} == set(SYSTEMS)


def test_unknown_system_is_refused_with_those_there_are() -> None:
    with pytest.raises(ConfigurationError, match="system = 'leg': expected one of upper_limb, pose_tracking"):
        system_named("leg")


@pytest.mark.parametrize("module", [*SHARED, "../cli"])
def test_shared_modules_import_no_system(module: str) -> None:
    text = (Path(rehab_opt.session.__file__).parent / f"{module}.py").read_text(encoding="utf-8")
    packages = ("upper_limb", "pose_tracking", "workspaces", "workspace_maps", "used_ranges")
    assert [package for package in packages if f"rehab_opt.session.{package}" in text] == []


def test_registry_loads_nothing_that_is_not_asked_for() -> None:
    late = ("matplotlib", "rich", "casadi.tools", "shapely", "rehab_opt.session.upper_limb")
    program = f"import sys, rehab_opt.session.systems; print([name for name in {late} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


class CountProblem(Problem):
    """A system that no other test knows."""

    count: int = 3


class CountSystem:
    schema = CountProblem
    options = frozenset({"speed"})

    def recordings(self, problem: CountProblem) -> tuple[Needed, ...]:
        return ()

    def check(self, loaded: ProblemFile[CountProblem]) -> tuple[str, ...]:
        return (f"counts to {loaded.problem.count}",)

    def run(self, loaded: ProblemFile[CountProblem], *, options: Mapping[str, str], progress: Progress) -> Outcome:
        return Outcome("count", loaded.name, loaded.problem.title, (), {"options": dict(options)})

    def table(self, outcome: Outcome) -> Table:
        return Table("counted")

    def trace(self, outcome: Outcome) -> Iterator[Column]:
        yield "n", [1, 2, 3]

    def figures(self, outcome: Outcome) -> dict[str, Figure]:
        return {"dots": Figure()}


@pytest.fixture
def count(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A folder with a problem of another system, which is known by an entry of its own and nothing else."""
    added: Mapping[str, Any] = MappingProxyType({**SYSTEMS, "count": CountSystem})
    monkeypatch.setattr(systems, "SYSTEMS", added)
    monkeypatch.setattr(files, "SYSTEMS", added)
    (tmp_path / "count.toml").write_text('system = "count"\ntitle = "to three"\n', encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_new_system_is_run_checked_and_reported_by_its_entry_alone(
    count: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for command in ("check", "run"):
        with pytest.raises(SystemExit) as end:
            main([command, "count.toml"])
        assert not end.value.code
    printed = capsys.readouterr().out
    assert "counts to 3" in printed
    assert "counted" in printed
    assert {path.name for path in (count / "out/count").iterdir()} == {"metrics.json", "trace.csv", "dots.png"}
    assert (count / "out/count/trace.csv").read_text(encoding="utf-8") == "n\n1\n2\n3\n"
    assert json.loads((count / "out/count/metrics.json").read_text(encoding="utf-8"))["title"] == "to three"


def test_options_reach_the_system_that_knows_them_and_no_other(count: Path) -> None:
    loaded = load_problem("count.toml")
    assert run_problem(loaded, speed="high", law=None).metrics == {"options": {"speed": "high"}}
    with pytest.raises(ConfigurationError, match="--law = 'both': expected no such option"):
        run_problem(loaded, law="both")
