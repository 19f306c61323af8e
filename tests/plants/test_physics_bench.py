"""A seeded slice of `python -m bench.physics`: it runs, and joints that move as commanded pass what they should."""

from __future__ import annotations

import numpy as np
import pytest

from bench.physics.__main__ import table
from bench.physics.arms import ARMS
from bench.physics.geometry import frames, heights, jacobians, manipulabilities
from bench.physics.rows import Done, done, measured
from bench.physics.setting import CELLS, Cell
from rehab_opt import KeepOut

pytest.importorskip("mujoco")


@pytest.mark.nightly
def test_joints_that_move_as_commanded_keep_every_bound() -> None:
    tasks = {"limit": range(2), "hand": range(1)}  # both arms; a tracker with hand bounds takes seconds to build
    found = {name: done(name, numbers, 5, ideal=True) for name, numbers in tasks.items()}
    rows = measured(found)
    assert [row.verdict for row in rows] == ["PASS"] * 4 + [""] + ["PASS"] * 3, table(rows)
    assert any(each.numbers["limit reached"] for each in found["limit"])


def test_a_late_and_noisy_robot_is_measured_and_judged() -> None:
    worst = [number for number, cell in enumerate(CELLS) if cell == Cell(0.008, 2e-4, 1000.0)]
    found = {name: done(name, worst, 5, ideal=False) for name in ("limit", "blocked")}
    rows = measured(found)
    lines = table(rows)
    assert len(lines) == 2 + len(rows)
    assert all(row.verdict in ("PASS", "FAIL") or row.row.at_most == np.inf for row in rows)
    assert all(np.isfinite(row.total) for row in rows)


@pytest.mark.parametrize(
    ("task", "number", "seed", "name", "at_most"),
    [
        # The other joints led the hand round a jammed one at recovery speed, with status OK, for more than a second.
        ("frozen", 34, 26119950, "blocked joint", 0.2),
        *(pytest.param("frozen", n, 26119950, "blocked joint", 0.3, marks=pytest.mark.nightly) for n in (128, 152)),
        # Where joints take over from others that are behind; where friction held one that turned back (1.0215 once).
        pytest.param("hand", 197, 31120005, "hand speed", 1.06, marks=pytest.mark.nightly),
        ("hand", 152, 31120005, "hand speed", 1.02),
        # A free hand that braked hard was taken for a held one, and the recording did not end.
        *(pytest.param("mirror", *each, "", np.inf, marks=pytest.mark.nightly) for each in ((40, 502), (184, 504))),
    ],
)
def test_what_once_broke_a_bound_keeps_it(task: str, number: int, seed: int, name: str, at_most: float) -> None:
    (found,) = done(task, [number], seed, ideal=False)
    assert found.numbers[name] <= at_most if name else max(found.numbers.values()) < at_most


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
