"""Delays are exact, jitter overtakes nothing, noise has the size that was asked for, and a seed says all of it."""

import numpy as np
import pytest

from rehab_opt.plants.arm_model import point_mass_model
from rehab_opt.plants.channel import Channel
from rehab_opt.plants.drives import HandForce
from rehab_opt.plants.mujoco_arm import MujocoArm
from tests.refusals import refuses

pytest.importorskip("mujoco")
STEP = 5e-4


def mass(dt: float = 0.001, *, seed: int = 0, **channel: float) -> MujocoArm:
    plant = MujocoArm(point_mass_model(2.0), dt=dt, drive=HandForce(), channel=Channel(**channel), seed=seed)
    plant.reset([0.3, -0.2])
    return plant


@pytest.mark.parametrize(("dt", "delay"), [(0.001, 0.0), (0.001, 0.008), (0.002, 0.005)])
def test_a_command_acts_after_its_delay_and_not_before(dt: float, delay: float) -> None:
    plant = mass(dt, command_delay=delay)
    plant.step([0.0, 0.0])
    pushing = round(0.02 / dt)
    for _ in range(pushing):
        plant.step([3.0, 0.0])
    # Forces that acted from dt + delay until now, in whole steps of the physics: v = F t / m.
    np.testing.assert_allclose(plant.truth.velocity, [3.0 * (pushing * dt - delay) / 2.0, 0.0], atol=1e-12)


@pytest.mark.parametrize(("dt", "delay"), [(0.001, 0.0), (0.001, 0.008), (0.002, 0.005)])
def test_a_measurement_is_what_was_so_at_its_stamp(dt: float, delay: float) -> None:
    plant, seen, true = mass(dt, measurement_delay=delay), [], []
    for _ in range(50):
        seen.append(plant.step([3.0, -1.0]))
        true.append(plant.truth)
    late = [t.time - s.stamp for s, t in zip(seen, true, strict=True)]
    np.testing.assert_allclose(late[10:], delay, atol=1e-12)
    for one in seen[10:]:
        steps = round(one.stamp / STEP)
        # Semi-implicit Euler of a constant force, in closed form.
        moved = np.array([3.0, -1.0]) / 2.0 * STEP**2 * steps * (steps + 1) / 2
        np.testing.assert_allclose(one.position, [0.3, -0.2] + moved, atol=1e-12)


def test_jitter_stays_in_its_range_and_nothing_overtakes() -> None:
    plant = mass(command_delay=0.002, command_jitter=0.004, measurement_delay=0.001, measurement_jitter=0.003, seed=4)
    stamps, late = [], []
    for _ in range(2000):
        seen = plant.step([0.0, 0.0])
        stamps.append(seen.stamp)
        late.append(plant.truth.time - seen.stamp)
    assert np.all(np.diff(stamps) >= 0.0)
    steady = np.array(late[10:])
    # A stamp never goes back, so that a late one is followed by fresher ones; to one step of the physics.
    assert steady.min() >= 0.001 - 1e-12
    assert steady.max() <= 0.004 + STEP + 1e-12
    assert steady.std() > 0.0003


def test_of_jittered_commands_the_last_one_sent_rules_in_the_end() -> None:
    plant = mass(command_delay=0.001, command_jitter=0.006, seed=1)
    drive = plant.drive
    assert isinstance(drive, HandForce)
    acted = []
    for k in range(400):
        plant.step([float(k), 0.0])
        acted.append(float(drive.acting[0]))
    late = np.arange(400) - np.array(acted)
    assert np.all(np.diff(acted) >= 0.0)
    assert late[20:].min() >= 0.0
    assert late[20:].max() <= 7.0


def test_noise_has_its_size_and_no_bias_and_encoders_their_counts() -> None:
    plant = mass(position_noise=2e-4, velocity_noise=3e-3, force_noise=0.5, seed=9)
    seen = [plant.step([0.0, 0.0]) for _ in range(8_000)]
    for values, size in (
        (np.array([s.position for s in seen]) - [0.3, -0.2], 2e-4),
        (np.array([s.velocity for s in seen]), 3e-3),
        (np.array([s.force for s in seen]), 0.5),
    ):
        np.testing.assert_allclose(values.std(axis=0), size, rtol=0.03)
        assert np.all(np.abs(values.mean(axis=0)) < 4 * size / np.sqrt(len(values)))
        white = (values[1:] * values[:-1]).mean(axis=0) / size**2
        assert np.all(np.abs(white) < 4 / np.sqrt(len(values)))
    counted = mass(position_resolution=1e-3, position_noise=2e-4, seed=9)
    counts = np.array([counted.step([0.0, 0.0]).position for _ in range(100)]) / 1e-3
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-9)


def test_a_seed_says_everything_random() -> None:
    def run(seed: int) -> list[float]:
        plant = mass(command_jitter=0.003, measurement_jitter=0.002, position_noise=1e-4, force_noise=1.0, seed=seed)
        return [float(plant.step([1.0, k % 3]).position.sum()) for k in range(50)]

    assert run(5) == run(5)
    assert run(5) != run(6)


def test_what_is_no_delay_and_no_noise_is_refused() -> None:
    names, values = ("command_delay", "measurement_jitter", "position_noise", "force_noise"), (-1e-3, np.nan, np.inf)
    refuses(Channel, *(({name: value}, name) for name in names for value in values))
    refuses(Channel, ({"command_delay": 20.0}, "at most 10 s"))  # milliseconds, most likely
