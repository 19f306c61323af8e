"""What is masked, a time, a boolean, text or ragged is no number: a controller says so and acts on nothing hidden."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest
import shapely

from rehab_opt import (
    Demonstration,
    PathAssistance,
    PoseTracker,
    PotentialField,
    Status,
    ThinPlateSpline,
    Workspace,
    measures,
    range_of_motion,
    smooth_path,
    ur5,
)
from rehab_opt.control.conditioning import conditioned
from rehab_opt.control.obstacles import Disc, HalfPlane, obstacle_numbers
from rehab_opt.control.watchdog import Watchdog
from rehab_opt.kinematics.chain import per_joint
from rehab_opt.kinematics.real_array import real_array
from rehab_opt.kinematics.rigid import rigid
from tests.control.every_controller import CASES, COMMANDING, as_new, smoother
from tests.refusals import refuses

INPUTS = [(name, k) for name in COMMANDING for k in range(len(CASES[name].inputs)) if (name, k) != ("bilateral", 1)]


def masked(array: np.ndarray) -> np.ndarray:
    """The same numbers, the last of them hidden."""
    hidden = np.ma.array(array, mask=False)
    hidden[(-1,) * array.ndim] = np.ma.masked
    assert hidden.data.ravel()[-1] == array.ravel()[-1]
    return hidden


def stepped(name: str, place: int, value: Any, **more: Any) -> tuple[Any, Any]:
    """The command at one input, and that at NaN in place of its last number, each of a controller as new."""
    inputs = CASES[name].inputs
    with_nan = inputs[place].copy()
    with_nan.ravel()[-1] = math.nan
    commands = []
    for each in (value, with_nan):
        controller, tick = as_new(name)
        for _ in range(3):
            tick()
        commands.append(CASES[name].step(controller, *inputs[:place], each, *inputs[place + 1 :], **more))
    return commands[0], commands[1]


def assert_same_command(one: Any, other: Any) -> None:
    np.testing.assert_array_equal(one.value, other.value)
    assert one._replace(value=None, wheels=None) == other._replace(value=None, wheels=None)


@pytest.mark.parametrize(("name", "place"), INPUTS)
def test_what_is_masked_counts_as_nan_and_what_is_no_number_is_refused(name: str, place: int) -> None:
    inputs = CASES[name].inputs
    for given in (masked(inputs[place]), list(masked(inputs[place]))):
        command, of_nan = stepped(name, place, given)
        assert not command.status.certified
        assert command.reason
        assert_same_command(command, of_nan)
    controller, tick = as_new(name)
    tick()
    before, after = inputs[:place], inputs[place + 1 :]
    for kind in ("m8[ns]", "U", "complex", "?"):
        whole = inputs[place].astype(np.int64) if kind.endswith("[ns]") else inputs[place]
        if name == "smoother":
            assert CASES[name].step(controller, whole.astype(kind)).reason == "target is not 3 finite numbers"
        else:
            refuses(partial(CASES[name].step, controller), ((*before, whole.astype(kind), *after), "real numbers"))
    if name != "bilateral":  # whose `step` takes no stamp
        for stamp in (np.timedelta64(1, "ns"), "1.0", True):
            assert tick(stamp=stamp).reason == "stamp is not a number of seconds"


class TestSmoother:
    @pytest.mark.parametrize(
        "target",
        [
            [np.array([0.1, 0.2]), 0.3, 0.4],
            [0.1, None, 0.2],
            {"x": 0.1},
        ],
        ids=["array", "none", "mapping"],
    )
    def test_a_ragged_target_is_a_reason_not_an_error(self, target: Any) -> None:
        axes = smoother()
        assert axes.step([0.1, 0.2, 0.3]).status is Status.OK
        for _ in range(3):
            assert axes.step(target).reason == "target is not 3 finite numbers"
        for _ in range(3):
            assert axes.step([0.1, 0.2, 0.3], target).reason == "target velocity is not 3 finite numbers"
        assert axes.step([0.1, 0.2, 0.3]).status is Status.OK

    def test_an_array_within_a_list_may_be_overwritten(self) -> None:
        """It was compared by identity: the axes went on to where it had been."""
        axes, twin = smoother(), smoother()
        moving = [np.array(0.1), np.array(0.0), np.array(0.0)]
        axes.step(moving)
        twin.step([0.1, 0.0, 0.0])
        moving[0][...] = -0.1
        for _ in range(500):
            command, expected = axes.step(moving), twin.step([-0.1, 0.0, 0.0])
        np.testing.assert_array_equal(command.value, expected.value)
        assert command.value[0] < 0


def test_a_masked_axis_of_the_stick_asks_for_nothing() -> None:
    stick, tick = as_new("joystick")
    stick.step(np.zeros(2))
    assert tick().twist.any()
    command = stick.step(masked(np.array([0.5, 0.5])))
    assert command.reason == "axes are not finite"
    assert not command.twist.any()


def test_a_masked_sample_is_dropped() -> None:
    follower, _ = as_new("conditioner")
    place, turn = CASES["conditioner"].inputs
    for k in range(3):
        assert follower.push(0.01 * k, masked(place), turn).dropped == k + 1
    assert follower.push(np.timedelta64(1, "ns"), place, turn).dropped == 4
    times = 0.01 * np.arange(10)
    hidden = np.ma.array(np.zeros((10, 3)), mask=False)
    hidden[9, 0] = np.ma.masked
    assert conditioned(times, hidden, np.tile(turn, (10, 1)), dt=0.01).dropped == 1


ROW = np.linspace(0.0, 0.3, 12)
LINE = np.column_stack([ROW, 0.5 * ROW])
FIELD = PotentialField(LINE, stiffness=300.0, width=0.05, compile=False)
AREA = Workspace(shapely.box(-1.0, -1.0, 1.0, 1.0), accuracy=0.0)
BOUNDS = {"velocity": 1.0, "acceleration": 5.0, "jerk": 50.0}
TAKEN: dict[str, tuple[str, Any, Callable[[Any], Any]]] = {
    "help along a path": (
        "path", LINE, lambda a: PathAssistance(a, stiffness=300.0, width=0.003, comfortable=AREA, compile=False)
    ),
    "field": ("path", LINE, lambda a: PotentialField(a, stiffness=300.0, width=0.05, compile=False)),
    "one of a field's paths": (
        "path", LINE, lambda a: PotentialField([LINE, a], stiffness=300.0, width=0.05, compile=False)
    ),
    "stiffness of a field": (
        "stiffness", 300 + LINE, lambda a: PotentialField(LINE, stiffness=a, width=0.05, compile=False)
    ),
    "damping of a field": (
        "damping", np.ones(2), lambda a: PotentialField(LINE, stiffness=3.0, damping=a, width=0.05, compile=False)
    ),
    "positions shown": ("positions", LINE, lambda a: Demonstration(a, LINE, dt=0.1)),
    "forces shown": ("forces", LINE, lambda a: Demonstration(LINE, a, dt=0.1)),
    "velocities shown": ("velocities", LINE, lambda a: Demonstration(LINE, LINE, a)),
    "times shown": ("times", ROW, lambda a: Demonstration(LINE, LINE, times=a)),
    "path of a drive": ("points", LINE, lambda a: smooth_path(ROW, a, **BOUNDS)),
    "length of a path": ("points", LINE, measures.path_length),
    "end of a movement": ("target", LINE[0], lambda a: measures.end_error(LINE, a)),
    "scored points": ("points", LINE, lambda a: measures.score(ROW, a)),
    "scored times": ("time", ROW, lambda a: measures.score(a, LINE)),
    "scored joints": ("joints", ROW, lambda a: measures.score(ROW, LINE, joints={"elbow": a})),
    "landmarks": ("source", LINE**2, lambda a: ThinPlateSpline(a, LINE**2)),
}  # fmt: skip


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        (np.ma.array([1.0, 2.0], mask=[0, 1]), [1.0, math.nan]),
        (np.ma.array([1, 2], mask=[0, 1]), [1.0, math.nan]),
        ([np.ma.masked, 1.0], [math.nan, 1.0]),
        ([[1.0, np.ma.masked], [1.0, 2.0]], [[1.0, math.nan], [1.0, 2.0]]),
        ((np.ma.array([1.0, 2.0], mask=[1, 0]), [3, 4]), [[math.nan, 2.0], [3.0, 4.0]]),
        (np.float32(0.5), 0.5),
        ([2**70, 1], [2.0**70, 1.0]),
    ],
)
def test_numbers_are_read_as_they_are_meant(given: Any, expected: Any) -> None:
    found = real_array(given)
    assert found.dtype == np.float64
    assert not isinstance(found, np.ma.MaskedArray)
    np.testing.assert_array_equal(found, expected)


def test_what_no_float_holds_is_infinite_and_what_is_too_small_nothing_whatever_numpy_is_told_to_raise() -> None:
    with np.errstate(all="raise"):
        found = real_array([np.longdouble("1e4000"), np.longdouble("-1e4000"), np.longdouble("1e-4000")])
    np.testing.assert_array_equal(found, [math.inf, -math.inf, 0.0])


def test_what_is_no_number_is_no_argument() -> None:
    for argument, usual, take in TAKEN.values():
        for wrong in (masked(usual), usual + 1e-3j, usual.astype(str)):
            refuses(take, ((wrong,), argument, ": expected "))
    assert math.isnan(FIELD.energy(masked(LINE[3])))
    assert np.isnan(FIELD.energy(masked(LINE))[-1])
    for ask in (FIELD.energy, FIELD.force, FIELD.stiffness, lambda x: FIELD.force(LINE[3], x)):
        refuses(ask, ((LINE[3] + 1j,), ": expected ", "metres"))
    refuses(range_of_motion, (({"elbow": ROW + 1j},), "angles", ": expected numbers"))
    tracker = partial(PoseTracker, ur5(), compile=False)
    refuses(tracker, ({"gain": True}, "gain"), ({"dt": np.True_}, "dt"), ({"linear_speed": True}, "linear_speed"))
    refuses(Watchdog, ({"dt": True, "max_age": 3.0}, "True"), ({"dt": 0.01, "max_age": True}, "True"))
    posts = Disc((True, False), 0.1), Disc((1.0, 0.0), True), HalfPlane((1.0, np.False_), 1.0)
    refuses(obstacle_numbers, *((([post], 1), "obstacles[0]") for post in posts))
    refuses(ur5().with_limits, ({"velocity": np.ma.array(np.ones(6), mask=[0, 0, 1, 0, 0, 0])}, "velocity"))
    refuses(per_joint, (("lower", ["1.0", "2.0"], 2), "lower"))
    refuses(rigid, (("tool", np.ma.array(np.eye(4), mask=np.eye(4))), "tool"))
    none: list[Any] = [
        "1", ["1", "2"], None, [None, 1.0], 1j, np.timedelta64(1), [2**70, np.timedelta64(1)], [[1.0], [1.0, 2.0]], {},
        True, np.True_, [True, False], [0.5, True], ([1.0, 2.0], [np.True_, 0.0]), [2**70, True],
    ]  # fmt: skip
    for given in none:
        with pytest.raises((TypeError, ValueError)):
            real_array(given)
