"""What faults are planted, and that tests are heard about a planted one."""

from __future__ import annotations

import ast
import json
import random
from pathlib import Path

import pytest

from tests.judge.numbering import seed_of_the_code
from tests.mutation import __main__ as mutation
from tests.mutation import nearest
from tests.mutation.operators import COMPARISON, CONSTANT, DROPPED, SIGN, SWAPPED, Fault, faults

MODULE = """
def total(a, b):
    return a + b


def unseen(a, b):
    return a - b


def countdown(n):
    while n > 0:
        n -= 1
    return n
"""
TESTS = """
from rehab_opt.sums.adding import countdown, total

def test_sum_is_that_of_arithmetic():
    assert total(2, 3) == 5

def test_countdown_ends_at_zero():
    assert countdown(3) == 0
"""
BROKEN = """
def test_that_also_fails_without_a_fault():
    assert False
"""


def found(text: str, operator: str) -> list[str]:
    return [each.after for each in faults("module.py", f"{text}\n".encode()) if each.operator == operator]


@pytest.mark.parametrize(
    ("text", "operator", "faulty"),
    [
        ("x = a + b", SIGN, ["x = a - b"]),
        ("x = -a", SIGN, ["x = a"]),
        ("x -= a", SIGN, ["x += a"]),
        ("x = a < b", COMPARISON, ["x = a <= b", "x = a > b"]),
        ("x = ca.fmin(a, b)", COMPARISON, ["x = ca.fmax(a, b)"]),
        ("RATE = 20.0", CONSTANT, ["RATE = (20.0 * 1.01)"]),
        ("x = ca.vertcat(a, b)", DROPPED, ["x = ca.vertcat(b)", "x = ca.vertcat(a)"]),
        ("x = ca.vertcat(a, b)", SWAPPED, ["x = ca.vertcat(b, a)"]),
        ("a, b = x[:2], x[2:]", SWAPPED, ["b, a = x[:2], x[2:]"]),
        ("x = step(q, v)", SWAPPED, ["x = step(v, q)"]),
    ],
)
def test_operator_changes_what_it_says(text: str, operator: str, faulty: list[str]) -> None:
    assert found(text, operator) == faulty


@pytest.mark.parametrize(
    "text",
    ['"""a + b"""', "def f(x: a < b) -> None: ...", "if a < b:\n    raise ValueError", "x = 'a' + b", "x = [a] + [b]",
     "x = 1.0", "a, b = [], []", "x = f'{a + b}'", "x = ca.fmin(a, a)[-1]", "x = checked_number('x', x, above=3.0)"],
)  # fmt: skip
def test_what_reaches_no_tick_is_left_alone(text: str) -> None:
    assert not [each for each in faults("module.py", f"{text}\n".encode()) if each.operator != COMPARISON]
    assert not found(text, COMPARISON) or "fmin" in text


def test_every_fault_of_the_package_is_python_and_changes_it() -> None:
    rng = random.Random(seed_of_the_code())
    for path in rng.sample(sorted((nearest.ROOT / "rehab_opt").rglob("*.py")), 15):  # others each time
        source = path.read_bytes()
        planted, without = faults(path.name, source), ast.dump(ast.parse(source))
        for each in rng.sample(planted, min(4, len(planted))):
            assert ast.dump(ast.parse(each.planted(source))) != without, each


@pytest.fixture
def tree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A library of one module, and its tests."""
    root = tmp_path / "tree"
    for name, text in {
        "rehab_opt/__init__.py": "", "rehab_opt/sums/__init__.py": "", "rehab_opt/sums/adding.py": MODULE,
        "tests/__init__.py": "", "tests/sums/test_adding.py": TESTS, "tests/sums/test_other.py": BROKEN,
        "tests/others/test_none.py": "assert False",
    }.items():  # fmt: skip
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text)
    for module in (mutation, nearest):
        monkeypatch.setattr(module, "ROOT", root)
    nearest.graph.cache_clear()
    yield root
    nearest.graph.cache_clear()


def fault_of(after: str) -> Fault:
    return next(each for each in mutation.drawn(5) if each.after == after)


def test_a_line_more_changes_no_other_draw(tree: Path) -> None:
    before, path = [each.key for each in mutation.drawn(7)], tree / "rehab_opt/sums/adding.py"
    assert before != [each.key for each in mutation.drawn(8)]
    path.write_text("AN_INCH = 0.0254\n" + MODULE)
    assert before == [each.key for each in mutation.drawn(7) if "AN_INCH" not in each.before]


def test_a_campaign_finds_what_a_test_of_the_folder_sees_and_goes_on_where_it_stopped(
    tree: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mutation, "COPIED", ("rehab_opt", "tests"))
    monkeypatch.setattr(mutation, "HANGING", 2)
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")
    seen, unseen, endless = (fault_of(after) for after in ("return a - b", "return a + b", "n += 1"))
    record = tree / "record.jsonl"
    first = mutation.campaign([seen], record, 60.0, 1, again=False)
    told = mutation.campaign([seen, unseen, endless], record, 60.0, 1, again=False)
    assert {seen: told[seen]} == first
    assert told[seen].test == "tests/sums/test_adding.py::test_sum_is_that_of_arithmetic"
    assert told[unseen][:3] == (False, "", "2 files pass")  # of which one fails without a fault, too
    assert told[endless].test == "tests/sums/test_adding.py::test_countdown_ends_at_zero"
    lines = [json.loads(line) for line in record.read_text().splitlines()]
    assert [each["place"] for each in lines if "place" in each].count("rehab_opt/sums/adding.py:7") == 2  # asked twice
    assert sum(len(each.get("pass_without_fault", ())) for each in lines) == 2
    table = "\n".join(mutation.table(told, {}))
    assert "2 of 3 found" in table
    assert "| rehab_opt/sums/adding.py:7 | sign | `return a - b` | `return a + b` | 2 files pass |" in table


def test_tests_of_a_folder_run_nearest_first(tree: Path) -> None:
    (tree / "tests/sums/test_middle.py").write_text("from tests.sums.test_adding import total\n")
    files = [Path(each).stem for each in nearest.test_files(tree, "rehab_opt/sums/adding.py")]
    assert files == ["test_adding", "test_middle", "test_other"]  # the last is the shortest


def test_what_is_called_equivalent_is_still_there() -> None:
    files = {key[0] for key in mutation.reasons()}
    known = {each.key for file in files for each in faults(file, (nearest.ROOT / file).read_bytes())}
    assert {*mutation.reasons()} <= known
