"""Runs that C has to repeat, and what is said of its controllers, are those kept."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest

from rehab_opt import Interaction, MirrorTracker, RedundancyResolver, ardis, human_arm
from rehab_opt.control.bilateral import Bilateral
from rehab_opt.export import random_runs
from rehab_opt.export.c_text import comment, indented, initialiser, layout, number
from rehab_opt.export.exported import ExportedController, ExportedVelocity
from rehab_opt.export.of_objects import exported_object
from rehab_opt.export.recording import MAX_TICKS, thinned
from tests.control.mirror_campaign import LARGEST
from tests.control.test_kept_functions import ARM, FAST, HAND, around, tracker
from tests.export.assisting import made, made_along_a_path
from tests.export.pairing import sides
from tests.golden import assert_kept
from tests.golden.functions import digest

LED = {"dt": 0.005}
MIRROR = {"dt": 0.01, "floor": 0.1, "max_manipulability": LARGEST, "compile": False, "person": human_arm()}
ROWS = [("x", "y"), ("z", "roll7", "rx")]
MADE: dict[str, Callable[[], Any]] = {
    "tracker": lambda: tracker(FAST, dt=0.01, limits=[around(HAND, 1)]),
    "led": lambda: tracker(ARM, **LED),
    "chair": lambda: RedundancyResolver(ardis(), row_sets=ROWS, compile=False, max_obstacles=2),
    "mirror": lambda: MirrorTracker(FAST, interaction=Interaction(slow_from=5.0), **MIRROR),  # type: ignore[arg-type]
    "assist": lambda: made("assist", compile=False),
    "path": made_along_a_path,
    "pair": lambda: Bilateral(*sides(), delay=0.002),
}


def told(exported: ExportedController) -> Iterator[Any]:
    """What is said, without what CasADi's code decides, and numbers of the run."""
    run = exported.recording
    yield run.csv().split("\n")[0], run.about, run.fields(), len(next(run.initialisers()).split(","))
    yield exported.limits(), exported.name, exported.title, exported.call, exported.differences, exported.solves
    yield {key: value for key, value in exported.shape().items() if key != "law_shapes" and len(value) < 200}
    yield [(each.name(), [each.numel_in(i) for i in range(each.n_in())]) for each in exported.generated]
    yield [law.row() for law in exported.laws] if isinstance(exported, ExportedVelocity) else []
    yield [[float(each or 0) for each in line.split(",")] for line in run.csv().splitlines()[1:]]


@pytest.mark.parametrize("name", MADE)
def test_runs_are_those_kept(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for constant, count in (("TICKS", 240), ("EACH", 30)):
        monkeypatch.setattr(random_runs, constant, count)
    found = exported_object(MADE[name](), run=None, memory=None, progress=lambda *_: None)
    assert_kept(f"export_{name}", digest(*(told(each) for each in found), width=120), absolute=1e-3)


def test_texts_are_those_kept() -> None:
    numbers = [number(each) for each in (1.0, 0.1, float("nan"), float("inf"), -float("inf"), 1e-300, 3)]
    texts = [initialiser([1.0, 2.5]), layout("at", {"a": slice(0, 2), "b": slice(2, 5)}), indented(["x", "y"])]
    counts = [*thinned(10), *thinned(MAX_TICKS + 1)[:5], len(thinned(3 * MAX_TICKS)), len(thinned(MAX_TICKS))]
    assert_kept("export_texts", [*numbers, *texts, comment("a */ b \n /* c \\"), *map(int, counts)])
