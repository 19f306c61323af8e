"""A seeded slice of `python -m bench.physics`: it runs, and joints that move as commanded pass what they should."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench.physics.__main__ import main, table
from bench.physics.arms import ARMS
from bench.physics.geometry import frames, heights, jacobians, manipulabilities
from bench.physics.rows import Done, done, measured
from bench.physics.setting import CELLS, Cell, setting_of
from rehab_opt import JointFeedback, KeepOut, MirrorTracker, PoseTracker

pytest.importorskip("mujoco")


def test_joints_that_move_as_commanded_keep_every_bound() -> None:
    tasks = {"limit": range(2), "hand": range(1)}  # both arms; a tracker with hand bounds takes seconds to build
    found = {name: done(name, numbers, 5, ideal=True, feedback=None) for name, numbers in tasks.items()}
    rows = measured(found)
    assert [row.verdict for row in rows] == ["PASS"] * 4 + [""] + ["PASS"] * 3, table(rows)
    assert any(each.numbers["limit reached"] for each in found["limit"])


def test_a_late_and_noisy_robot_is_measured_and_judged() -> None:
    worst = [number for number, cell in enumerate(CELLS) if cell == Cell(0.008, 2e-4, 1000.0)]
    found = {name: done(name, worst, 5, ideal=False, feedback=None) for name in ("limit", "blocked")}
    rows = measured(found)
    lines = table(rows)
    assert len(lines) == 2 + len(rows)
    assert all(row.verdict in ("PASS", "FAIL") or row.row.at_most == np.inf for row in rows)
    assert all(np.isfinite(row.total) for row in rows)
    again = done("limit", worst, 5, ideal=False, feedback=None)
    assert again == found["limit"]  # the seed says everything


@pytest.mark.parametrize("number", [34, *(pytest.param(each, marks=pytest.mark.nightly) for each in (128, 152))])
def test_a_jammed_joint_is_a_fault_also_where_it_is_taken_for_a_hand_that_is_held(number: int) -> None:
    """The other joints led the hand round it at recovery speed, with status OK, for more than a second."""
    (found,) = done("frozen", [number], 26119950, ideal=False, feedback=None)
    assert found.numbers["blocked joint"] <= 0.2


def test_a_hand_is_no_faster_while_joints_take_over_from_others_that_are_behind() -> None:
    """1.039, where all went through the null space with all their acceleration."""
    (found,) = done("hand", [197], 31120005, ideal=False, feedback=None)
    assert found.numbers["hand speed"] <= 1.0


def test_a_hand_is_no_faster_where_friction_holds_a_joint_that_turns_back() -> None:
    """1.0215 where hands were led at 0.975 of their speed."""
    (found,) = done("hand", [152], 31120005, ideal=False, feedback=None)
    assert found.numbers["hand speed"] <= 1.02


@pytest.mark.parametrize(("number", "seed"), [(40, 502), pytest.param(184, 504, marks=pytest.mark.nightly)])
def test_a_free_hand_that_braked_hard_is_not_held(number: int, seed: int) -> None:
    """Its joints rest elsewhere within their friction than was learned: it was stopped, and the recording not ended."""
    (found,) = done("mirror", [number], seed, ideal=False, feedback=None)
    assert max(found.numbers.values()) < np.inf


def test_a_hand_that_is_led_too_early_is_noticed_on_a_wall_as_soon() -> None:
    """A delay told 3 ms too long: 186 N, where nothing that it is ahead counted."""
    (found,) = done("blocked", [19], 11271141, ideal=False, feedback=None)
    assert found.numbers["blocked: peak"] <= 160


@pytest.mark.nightly
def test_processes_share_the_tasks_and_change_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    told = ["--tasks", "2", "--only", "frozen", "--seed", "3"]
    codes = [main([*told, "--processes", count]) for count in ("1", "2")]
    lines = [line for line in capsys.readouterr().out.splitlines() if line.startswith("| ")]
    assert codes[0] == codes[1]
    once = lines[: len(lines) // 2]
    assert [line.split("|")[1].split(",")[0].strip() for line in once[1:]] == [
        "frozen encoder",
        "the same without a `JointFeedback`",
        "blocked joint: braking after",
        "the same without a `JointFeedback`",
    ]
    assert lines == once * 2


def test_delays_are_told_truly_and_wrong_to_both_arms() -> None:
    settings = [setting_of(n, "limit", seed=0, kept={}) for n in range(6 * len(CELLS))]
    assert {(each.mistold, each.arm.name) for each in settings} == {
        (told, arm().name) for told in (-0.003, 0.0, 0.003) for arm in ARMS.values()
    }
    told = {(each.cell.delay, each.told(PoseTracker)["feedback"].delay) for each in settings}
    assert (0.002, 0.0) in told
    assert (0.008, 0.011) in told


def test_a_controller_is_told_what_its_class_can_be_told() -> None:
    class Later(PoseTracker):
        def __init__(self, *own: object, actuation_delay: float, **options: object) -> None:
            super().__init__(*own, **options)
            self.told = actuation_delay

    setting = replace(setting_of(23, "limit", seed=0, kept={}), mistold=0.0)
    led = setting.controller(Later, setting.arm.chain)
    assert led.told == 0.008
    assert led.feedback == JointFeedback(delay=0.008)
    assert setting.told(MirrorTracker) == {"feedback": JointFeedback(delay=0.008)}
    measured = setting_of(23, "limit", seed=0, feedback="measured", kept={})
    assert measured.controller(Later, setting.arm.chain).feedback is None


@pytest.mark.parametrize("value", [float("nan"), 0.6])
def test_a_number_that_misses_its_bound_or_is_none_fails(value: float) -> None:
    numbers = dict.fromkeys(("beyond a bare servo", "limit: peak to peak", "limit: hand RMS", "limit reached"), 0.0)
    numbers["beyond the limit"] = 1e-3 * value
    rows = measured({"limit": [Done(CELLS[0], numbers)]})
    assert [row.verdict for row in rows] == ["FAIL", "PASS", "PASS", "PASS", ""]


@pytest.mark.parametrize("name", ARMS)
def test_the_bench_judges_by_the_arms_geometry(name: str) -> None:
    chain, rng = ARMS[name]().chain, np.random.default_rng(2)
    q = rng.uniform(-2, 2, (20, chain.n))
    np.testing.assert_allclose(frames(chain, q)[:, -1], [chain.pose(each) for each in q], atol=1e-12)
    np.testing.assert_allclose(jacobians(chain, q), [chain.jacobian(each) for each in q], atol=1e-12)
    np.testing.assert_allclose(manipulabilities(chain, q), [chain.manipulability(each) for each in q], atol=1e-9)
    plane = KeepOut.through([0.0, 0.0, -0.5], [0.0, 0.0, 1.0])
    assert np.all(heights(chain, q, plane) <= frames(chain, q)[:, -1, 2, 3] + 0.5 + 1e-12)
