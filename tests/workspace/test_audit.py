"""An audit says what is wrong in numbers, and a controller gets no map that fails it."""

from dataclasses import replace

import numpy as np
import pytest

from rehab_opt.workspace.audit import Audit, random_points
from rehab_opt.workspace.certificate import Certificate
from rehab_opt.workspace.controller_map import ControllerMap
from tests.refusals import refuses
from tests.workspace.mapped import ell, mapped, sliver, workspace

GOOD = Audit(
    samples=10, folded=0.0, outside=0.0, max_stretch=0.4, min_stretch=0.1, overall_ratio=0.2, round_trip=1e-12,
    coverage=0.8, certificate=Certificate(0.01, 0.002, True, 100, ""), target_accuracy=0.001,
)  # fmt: skip


WAYS = [("regular", "restricted"), ("restricted", "regular"), ("crescent", "blob")]
MORE_WAYS = [("blob", "crescent"), ("blob", "ell"), ("sliver", "blob"), ("figure_3", "regular")]


@pytest.mark.parametrize(
    ("source", "target"), [*WAYS, *(pytest.param(*way, marks=pytest.mark.nightly) for way in MORE_WAYS)]
)
def test_a_safe_map_between_workspaces_or_shapes_of_other_kinds_passes(source, target):
    audit = mapped(source, target).audit()
    assert audit.samples == 20_000
    assert (audit.folded, audit.outside, audit.reasons) == (0.0, 0.0, ())
    assert audit.round_trip <= 1e-9
    assert audit.certificate.valid
    assert audit.passed
    assert audit.coverage > 0.6


@pytest.mark.nightly
def test_a_crescent_maps_to_an_ell_and_uses_most_of_it_where_it_may_turn():
    assert mapped("crescent", "ell").audit().passed  # of 42 % of the ell, see bench/RESULTS.md
    turned = mapped("crescent", "ell", rotation="best").audit()
    assert turned.passed
    assert turned.coverage > 0.6


@pytest.mark.parametrize(
    ("wrong", "word"),
    [
        ({"folded": 1e-4}, "folded"),
        ({"outside": 5e-5}, "outside"),
        ({"max_stretch": 0.2 * 5.01}, "stretches"),
        ({"min_stretch": 0.2 / 5.01}, "squeezes"),
        ({"round_trip": 1.1e-9}, "round trip"),
        ({"certificate": Certificate(-1.0, 0.002, True, 1, "")}, "not certified"),
        ({"certificate": Certificate(0.1, 0.002, False, 1, "")}, "not certified"),
        ({"certificate": Certificate(0.1, 0.002, True, 1, "left open")}, "left open"),
        ({"target_accuracy": 0.003}, "3 mm"),
    ],
)
def test_each_figure_alone_refuses_a_map(wrong, word):
    assert GOOD.passed
    audit = replace(GOOD, **wrong)
    assert not audit.passed
    (reason,) = audit.reasons
    assert word in reason


def test_a_figure_or_a_certificate_of_not_a_number_refuses_a_map():
    for name in (
        "folded", "outside", "max_stretch", "min_stretch", "round_trip", "overall_ratio", "target_accuracy",
    ):  # fmt: skip
        assert not replace(GOOD, **{name: np.nan}).passed, name
    for numbers in ((np.nan, 0.1), (0.1, np.nan)):
        assert not Certificate(*numbers, True, 1, "").valid


def test_a_map_that_fails_reaches_no_controller_unless_unsafe_is_said():
    unsafe = mapped("regular", "restricted", rule="polar", landmarks=20)
    assert not hasattr(unsafe, "image")
    refuses(unsafe.for_controller, ({}, "map = ", "unsafe=True", "folded over", "not certified"))
    refuses(unsafe.for_controller, *(({"unsafe": nearly}, "unsafe=True") for nearly in (1, np.True_)))
    refuses(ControllerMap, ((unsafe.source, unsafe.spline, unsafe.audit(100)), "unsafe=True"))
    held = unsafe.for_controller(unsafe=True)
    assert (held.unsafe, held.audit.passed) == (True, False)
    assert not mapped("regular", "restricted").for_controller().unsafe


def test_no_input_drives_a_controller_outside_the_target_or_into_an_error():
    made = mapped("restricted", "regular")
    held = made.for_controller()
    for point in 10.0 * np.random.default_rng(1).normal(size=(300, 2)):
        assert made.target.contains(held.image(point))
    for bad in ([np.nan, 0.0], [np.inf, 0.0], [np.nan, np.nan]):
        image = held.image(np.array(bad))
        assert np.isnan(image).all() or made.target.contains(image)
        assert held.jacobian(np.array(bad)).shape == (2, 2)
    assert np.isnan(held.image(np.array([np.nan, 0.1]))).all()


def test_drawn_points_are_all_inside_and_spread_by_area():
    space = workspace(ell())
    points = random_points(space, 20_000, 0)
    assert space.contains(points).all()
    foot = points[:, 1] < 0.1  # 3/5 of the area
    assert foot.mean() == pytest.approx(0.6, abs=0.02)
    assert (random_points(space, 100, 5) == random_points(space, 100, 5)).all()
    assert len(random_points(workspace(sliver()), 1, 0)) == 1
