"""What faults are planted, and that a planted one is seen."""

from __future__ import annotations

import ast
import itertools
import random
import shutil
from pathlib import Path

import pytest

from tests.judge.fault_operators import COMPARISON, CONSTANT, DROPPED, SIGN, SWAPPED, faults
from tests.judge.fault_trial import Hearing, copied, heard
from tests.judge.faults import FOLDERS, drawn, reasons
from tests.judge.numbering import seed_of_the_code
from tests.judge.verdict import ROOT


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
    for path in itertools.chain(*((ROOT / folder).glob("*.py") for folder in FOLDERS)):
        source = path.read_bytes()
        found, sound = faults(path.name, source), ast.dump(ast.parse(source))
        for each in rng.sample(found, min(4, len(found))):  # of thousands, others each time
            assert ast.dump(ast.parse(each.planted(source))) != sound, each


def test_one_seed_draws_the_same_faults_again_and_none_twice() -> None:
    first, again = (list(itertools.islice(drawn(5), 80)) for _ in range(2))
    assert first == again
    assert len({each[:2] + each[5:] for each in first}) == len(first)


def test_a_line_more_changes_no_other_draw(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = {each.key for each in itertools.islice(drawn(7), 400)}
    for folder in FOLDERS:
        shutil.copytree(ROOT / folder, tmp_path / folder)
    changed = tmp_path / FOLDERS[0] / "joystick.py"
    changed.write_bytes(b"AN_INCH = 0.0254\n" + changed.read_bytes())
    monkeypatch.setattr("tests.judge.faults.ROOT", tmp_path)
    assert len(before - {each.key for each in itertools.islice(drawn(7), 401)}) <= 1


def test_what_is_called_equivalent_is_still_there() -> None:
    known = {each.key for folder in FOLDERS for path in (ROOT / folder).glob("*.py")
             for each in faults(str(path.relative_to(ROOT)), path.read_bytes())}  # fmt: skip
    assert set(reasons()) <= known


def test_planted_fault_breaks_a_claim_that_holds_without_it() -> None:
    hearing = Hearing("joystick_stick", 2000, 20)
    with copied() as root:
        path = root / "rehab_opt/control/joystick.py"
        (outcome,) = heard(root, [hearing], seconds=300.0)
        assert not outcome.claims
        source = path.read_bytes()
        fault = next(each for each in faults(path.name, source) if "last - way" in each.after)
        path.write_bytes(fault.planted(source))
        (outcome,) = heard(root, [hearing], seconds=300.0)
    assert "deflection away from a model of its own" in outcome.claims
