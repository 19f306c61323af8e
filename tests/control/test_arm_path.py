"""The way through the postures that are found for a person's arm is the best there is."""

import itertools

import numpy as np
import pytest

from rehab_opt.control.arm_path import CHANGE, _best_way


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
