"""The proof: its bounds hold wherever one looks, and what folds, leaves or overlaps is not certified."""

import itertools

import numpy as np
import pytest
from scipy.interpolate import BSpline
from shapely import Point, Polygon, affinity, box, contains_xy, get_coordinates

from rehab_opt.workspace import certificate as proof
from rehab_opt.workspace.bspline import PlaneBSpline
from rehab_opt.workspace.certificate import certificate, determinant_bounds, examined, quartered
from rehab_opt.workspace.spline import ThinPlateSpline
from tests.workspace.mapped import mapped, workspace
from tests.workspace.test_bspline import fitted, knots, wavy

SQUARE = box(0.0, 0.0, 1.0, 1.0)
FINE = 30
"""Points across a cell of the brute force."""


def on_unit(function, cells: int = 16) -> PlaneBSpline:
    """A map of the square, on a net a little larger than it."""
    return fitted(function, (-0.1, -0.1), (1.2 / cells, 1.2 / cells), (cells, cells))


def brute(spline: PlaneBSpline, region: Polygon, per_cell: int = FINE) -> tuple[float, float]:
    """Smallest det J and largest stretch at a grid of the set's points, by scipy's splines alone."""
    u, v = (np.linspace(0.0, n, per_cell * n + 1) for n in spline.cells)
    x, y = np.meshgrid(spline.low[0] + spline.step[0] * u, spline.low[1] + spline.step[1] * v, indexing="ij")
    bases = [
        [BSpline(knots(n), np.eye(n + 3), 3)(t, d) / spline.step[i] ** d for d in (0, 1)]
        for i, (t, n) in enumerate(zip((u, v), spline.cells, strict=True))
    ]
    Jx = np.einsum("ai,bj,ijc->abc", bases[0][1], bases[1][0], spline.coefficients, optimize=True)
    Jy = np.einsum("ai,bj,ijc->abc", bases[0][0], bases[1][1], spline.coefficients, optimize=True)
    within = contains_xy(region, x, y)
    slopes = np.stack([Jx[within], Jy[within]], axis=-1)
    return float(np.linalg.det(slopes).min()), float(np.linalg.norm(slopes, ord=2, axis=(1, 2)).max())


def somewhere(spline: PlaneBSpline, seed: int) -> Polygon:
    """A disc, or a triangle, within the net."""
    random = np.random.default_rng(seed)
    size = spline.step * spline.cells
    middle = spline.low + size * random.uniform(0.4, 0.6, 2)
    disc = affinity.scale(Point(*middle).buffer(1.0), *(0.38 * size))
    corners = get_coordinates(disc)[random.choice(len(disc.exterior.coords) - 1, 3, replace=False)]
    return disc if seed % 2 else Polygon(corners).buffer(0.02 * size.min())


@pytest.mark.parametrize("seed", range(24))
def test_bounds_of_random_maps_hold_and_are_sharp(seed):
    spline = wavy(seed, bend=0.002 * (1 + seed % 4))
    region = somewhere(spline, seed)
    least, largest = brute(spline, region)
    turned = spline
    if least < 0.0:  # seen in a mirror, where it may be bounded
        turned = PlaneBSpline(spline.low, spline.step, spline.coefficients * [1.0, -1.0])
        least, largest = brute(turned, region)
    bounds = determinant_bounds(turned, region, enough=np.inf)
    assert bounds.stretch >= largest
    assert bounds.stretch <= 3.0 * largest
    size = largest**2
    assert bounds.determinant <= least + 1e-12 * size
    if least > 0.05 * size:
        assert bounds.determinant > 0.3 * least
        assert not len(determinant_bounds(turned, region).doubtful)
    if least < -0.01 * size:
        assert not bounds.determinant > 0.0
        assert len(bounds.doubtful)


def test_a_linear_map_has_its_own_determinant_as_bound_in_any_units():
    turn = np.array([[0.5, 0.1], [-0.3, 0.4]])
    for scale in (1e-3, 1.0, 50.0):
        spline = fitted(lambda x: x @ turn, (0.0, 0.0), (0.1 * scale, 0.3 * scale), (5, 4))
        bounds = determinant_bounds(spline, box(0.01 * scale, 0.01 * scale, 0.4 * scale, scale))
        assert bounds.determinant == pytest.approx(0.23, rel=1e-9)
        assert np.linalg.norm(turn, 2) <= bounds.stretch <= 1.0001 * np.hypot(*np.linalg.norm(turn, axis=1))


def test_quarters_of_a_cell_are_the_same_polynomial():
    def at(cells, u, v):
        bernstein = lambda t: np.array([(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3])  # noqa: E731
        return np.einsum("p,mpqc,q->mc", bernstein(u), cells, bernstein(v))

    random = np.random.default_rng(0)
    cells, corner, size = random.normal(size=(3, 4, 4, 2)), random.normal(size=(3, 2)), np.array([0.3, 0.7])
    quarters, corners = quartered(cells, corner, size)
    for k, (i, j) in enumerate(itertools.product((0, 1), repeat=2)):
        rows = slice(3 * k, 3 * k + 3)
        np.testing.assert_allclose(corners[rows], corner + size * [i, j] / 2.0)
        for u, v in random.random((20, 2)):
            np.testing.assert_allclose(at(quarters[rows], u, v), at(cells, (u + i) / 2.0, (v + j) / 2.0), atol=1e-12)


def test_a_fold_too_small_to_be_sampled_is_not_certified():
    def pinched(x):
        away = x - [0.431, 0.569]
        return 0.1 + 0.8 * (x - away * (1.3 * np.exp(-(away**2).sum(axis=1) / 0.006**2))[:, None])

    spline, target = on_unit(pinched, cells=256), workspace(box(-1.0, -1.0, 2.0, 2.0))
    sampled = spline.jacobian(np.random.default_rng(1).uniform(0.0, 1.0, (2_000, 2)))
    assert (np.linalg.det(sampled) > 0.0).all()
    assert brute(spline, SQUARE, 4)[0] < 0.0
    proven, at = examined(spline, workspace(SQUARE), target)
    assert not proven.valid
    assert not proven.determinant > 0.0
    assert np.linalg.norm(at - [0.431, 0.569], axis=1).max() < 0.03


@pytest.mark.parametrize(("excess", "certified"), [(1e-3, False), (1e-5, False), (-1e-3, True), (-1e-4, True)])
def test_an_image_that_leaves_the_target_by_a_hair_is_not_certified(excess, certified):
    spline = on_unit(lambda x: (x - 0.5) * (1.0 + 2.0 * excess) + 0.5)
    proven = certificate(spline, workspace(SQUARE), workspace(SQUARE))
    assert proven.valid is certified
    if certified:
        assert -excess - 8e-5 < proven.margin <= -excess + 1e-12  # a chord's error is 7e-5
        assert proven.determinant == pytest.approx((1.0 + 2.0 * excess) ** 2, rel=1e-6)


@pytest.mark.parametrize("scale", [1e-2, 10.0])
def test_the_proof_does_not_depend_on_units(scale):
    spline = wavy(1, (8, 8), bend=0.002)
    if np.linalg.det(spline.jacobian(spline.low + 4 * spline.step)) < 0.0:
        spline = PlaneBSpline(spline.low, spline.step, spline.coefficients * [1.0, -1.0])
    region = Point(*(spline.low + 4 * spline.step)).buffer(2.5 * spline.step.min())
    image = Polygon(spline(get_coordinates(region.exterior))).buffer(0.02)
    here = certificate(spline, workspace(region), workspace(image))
    assert here.valid
    there = certificate(
        PlaneBSpline(scale * spline.low, scale * spline.step, scale * spline.coefficients),
        *(workspace(affinity.scale(each, scale, scale, origin=(0, 0))) for each in (region, image)),
    )
    assert there.valid
    assert there.determinant == pytest.approx(here.determinant, rel=1e-9)
    assert there.margin == pytest.approx(scale * here.margin, rel=1e-6)


def bent(turn: float):
    """A ring opened at one side, whose ends overlap for a turn of more than a round."""
    angle = np.linspace(-1.0, 1.0, 60) * 2.6
    rim = np.column_stack([np.cos(angle), np.sin(angle)])
    source = Polygon(np.concatenate([rim, 0.5 * rim[::-1]]))

    def polar(x):
        at, radius = np.arctan2(x[:, 1], x[:, 0]), np.maximum(np.hypot(*x.T), 0.2)
        return radius[:, None] * np.column_stack([np.cos(turn * at), np.sin(turn * at)])

    return fitted(polar, (-1.1, -1.1), (2.2 / 60, 2.2 / 60), (60, 60)), source


def test_a_map_that_overlaps_without_folding_is_not_certified():
    target = workspace(box(-2.0, -2.0, 2.0, 2.0))
    for turn, certified in ((1.0, True), (1.18, True), (1.25, False), (1.4, False)):  # 1.21 * 2.6 rad is half a turn
        spline, source = bent(turn)
        proven = certificate(spline, workspace(source), target)
        assert proven.determinant > 0.0
        assert proven.outline_simple is certified
        assert proven.valid is certified
        assert certified or "keep clear of itself" in proven.reason


def test_a_map_that_winds_twice_or_mirrors_is_not_certified():
    target = workspace(box(-9.0, -9.0, 9.0, 9.0))

    def squared(x):
        z = (x @ [1.0, 1.0j]) ** 2
        return np.column_stack([z.real, z.imag])

    ring = Point(0.0, 0.0).buffer(1.0).difference(Point(0.0, 0.0).buffer(0.5)).difference(box(-2.0, -0.05, 0.0, 0.05))
    spline = fitted(squared, (-1.1, -1.1), (0.1, 0.1), (22, 22))
    proven = certificate(spline, workspace(ring), target)
    assert not proven.valid
    mirrored = on_unit(lambda x: x * [1.0, -1.0])
    assert not certificate(mirrored, workspace(SQUARE), target).valid


def test_nothing_is_proven_outside_of_the_net_of_nan_or_of_another_kind_of_map():
    target = workspace(box(-9.0, -9.0, 9.0, 9.0))
    spline = on_unit(lambda x: x)
    assert certificate(spline, workspace(SQUARE), target).valid
    for shift in ([0.1, 0.0], [-0.1, 0.0], [0.0, 0.1], [0.0, -0.1]):
        moved = affinity.translate(SQUARE, *np.multiply(shift, 1.01))
        assert determinant_bounds(spline, moved).determinant == -np.inf
        assert not certificate(spline, workspace(moved), target).valid
    broken = np.array(spline.coefficients)
    broken[7, 7, 0] = np.nan
    assert not certificate(PlaneBSpline(spline.low, spline.step, broken), workspace(SQUARE), target).valid
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    assert certificate(ThinPlateSpline(corners, corners), workspace(SQUARE), target).reason == proof.UNPROVEN


def test_a_curve_encloses_another_if_it_is_simple_around_it_and_further_away_than_chords_err():
    def encloses(outer, inner, *errors):
        fine = [
            proof._Chords(Polygon(each.exterior.segmentize(1e-3)), error)
            for each, error in zip((outer, inner), errors, strict=True)
        ]
        return proof._encloses(*fine)

    inner = box(0.1, 0.1, 0.9, 0.9)
    assert encloses(SQUARE, inner, 0.0, 0.0)
    assert encloses(SQUARE, inner, 0.03, 0.019)
    assert encloses(SQUARE, inner, 0.019, 0.03)
    for errors in ((0.03, 0.021), (0.021, 0.03), (0.051, 0.0), (0.0, 0.051), (np.nan, 0.0)):
        assert not encloses(SQUARE, inner, *errors)
    assert not encloses(SQUARE, affinity.translate(inner, 2.0, 0.0), 0.0, 0.0)
    flag = [(0.5, 1.0), (0.5, 2.0), (1.0, 2.5), (1.0, 2.0), (0.4, 2.6), (0.0, 1.0)]
    crossed = Polygon([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), *flag])
    assert not crossed.is_valid
    assert not encloses(crossed, inner, 0.0, 0.0)


def test_chords_err_by_no_more_than_they_say(monkeypatch):
    spline = wavy(3, (10, 10), bend=0.01)
    region = Point(*(spline.low + 5 * spline.step)).buffer(3 * spline.step.min())
    stretch = determinant_bounds(spline, region).stretch
    fine = get_coordinates(region.exterior.segmentize(region.length / 20_000))
    images = spline(fine)
    for pieces in (40, 200):
        monkeypatch.setattr(proof, "CHORDS", pieces)
        chords = proof._chords(spline, region, stretch)
        corners = get_coordinates(chords.polygon.exterior)
        away = np.linalg.norm(images[:, None] - corners, axis=2).min(axis=1).max()
        assert away <= chords.error <= 6.0 * away


@pytest.mark.parametrize(("source", "target"), [("regular", "restricted"), ("crescent", "blob")])
def test_nothing_sampled_is_worse_than_what_is_proven(source, target):
    made = mapped(source, target)
    assert made.certificate.valid
    least, _ = brute(made.spline, made.source.polygon, 12)
    assert least >= made.certificate.determinant > 0.0
    outline = get_coordinates(made.source.polygon.exterior.segmentize(1e-4))
    assert -np.max(made.target.distance(made.spline(outline))) >= made.certificate.margin > 0.0
