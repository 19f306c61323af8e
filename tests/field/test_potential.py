"""Claims about force fields: gradients, rest, drag, and many samples as few."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rehab_opt import ConfigurationError, PotentialField
from rehab_opt.field.assembly import assembled
from rehab_opt.field.energy import energies_and_forces, field_kernel
from rehab_opt.field.samples import arc_length, resampled_path
from tests.refusals import refuses

S = np.linspace(0.0, 1.0, 300)
LINE = np.column_stack([-0.15 + 0.3 * S, np.full(300, 0.4)])
ARC = np.column_stack([0.2 * np.cos(2 * S), 0.2 * np.sin(2 * S)])
HOOK = np.column_stack([-0.15 + 0.3 * S, 0.4 + 0.08 * S**3])
PATHS = {"line": LINE, "arc": ARC, "hook": HOOK}
SETTINGS = [
    {"stiffness": 1000.0, "drag": 200.0, "width": 0.025},
    {"stiffness": 3000.0, "drag": 0.0, "width": 0.025},
    {"stiffness": 3500.0, "drag": 0.0, "width": 0.04},
    {"stiffness": [500.0, 1500.0], "drag": 250.0, "width": 0.03},
    {"stiffness": 1000.0, "drag": 250.0, "width": 0.03, "drag_along": "travelled"},
]


def field(path: object = LINE, **options: object) -> PotentialField:
    return PotentialField(path, **{"stiffness": 1000.0, "width": 0.025, "compile": False, **options})  # type: ignore[arg-type]


def along(each: PotentialField) -> np.ndarray:
    path = each.paths[0]
    return np.sum(each.force(path.points) * path.tangents, axis=1)


@pytest.mark.parametrize("options", SETTINGS)
@pytest.mark.parametrize("rest_on_target", [True, False])
def test_the_force_is_the_negative_gradient_of_the_energy(options: dict, rest_on_target: bool) -> None:
    each, h = field(HOOK, rest_on_target=rest_on_target, **options), 1e-6
    for x in np.random.default_rng(0).uniform((-0.25, 0.3), (0.25, 0.6), (15, 2)):
        slope = np.array([(each.energy(x + h * e) - each.energy(x - h * e)) / (2 * h) for e in np.eye(2)])
        np.testing.assert_allclose(each.force(x), -slope, rtol=1e-5, atol=2e-4)


def test_the_stiffness_is_the_derivative_of_the_force() -> None:
    each, h, x = field(ARC, drag=100.0), 1e-6, np.array([0.12, 0.15])
    slopes = np.column_stack([(each.force(x + h * e) - each.force(x - h * e)) / (2 * h) for e in np.eye(2)])
    np.testing.assert_allclose(each.stiffness(x), -slopes, rtol=1e-5, atol=1e-2)


@pytest.mark.parametrize("name", PATHS)
@pytest.mark.parametrize("options", SETTINGS)
def test_the_field_rests_on_its_target(name: str, options: dict) -> None:
    each = field(PATHS[name], **options)
    np.testing.assert_allclose(each.force(each.target), 0.0, atol=1e-9)
    assert np.linalg.eigvalsh(each.stiffness(each.target))[0] > 100.0
    at_target = each.energy(each.target)
    for angle in np.linspace(0, 2 * math.pi, 12, endpoint=False):
        for radius in (1e-4, 1e-3, 5e-3, 0.02):
            assert each.energy(each.target + radius * np.array([math.cos(angle), math.sin(angle)])) > at_target
    if each.drag_along == "remaining":
        published = field(PATHS[name], rest_on_target=False, **options)
        assert np.linalg.norm(published.force(each.target)) > 0.5


def test_a_hand_that_is_let_go_anywhere_ends_on_the_target_of_an_assisting_field() -> None:
    each = field(HOOK, stiffness=3000.0, drag=200.0, width=0.03)
    for start in np.random.default_rng(2).uniform((-0.25, 0.3), (0.3, 0.6), (8, 2)):
        x = start
        for _ in range(4000):
            force = each.force(x)
            x = x + 1e-4 * force / max(1.0, np.linalg.norm(force) / 30.0)
        np.testing.assert_allclose(x, HOOK[-1], atol=1e-4)


def test_the_drag_is_twice_k1_times_the_remaining_length() -> None:
    each = field(LINE, drag=200.0)
    for remaining in (0.06, 0.1, 0.15, 0.2):
        assert each.force([0.15 - remaining, 0.4])[0] == pytest.approx(2 * 200.0 * remaining, rel=5e-3)


@pytest.mark.parametrize("name", PATHS)
@pytest.mark.parametrize("stiffness", [300.0, 1500.0])
def test_resistance_is_against_the_motion_everywhere_and_largest_at_the_target(name: str, stiffness: float) -> None:
    resists = along(field(PATHS[name], stiffness=stiffness, drag=100.0, drag_along="travelled"))
    assert np.all(resists[1:] < 0.0)
    assert np.all(np.diff(resists) < 0.0)
    published = along(field(PATHS[name], stiffness=stiffness, drag=-100.0, rest_on_target=False))
    assert abs(published[-1]) < 0.5 * np.abs(published).max()  # the printed form: little is left at the target


@pytest.mark.parametrize("name", PATHS)
def test_a_field_without_drag_lets_a_hand_move_along_its_path(name: str) -> None:
    each = field(PATHS[name], stiffness=3000.0)
    free = along(each)[: -round(3 * 0.025 / (0.025 / 4))]
    assert np.abs(free).max() < 1.5
    assert np.abs(along(field(PATHS[name], stiffness=3000.0, rest_on_target=False))).max() > 20.0


@settings(max_examples=200, deadline=None)
@given(x=st.floats(-900, 900), y=st.floats(-900, 900))
def test_it_is_finite_at_any_distance(x: float, y: float) -> None:
    assert np.isnan(FAR.force([math.nan, y])).all()
    force = FAR.force([x, y])
    assert np.all(np.isfinite(force))
    assert math.isfinite(FAR.energy([x, y]))
    size = math.hypot(x, y)
    if size > 2.0:  # and leads back
        assert force @ [x, y] < 0.0


FAR = field(HOOK, drag=200.0)


def test_many_points_and_one_point_agree() -> None:
    x = np.random.default_rng(3).uniform(-0.3, 0.6, (50, 2))
    v = np.random.default_rng(4).standard_normal((50, 2))
    each = field(HOOK, drag=100.0, damping=[3.0, 5.0])
    np.testing.assert_allclose(each.force(x, v), [each.force(a, b) for a, b in zip(x, v, strict=True)], atol=1e-8)
    np.testing.assert_allclose(each.energy(x), [each.energy(a) for a in x], rtol=1e-9)


def test_more_samples_change_nothing() -> None:
    x = np.random.default_rng(7).uniform((-0.2, 0.35), (0.2, 0.55), (30, 2))
    fine = field(HOOK, drag=200.0, spacing=0.025 / 16)
    apart = np.linalg.norm(fine.force(x) - FAR.force(x), axis=1)
    assert apart.max() < 0.4  # of up to 200 N: from the curved path's chords


def test_beyond_its_target_a_hand_is_brought_back() -> None:
    for options in SETTINGS[:4]:
        each = field(LINE, **options)
        for beyond in (0.002, 0.01, 0.03, 0.1, 0.3, 1.0):
            assert each.force([0.15 + beyond, 0.4])[0] < 0.0


def test_stiffness_may_vary_along_the_path() -> None:
    stiffness = np.linspace(500.0, 1500.0, 300)
    each = field(LINE, stiffness=stiffness)
    assert each.force([0.0, 0.405])[1] == pytest.approx(-5.0, rel=0.02)
    assert each.force([0.05, 0.405])[1] == pytest.approx(-1000 / 6 * 1e-2 * 0.5 - 5.0, rel=0.02)
    both = field([LINE, LINE], stiffness=[stiffness, np.column_stack([stiffness, stiffness])])
    x = np.random.default_rng(8).uniform((-0.2, 0.35), (0.2, 0.55), (10, 2))
    np.testing.assert_allclose(both.force(x), each.force(x), atol=1e-6)


def test_several_demonstrations_share_one_target() -> None:
    rng = np.random.default_rng(9)
    paths = [
        LINE + S[:, None] * rng.normal(0, 0.004, 2) + 0.01 * rng.standard_normal(2) * (1 - S[:, None]) for _ in range(6)
    ]
    each = field(paths, drag=200.0)
    np.testing.assert_allclose(each.target, np.mean([path[-1] for path in paths], axis=0))
    np.testing.assert_allclose(each.force(each.target), 0.0, atol=1e-9)
    assert np.linalg.eigvalsh(each.stiffness(each.target))[0] > 100.0


def test_demonstrations_without_a_common_target_are_refused_or_published() -> None:
    apart = [LINE, LINE + [0.0, 0.1]]
    with pytest.raises(ConfigurationError, match="rest_on_target"):
        field(apart)
    assert field(apart, rest_on_target=False).target is None


# ------------------------------------------------------------------------------------------------------- many samples
def crowd(count: int, width: float = 0.025) -> list[np.ndarray]:
    rng = np.random.default_rng(10)
    return [
        np.column_stack([LINE[:, 0], 0.4 + rng.normal(0, 0.02) + 0.01 * np.sin(6 * S + rng.uniform(0, 6))])
        for _ in range(count)
    ]


@pytest.mark.parametrize("count", [40, 200])
def test_many_samples_are_few_and_give_nearly_the_same_force(count: int) -> None:
    paths = crowd(count)
    each = field(paths, drag=200.0, rest_on_target=False)
    few = field(paths[:10], rest_on_target=False)
    assert len(few.samples.points) == few.count
    whole = assembled(
        each.paths, [200.0 * p.remaining**2 for p in each.paths], [np.full(p.points.shape, 1000.0) for p in each.paths],
        along="remaining", width=0.025, target=None, most=10**9,
    )  # fmt: skip
    assert len(whole.points) == each.count > 1.5 * len(each.samples.points)
    x = np.random.default_rng(11).uniform((-0.25, 0.25), (0.25, 0.55), (60, 2))
    errors = np.linalg.norm(energies_and_forces(field_kernel(whole, 0.025).mine, x)[1] - each.force(x), axis=1)
    assert errors.max() < 0.3


def test_a_merged_field_still_rests_on_its_target() -> None:
    each = field([path + S[:, None] * (LINE[-1] - path[-1]) for path in crowd(60)], drag=200.0)
    assert len(each.samples.points) < each.count
    np.testing.assert_allclose(each.force(each.target), 0.0, atol=1e-9)


# -------------------------------------------------------------------------------------------------------- arguments
def test_what_cannot_be_used_and_what_is_no_path_is_named() -> None:
    wrong = [
        ("width", math.nan), ("stiffness", -1.0), ("damping", -1.0), ("drag", math.inf), ("drag", -1.0),
        ("drag_along", "sideways"), ("spacing", 1e-8),
    ]  # fmt: skip
    refuses(field, *(({name: value}, f"{name}") for name, value in wrong))
    paths = [[], np.zeros((0, 2)), np.zeros((3, 3)), [[0.0, math.nan]], [[0.0, 1e9]], "path", None]
    refuses(field, *(((path,), "path") for path in paths))


def test_resampling_keeps_the_ends_and_the_length() -> None:
    path = resampled_path(ARC, 0.01)
    np.testing.assert_array_equal(path.points[[0, -1]], ARC[[0, -1]])
    steps = np.diff(path.travelled)
    np.testing.assert_allclose(steps, steps[0])
    assert steps[0] <= 0.01
    assert path.travelled[-1] == pytest.approx(arc_length(ARC)[-1])
    np.testing.assert_allclose(path.travelled + path.remaining, path.travelled[-1])
    np.testing.assert_allclose(np.sum(path.tangents * path.points, axis=1), 0.0, atol=6e-3)  # a circle about zero
