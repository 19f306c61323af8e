"""Shipped problems give the numbers that they gave when `python -m tests.golden` last kept them."""

from __future__ import annotations

import copy
import json
import os

import pytest

from rehab_opt.session.files import recording_state, shipped_problems
from tests.golden import differences, golden_file, measured
from tests.session.conftest import REQUIRE

FAST = ("robot/ur5_circle",)
"""Others run in tests of their own, or take minutes."""


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[] if name in FAST else [pytest.mark.nightly]) for name in shipped_problems()]
)
def test_shipped_problem_gives_the_numbers_kept(name: str) -> None:
    _, state = recording_state(name)
    if state.startswith("absent"):
        (pytest.fail if os.environ.get(REQUIRE) == "1" else pytest.skip)(f"{name}: {state}")
    kept = json.loads(golden_file(name).read_text())
    changed = list(differences(kept, measured(name)))
    assert not changed, (
        f"{len(changed)} numbers differ; python -m tests.golden {name} keeps the new ones:\n" + "\n".join(changed[:40])
    )


def test_numbers_are_kept_for_every_shipped_problem_and_no_other() -> None:
    assert {golden_file(name).name for name in shipped_problems()} == {
        file.name for file in golden_file("x/y").parent.glob("*.json")
    }


def test_a_changed_number_a_missing_key_and_nan_are_seen() -> None:
    kept = json.loads(golden_file("robot/ur5_circle").read_text())
    header = next(iter(kept["trace"]))
    for change in (lambda new: new["trace"][header].__setitem__(3, float("nan")), lambda new: new["trace"].pop(header)):
        new = copy.deepcopy(kept)
        change(new)
        assert list(differences(kept, new))
    assert not list(differences({"a_m": 1.0, "tick_ms": 1.0}, {"a_m": 1.0005, "tick_ms": 9.0}))
    assert list(differences({"a_m": 1.0}, {"a_m": 1.002})) == ["a_m: 1.0 -> 1.002"]
