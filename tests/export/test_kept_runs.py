"""Runs that C has to repeat, and what is said of its controllers, are those kept."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest

from rehab_opt import Interaction, JointFeedback, KeepOut, MirrorTracker, PoseTracker, RedundancyResolver, ardis, human_arm, ur5
from rehab_opt.control.bilateral import Bilateral
from rehab_opt.control.obstacles import Disc, HalfPlane
from rehab_opt.export import random_runs
from rehab_opt.export.c_text import comment, indented, initialiser, layout, number
from rehab_opt.export.exported import ExportedController, ExportedVelocity
from rehab_opt.export.of_objects import exported_object
from rehab_opt.export.recording import MAX_TICKS, thinned
from tests.control.test_kept_functions import HAND, around
from tests.control.mirror_campaign import LARGEST
from tests.export.assisting import made, made_along_a_path
from tests.export.pairing import sides
from tests.golden import assert_kept
from tests.golden.functions import digest

FAST = ur5(acceleration=np.full(6, 10.0))
MADE: dict[str, Callable[[], Any]] = {
    "tracker": lambda: PoseTracker(FAST, dt=0.01, limits=[around(HAND, 1)], compile=False),
    "led": lambda: PoseTracker(ur5(), feedback=JointFeedback(), dt=0.005, compile=False),
    "chair": lambda: RedundancyResolver(ardis(), obstacles=[HalfPlane((1.0, 0.0), 1.0), Disc((0.0, 1.0), 0.2)], row_sets=[("x", "y"), ("z", "roll7", "rx")], compile=False),
    "mirror": lambda: MirrorTracker(FAST, dt=0.01, floor=0.1, max_manipulability=LARGEST, compile=False, interaction=Interaction(slow_from=5.0), keep_out=[KeepOut.through([0, 0, -0.1], [0, 0, 1])], person=human_arm()),
    "assist": lambda: made("assist", compile=False),
    "path": lambda: made_along_a_path(),
    "pair": lambda: Bilateral(*sides(), delay=0.002),
}  # fmt: skip


def told(exported: ExportedController) -> Any:
    """Numbers of the run, tick by tick in groups, and all that is said without what CasADi's code decides."""
    run = exported.recording
    rows = [[float(each) if each.strip() else 0.0 for each in line.split(",")] for line in run.csv().splitlines()[1:]]
    words = {key: value if len(value) < 200 else len(value.split(",")) for key, value in exported.shape().items() if key != "law_shapes"}
    found = {"run": digest(*rows, width=3 * len(rows[0])), "head": run.csv().split("\n")[0], "about": run.about,
             "fields": run.fields(), "first": len(next(run.initialisers()).split(",")), "limits": exported.limits(),
             "shape": words, "names": sorted(each.name() for each in exported.generated),
             "sizes": [[each.numel_in(i) for i in range(each.n_in())] for each in exported.generated],
             "said": [exported.name, exported.title, exported.call, *exported.differences, exported.solves]}  # fmt: skip
    if isinstance(exported, ExportedVelocity):
        found["rows"] = [law.row() for law in exported.laws]
    return found


@pytest.mark.parametrize("name", MADE)
def test_runs_are_those_kept(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(random_runs, "TICKS", 240)
    monkeypatch.setattr(random_runs, "EACH", 30)
    found: Sequence[ExportedController] = exported_object(MADE[name](), run=None, memory=None, progress=lambda *_: None)
    assert_kept(f"export_{name}", [told(each) for each in found], absolute=1e-3)


def test_texts_are_those_kept() -> None:
    numbers = [number(each) for each in (1.0, 0.1, float("nan"), float("inf"), -float("inf"), 1e-300, 3)]
    texts = [initialiser([1.0, 2.5]), layout("at", {"a": slice(0, 2), "b": slice(2, 5)}), comment("a */ b \n /* c \\"), indented(["x", "y"])]
    counts = [*thinned(10), *thinned(MAX_TICKS + 1)[:5], len(thinned(3 * MAX_TICKS)), len(thinned(MAX_TICKS))]
    assert_kept("export_texts", [*numbers, *texts, *map(int, counts)])
