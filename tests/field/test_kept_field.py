"""Numbers of fields, kept: made, merged and learnt on seeded paths."""

from __future__ import annotations

from itertools import product

import numpy as np

from rehab_opt import ConfigurationError, PotentialField
from rehab_opt.field.demonstration import Demonstration, check_agreement, check_closeness, check_units
from rehab_opt.field.energy import field_function, field_function_in_blocks, field_table
from rehab_opt.field.fit import constant_stiffness_error, identified
from rehab_opt.field.merging import merged
from rehab_opt.field.samples import mean_path
from rehab_opt.field.settling import crossover, fitting_damping, fitting_slew, settling_notes
from tests.field.demonstrators import WAY, led_hands
from tests.golden import assert_kept
from tests.golden.returns import Returns, sums

HOOK = np.column_stack([np.linspace(-0.15, 0.15, 200), 0.4 + 0.08 * np.linspace(-0.5, 1, 200) ** 3])
POINTS = np.random.default_rng(0).uniform((-0.25, 0.3), (0.25, 0.6), (12, 2))


def test_fields() -> None:
    rng, more = np.random.default_rng(1), []
    with Returns("rehab_opt/field/") as seen:
        for rest, given in product((True, False), ({"drag": 200.0}, {"drag": 150.0, "drag_along": "travelled"},
                                                   {"stiffness": [500.0, 1500.0], "spacing": 2e-3})):  # fmt: skip
            if rest and given.get("drag_along"):
                continue
            for path in (HOOK, [HOOK, HOOK + (0.004, 0.006)]):
                made = PotentialField(path, **{"stiffness": 900.0, "width": 0.025, "damping": 8.0,
                                               "rest_on_target": rest, "compile": False} | given)  # fmt: skip
                more += [made.force(POINTS, 0.1 * POINTS), made.energy(POINTS), made.stiffness(POINTS[0])]
                more += [made.force(POINTS[1], POINTS[2]), made.pull(0.1, 0.45)]
                more += [made.length, made.rest_stiffness, made.rests]
        table = field_table(made.samples)
        for function in (field_function(len(table)), field_function_in_blocks(len(table))):
            sample = table if function.size_in(1)[0] == len(table) else table.T
            more += [np.array(each) for point in POINTS for each in function(point, sample, 1 / 0.025**2)]
        dense = PotentialField(HOOK, stiffness=np.linspace(400, 2000, 200), width=0.02, drag=99.0, spacing=1.5e-4,
                               rest_on_target=False, compile=False)  # fmt: skip
        for width, most in ((0.02, 1000), (0.05, 60), (0.005, 30)):
            more.append(merged(dense.samples, width, most))
        for stiffness, damping, delay in product((100.0, 5000.0), (0.0, 40.0), (0.0, 0.008)):
            times = {"delay": delay, "lag": 0.5 * delay, "velocity_lag": 0.003}
            more += [crossover(stiffness, damping, mass=2.0, **times), fitting_damping(stiffness)]
            more.append(fitting_slew(stiffness, damping, force_limit=30.0, velocity_lag=0.003))
            for slew in (100.0, 1e5):
                more.append([*settling_notes(stiffness, damping, force_limit=30.0, slew_limit=slew, **times)])
        more.append(mean_path([WAY + 0.002 * rng.normal(size=WAY.shape) for _ in range(3)], 0.01))
    assert_kept("field.fields", [seen.numbers(), [sums(each) for each in more]], relative=1e-5, absolute=1e-8)


def test_learnt() -> None:
    truth, more = PotentialField(WAY, stiffness=1000.0, drag=200.0, damping=8.0, width=0.025, compile=False), []
    hands = led_hands(truth, count=6, samples=120, noise=0.5)
    with Returns("rehab_opt/field/", last=12) as seen:
        for given in ({}, {"width": [0.02, 0.03], "held_out": [0, 3]},
                      {"path": None, "rest_on_target": False}, {"held_out": []}):  # fmt: skip
            fit = PotentialField.learn(hands, **{"width": 0.025, "path": WAY, "compile": False} | given).fit
            more += [
                fit.parameters,
                fit.standard_error,
                [*fit._replace(seconds=0.0, residual=0.0, singular_values=0.0)[2:]],
            ]
        design = np.random.default_rng(3).normal(size=(60, 4))
        design[:, 3] = 0.0
        for lean in (
            0.0,
            1e-5,
            0.3,
            0.44,
            1.0,
        ):  # how much of a column another one is: a weak direction shared unevenly
            design[:, 2] = design[:, 0] + lean * design[:, 1] + 1e-9 * design[::-1, 1]
            more.append(identified(design, [*"abcd"], design[:, 1], [25, 35]).unidentified)
        more += [constant_stiffness_error(WAY, hands[:4], hands[4:])]
        rising = np.cumsum(np.linspace(0.01, 0.03, 60))
        more += [
            Demonstration(WAY[:60], np.ones((60, 2)), **given).velocities for given in ({"dt": 0.02}, {"times": rising})
        ]
        for wrong in ([Demonstration(1e-3 * h.positions, h.forces, h.velocities) for h in hands],
                      [hands[0], Demonstration(hands[1].positions[::-1], hands[1].forces, hands[1].velocities)],
                      [hands[0], Demonstration(hands[1].positions + 0.05, hands[1].forces,
                                               hands[1].velocities)]):  # fmt: skip
            for check in (
                check_units,
                lambda h: check_agreement(h, None, 0.025),
                lambda h: check_closeness(h, [WAY], 0.025),
            ):
                try:
                    more.append(check(wrong))
                except ConfigurationError as told:
                    more.append(str(told))
    assert_kept(
        "field.learnt",
        [seen.numbers(with_constants=False), [sums(each) for each in more]],
        relative=1e-3,
        absolute=1e-6,
    )
