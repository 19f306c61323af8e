"""Assistance in C applies the forces that it applies in Python, and accounts for the same energy."""

from __future__ import annotations

import ctypes
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.scenarios import changed
from rehab_opt import Assistance, ConfigurationError, Workspace
from rehab_opt.control.command import Status
from rehab_opt.errors import ProblemFileError
from rehab_opt.export.controllers.assistance import exported_assistance
from rehab_opt.export.export_c import export_c
from tests.export.assisting import DT, exported_to, made
from tests.export.calling_c import Built, CCommand, Exported, assert_same, doubles, giving_up, shared, solver_gives_up

MODES = ("assist", "follow")


class CAssistance:
    """The C controller, called from Python."""

    def __init__(self, library: ctypes.CDLL, *, initialise: bool = True) -> None:
        library.rehab_assistance_energy_left.restype = ctypes.c_double
        self.library, self.memory = library, ctypes.create_string_buffer(library.controller_size())
        if initialise:
            assert library.rehab_assistance_init(self.memory) == 0

    @property
    def energy_left(self) -> float:
        return float(self.library.rehab_assistance_energy_left(self.memory))

    def reset(self, *, energy: bool) -> None:
        assert self.library.rehab_assistance_reset(self.memory, int(energy)) == 0

    def step(self, x: Any, v: Any, *, enable: int = 1, stamp: float) -> CCommand:
        out = CCommand()
        self.library.rehab_assistance_step(
            self.memory, doubles(x), doubles(v), enable, ctypes.c_double(stamp), ctypes.byref(out)
        )
        return out


@pytest.fixture(scope="module", params=MODES)
def mode(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="module")
def library(mode: str, exported: Exported, built: Built, tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    folder = exported("assistance") if mode == "assist" else exported_to(tmp_path_factory.mktemp("as") / "c", mode)
    return shared(folder, "assistance", built)


@pytest.fixture(scope="module")
def helper(mode: str) -> Assistance:
    return made(mode)


@settings(max_examples=60)
@given(seed=st.integers(0, 2**32 - 1))
def test_any_motion_of_a_hand_gives_the_forces_of_python(library: ctypes.CDLL, helper: Assistance, seed: int) -> None:
    """Hands that wander and rest, sensors that freeze, jump and fail, a switch that opens, stamps that are late."""
    rng, c = np.random.default_rng(seed), CAssistance(library)
    helper.reset()
    x, way, stamp = np.array([rng.uniform(-0.2, 0.15), rng.uniform(0.33, 0.47)]), rng.normal(size=2), 0.0
    with_v = rng.random() < 0.5
    for _ in range(120):
        way = 0.97 * way + 0.2 * rng.normal(size=2)
        moved = x + DT * 0.3 * way if rng.random() < 0.9 else x
        v = (moved - x) / DT if with_v else None
        x = moved if rng.random() < 0.99 else moved + 0.05 * rng.normal(size=2)
        seen = x.copy()
        if rng.random() < 0.02:
            seen[rng.integers(2)] = rng.choice([np.nan, np.inf, 1e4])
        if v is not None and rng.random() < 0.02:
            v[rng.integers(2)] = rng.choice([np.nan, -np.inf, 3.0])
        stamp += DT if rng.random() < 0.95 else rng.choice([0.01, 0.0, -DT, 0.2, -0.2])
        told = {"enable": int(rng.random() < 0.97), "stamp": float(stamp)}
        assert_same(c.step(seen, v, **told), helper.step(seen, v, **told))
        assert c.energy_left == pytest.approx(helper.energy_left, abs=1e-9)
        if rng.random() < 0.02:
            energy = bool(rng.random() < 0.5)
            c.reset(energy=energy)
            helper.reset(energy=energy)


def test_the_energy_runs_out_as_it_does_in_python(library: ctypes.CDLL, helper: Assistance, mode: str) -> None:
    """A hand that lets itself be led, out and back by hand, until nothing is left to lead it with."""
    c, statuses = CAssistance(library), set()
    helper.reset()
    for k in range(8000):
        phase = (0.0005 * k) % 2.0
        x = np.array([0.02 + 0.1 * min(phase, 2.0 - phase), 0.45 if phase < 1.0 else 0.36])
        x = x if mode == "assist" else x - [0.15, 0.03]
        command = helper.step(x, stamp=DT * k)
        assert_same(c.step(x, None, stamp=DT * k), command)
        statuses.add(command.status)
    assert statuses > {Status.OK}


def test_a_solver_that_writes_nothing_releases(exported: Exported, built: Built) -> None:
    """What it answered before is not taken for an answer."""
    library = giving_up(exported("assistance"), "assistance", built, "assistance_tick")
    c, helper, x = CAssistance(library), made("assist"), np.array([0.02, 0.45])
    for k in range(60):
        assert_same(c.step(x, None, stamp=DT * k), helper.step(x, stamp=DT * k))
    library.give_up(1)
    with solver_gives_up(helper._ladder, helper):
        for k in range(60, 200):
            answer = c.step(x, None, stamp=DT * k)
            assert_same(answer, helper.step(x, stamp=DT * k))
            assert answer.why == "NOT_CERTIFIED"
    assert answer.status == 5


def test_a_hand_that_is_not_there_and_a_controller_that_was_not_made_apply_nothing(library: ctypes.CDLL) -> None:
    answer = CAssistance(library).step(None, None, stamp=0.0)
    assert (answer.why, answer.status, list(answer.value)) == ("POSITION_UNUSABLE", 5, [0.0] * 8)
    answer = CAssistance(library, initialise=False).step([0.1, 0.4], None, stamp=0.0)
    assert (answer.why, answer.status, list(answer.value)) == ("NOT_INITIALISED", 5, [0.0] * 8)


def test_what_c_cannot_do_is_refused() -> None:
    hand = np.zeros((10, 2))
    with pytest.raises(ConfigurationError, match="backup='qrqp'"):
        exported_assistance(made("assist", backup=None), hand, title="t")
    pointed = Workspace(shapely.Polygon([(0, 0), (1, 0), (1, 1), (0, 1e-3)]), accuracy=0.0)
    sharp = Workspace(shapely.Polygon([(0, 0), (1, 0), (0, 1e-3)]), accuracy=0.0)
    exported_assistance(made("assist", pointed), hand, title="t")
    with pytest.raises(ConfigurationError, match="no spikes"):
        exported_assistance(made("assist", sharp), hand, title="t")


def test_a_scenario_s_assistance_repeats_its_trial_in_c(tmp_path: Path, built: Built) -> None:
    loaded = changed("scenario_3_resist", run={"rate_hz": 200.0})
    export_c(loaded, tmp_path)
    example = built(tmp_path, "example", "rehab_assistance.c", "main.c", "-lm")
    replay = subprocess.run([example], capture_output=True, text=True, check=False)
    assert replay.returncode == 0, replay.stdout + replay.stderr
    difference = float(replay.stdout.split("largest difference from Python ")[1].split()[0])
    assert difference <= 1e-9


def test_a_scenario_whose_field_moves_is_refused_by_its_mode() -> None:
    with pytest.raises(ProblemFileError, match="mode"):
        export_c(changed("scenario_5_hold"), Path("nowhere"))
