"""Claims about the published force field, and where ours is the same and where not."""

import math

import numpy as np
import pytest

from rehab_opt import ConfigurationError, PotentialField
from rehab_opt.published.field_law import FieldLaw

LINE = np.column_stack([np.linspace(-0.15, 0.15, 49), np.full(49, 0.4)])


def law(**options: object) -> FieldLaw:
    return FieldLaw(LINE, **{"stiffness": 1000.0, "drag": 200.0, "width": 0.025, **options})  # type: ignore[arg-type]


def test_the_force_is_the_negative_gradient_of_the_energy() -> None:
    rng, h = np.random.default_rng(0), 1e-6
    for x in rng.uniform((-0.2, 0.35), (0.2, 0.45), (20, 2)):
        slope = [(law().energy(x + h * e) - law().energy(x - h * e)) / (2 * h) for e in np.eye(2)]
        np.testing.assert_allclose(law().force(x), -np.array(slope), rtol=1e-6, atol=1e-5)


def test_our_field_without_corrections_is_the_published_one() -> None:
    ours = PotentialField(
        LINE, stiffness=1000.0, drag=200.0, width=0.025, damping=7.0, rest_on_target=False, compile=False
    )
    for x in np.random.default_rng(1).uniform((-0.25, 0.3), (0.25, 0.5), (20, 2)):
        v = np.array([0.1, -0.3])
        np.testing.assert_allclose(ours.force(x, v), law(damping=7.0).force(x, v), rtol=1e-9, atol=1e-9)


def test_the_gate_and_the_bound_are_hard() -> None:
    gated = law(released=lambda x: bool(x[0] < 0.0), force_limit=30.0)
    assert not gated.force([-1e-9, 0.41]).any()
    assert math.hypot(*gated.force([1e-9, 0.41])) == pytest.approx(30.0)


def test_far_away_where_every_weight_underflows_there_is_no_force() -> None:
    assert not law().force([0.0, 1.6]).any()


@pytest.mark.parametrize("bad", [{"width": 0.0}, {"width": math.nan}, {"force_limit": -1.0}])
def test_what_cannot_be_used_is_named(bad: dict[str, float]) -> None:
    with pytest.raises(ConfigurationError, match=next(iter(bad))):
        law(**bad)
