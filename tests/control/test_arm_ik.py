"""Inverse kinematics: the hand in place, the handle upright, no joint outside its limits, whatever is asked."""

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from rehab_opt import SerialChain, human_arm
from rehab_opt.control import ik_search
from rehab_opt.control.arm_ik import ArmIK, IKSolution
from rehab_opt.control.command import Status
from rehab_opt.kinematics.human_arm import ARM_JOINTS
from rehab_opt.optim.nlp import NLP
from tests.refusals import refuses

Array = NDArray[np.float64]
TILT = math.radians(2.0)
HOSTILE = [0.0, -0.2, 0.4, math.nan, math.inf, -math.inf, 1e300, -1e300, 5e-324]


def forward(arm: SerialChain) -> Callable[[Array], tuple[Array, Array]]:
    """Hand and handle axis, whose kinematics tests/kinematics judges."""
    return lambda q: (arm.pose(q)[:3, 3], arm.pose(q)[:3, 0])


def reachable(arm: SerialChain, count: int, *, tilt: float | None = TILT, seed: int = 0) -> tuple[Array, Array]:
    """Hands (count, 3) and postures (count, n) of random postures within the limits and the tilt."""
    x = ca.SX.sym("q", arm.n)
    pose = arm.pose_expression(x)
    at = ca.Function("at", [x], [pose[:3, 3], pose[2, 0]])
    rng = np.random.default_rng(seed)
    hands, postures = np.zeros((0, 3)), np.zeros((0, arm.n))
    while len(hands) < count:
        q = arm.lower + (arm.upper - arm.lower) * rng.random((5000, arm.n))
        hand, upright = at(q.T)
        good = upright.full()[0] > (-2 if tilt is None else math.cos(tilt))
        hands, postures = np.vstack([hands, hand.full().T[good]]), np.vstack([postures, q[good]])
    return hands[:count], postures[:count]


def assert_safe(arm: SerialChain, answer: IKSolution, tilt: float | None, target: Array | None = None) -> None:
    """What must hold of every answer."""
    assert answer.q.shape == (arm.n,)
    assert np.all(np.isfinite(answer.q))
    assert np.all(answer.q >= arm.lower)
    assert np.all(answer.q <= arm.upper)
    hand, axis = forward(arm)(answer.q)
    assert answer.handle_tilt == pytest.approx(math.atan2(math.hypot(axis[0], axis[1]), axis[2]), abs=1e-9)
    if target is not None and np.all(np.isfinite(target)):
        assert answer.position_error == pytest.approx(math.dist(hand, target), abs=1e-9, rel=1e-9)
    if answer.status.certified:
        assert answer.position_error <= 1e-6
        assert tilt is None or answer.handle_tilt <= tilt + 2e-9
        assert answer.status is Status.BACKUP or 0 <= answer.residual <= 1e-9
    assert (answer.status is Status.OK) == (answer.reason == "")


@pytest.fixture(scope="module", params=["regular", "restricted"])
def arm(request: pytest.FixtureRequest) -> SerialChain:
    return human_arm(range_of_motion=request.param)


@pytest.fixture(scope="module")
def ik(arm: SerialChain) -> ArmIK:
    return ArmIK(arm)


def give_up(monkeypatch: pytest.MonkeyPatch, *which: tuple[str, str]) -> None:
    """Let solvers that are made from now on end before their first step, by the names of their problem and solver."""
    made = ik_search.nlp_solver

    def ended(nlp: NLP, name: str, **options: Any) -> Any:
        solver = made(nlp, name, **options)
        if (nlp.name, name) in which:
            solver.max_iterations = 0
        return solver

    monkeypatch.setattr(ik_search, "nlp_solver", ended)


class TestLadder:
    @pytest.mark.parametrize("backup", ["ipopt"])
    def test_the_backup_answers_where_the_primary_cannot(
        self, arm: SerialChain, backup: str, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        give_up(monkeypatch, ("ik_posture", "sqp"))
        ik = ArmIK(arm, backup=backup, compile=False)
        for target in reachable(arm, 4)[0]:
            answer = ik.solve(target)
            assert answer.status is Status.BACKUP
            assert_safe(arm, answer, TILT, target)

    def test_with_no_solver_for_the_cost_the_hand_is_still_in_place(
        self, arm: SerialChain, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        give_up(monkeypatch, ("ik_posture", "sqp"))
        ik = ArmIK(arm, backup="sqp", compile=False)
        target = reachable(arm, 1)[0][0]
        answer = ik.solve(target)
        assert answer.status is Status.BACKUP
        assert "not certified" in answer.reason
        assert_safe(arm, answer, TILT, target)

    def test_with_no_solver_at_all_it_holds(self, arm: SerialChain, monkeypatch: pytest.MonkeyPatch) -> None:
        give_up(monkeypatch, ("ik_posture", "sqp"), ("ik_nearest", "sqp"))
        ik = ArmIK(arm, backup="sqp", compile=False)
        answer = ik.solve([0.0, 0.4, -0.2])
        assert answer.status is Status.HOLDING
        assert_safe(arm, answer, TILT)


class TestArms:
    @given(
        centre=st.lists(st.floats(-0.6, 0.6), min_size=8, max_size=8),
        width=st.lists(st.sampled_from([0.0, 0.0, 1e-9, 1e-4, 0.05, 0.4, 1.2]), min_size=8, max_size=8),
        segments=st.lists(st.floats(0.05, 0.5), min_size=4, max_size=4),
        side=st.sampled_from(["left", "right"]),
        tilt=st.sampled_from([None, 0.0, 0.01, TILT, 0.5, 3.0, math.pi]),
        seed=st.integers(0, 99),
    )
    @settings(max_examples=6, deadline=None)
    def test_any_arm_answers_safely_and_reaches_where_it_has_been(
        self,
        *,
        centre: list[float],
        width: list[float],
        segments: list[float],
        side: str,
        tilt: float | None,
        seed: int,
    ) -> None:
        middle = np.deg2rad([0, 0, 80, 50, 30, 20, -38, 40]) + np.array(centre) * 0.5
        ranges = {name: (m - w / 2, m + w / 2) for name, m, w in zip(ARM_JOINTS, middle, width, strict=True)}
        arm = human_arm(range_of_motion=ranges, segments=segments, side=side)  # type: ignore[arg-type]
        ik = ArmIK(arm, handle_tilt=tilt, compile=False, table_size=512)
        at, rng = forward(arm), np.random.default_rng(seed)
        q = rng.uniform(arm.lower, arm.upper)
        hand, axis = at(q)
        answer = ik.solve(hand)
        assert_safe(arm, answer, tilt, hand)
        held = tilt is None or math.atan2(math.hypot(axis[0], axis[1]), axis[2]) <= tilt
        if held:
            assert answer.status.certified
        else:  # wherever it went, it can go again
            again = ik.solve(at(answer.q)[0])
            # Where the cone only touches what is reachable, its own tolerance of 1e-9 rad is worth micrometres.
            assert again.position_error <= 1e-4 or "most upright" in again.reason

    def test_an_arm_that_cannot_move_says_so(self) -> None:
        arm = human_arm(range_of_motion=dict.fromkeys(ARM_JOINTS, (0.3, 0.3)))
        hand, axis = forward(arm)(arm.lower)
        ik = ArmIK(arm, handle_tilt=None)
        assert ik.solve(hand).status is Status.OK
        away = ik.solve(hand + 0.1)
        assert away.status is Status.UNREACHABLE
        assert away.position_error == pytest.approx(0.1 * math.sqrt(3))
        assert ik.follow([hand, hand + 0.1]).status == [Status.OK, Status.UNREACHABLE]
        assert ArmIK(arm, handle_tilt=0.0).solve(hand).status is Status.UNREACHABLE
        assert axis[2] < 1


class TestHostile:
    @given(position=st.lists(st.sampled_from(HOSTILE), min_size=3, max_size=3), start=st.sampled_from([None, *HOSTILE]))
    @settings(max_examples=20, deadline=None)
    def test_no_number_is_too_strange(self, position: list[float], start: float | None) -> None:
        answer = SHARED.solve(position, start=None if start is None else np.full(8, start))
        assert_safe(SHARED.arm, answer, TILT, np.array(position))
        assert (answer.status is Status.HOLDING) == (not np.all(np.isfinite(position)))


SHARED = ArmIK(human_arm(), compile=False)


ANGLE = np.linspace(0, 2 * np.pi, 300)
CIRCLE = np.array([-0.15, 0.45, -0.24]) + 0.03 * np.c_[np.cos(ANGLE), np.sin(ANGLE), 0 * ANGLE]


class TestFollow:
    def test_a_path_that_leaves_the_reachable_set_is_rejoined(self) -> None:
        arm = human_arm(range_of_motion="restricted")
        inside = reachable(arm, 1, seed=3)[0][0]
        away = inside + np.array([0.0, 0.15, 0.0])
        fraction = np.abs(np.linspace(-1, 1, 61))[:, None]
        path = ArmIK(arm).follow(fraction * inside + (1 - fraction) * away)
        assert path.status[0] is path.status[-1] is Status.OK
        assert path.status[30] is Status.UNREACHABLE
        assert path.position_error[30] > 0.05
        single = ArmIK(arm).solve(away)
        assert path.position_error[30] == pytest.approx(single.position_error, abs=1e-6)
        assert path.handle_tilt.max() <= TILT + 2e-9

    def test_a_single_bad_sample_does_not_end_a_path(self) -> None:
        broken = CIRCLE[:9].copy()
        broken[4] = np.nan
        path = SHARED.follow(broken)
        assert path.status == [Status.OK] * 4 + [Status.HOLDING] + [Status.OK] * 4
        np.testing.assert_array_equal(path.q[4], path.q[3])


def test_what_cannot_be_used_is_named() -> None:
    settings: list[tuple[str, Any]] = [
        ("handle_tilt", -0.1), ("handle_tilt", 3.2), ("handle_tilt", math.nan), ("handle_tilt", "x"),
        ("handle_tilt", [0.1, 0.2]), ("starts", 0), ("starts", "x"), ("table_size", 0), ("tolerance", 0.0),
        ("tolerance", math.nan), ("tolerance", "x"), ("tolerance", None), ("rest", [0.0]), ("rest", "x"),
        ("solver", "nonesuch"), ("solver", None), ("posture_cost", {}), ("posture_cost", {"comfort": 1.0}),
        ("posture_cost", {"rest": -1.0}), ("posture_cost", {"rest": math.nan}), ("posture_cost", {"rest": "much"}),
        ("posture_cost", None), ("posture_cost", 3), ("posture_cost", "rest"),
        ("posture_cost", {"displacement": {"knee": 1.0}}), ("posture_cost", {"manipulability": {"elbow": 1.0}}),
    ]  # fmt: skip
    arm = human_arm()
    refuses(partial(ArmIK, arm), *(({name: value}, name) for name, value in settings))
    refuses(partial(ArmIK, arm), ({"backup": "nonesuch"}, "backup"))
    refuses(ArmIK, *(((each,), "arm") for each in (3, None, "arm", human_arm)))
    wrong: list[Any] = [[0, 0], [[0, 0, 0]], "here", None, [0, 0, 0, 0]]
    refuses(SHARED.solve, *(((each,), "position") for each in wrong))
    refuses(SHARED.follow, *(((each,), "path") for each in ([0, 0], "here", None)))
    refuses(SHARED.solve, (([0, 0, 0], [0, 0]), "start"))
