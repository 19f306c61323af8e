"""Claims about fields learnt from recorded forces."""

import math

import numpy as np
import pytest

from rehab_opt import ConfigurationError, PotentialField
from rehab_opt.field.demonstration import Demonstration, check_agreement
from rehab_opt.field.learning import force_columns
from rehab_opt.field.samples import arc_length, mean_path, resampled_path
from rehab_opt.optim.recorder import recording_qps
from tests.field.demonstrators import WAY, S, led_hands
from tests.refusals import refuses

TRUE = {"stiffness": 1000.0, "drag": 200.0, "damping": 8.0}


def truth(**options: object) -> PotentialField:
    return PotentialField(WAY, **{**TRUE, "width": 0.025, "compile": False, **options})  # type: ignore[arg-type]


def learnt(hands: list[Demonstration], **options: object) -> PotentialField:
    return PotentialField.learn(hands, **{"width": 0.025, "path": WAY, "compile": False, **options})


@pytest.mark.parametrize("rest_on_target", [True, False])
def test_without_noise_stiffness_drag_and_damping_are_recovered(rest_on_target: bool) -> None:
    fit = learnt(led_hands(truth(rest_on_target=rest_on_target)), rest_on_target=rest_on_target).fit
    assert fit.parameters == pytest.approx(TRUE, rel=1e-6)
    assert fit.held_out == (4, 9)
    assert fit.held_out_fraction < 1e-6
    assert fit.unidentified == ()
    assert 0.0 <= fit.residual <= 1e-6


def test_with_noise_the_error_left_is_the_noise() -> None:
    fit = learnt(led_hands(truth(), noise=1.0)).fit
    assert fit.parameters == pytest.approx(TRUE, rel=0.02)
    assert fit.held_out_error == pytest.approx(math.sqrt(2.0), rel=0.05)
    assert fit.constant_stiffness_error > 10 * fit.held_out_error
    for name, value in fit.parameters.items():
        assert abs(value - TRUE[name]) < 5 * fit.standard_error[name]


def test_a_hidden_truth_is_found_from_the_demonstrations_alone() -> None:
    field = learnt(led_hands(truth(), noise=0.5), path=None)
    assert len(field.paths) == 1
    assert np.linalg.norm(field.paths[0].points[:, None] - WAY, axis=2).min(axis=1).max() < 0.005
    assert field.fit.held_out_fraction < 0.1
    assert field.fit.held_out_error < 0.1 * field.fit.constant_stiffness_error


def test_the_force_never_points_against_the_demonstration_whatever_was_recorded() -> None:
    # Where stiffness rises along the path, its mean under the Gaussian pulls back, though no phi_0 does.
    rising = truth(stiffness=np.linspace(400.0, 4000.0, 300), drag=0.0)
    path = rising.paths[0]
    along = np.sum(rising.force(path.points) * path.tangents, axis=1)
    assert along.min() < -3.0
    field = learnt(led_hands(rising))
    along = np.sum(field.force(path.points) * path.tangents, axis=1)
    assert along.min() >= -1e-6
    assert field.fit.constraints_active > 0
    assert min(field.fit.parameters.values()) >= 0.0


def test_forces_that_pull_back_teach_no_rising_offset() -> None:
    hands = []
    for hand in led_hands(truth()):
        back = np.where(np.abs(hand.positions[:, :1]) < 0.05, -90.0, 0.0) * np.array([1.0, 0.0])
        hands.append(Demonstration(hand.positions, hand.forces + back, hand.velocities))
    field = learnt(hands)
    assert min(field.fit.parameters.values()) >= 0.0
    assert np.sum(field.force(field.paths[0].points) * field.paths[0].tangents, axis=1).min() >= -1e-6
    assert field.fit.rest_stiffness > 0.0


@pytest.mark.parametrize(("sign", "offset"), [(-1.0, 0.0), (0.0, -5.0)])
def test_forces_that_show_no_stiffness_are_refused(sign: float, offset: float) -> None:
    """Of the other sign, or always the same: a field without a spring was learnt, which holds no hand."""
    hands = [
        Demonstration(h.positions, sign * h.forces + (offset, 0.0), sign * h.velocities)
        for h in led_hands(truth(), noise=0.1)
    ]
    with pytest.raises(ConfigurationError, match=r"^demonstrations = .*hold no hand on a path"):
        learnt(hands)


def test_what_the_data_do_not_tell_is_named() -> None:
    still = [Demonstration(h.positions, h.forces, np.zeros_like(h.positions)) for h in led_hands(truth(damping=0.0))]
    fit = learnt(still).fit
    assert fit.unidentified == ("damping",)
    assert fit.standard_error["damping"] == math.inf
    assert fit.condition > 1e3


def test_of_several_widths_the_one_that_held_out_data_prefer_is_taken() -> None:
    assert learnt(led_hands(truth()), width=[0.015, 0.025, 0.04]).fit.width == 0.025


@pytest.mark.parametrize("rest_on_target", [True, False])
def test_the_design_is_the_force_of_the_field(rest_on_target: bool) -> None:
    paths = [resampled_path(WAY, 0.006), resampled_path(WAY + 0.004 * np.sin(5 * S[:, None]), 0.006)]
    rng = np.random.default_rng(0)
    x, v = rng.uniform((-0.2, 0.3), (0.2, 0.5), (30, 2)), rng.standard_normal((30, 2))
    theta = rng.uniform(0.5, 2.0, 3) * np.array([1000.0, 5.0, 5.0])
    field = PotentialField.of_samples(
        paths,
        [theta[1] * path.remaining**2 for path in paths],
        [np.full(path.points.shape, theta[0]) for path in paths],
        width=0.025,
        damping=theta[2],
        rest_on_target=rest_on_target,
        compile=False,
    )
    columns = force_columns(paths, 0.025, x, rest_on_target=rest_on_target)
    np.testing.assert_allclose(columns @ theta - theta[2] * v, field.force(x, v), rtol=1e-9, atol=1e-8)


def test_the_mean_of_swaying_paths_is_smooth_and_keeps_its_ends() -> None:
    rng = np.random.default_rng(2)
    paths = [
        WAY + 0.01 * np.sin(20 * S[:, None] + rng.uniform(0, 6, 2)) * np.sin(np.pi * S[:, None]) for _ in range(10)
    ]
    mean = mean_path(paths, 0.0125)
    np.testing.assert_allclose(mean[[0, -1]], WAY[[0, -1]], atol=1e-12)
    assert np.linalg.norm(mean[:, None] - WAY, axis=2).min(axis=1).max() < 0.004
    assert arc_length(mean)[-1] == pytest.approx(arc_length(WAY)[-1], rel=0.02)
    np.testing.assert_allclose(
        mean_path([WAY], 1e-4)[[0, 200, -1]], mean_path([WAY, WAY], 1e-4)[[0, 200, -1]], atol=1e-12
    )
    still = np.zeros((5, 2))
    np.testing.assert_array_equal(mean_path([still], 0.01), np.zeros((400, 2)))


def test_the_standard_error_covers_what_repeated_demonstrations_scatter() -> None:
    found, stated = [], []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        hands = []
        for each in led_hands(truth(), noise=0.0)[:4]:
            waves = np.sin(np.linspace(0, 25, len(each.forces))[:, None] + rng.uniform(0, 7, 2)) * rng.normal(size=2)
            hands.append(
                Demonstration(positions=each.positions, forces=each.forces + waves, velocities=each.velocities)
            )
        fit = learnt(hands, held_out=()).fit
        found.append(fit.parameters["stiffness"])
        stated.append(fit.standard_error["stiffness"])
    assert np.std(found) < 2.0 * np.mean(stated)


def test_noise_of_a_hand_at_rest_is_no_way_along_the_path() -> None:
    rng = np.random.default_rng(1)
    line = np.column_stack((np.linspace(0.0, 0.1, 400), 0.02 * np.sin(np.linspace(0.0, 3.0, 400))))
    resting = np.vstack((line, np.tile(line[-1], (8000, 1)))) + rng.normal(0, 1e-4, (8400, 2))
    mean = mean_path([line, resting], 0.005)
    away = np.linalg.norm(mean[:, None] - line, axis=2).min(axis=1)
    assert away.max() < 1e-3


def test_velocities_of_a_noisy_recording_at_a_kilohertz_are_those_of_the_hand() -> None:
    rng, times = np.random.default_rng(2), np.arange(3000) * 1e-3
    places = np.column_stack((0.05 * np.sin(times), 0.03 * np.cos(2 * times)))
    true = np.column_stack((0.05 * np.cos(times), -0.06 * np.sin(2 * times)))
    seen = places + rng.normal(0, 1e-4, places.shape)
    for kwargs in ({"dt": 1e-3}, {"times": 7.0 + times}):
        hand = Demonstration(positions=seen, forces=np.zeros_like(seen), **kwargs)  # type: ignore[arg-type]
        assert np.sqrt(((hand.velocities - true) ** 2).mean()) < 0.004


def test_a_circle_gone_the_other_way_round_is_refused_and_a_way_there_and_back_is_not() -> None:
    angle = np.linspace(0.0, 2 * np.pi, 200)
    circle = 0.05 * np.column_stack((np.cos(angle), np.sin(angle)))
    there_and_back = np.column_stack((0.1 * np.sin(angle / 2), np.zeros(200)))
    both = [Demonstration(positions=way, forces=0 * way, dt=0.01) for way in (circle, circle[::-1])]
    with pytest.raises(ConfigurationError, match=r"demonstrations\[1\]"):
        check_agreement(both, None, 0.02)
    check_agreement([both[0], both[0]], None, 0.02)
    again = [Demonstration(positions=way, forces=0 * way, dt=0.01) for way in (there_and_back, there_and_back[::-1])]
    check_agreement(again, None, 0.02)


def test_fits_of_several_widths_are_recorded_as_problems_of_one_size_each() -> None:
    with recording_qps() as recorder:
        learnt(led_hands(truth()), width=[0.01, 0.02, 0.025])
    for stream in recorder.streams:
        assert len({(qp.g.size, qp.rows_lower.size) for qp in stream.instances()}) == 1
    assert sum(len(stream) for stream in recorder.streams) == 3


def test_recordings_and_options_that_cannot_be_used_are_named() -> None:
    """Also in another unit: from forces in mN a stiffness of 1.6e6 N/m was learnt."""
    hands = led_hands(truth())
    for time, force, said in ((1e3, 1.0, "m/s"), (1e-3, 1.0, "m/s"), (1.0, 1e3, " N")):
        other = Demonstration(hands[3].positions, force * hands[3].forces, dt=2.0 * time / 299)
        refuses(learnt, (([*hands[:3], other],), "demonstrations[3] = ", said, "another unit"))
    good = {"positions": np.arange(8.0).reshape(4, 2), "forces": np.zeros((4, 2)), "dt": 0.1}
    lacking = np.where(np.arange(8).reshape(4, 2) == 5, math.nan, 0.0)
    refuses(
        Demonstration,
        (good | {"forces": np.zeros((3, 2))}, "forces"),
        (good | {"dt": None}, "dt"),
        (good | {"times": np.zeros(4)}, "times"),
        (good | {"positions": [[0.0, 1.0], [1.0]]}, "positions"),
        (good | {"forces": lacking}, "forces[2] = [0.0, nan]: expected finite"),
        (good | {"dt": None, "velocities": lacking}, "velocities[2] = [0.0, nan]: expected finite"),
    )
    few = led_hands(truth(), samples=20)
    wrong = [("width", -1.0), ("held_out", [99]), ("held_out", [1.7])]
    refuses(learnt, *(({"hands": few, name: value}, name) for name, value in [*wrong, ("solvers", "daqp")]))
