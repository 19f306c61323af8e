"""How often a point is reachable: exact counts of the polygons."""

import math
import pickle
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import kstest, truncnorm

from rehab_opt import ConfigurationError, human_arm
from rehab_opt.kinematics.human_arm import ARM_JOINTS, RANGES_OF_MOTION_DEG
from rehab_opt.workspace import variation
from rehab_opt.workspace.region import Workspace
from rehab_opt.workspace.used_range import named_ranges
from rehab_opt.workspace.variation import reachability_map, varied_ranges
from tests.refusals import refuses


def box(left: float, low: float, right: float, high: float) -> Workspace:
    return Workspace(shapely.box(left, low, right, high), accuracy=1e-3, height=-0.24)


NOTHING = Workspace(shapely.Polygon(), accuracy=1e-3, height=-0.24, reason="no posture")
THREE = [box(0, 0, 0.2, 0.2), box(0.1, 0, 0.3, 0.2), box(0.1, 0.1, 0.3, 0.3)]
corner = st.integers(0, 12).map(lambda n: n / 40)
boxes = st.tuples(corner, corner, st.integers(1, 8), st.integers(1, 8)).map(
    lambda b: (b[0], b[1], b[0] + b[2] / 40, b[1] + b[3] / 40)
)


# ------------------------------------------------------------------------------------------------------------- shares
def test_the_fraction_of_a_point_is_that_of_the_trials_that_reach_it() -> None:
    fractions = reachability_map(THREE)
    points = [[0.05, 0.05], [0.15, 0.05], [0.15, 0.15], [0.25, 0.25], [0.4, 0.4], [math.nan, 0.1]]
    np.testing.assert_allclose(fractions.probability(points), [1 / 3, 2 / 3, 1, 1 / 3, 0, 0])
    assert fractions.probability([0.15, 0.05]) == pytest.approx(2 / 3)
    weighted = reachability_map(THREE, weights=[2, 1, 1])
    np.testing.assert_allclose(weighted.probability(points), [0.5, 0.75, 1, 0.25, 0, 0])


def test_a_trial_that_reaches_nothing_counts_against_every_point() -> None:
    fractions = reachability_map([*THREE, NOTHING])
    assert fractions.probability([0.15, 0.15]) == pytest.approx(0.75)
    assert fractions.empty == 1
    assert fractions.region(0.76).empty
    assert "no point" in fractions.region(0.76).reason


def test_the_grid_samples_the_probability_and_surrounds_the_workspaces() -> None:
    fractions = reachability_map(THREE, spacing=0.07)
    assert fractions.grid.shape == (len(fractions.y), len(fractions.x))
    for i, j in [(0, 0), (1, 2), (3, 1), (-1, -1)]:
        assert fractions.grid[i, j] == fractions.probability([fractions.x[j], fractions.y[i]])
    for nodes in (fractions.x, fractions.y):
        assert nodes[0] <= 0
        assert nodes[-1] >= 0.3
    np.testing.assert_allclose(np.diff(fractions.x), 0.07)


# ------------------------------------------------------------------------------------------------------------ regions
@settings(max_examples=20, deadline=None)
@given(st.lists(boxes, min_size=1, max_size=7), st.data())
def test_a_region_has_exactly_the_points_of_that_fraction(limits: list[tuple[float, ...]], data: Any) -> None:
    """The oracle counts cells of the lattice that all corners lie on."""
    weights = data.draw(st.lists(st.integers(1, 5), min_size=len(limits), max_size=len(limits)))
    fraction = data.draw(st.sampled_from([0.1, 0.25, 0.5, 0.6, 0.75, 0.9, 1.0]))
    fractions = reachability_map([box(*b) for b in limits], weights=weights, spacing=0.1)
    centres = (np.arange(24) + 0.5) / 40
    x, y = np.meshgrid(centres, centres)
    counts = sum(w * ((b[0] < x) & (x < b[2]) & (b[1] < y) & (y < b[3])) for w, b in zip(weights, limits, strict=True))
    wanted = np.asarray(counts) >= fraction * sum(weights) - 1e-9
    region = fractions.region(fraction)
    assert region.area == pytest.approx(wanted.sum() / 1600, abs=1e-9)
    inside = shapely.contains_xy(region.polygon, x, y)
    np.testing.assert_array_equal(inside, wanted)


def test_boundaries_that_coincide_but_for_their_accuracy_do_not_multiply() -> None:
    """Trials with a limit in common: their boundaries cross wherever noise has it, ten thousand times in all."""
    rng = np.random.default_rng(5)
    angles = np.linspace(0, 2 * np.pi, 300, endpoint=False)
    circle = 0.2 * np.column_stack([np.cos(angles), np.sin(angles)])
    noisy = [shapely.Polygon(circle * (1 + 1e-6 * rng.standard_normal((300, 1)))) for _ in range(12)]
    fractions = reachability_map([Workspace(polygon, accuracy=1e-3) for polygon in noisy])
    for fraction in (0.1, 0.9, 1.0):
        region = fractions.region(fraction)
        assert region.polygon.geom_type == "Polygon"
        assert shapely.hausdorff_distance(region.polygon, shapely.Polygon(circle)) < fractions.snapping
        assert region.accuracy == pytest.approx(1.1e-3)
    assert fractions.snapping == pytest.approx(1e-4)


def test_a_region_is_of_the_plane_of_its_trials_and_no_more_accurate() -> None:
    coarse = Workspace(shapely.box(0, 0, 1, 1), accuracy=5e-3, height=-0.24)
    region = reachability_map([THREE[0], coarse]).region(0.5)
    assert (region.height, region.handle_tilt) == (-0.24, None)
    assert 5e-3 < region.accuracy <= 5.1e-3


# -------------------------------------------------------------------------------------------------- ranges and draws
def test_ranges_and_arms_become_workspaces_here_or_elsewhere_in_the_given_order(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """With a stand-in for the workspace, whose width is the elbow's range: what counts is who is asked for what."""

    def stand_in(arm: Any, asked: Any) -> Workspace:
        return Workspace(
            shapely.box(0, 0, float(arm.upper[4]), asked["height"] + 1), accuracy=1e-3, height=asked["height"]
        )

    monkeypatch.setattr(variation, "_workspace", stand_in)
    ranges = [{**named_ranges("", "regular"), "forearm_extension": (0.0, 0.2 * k)} for k in (1, 2, 3)]
    mixed: list[Any] = [ranges[0], human_arm(range_of_motion=ranges[1]), ranges[2], box(0, 0, 0.5, 0.76)]
    here = reachability_map(mixed)
    with ThreadPoolExecutor(2) as pool:
        there = reachability_map(mixed, executor=pool)
    for found in (here, there):
        assert [w.polygon.bounds[2] for w in found.workspaces] == pytest.approx([0.2, 0.4, 0.6, 0.5])
    np.testing.assert_array_equal(here.grid, there.grid)
    with pytest.raises(ConfigurationError, match="limbs"):
        reachability_map(mixed, height=-0.3)  # the given workspace is of another plane


def test_drawn_limits_follow_the_stated_truncated_normal() -> None:
    ranges = varied_ranges("regular", spread=0.05, count=3000, seed=1)
    lower = np.array([r["wrist_flexion"][0] for r in ranges])
    nominal = np.deg2rad(RANGES_OF_MOTION_DEG["regular"]["wrist_flexion"][0])
    assert kstest((lower - nominal) / 0.05, truncnorm(-2, 2).cdf).pvalue > 1e-3
    upper = np.array([r["wrist_flexion"][1] for r in ranges])
    assert abs(np.corrcoef(lower, upper)[0, 1]) < 0.06


@settings(max_examples=30, deadline=None)
@given(st.just(0.0) | st.floats(1e-3, 2), st.integers(0, 2**31))
def test_no_drawn_range_is_inverted_or_far_off_and_locked_joints_stay(spread: float, seed: int) -> None:
    nominal = named_ranges("", "restricted")
    for drawn in varied_ranges("restricted", spread=spread, count=5, seed=seed):
        assert tuple(drawn) == ARM_JOINTS
        for name, (lower, upper) in drawn.items():
            assert lower <= upper
            assert abs(lower - nominal[name][0]) <= 2 * spread + 1e-12
            assert abs(upper - nominal[name][1]) <= 2 * spread + 1e-12
        arm = human_arm(range_of_motion=drawn)
        assert arm.locked[[0, 6]].all()


def test_equal_seeds_draw_equal_ranges_and_only_named_joints_vary() -> None:
    spread: dict[str, Any] = {"wrist_flexion": (0.0, 0.1), "humeral_flexion": 0.2}
    first = varied_ranges("regular", spread=spread, count=4, seed=7)
    assert first == varied_ranges("regular", spread=spread, count=9, seed=7)[:4]
    assert first != varied_ranges("regular", spread=spread, count=4, seed=8)
    nominal = named_ranges("", "regular")
    for drawn in first:
        assert drawn["wrist_flexion"][0] == nominal["wrist_flexion"][0]
        assert drawn["wrist_flexion"][1] != nominal["wrist_flexion"][1]
        assert drawn["forearm_extension"] == nominal["forearm_extension"]
    assert pickle.loads(pickle.dumps(first)) == first


# ------------------------------------------------------------------------------------------------------ bad arguments


def test_limbs_that_cannot_be_overlaid_and_bad_draws_are_refused() -> None:
    higher = Workspace(shapely.box(0, 0, 1, 1), accuracy=1e-3, height=0.1)
    refuses(
        reachability_map,
        (([],), "limbs"),
        ({"limbs": THREE, "weights": [1, 1]}, "weights"),
        ({"limbs": THREE, "weights": [1, 1, -1]}, "weights"),
        ({"limbs": THREE, "weights": [1, 1, math.nan]}, "weights"),
        ({"limbs": THREE, "spacing": 1e-6}, "spacing"),
        (([*THREE, higher],), "limbs"),
    )
    good: dict[str, Any] = {"range_of_motion": "regular", "spread": 0.1, "count": 2, "seed": 0}
    refuses(
        varied_ranges,
        (good | {"count": 0}, "count"),
        (good | {"spread": -0.1}, "spread"),
        (good | {"spread": {"elbow": 0.1}}, "spread", "elbow"),
        (good | {"range_of_motion": "wide"}, "range_of_motion"),
        (good | {"range_of_motion": {"wrist_flexion": (1.0, 0.0)}}, "range_of_motion"),
    )
