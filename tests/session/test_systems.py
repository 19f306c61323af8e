"""One place knows the systems; what reads, runs, reports and lists them knows none by name."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from rehab_opt.cli import main
from rehab_opt.errors import ConfigurationError
from rehab_opt.session.files import load_problem, shipped_problems
from rehab_opt.session.inputs import inputs_digest
from rehab_opt.session.many.participants import participants_of
from rehab_opt.session.many.run import run_many
from rehab_opt.session.run import run_problem
from rehab_opt.session.systems import SHIPPED, system_named, systems
from tests.refusals import refuses


def test_every_system_has_a_shipped_problem() -> None:
    assert {load_problem(name).problem.system for name in shipped_problems()} == set(SHIPPED)


def test_registry_loads_nothing_that_is_not_asked_for() -> None:
    late = ("matplotlib", "rich", "casadi.tools", "shapely", "rehab_opt.session.upper_limb", "casadi", "scipy")
    program = f"import sys, rehab_opt.session.systems; print([name for name in {late} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


KIND = """
from rehab_opt.session.schema import Problem
from rehab_opt.session.systems import System
from rehab_opt.session.trace import Trace


class CountProblem(Problem):
    count: int = 3


class Counting:
    def __init__(self, problem, options):
        self.problem, self.options = problem, options

    def run(self, progress):
        numbers = [float(n) for n in range(self.problem.count)]
        return Trace({"t_s": numbers, "count_m": numbers, "word": ["n"] * len(numbers)})

    def numbers(self, trace):
        return {"last_m": float(trace["count_m"][-1]), "options": dict(self.options)}

    def notes(self, trace):
        return ()


class CountSystem(System[CountProblem, Counting]):
    schema = CountProblem
    options = frozenset({"speed"})

    def check(self, config):
        return (f"counts to {config.problem.count}",)

    def scenes(self, config, options):
        return {(): Counting(config.problem, options)}
"""
"""A kind of problem in one module of another distribution."""
ENTRY = "[rehab_opt.systems]\n{name} = {value}\n"


def installed(folder: Path, name: str, *, value: str) -> None:
    """A distribution with one entry point, as pip leaves it."""
    metadata = folder / f"{name}_problems-1.0.dist-info"
    metadata.mkdir(parents=True)
    (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}_problems\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text(ENTRY.format(name=name, value=value))


@pytest.fixture
def count(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A folder with a problem of a kind that an installed distribution brings, and nothing in this package names."""
    site = tmp_path / "site"
    installed(site, "count", value="counting_problems:CountSystem")
    (site / "counting_problems.py").write_text(KIND, encoding="utf-8")
    monkeypatch.syspath_prepend(site)
    monkeypatch.delitem(sys.modules, "counting_problems", raising=False)
    work = tmp_path / "work"
    work.mkdir()
    (work / "count.toml").write_text('system = "count"\ntitle = "to three"\n', encoding="utf-8")
    monkeypatch.chdir(work)
    return work


def test_a_kind_from_outside_is_run_checked_and_reported(count: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for command in ("check", "run"):
        with pytest.raises(SystemExit) as end:
            main([command, "count.toml"])
        assert not end.value.code
    printed = capsys.readouterr().out
    assert "counts to 3" in printed
    assert "last, mm" in printed  # its numbers, though it draws no table of its own
    written = {path.name for path in (count / "out/count").iterdir()}
    assert written == {"metrics.json", "trace.csv", "trace.png", "trace.pdf", "captions.md"}
    assert (count / "out/count/trace.csv").read_text(encoding="utf-8") == "t_s,count_m,word\n0,0,n\n1,1,n\n2,2,n\n"
    assert json.loads((count / "out/count/metrics.json").read_text(encoding="utf-8"))["title"] == "to three"


def test_a_kind_from_outside_runs_for_many_people(count: Path) -> None:
    folder = count / "people"
    folder.mkdir()
    for number in (2, 5):
        (folder / f"p{number}.toml").write_text(f'system = "count"\ntitle = "p"\ncount = {number}\n', encoding="utf-8")
    rows = run_many(participants_of(folder, problem=None), out=count / "out", workers=1, executor=None)
    assert [row.error for row in rows] == ["", ""]


def test_a_changed_kind_is_computed_again(count: Path) -> None:
    before = inputs_digest(load_problem("count.toml"))
    assert inputs_digest(load_problem("count.toml")) == before
    source = count.parent / "site" / "counting_problems.py"
    source.write_text(source.read_text(encoding="utf-8") + "# another version\n", encoding="utf-8")
    assert inputs_digest(load_problem("count.toml")) != before


def test_options_reach_the_system_that_knows_them_and_no_other(count: Path) -> None:
    config = load_problem("count.toml")
    assert run_problem(config, speed="high", law=None).metrics["options"] == {"speed": "high"}
    with pytest.raises(ConfigurationError, match="--law = 'both': expected another option"):
        run_problem(config, law="both")


def test_an_entry_point_that_leads_nowhere_is_named_and_none_replaces_a_shipped_kind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    leads = {"gone": "not_there_at_all:System", "empty": "json:nothing", "other": "json:dumps"}
    for name, value in {**leads, "ardis": "json:dumps"}.items():
        installed(tmp_path, name, value=value)
    monkeypatch.syspath_prepend(tmp_path)
    refuses(
        system_named,
        (("gone",), "not_there_at_all"),
        (("empty",), "nothing"),
        (("other",), "derived from System"),
    )
    assert systems()["ardis"] == SHIPPED["ardis"]
