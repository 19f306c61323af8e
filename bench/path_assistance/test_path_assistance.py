"""The judge of help along a path knows what a hand did, and a slice of what it is run on."""

from __future__ import annotations

import numpy as np
import pytest

from bench.path_assistance.__main__ import measured
from bench.path_assistance.judge import Seen, judged
from bench.path_assistance.traces import Stroke, handwriting, pen_path
from rehab_opt.measures.along_path import covered_in_order, deviation_in_order
from rehab_opt.plants.intention import AIMS, Aims

WIDTH = 0.003
LOOP = np.column_stack([np.linspace(0.0, 0.1, 400), np.zeros(400)])
LOOP[150:250] += 0.02 * np.column_stack(
    [np.sin(np.linspace(0, 2 * np.pi, 100)), 1 - np.cos(np.linspace(0, 2 * np.pi, 100))]
)
"""A straight line with a loop of 126 mm in its middle."""


def seen(position: np.ndarray, force: float = 0.0) -> Seen:
    return Seen(position, np.full(position.shape, force), np.repeat(LOOP, 10, axis=0)[: len(position)], 0.01)


def test_a_stroke_is_an_arc_of_its_length() -> None:
    path = pen_path([Stroke(0.1, -1.0, 0.3, 0.05, 0.0, np.pi)], 3.0)
    assert np.linalg.norm(np.diff(path, axis=0), axis=1).sum() == pytest.approx(0.05, rel=1e-3)
    np.testing.assert_allclose(path[-1], [0.0, 2 * 0.05 / np.pi], atol=1e-5)


def test_a_loop_that_is_left_out_is_not_covered_and_one_that_is_walked_is() -> None:
    whole, left_out = (
        judged(seen(LOOP), LOOP, width=WIDTH),
        judged(seen(np.vstack((LOOP[:150], LOOP[250:]))), LOOP, width=WIDTH),
    )
    assert whole.covered == 1.0
    assert whole.deviation < 3e-4
    assert left_out.covered < 0.5  # the loop is more than half of the length
    assert left_out.deviation == pytest.approx(whole.deviation, rel=0.1)  # places may be passed over


def test_a_hand_that_is_held_while_its_person_goes_on_is_seen() -> None:
    standing = np.repeat(LOOP[:100], 10, axis=0)
    standing[300:] = standing[300]
    # It stands from 3 s to 10 s, and is 3 widths behind from 6.6 s on: windows of 2 s begin until 8 s.
    assert judged(seen(standing, 12.0), LOOP, width=WIDTH).stuck == pytest.approx(1.4, abs=0.1)
    assert judged(seen(standing, 2.0), LOOP, width=WIDTH).stuck == 0.0
    assert judged(seen(np.repeat(LOOP, 10, axis=0), 12.0), LOOP, width=WIDTH).stuck == 0.0


@pytest.mark.parametrize("seed", range(3))
def test_the_library_measures_what_the_judge_does(seed: int) -> None:
    path = handwriting(seed, width=0.02, height=0.04)
    rng = np.random.default_rng(seed)
    part = path[: len(path) * 2 // 3] + np.cumsum(3e-4 * rng.standard_normal((len(path) * 2 // 3, 2)), axis=0)
    verdict = judged(Seen(part, np.zeros_like(part), part, 0.01), path, width=WIDTH)
    assert covered_in_order(part, path, within=0.005, jump=2 * WIDTH) == pytest.approx(verdict.covered, abs=0.02)
    ours = np.sqrt((deviation_in_order(part, path) ** 2).mean())
    assert ours == pytest.approx(verdict.deviation, rel=0.02, abs=1e-4)


@pytest.mark.parametrize("aims", AIMS)
def test_help_along_a_trace_that_nobody_has_seen(aims: Aims) -> None:
    """It deviates less; it covers less, too: the help leads no hand on (bench/RESULTS.md)."""
    of = measured(31, aims, trials=1)
    assert of.helped > 0.9
    assert of.ratio < 1.0
    assert of.stuck == 0.0
