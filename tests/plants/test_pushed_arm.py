"""A push on an arm with mass, servos, delay and noise: what the person feels of `Interaction`'s defaults."""

from __future__ import annotations

import functools
import itertools
import math

import numpy as np
import pytest

from bench.physics.arms import ARMS
from bench.physics.following import follow
from bench.physics.forces import SpringDamper
from rehab_opt import Interaction, MirrorTracker
from rehab_opt.plants.channel import Channel
from rehab_opt.plants.mujoco_arm import MujocoArm
from rehab_opt.plants.plant import Measurement

pytest.importorskip("mujoco")
DT = 0.002
WIDEST = {"UR5": 0.128, "iiwa 14": 0.2}
"""Of manipulability, about: the floor is not what is tested here."""


@functools.cache
def tracker(name: str) -> MirrorTracker:
    arm = next(each() for each in ARMS.values() if each().name == name)
    return MirrorTracker(arm.chain, dt=DT, max_manipulability=WIDEST[name], compile=False)


@pytest.mark.parametrize(
    ("name", "delay"),
    [
        ("UR5", 0.008),
        *(
            pytest.param(*each, marks=pytest.mark.nightly)
            for each in (("UR5", 0.0), ("iiwa 14", 0.0), ("iiwa 14", 0.008))
        ),
    ],
)
def test_it_gives_way_calmly_and_comes_back(name: str, delay: float) -> None:
    rng = np.random.default_rng([round(1e3 * delay), len(name)])
    arm = next(each() for each in ARMS.values() if each().name == name)
    robot, law, start = tracker(name), Interaction(), arm.start(rng, 0.1)
    robot.reset()
    channel = Channel(command_delay=delay / 2, measurement_delay=delay / 2, position_noise=1e-4, force_noise=2.0)
    plant = MujocoArm(arm.model, dt=DT, channel=channel, seed=rng)
    way = rng.normal(size=3)
    way /= np.linalg.norm(way)
    pose, begin, end = arm.chain.pose(start), round(0.2 / DT), round(2.2 / DT)
    run = follow(
        plant, arm.chain, start, end + round(2.0 / DT),
        lambda _, seen: robot.step(seen.position, pose, np.zeros(6), force=seen.force),
        each=lambda k, _: 28.0 * way if begin <= k < end else None,
    )  # fmt: skip
    places = run.hand - pose[:3, 3]
    fraction = places[begin + round(1.0 / DT) : end] @ way * law.stiffness / 28.0
    assert law.stiffness <= 600.0
    assert 0.8 <= fraction.min() <= fraction.max() <= 1.2
    assert run.hand_speed().max() <= 0.25
    assert np.linalg.norm(places[-1]) <= 5e-3
    assert sum(a is not b for a, b in itertools.pairwise(run.status)) <= 4


@pytest.mark.parametrize(("hertz", "newtons"), [(15.0, 60.0), (6.0, 40.0)])
def test_a_hand_that_is_shaken_is_given_no_more_than_it_gave_and_twice_the_reserve(
    hertz: float, newtons: float
) -> None:
    arm = ARMS[next(iter(ARMS))]()
    law, start, delay = Interaction(), arm.ready, 0.008
    robot = tracker(arm.name)
    robot.reset()
    channel = Channel(command_delay=delay / 2, measurement_delay=delay / 2, position_noise=1e-4, force_noise=2.0)
    plant = MujocoArm(arm.model, dt=DT, channel=channel, seed=np.random.default_rng(3))
    way, pose = np.array([0.6, 0.0, 0.8]), arm.chain.pose(start)

    def push(k: int) -> np.ndarray:
        return np.asarray(newtons * math.sin(2 * math.pi * hertz * k * DT) * way)

    def step(_: int, seen: Measurement):  # type: ignore[no-untyped-def]
        return robot.step(seen.position, pose, np.zeros(6), force=seen.force)

    run = follow(plant, arm.chain, start, 1000, step, each=lambda k, _: push(k))
    moves, forces = np.diff(run.hand, axis=0), np.array([push(k) for k in range(999)])
    work = np.cumsum(np.einsum("ki,ki->k", forces, moves))
    assert work.min() >= -2 * law.reserve  # what the servo's own spring keeps comes on top
    assert run.hand_speed().max() <= 0.35


@pytest.mark.parametrize("stiffness", [300.0, 3000.0])
def test_a_person_who_holds_the_hand_elsewhere_meets_the_arm_half_way_and_at_rest(stiffness: float) -> None:
    arm, delay, way = ARMS[next(iter(ARMS))](), 0.008, np.array([0.6, 0.0, 0.8])
    robot, law, start = tracker(arm.name), Interaction(), arm.ready
    robot.reset()
    pose, off = arm.chain.pose(start), 0.03
    person = SpringDamper(pose[:3, 3] + off * way, stiffness=stiffness)
    channel = Channel(command_delay=delay / 2, measurement_delay=delay / 2, position_noise=1e-4, force_noise=2.0)
    plant = MujocoArm(arm.model, dt=DT, channel=channel, contacts=(person,), seed=np.random.default_rng(3))
    run = follow(
        plant, arm.chain, start, 1000, lambda _, seen: robot.step(seen.position, pose, np.zeros(6), force=seen.force)
    )  # fmt: skip
    late = slice(750, None)
    assert run.hand_speed(late).max() <= 0.04
    moved = (run.hand[late] - pose[:3, 3]) @ way
    np.testing.assert_allclose(moved, off * stiffness / (stiffness + law.stiffness), rtol=0.1)
    assert np.linalg.norm(run.force[late], axis=1).std() <= 1.0
    assert run.hand_speed().max() <= 0.26  # commanded are 0.25, which a servo overshoots
