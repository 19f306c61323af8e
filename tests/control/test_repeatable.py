"""After a reset the same inputs give the same commands, to the last bit, whichever solver answers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from rehab_opt.kinematics.ardis import ARDIS_READY
from tests.control.every_controller import CASES, HAND, READY, made

TO_ROUNDING = 1e-8
"""proxqp's answers depend on where its memory lies; each is certified to this."""


def tracking(tracker: Any, rng: np.random.Generator) -> list[Any]:
    q, pose, commands = READY.copy(), tracker.chain.pose(READY), []
    for k in range(80):
        twist = rng.normal(size=6) * (2.0 if 30 < k < 50 else 0.3)
        pose = pose.copy()
        pose[:3, 3] += tracker.dt * twist[:3]
        commands.append(tracker.step(q, pose, twist))
        q = q + tracker.dt * commands[-1].value
    return commands


def driving(resolver: Any, rng: np.random.Generator) -> list[Any]:
    q, commands = ARDIS_READY.copy(), []
    for k in range(60):
        rows = ("x", "y") if 20 < k < 40 else ("x", "y", "z")
        commands.append(resolver.step(q, rng.normal(size=len(rows)) * 0.1, rows))
        q = q + resolver.dt * commands[-1].value
    return commands


def assisting(helper: Any, rng: np.random.Generator) -> list[Any]:
    x, commands = HAND.copy(), []
    for k in range(80):
        x = x + rng.normal(0.0, 2e-4, 2)
        commands.append(helper.step(x * np.nan if k == 40 else x, np.zeros(2)))
    return commands


RUNS: dict[str, tuple[Callable[[Any, np.random.Generator], list[Any]], dict[str, Any]]] = {
    "pose_tracker": (tracking, {"acceleration": 5.0}),
    "mirror_tracker": (tracking, {}),
    "redundancy": (driving, {}),
    "assistance": (assisting, {}),
}


@pytest.mark.parametrize(
    ("name", "solver"),
    [*((name, "qrqp") for name in RUNS), ("pose_tracker", "osqp"), ("redundancy", "daqp"), ("assistance", "proxqp")],
)
def test_after_a_reset_the_same_inputs_give_the_same_commands(name: str, solver: str) -> None:
    run, options = RUNS[name]
    controller, _ = made(name, solver=solver, **options)
    first = run(controller, np.random.default_rng(1))
    assert solver in {command.solver for command in first} or solver == "qrqp"
    run(controller, np.random.default_rng(2))
    CASES[name].reset(controller)
    again = run(controller, np.random.default_rng(1))
    slack = TO_ROUNDING if solver == "proxqp" else 0.0
    np.testing.assert_allclose([c.value for c in again], [c.value for c in first], rtol=0, atol=slack)
    if not slack:
        assert [c[1:-1] for c in again] == [c[1:-1] for c in first]  # the rest, but for wheels


@pytest.mark.parametrize("name", [name for name in CASES if name not in RUNS])
def test_after_a_reset_the_usual_tick_is_the_first_one_again(name: str) -> None:
    controller, tick = made(name)
    first = [tick() for _ in range(5)]
    CASES[name].reset(controller)
    for one, other in zip(first, [tick() for _ in range(5)], strict=True):
        for a, b in zip(one, other, strict=True):
            np.testing.assert_array_equal(a, b)
