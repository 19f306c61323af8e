"""Helper's and participant's side in C do what they do in Python, with every message that a network may hand over."""

from __future__ import annotations

import ctypes
import itertools
import math
import subprocess
from collections import deque
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.scenarios import changed
from rehab_opt.control.bilateral import Bilateral
from rehab_opt.control.bilateral_sides import FromHelper, FromParticipant, HelperSide, ParticipantSide
from rehab_opt.control.command import Status
from rehab_opt.export.export_c import written_files
from rehab_opt.export.exporters import exported_controllers
from tests.export.calling_c import Built, CCommand, CController, Exported, assert_same, shared
from tests.export.pairing import DT, EGG, HELPER, SIDES, broken, ready_for, sides, workspace_map


class CFromHelper(ctypes.Structure):
    """`rehab_from_helper`."""

    _fields_ = [*((name, ctypes.c_double) for name in ("x", "y", "energy")), ("serial", ctypes.c_longlong)]


class CFromParticipant(ctypes.Structure):
    """`rehab_from_participant`."""

    _fields_ = [
        *((name, ctypes.c_double) for name in ("x", "y", "force_x", "force_y", "energy")),
        ("serial", ctypes.c_longlong),
    ]


class CSide(CController):
    """One side in C, which hears and says messages."""

    def step(self, x: Any, received: Any, v: Any, *, enable: int = 1, stamp: float) -> tuple[CCommand, Any]:  # type: ignore[override]
        """Its force, and what it says."""
        hears, says = (CFromHelper, CFromParticipant)[:: -1 if self.name == "helper_side" else 1]
        out, said = CCommand(), says()
        message = None if received is None else ctypes.byref(hears(*received))
        self.call("step", x, message, v, enable, stamp, ctypes.byref(out), ctypes.byref(said))
        return out, said


def assert_said(said: Any, message: FromHelper | FromParticipant) -> None:
    """C says what Python does; nowhere where Python says nowhere."""
    numbers = [getattr(said, name) for name, _ in said._fields_]
    np.testing.assert_allclose(numbers, message, rtol=0, atol=1e-9, equal_nan=True)


@pytest.fixture(scope="module")
def libraries(exported: Exported, built: Built) -> dict[str, ctypes.CDLL]:
    return {name: shared(exported(name), name, built) for name in SIDES}


@pytest.fixture(scope="module")
def twins(libraries: dict[str, ctypes.CDLL]) -> dict[str, tuple[CSide, HelperSide | ParticipantSide]]:
    """Each side in C and in Python: both count their messages from 1, and on over a reset."""
    return {name: (CSide(libraries[name], name), side) for name, side in zip(SIDES, sides(), strict=True)}


HEARD = itertools.count(1)
"""Numbers of messages, each later than all before it."""


def test_the_sums_that_c_has_are_the_map_of_python() -> None:
    spline = workspace_map().spline
    points = HELPER + 0.08 * np.random.default_rng(0).normal(size=(500, 2))
    for point, image, slopes in zip(points, spline(points), spline.jacobian(points), strict=True):
        summed = [each.full().squeeze() for each in spline.statement(point)]
        np.testing.assert_allclose(summed[0], image, rtol=0, atol=1e-13)
        np.testing.assert_allclose(summed[1], slopes, rtol=0, atol=1e-11)


@pytest.mark.parametrize("name", SIDES)
@settings(max_examples=10)
@given(seed=st.integers(0, 2**32 - 1))
def test_any_hand_and_any_messages_give_the_forces_and_messages_of_python(
    twins: dict[str, tuple[CSide, Any]], name: str, seed: int
) -> None:
    """Hands inside and outside, sensors that fail; messages that are lost, doubled, late, broken."""
    rng, (c, side) = np.random.default_rng(seed), twins[name]
    assert c.call("reset") == 0
    side.reset()
    of_helper = name == "helper_side"
    x = (HELPER if of_helper else EGG.mean(axis=0)) + 0.05 * rng.normal(size=2)
    other = (EGG.mean(axis=0) if of_helper else HELPER) + 0.03 * rng.normal(size=2)
    way, stamp, box = rng.normal(size=2), 0.0, []
    with_v = rng.random() < 0.5
    for serial in itertools.islice(HEARD, 120):
        way = 0.97 * way + 0.2 * rng.normal(size=2)
        x = x + DT * 0.3 * way
        other = other + 3e-4 * rng.normal(size=2)
        energy = float(rng.choice([0.0, 1e-3, 0.1]))
        sent = (
            FromParticipant(*other, *(5.0 * way), energy, serial) if of_helper else FromHelper(*other, energy, serial)
        )
        box.append(broken(sent, rng) if rng.random() < 0.03 else sent)
        received = None if rng.random() < 0.03 else box[-1 if rng.random() < 0.9 else rng.integers(len(box))]
        seen = x.copy()
        if rng.random() < 0.02:
            seen[rng.integers(2)] = rng.choice([np.nan, np.inf, 1e4, 0.3])
        stamp += DT if rng.random() < 0.95 else rng.choice([0.01, 0.0, -DT, 0.2, -0.2])
        told = {"enable": int(rng.random() < 0.97), "stamp": float(stamp)}
        v = DT * 300 * way if with_v else None
        (answer, said), (command, message) = c.step(seen, received, v, **told), side.step(seen, received, v, **told)
        assert_same(answer, command)
        assert_said(said, message)
        assert c.told("energy_left") == pytest.approx(side.force.energy_left, abs=1e-9)
        if rng.random() < 0.01:
            assert c.call("reset") == 0
            side.reset()


def test_two_sides_in_c_do_what_the_pair_does_in_python(libraries: dict[str, ctypes.CDLL]) -> None:
    """Hands that go with every force, until the tanks run low: whatever one side says is heard by the other."""
    delay = 20
    both = Bilateral(*sides(), delay=delay * DT)
    one, two = (CSide(libraries[name], name) for name in SIDES)
    there, back = (deque([None] * (delay + 1)) for _ in range(2))
    helper, participant = HELPER.copy(), workspace_map().image(HELPER)
    forces = []
    for k in range(1500):
        felt, drawn = both.step(helper, participant)
        # Bilateral gives no stamps; stamps of sound ticks change nothing.
        (of_helper, said), (of_participant, answer) = (
            one.step(helper, back.popleft(), None, stamp=DT * k),
            two.step(participant, there.popleft(), None, stamp=DT * k),
        )
        there.append([getattr(said, name) for name, _ in said._fields_])
        back.append([getattr(answer, name) for name, _ in answer._fields_])
        assert_same(of_helper, felt)
        assert_same(of_participant, drawn)
        forces.append([*felt.value, *drawn.value])
        angle = 2 * math.pi * k * DT
        helper = HELPER + [0.04 * math.sin(angle), 0.03 * math.sin(2 * angle)] + 1e-3 * felt.value / 50.0
        participant = participant + DT * drawn.value / 60.0  # viscous: 60 N s/m
    assert np.abs(forces).max(axis=0).min() > 1.0


@pytest.mark.nightly
@pytest.mark.parametrize("laws", [["together", "delayed"], ["assisted", "together"]])
def test_a_scenario_of_two_becomes_two_controllers(
    laws: list[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path, built: Built
) -> None:
    """And one more where the file asks for assistance too. The map of the file takes seconds: that of these tests
    stands for it."""
    task = {"movement_s": 3.0, "rest_s": 0.5}
    config = changed("scenario_together", run={"rate_hz": 200.0, "laws": laws}, task=task)
    monkeypatch.setattr("rehab_opt.export.controllers.scenario.precompute", lambda *_, **__: ready_for(config))
    *alone, helper, participant = exported_controllers(config, progress=lambda *_: None)
    assert (helper.name, participant.name) == SIDES
    assert [each.name for each in alone] == (["path_assistance"] if "assisted" in laws else [])
    late = 1 + (20 if "delayed" in laws else 0)  # ticks that a message is under way
    ticks = participant.recording.ticks
    assert [tick["with_received"] for tick in ticks[: late + 2]] == [0] * late + [1, 1]
    np.testing.assert_array_equal([tick["serial"] for tick in ticks[late : late + 9]], np.arange(1, 10))
    for side in (helper, participant):
        commands = side.recording.commands
        assert np.mean([command.status is Status.OK for command in commands]) > 0.5
        assert max(math.hypot(*command.value) for command in commands) > 1.0
    if "delayed" in laws:
        written_files({tmp_path / each.name: each for each in (helper, participant)}, tmp_path, problem="p")
        for name in SIDES:
            program = built(tmp_path / name, "example", f"rehab_{name}.c", "main.c", flags=("-O0",))
            replay = subprocess.run([program, "0"], capture_output=True, text=True, check=False)
            assert replay.returncode == 0, replay.stdout
