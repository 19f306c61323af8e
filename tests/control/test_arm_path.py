"""A person's arm along a whole recording: within its range, never jumping, and in time where it has to be."""

import itertools
import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rehab_opt import human_arm
from rehab_opt.control.arm_path import CHANGE, ArmPath, _best_way, arm_path

ARM, DT = human_arm(range_of_motion="regular"), 0.01
GRIP = np.eye(4)
GRIP[:3, 3] = 0.0, 0.02, 0.05
MIDDLE, HALF = (ARM.lower + ARM.upper) / 2, (ARM.upper - ARM.lower) / 2


def reaches(seed: int, many: int) -> tuple[np.ndarray, np.ndarray]:
    """Tool poses of so many reaches, each between two postures, and whether they are such; the others are beyond all.

    From one reach to the next the hand goes a way that no arm of this length has, turning on it.
    """
    rng = np.random.default_rng(seed)
    found, within = [], []
    for _ in range(many):
        here = MIDDLE + 0.98 * HALF * np.sign(rng.uniform(-1, 1, ARM.n)) * rng.uniform(0.6, 1.0, ARM.n)
        there = np.clip(here + rng.uniform(-0.6, 0.6, ARM.n), ARM.lower, ARM.upper)
        s = np.linspace(0, 1, 40)[:, None]
        found += [ARM.pose(q) @ GRIP for q in here + s**3 * (10 - 15 * s + 6 * s**2) * (there - here)]
        axis = rng.standard_normal(3)
        for part in np.linspace(0, 1, 40):
            away = found[-1].copy()
            away[:3, :3] = Rotation.from_rotvec(0.08 * axis / np.linalg.norm(axis)).as_matrix() @ away[:3, :3]
            away[:3, 3] *= 1 + 0.15 * (1 - 2 * part)
            found.append(away)
        within += [True] * 40 + [False] * 40
    return np.array(found), np.array(within)


@pytest.fixture(scope="module", params=[3])
def case(request: pytest.FixtureRequest) -> tuple[np.ndarray, np.ndarray, ArmPath]:
    tools, within = reaches(request.param, 3)
    return tools, within, arm_path(ARM, GRIP, tools, dt=DT)


def test_every_posture_is_within_the_range_and_none_is_jumped_to(case: tuple[np.ndarray, np.ndarray, ArmPath]) -> None:
    _, _, path = case
    assert np.all((path.q >= ARM.lower - 1e-12) & (path.q <= ARM.upper + 1e-12))
    assert np.abs(np.diff(path.q, axis=0)).max() <= 0.03 + 1e-12  # 3 rad/s, also from one posture to another
    assert np.all(np.diff(path.reference_index) >= 0)
    assert set(path.reference_index) == set(range(240))  # nothing of the recording is left out


def test_what_is_led_along_is_where_the_hand_of_these_postures_is(case: tuple[np.ndarray, np.ndarray, ArmPath]) -> None:
    _, _, path = case
    np.testing.assert_allclose(path.poses, [ARM.pose(q) @ GRIP for q in path.q], atol=1e-12)
    places, turns = path.poses[:, :3, 3], Rotation.from_matrix(path.poses[:, :3, :3])
    moved = np.column_stack([np.diff(places, axis=0), (turns[1:] * turns[:-1].inv()).as_rotvec()])
    np.testing.assert_allclose(path.twists[1:], moved / DT, atol=1e-9)
    assert not path.twists[0].any()


def test_nearly_all_that_some_posture_reaches_is_reached(case: tuple[np.ndarray, np.ndarray, ArmPath]) -> None:
    tools, within, path = case
    asked = tools[path.reference_index]
    near = np.linalg.norm(path.poses[:, :3, 3] - asked[:, :3, 3], axis=1) < 2e-3
    cosine = (np.einsum("nij,nij->n", path.poses[:, :3, :3], asked[:, :3, :3]) - 1) / 2
    done = np.zeros(len(tools), dtype=bool)
    np.logical_or.at(done, path.reference_index, near & (cosine > math.cos(math.radians(2.0))))
    assert done[within].mean() > 0.98


@pytest.mark.parametrize("seed", range(5))
def test_no_other_way_through_the_postures_found_is_worth_more(seed: int) -> None:
    rng = np.random.default_rng(seed)
    tracks, missing = rng.uniform(-2.0, 2.0, (5, 4, 3)), rng.choice([0.3, 1.0, 1.1, 70.0, 500.0], (5, 4))

    def worth(way: tuple[int, ...]) -> float:
        postures, short = tracks[range(5), way], missing[range(5), way]
        reached, changes = short <= 1.0, np.abs(np.diff(postures, axis=0)).max(axis=1)
        return float(reached.sum() - 1e-4 * np.minimum(short, 100.0)[~reached].sum() - CHANGE * changes.sum())

    best = max(map(worth, itertools.product(range(4), repeat=5)))
    assert worth(tuple(_best_way(tracks, missing).tolist())) == pytest.approx(best, abs=1e-12)
