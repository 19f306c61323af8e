"""Controllers in C that were not made, or are given what is not there: they do nothing, and say why."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from rehab_opt import ur5
from rehab_opt.export.exported import MAX_VALUES
from rehab_opt.kinematics.ardis import ARDIS_READY
from tests.export.calling_c import Built, CController, Exported, shared
from tests.export.mirroring import CMirror
from tests.export.pairing import HELPER
from tests.export.test_bilateral_sides import CSide

Q, READY, TWIST, STICK = np.array([0.0, -1.2, 1.5, -1.8, -1.57, 0.0]), np.array(ARDIS_READY), np.zeros(6), np.zeros(2)
POSE = ur5().pose(Q)
BAD = np.where(np.arange(16).reshape(4, 4) == 6, np.nan, POSE)
OF_A_TRACKER: list[tuple[tuple[Any, ...], tuple[int, int]]] = [
    ((None, POSE, TWIST), (0, 0)), ((Q, None, TWIST), (1, 0)), ((Q, BAD, TWIST), (1, 6)), ((Q, POSE, None), (2, 0)),
]  # fmt: skip
HOLES: dict[str, list[tuple[tuple[Any, ...], tuple[int, int]]]] = {
    "pose_tracker": OF_A_TRACKER,
    "mirror_tracker": [*(((*inputs, None), where) for inputs, where in OF_A_TRACKER),
                       ((Q, POSE, TWIST, [0.0, np.inf, np.nan]), (3, 1))],
    "redundancy_differential": [((None, STICK, 0, 0), (0, 0)), ((READY, None, 0, 0), (1, 0)),
                                ((READY, [0.0, np.inf], 0, 0), (1, 1))],
}  # fmt: skip
"""Inputs of a step; which input, and which of its numbers, is not there."""


@pytest.mark.parametrize(
    "name", ["pose_tracker", "redundancy_differential", pytest.param("mirror_tracker", marks=pytest.mark.nightly)]
)
def test_what_is_not_there_is_named_and_a_controller_that_was_not_made_holds(
    name: str, exported: Exported, built: Built
) -> None:
    library = shared(exported(name), name, built)
    for inputs, where in HOLES[name]:
        answer = CController(library, name).step(*inputs, stamp=0.0)
        assert (answer.why, answer.input, answer.element) == ("INPUT_INVALID", *where)
        assert list(answer.value) == [0.0] * MAX_VALUES
    unmade = CController(library, name, initialise=False)
    whole = [*HOLES[name][0][0]]
    whole[0] = READY if name == "redundancy_differential" else Q
    answer = unmade.step(*whole, stamp=0.0)
    assert (answer.why, answer.status, list(answer.value)) == ("NOT_INITIALISED", 3, [0.0] * MAX_VALUES)
    if name == "redundancy_differential":
        return
    assert unmade.call("reset", np.zeros(6)) == 1
    for bad in (100.0, np.nan):
        assert CController(library, name).call("reset", np.full(6, bad)) == 1


def test_a_hand_that_is_not_there_and_a_force_that_was_not_made_is_none(exported: Exported, built: Built) -> None:
    library, name = shared(exported("assistance"), "assistance", built), "assistance"
    for controller, x, why in (
        (CController(library, name), None, "POSITION_INVALID"),
        (CController(library, name, initialise=False), [0.1, 0.4], "NOT_INITIALISED"),
    ):
        answer = controller.step(x, None, stamp=0.0)
        assert (answer.why, answer.status, list(answer.value)) == (why, 5, [0.0] * MAX_VALUES)


def test_a_side_that_was_not_made_says_nothing(exported: Exported, built: Built) -> None:
    for name in ("helper_side", "participant_side"):
        side = CSide(shared(exported(name), name, built), name, initialise=False)
        answer, said = side.step(HELPER, None, None, stamp=0.0)
        assert (answer.why, list(answer.value)) == ("NOT_INITIALISED", [0.0] * MAX_VALUES)
        assert math.isnan(said.x)
        assert (said.energy, said.serial) == (0.0, 0)


@pytest.mark.nightly
def test_a_mirror_that_was_not_made_follows_nothing(exported: Exported, built: Built) -> None:
    mirror = CMirror(shared(exported("mirror_tracker"), "mirror_tracker", built), "mirror_tracker", initialise=False)
    mirror.memory.raw = b"\x5a" * len(mirror.memory)  # what a stack may hold: counts that lead anywhere
    told = mirror.following()
    assert np.isnan([*told.reference, told.manipulability]).all()
    assert (told.lag, told.time_scale, told.braked) == (0.0, 0.0, 0)
