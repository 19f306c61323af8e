"""Assistance in C applies the forces that it applies in Python, and accounts for the same energy."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from rehab_opt import Assistance, ConfigurationError, PotentialField, Workspace
from rehab_opt.control.command import Status
from rehab_opt.control.path_assistance import PathAssistance
from rehab_opt.export.controllers.assistance import exported_assistance
from rehab_opt.export.export_c import export_c
from tests.export.assisting import DT, EIGHT, exported_to, field_of, made, made_along_a_path
from tests.export.calling_c import Built, CController, Exported, assert_same, shared

MODES = ("assist", pytest.param("follow", marks=pytest.mark.nightly))


@pytest.fixture(scope="module", params=MODES)
def mode(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="module")
def library(mode: str, exported: Exported, built: Built, tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    folder = exported("assistance") if mode == "assist" else exported_to(tmp_path_factory.mktemp("as") / "c", mode)
    return shared(folder, "assistance", built)


@pytest.fixture(scope="module")
def made_once(mode: str) -> Assistance:
    return made(mode)


@pytest.fixture
def helper(made_once: Assistance, mode: str) -> Assistance:
    """Made once, new in every test: at rest, with its own field where it was made."""
    return begun(made_once, mode)


def begun(helper: Assistance, mode: str) -> Assistance:
    helper.reset()
    helper.set_field(field_of(mode))
    return helper


@pytest.fixture(scope="module")
def along(exported: Exported, built: Built) -> ctypes.CDLL:
    return shared(exported("path_assistance"), "path_assistance", built)


@pytest.fixture(scope="module")
def path_helper() -> PathAssistance:
    return made_along_a_path()


def wandering(rng: np.random.Generator, x: Any, ticks: int) -> Iterator[tuple[Any, Any, dict[str, Any]]]:
    """Hands that wander and rest, sensors that freeze, jump and fail, a switch that opens, stamps that are late."""
    way, stamp, with_v = rng.normal(size=2), 0.0, rng.random() < 0.5
    for _ in range(ticks):
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
        yield seen, v, {"enable": int(rng.random() < 0.97), "stamp": float(stamp)}


@settings(max_examples=20)
@given(seed=st.integers(0, 2**32 - 1))
def test_any_motion_of_a_hand_gives_the_forces_of_python(
    library: ctypes.CDLL, made_once: Assistance, mode: str, seed: int
) -> None:
    """With fields that change and are carried, to where is no number too."""
    rng, c, fields = (
        np.random.default_rng(seed),
        CController(library, "assistance"),
        (field_of(mode), field_of(mode, 1)),
    )
    helper = begun(made_once, mode)
    start = np.array([rng.uniform(-0.2, 0.15), rng.uniform(0.33, 0.47)])
    for x, v, told in wandering(rng, start, 120):
        if rng.random() < 0.05:
            field = int(rng.integers(2))
            assert c.call("set_field", field) == 0
            helper.set_field(fields[field])
        if rng.random() < 0.3:
            by = (0.02 * rng.normal(size=2)).tolist()
            if rng.random() < 0.1:
                by[rng.integers(2)] = float(rng.choice([np.nan, np.inf, -1e300]))
            assert c.call("shift", *by) == 0
            helper.shift(*by)
        assert_same(c.step(x, v, **told), helper.step(x, v, **told))
        assert c.told("energy_left") == pytest.approx(helper.energy_left, abs=1e-9)
        if rng.random() < 0.02:
            energy = bool(rng.random() < 0.5)
            assert c.call("reset", int(energy)) == 0
            helper.reset(energy=energy)


@settings(max_examples=12)
@given(seed=st.integers(0, 2**32 - 1))
def test_along_a_path_the_progress_and_the_forces_are_those_of_python(
    along: ctypes.CDLL, path_helper: PathAssistance, seed: int
) -> None:
    """A hand that hurries along a path that crosses itself, or turns round, or strays."""
    rng, c, helper = np.random.default_rng(seed), CController(along, "path_assistance"), path_helper
    helper.reset()
    way = int(rng.choice([1, 1, -1]))
    for k, (strayed, v, told) in enumerate(wandering(rng, np.zeros(2), 300)):
        x = strayed + EIGHT[way * k * 2 // 5 % len(EIGHT)]
        assert_same(c.step(x, v, **told), helper.step(x, v, **told))
        assert c.told("progress") == helper.progress
        assert c.told("energy_left") == pytest.approx(helper.energy_left, abs=1e-9)
        if rng.random() < 0.01:
            energy = bool(rng.random() < 0.5)
            assert c.call("reset", int(energy)) == 0
            helper.reset(energy=energy)


def test_the_end_of_a_path_is_reached_and_a_hand_that_stands_is_let_go(
    along: ctypes.CDLL, path_helper: PathAssistance
) -> None:
    c, helper, seen = CController(along, "path_assistance"), path_helper, set()
    helper.reset()
    half = len(EIGHT) // 3
    aside = np.linspace(0.0, 0.012, 200)[:, None] * [-0.5, 0.9]
    stands = EIGHT[half] + np.vstack((aside, np.repeat(aside[-1:], 1500, axis=0), aside[::-1]))
    stands += 1e-6 * np.random.default_rng(0).standard_normal(stands.shape)  # a sensor that is not frozen
    on = [np.repeat(each, 4, axis=0) for each in (EIGHT[:half], EIGHT[half:])]
    for k, x in enumerate(np.vstack((on[0], stands, on[1]))):
        command = helper.step(x, stamp=DT * k)
        assert_same(c.step(x, None, stamp=DT * k), command)
        assert c.told("progress") == helper.progress
        seen.add((command.status, command.reason[:23]))
    assert helper.progress == 1.0
    assert (Status.BLOCKED, "the hand stood under fo") in seen


@pytest.mark.nightly
def test_a_force_without_a_certificate_releases(built: Built, tmp_path: Path) -> None:
    """What it answered before is not taken for an answer."""
    helper, released, last = made("assist", tolerance=1e-300, slew_limit=100.0, energy_budget=20.0), 0, 0.0
    export_c(helper, tmp_path)
    c = CController(shared(tmp_path, "assistance", built), "assistance")
    for k in range(300):
        x = np.array([0.02 + 0.01 * math.sin(0.02 * k), 0.45 + 0.01 * math.cos(0.03 * k)])
        answer = c.step(x, None, stamp=DT * k)
        size = math.hypot(*answer.value[:2])
        if answer.why == "NOT_CERTIFIED":
            assert size == pytest.approx(max(last - 100.0 * DT, 0.0), abs=1e-9)
            released += 1
        last = size
    assert released > 20


def test_nothing_in_the_c_of_a_force_can_give_up(exported: Exported) -> None:
    source = (exported("assistance") / "rehab_assistance.c").read_text()
    assert "casadi_qp" not in source
    assert "casadi_qrqp" not in source


def test_what_c_cannot_do_is_refused() -> None:
    hand = np.zeros((10, 2))
    with pytest.raises(ConfigurationError, match="solver = 'proxqp': expected qrqp"):
        exported_assistance(made("assist", solver="proxqp"), hand, title="t")
    resisting = PotentialField(EIGHT[:50], stiffness=1000.0, width=0.02, drag=50.0, drag_along="travelled")
    with pytest.raises(ConfigurationError, match="mode"):
        exported_assistance(made("assist"), hand, title="t", fields=[resisting])


def test_a_workspace_with_a_spike_becomes_c() -> None:
    sharp = Workspace(shapely.Polygon([(0, 0), (1, 0), (0, 1e-3)]), accuracy=0.0)
    assert exported_assistance(made("assist", sharp), np.zeros((10, 2)), title="t").desired.function.n_in() == 6


def test_a_field_that_is_not_there_is_not_aimed_at(library: ctypes.CDLL, helper: Assistance, mode: str) -> None:
    c, x = CController(library, "assistance"), np.array([0.02, 0.45]) if mode == "assist" else np.array([-0.08, 0.43])
    helper.shift(0.01, 0.0)
    assert [c.call("shift", 0.01, 0.0), c.call("set_field", 2), c.call("set_field", -1)] == [0, 1, 1]
    for k in range(60):
        assert_same(c.step(x, None, stamp=DT * k), helper.step(x, stamp=DT * k))
