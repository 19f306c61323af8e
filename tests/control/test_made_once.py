"""Controllers of equal parts share their functions; a number that differs, or a user's code, makes others."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest

from rehab_opt import (
    Clearance,
    ConfigurationError,
    Limit,
    MirrorTracker,
    PoseTracker,
    RedundancyResolver,
    Relaxed,
    ardis,
    ur5,
)
from rehab_opt.control import velocity_controller
from rehab_opt.control.obstacles import HalfPlane
from rehab_opt.kinematics.chain import SerialChain
from tests.control.every_controller import POSE, READY, made

ARM, CHAIR = ur5(), ardis()
CAPSULE = ARM.capsules[2]


class CaughtError(Exception):
    """Instead of what would be made of a form."""


def form_of(make: Callable[..., Any], **options: Any) -> bytes:
    """Of the parts of a controller, of which nothing is made."""

    def caught(form: bytes, _: object) -> None:
        raise CaughtError(form)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(velocity_controller, "remembered", caught)
        with pytest.raises(CaughtError) as found:
            make(compile=False, **options)
    assert found.value.args[0] is not None
    return found.value.args[0]


def pose_tracker(chain: SerialChain = ARM, **options: Any) -> PoseTracker:
    return PoseTracker(chain, **options)


def mirror_tracker(chain: SerialChain = ARM, **options: Any) -> MirrorTracker:
    return MirrorTracker(chain, **{"floor": 0.1, "max_manipulability": 0.1} | options)


def chair(robot: Any = CHAIR, **options: Any) -> RedundancyResolver:
    return RedundancyResolver(robot, **{"row_sets": [("x", "y")]} | options)


def moved(chain: SerialChain) -> SerialChain:
    """One number of its links is another."""
    return replace(chain, rows=(chain.rows[0]._replace(d=chain.rows[0].d + 1e-9), *chain.rows[1:]))


COMMON: list[dict[str, Any]] = [
    {"dt": 0.00101}, {"recovery_speed": 0.11}, {"tolerance": 1e-7}, {"max_age": 0.5},
]  # fmt: skip
OF_AN_ARM: list[dict[str, Any]] = [
    *COMMON, {"gain": 50.1}, {"linear_speed": 0.9}, {"angular_speed": 3.0},
    {"chain": moved(ARM)}, {"chain": ur5(velocity=2.9)},
    {"chain": ur5(acceleration=29.9)}, {"chain": ur5(lower=-6.0)}, {"limits": [Clearance(margin=0.02, moving=1)]},
    {"limits": [Clearance(margin=0.021, moving=1)]},
    {"limits": [Clearance(margin=0.02, moving=1)], "chain": replace(ARM, capsules=(CAPSULE, *ARM.capsules[:2]))},
]  # fmt: skip
CASES: list[tuple[Callable[..., Any], list[dict[str, Any]]]] = [
    (
        pose_tracker,
        [
            *OF_AN_ARM, {"posture": READY}, {"task_weights": (1, 1, 1, 1, 1, 0)}, {"jerk": 500.0, "gain": 8.0},
            {"jerk": 501.0, "gain": 8.0},
        ],
    ),
    (mirror_tracker, [*OF_AN_ARM, {"floor": 0.11}, {"max_deviation": 0.04}]),
    (
        chair,
        [
            *COMMON, {"drive": "fixed"}, {"row_sets": [("x", "z")]}, {"self_motion": 1.1}, {"max_obstacles": 1},
            {"keep_out": False}, {"robot": ardis(velocity=CHAIR.chain.velocity * 0.99)},
        ],
    ),
]  # fmt: skip


@pytest.mark.parametrize(("make", "others"), CASES, ids=["pose", "mirror", "chair"])
def test_any_other_number_is_another_form_and_equal_ones_are_the_same(
    make: Callable[..., Any], others: list[dict[str, Any]]
) -> None:
    forms, again = ([form_of(make), *(form_of(make, **options) for options in others)] for _ in range(2))
    assert len(set(forms)) == len(forms)
    assert again == forms


SETTINGS = {
    "pose_tracker": ("chain", "dt", "gain", "linear_speed", "angular_speed", "limits", "recovery_speed"),
    "mirror_tracker": ("chain", "dt", "floor", "max_deviation", "linear_speed", "max_turn", "catch_up", "limits"),
    "redundancy": ("robot", "drive", "dt", "limits"),
    "assistance": ("comfortable", "mode", "force_limit", "slew_limit", "energy_budget", "dt"),
    "bounded_force": ("force_limit", "slew_limit", "growth_limit", "speed_cap", "energy_budget", "max_age"),
    "path_assistance": ("comfortable", "force_limit", "dt"),
}


@pytest.mark.parametrize("name", SETTINGS)
def test_a_setting_that_is_changed_afterwards_is_refused(name: str) -> None:
    """A hand whose `linear_speed` was set to 0.05 went on at 0.25."""
    control, _ = made(name)
    for each in SETTINGS[name]:
        before = getattr(control, each)
        with pytest.raises(
            ConfigurationError, match=f"^{each} = .*: expected no change once a {type(control).__name__}"
        ):
            setattr(control, each, before)
        assert getattr(control, each) is before
    control.reset()


def test_what_a_chain_has_worked_out_and_obstacles_that_may_be_set_are_no_parts() -> None:
    robot = ardis()
    before = form_of(chair, robot=robot, max_obstacles=1)
    RedundancyResolver(robot, compile=False, row_sets=[("x", "y")])
    assert form_of(chair, robot=robot, max_obstacles=1, obstacles=[HalfPlane((1.0, 0.0), 2.0)]) == before


def test_a_user_s_code_is_read_again_each_time() -> None:
    """A function that is defined anew has the name of the one before."""
    commands = []
    for least in (2.0, -2.0):

        def distances(chain: SerialChain, q: ca.SX) -> ca.SX:
            return chain.frames_expression(q)[3][2, 3] - least  # noqa: B023

        globals()["distances"] = distances
        distances.__qualname__ = "distances"
        control = PoseTracker(ARM, limits=[Limit(distances)], compile=False)
        commands.append(control.step(READY, POSE, np.zeros(6)))
    assert [bool(each.relaxed & Relaxed.POSITION) for each in commands] == [True, False]

    class Slower(PoseTracker):
        def excess(self, inputs: Any, jacobian: ca.SX, velocity: ca.SX) -> ca.SX:
            return 2 * super().excess(inputs, jacobian, velocity)

    functions = [Slower(ARM, compile=False).functions.tick for _ in range(2)]
    assert functions[0].__hash__() != functions[1].__hash__()


def test_four_of_equal_parts_in_four_threads_command_what_one_alone_commands() -> None:
    def commands(_: int) -> list[bytes]:
        control, q = PoseTracker(ARM, dt=0.002, compile=False), READY
        values = []
        for k in range(400):
            values.append(control.step(q, POSE, np.full(6, 0.3 * np.sin(0.05 * k))).value)
            q = q + 0.002 * values[-1]
        return [each.tobytes() for each in values]

    alone = commands(0)
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(commands, range(4))) == [alone] * 4


def test_a_class_that_is_changed_makes_other_functions(monkeypatch: pytest.MonkeyPatch) -> None:
    before = form_of(pose_tracker)
    with monkeypatch.context() as patched:
        patched.setattr(PoseTracker, "watched", False)
        assert form_of(pose_tracker) != before
    assert form_of(pose_tracker) == before
