"""Even samples out of uneven ones: what is interpolated, filtered and given up, whole and as a stream."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rehab_opt import ConfigurationError
from rehab_opt.control.conditioning import Conditioned, Conditioner, conditioned

NO_TURN = np.array([0.0, 0.0, 0.0, 1.0])


def streamed(times: np.ndarray, positions: np.ndarray, quaternions: np.ndarray, **options: float) -> Conditioned:
    rule = Conditioner(**options)  # type: ignore[arg-type]
    parts = [rule.push(*sample) for sample in zip(times, positions, quaternions, strict=True)]
    columns = [np.concatenate([np.atleast_1d(part[i]) for part in parts]) for i in range(4)]
    return Conditioned(*columns, dropped=rule.dropped, gaps=rule.gaps)  # type: ignore[arg-type]


def motion(n: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    times = 3.0 + np.cumsum(rng.uniform(0.002, 0.02, n))
    positions = np.stack([0.3 * np.sin(times), 0.2 * np.cos(2 * times), 0.1 * times], axis=1)
    turns = Rotation.from_euler("zx", np.stack([4 * times, 0.5 * np.sin(times)], axis=1))
    return times, positions, turns.as_quat() * rng.choice([-1.0, 1.0], (n, 1))


@pytest.mark.parametrize(("at", "wild"), [(0, 2), (1, 1), (50, 2)])
def test_a_stamp_of_the_future_is_left_out_as_a_spike_is(at: int, wild: int) -> None:
    """Sight was lost until the clock had caught up: one stamp 30 s ahead took 349 of 400 samples, in silence."""
    times = 0.01 * np.arange(400)
    positions, turns = np.outer(np.sin(times), [0.1, 0.1, 0.1]), np.tile(NO_TURN, (400, 1))
    times[at : at + wild] += 30.0
    for found in (conditioned(times, positions, turns, dt=0.005), streamed(times, positions, turns, dt=0.005)):
        assert found.dropped == wild + (at == 1)  # one sample before it is no stretch
        assert found.gaps == (at > 1)
        assert found.lost.sum() <= 2 * (wild + 1)
        assert found.times[-1] == pytest.approx(3.99)


def test_nothing_usable_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="valid"):
        conditioned([0.0, 1.0], np.full((2, 3), np.nan), np.tile(NO_TURN, (2, 1)), dt=0.01)


def test_a_clock_that_was_set_gives_no_ticks_of_the_years_between() -> None:
    """A stream whose stamps went over to seconds since 1970 filled the memory; 1e12 ticks were lost in one push."""
    stamps = np.concatenate([0.01 * np.arange(10), 1.7e9 + 0.01 * np.arange(10), 1.7e9 + 500 + 0.01 * np.arange(10)])
    places, turns = np.tile([0.1, 0.2, 0.3], (30, 1)), np.tile(NO_TURN, (30, 1))
    given = streamed(stamps, places, turns, dt=0.01)
    assert given.gaps == 2
    assert given.times[:20].tolist() == stamps[:20].tolist()
    assert np.diff(given.times[10:]) == pytest.approx(0.01, abs=1e-6)
    assert given.lost.sum() == given.lost[20:-10].sum() == 50_000 - 10
    with pytest.raises(ConfigurationError, match=r"a gap of 1\.7e\+09 s.*: expected no more than 600 s"):
        conditioned(stamps, places, turns, dt=0.01)


@pytest.mark.parametrize("unit", ["mm", "ms", "a sample every 0.2 s"])
def test_samples_of_which_none_go_together_are_told_what_would(unit: str) -> None:
    times, positions, turns = motion(100, 3)
    scaled = {"mm": (times, 1e3 * positions), "ms": (1e3 * times, positions)}
    given = scaled.get(unit, (0.2 * np.arange(100), positions))
    with pytest.raises(ConfigurationError, match=r"100 finite samples.*\[s\] at most 0\.1 apart .* \[m\] .* 5 m/s"):
        conditioned(*given, turns, dt=0.01)
