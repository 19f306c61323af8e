"""Even samples out of uneven ones: what is interpolated, filtered and given up, whole and as a stream."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
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


@given(seed=st.integers(0, 2**32 - 1), faults=st.integers(0, 6), dt=st.sampled_from([0.001, 0.004, 0.02]))
@settings(max_examples=20, deadline=None)
def test_stream_and_whole_agree_to_rounding_whatever_is_wrong(seed: int, faults: int, dt: float) -> None:
    times, positions, quaternions = motion(120, seed)
    rng = np.random.default_rng(seed)
    for _ in range(faults):
        at, kind = rng.integers(1, 110), rng.integers(8)
        if kind == 0:
            positions[at : at + rng.integers(1, 5), 1] = math.nan
        elif kind == 1:
            times[at] = times[at - 1]
        elif kind == 2:
            times[at:] += 0.3
        elif kind == 3:
            positions[at] += 2.0
        elif kind == 4:
            positions[at:] += 1.5
        elif kind == 5:
            times[at : at + rng.integers(1, 5)] += rng.uniform(0.05, 5.0)
        elif kind == 6:
            times[at:] -= rng.uniform(0.0, 0.1)
        else:
            quaternions[at] = 0.0
    whole = conditioned(times, positions, quaternions, dt=dt)
    stream = streamed(times, positions, quaternions, dt=dt)
    assert len(stream.times) <= len(whole.times)
    assert len(stream.times) >= len(whole.times) - 0.2 / dt
    n = len(stream.times)
    for a, b in zip(stream[:3], whole[:3], strict=True):
        np.testing.assert_allclose(a, b[:n], rtol=0, atol=1e-9 / dt if a.ndim == 2 else 1e-12)  # twists: over dt
    np.testing.assert_array_equal(stream.lost, whole.lost[:n])
    assert stream.gaps == whole.gaps


def test_a_ramp_is_delayed_by_the_stated_lag() -> None:
    times = np.arange(0, 3, 0.011)
    positions = np.outer(times, [0.2, -0.1, 0.05])
    for dt, cutoff in ((0.001, 8.0), (0.005, 3.0)):
        rule = Conditioner(dt, cutoff_hz=cutoff)
        out = conditioned(times, positions, np.tile(NO_TURN, (len(times), 1)), dt=dt, cutoff_hz=cutoff)
        lag = out.times[-1] - out.poses[-1, 0, 3] / 0.2
        assert lag == pytest.approx(rule.lag, abs=1e-6)
        np.testing.assert_allclose(out.twists[-1, :3], [0.2, -0.1, 0.05], atol=1e-6)


def test_a_turn_has_its_angular_velocity_also_across_the_seam() -> None:
    times = np.arange(0, 4, 0.01)
    quaternions = Rotation.from_euler("z", 2.0 * times[:, None]).as_quat()
    out = conditioned(times, np.zeros((len(times), 3)), quaternions, dt=0.002)
    assert not out.lost.any()
    np.testing.assert_allclose(out.twists[300:, 5], 2.0, atol=0.01)
    np.testing.assert_allclose(out.twists[:, 3:5], 0.0, atol=1e-9)


def test_without_a_filter_even_samples_come_back_as_they_were() -> None:
    times = np.arange(200) * 0.01
    _, positions, quaternions = motion(200, 1)
    positions = np.cumsum(0.01 * np.sin(positions), axis=0)
    quaternions = Rotation.from_euler("x", times[:, None]).as_quat()
    out = conditioned(times, positions, quaternions, dt=0.01, cutoff_hz=math.inf)
    np.testing.assert_allclose(out.poses[:, :3, 3], positions[: len(out.times)], atol=1e-12)
    assert Conditioner(0.01, cutoff_hz=math.inf).lag == 0.0


@pytest.mark.parametrize("fault", ["gap", "jump", "spike", "nan"])
def test_lost_sight_is_made_known_and_what_follows_starts_anew(fault: str) -> None:
    times = np.arange(300) * 0.01
    positions = np.outer(np.sin(times), [0.1, 0.1, 0.1])
    quaternions = np.tile(NO_TURN, (300, 1))
    if fault == "gap":
        times[150:] += 0.5
    elif fault == "jump":
        positions[150:] += 1.0
    elif fault == "spike":
        positions[150] += 1.0
    else:
        positions[150:170] = math.nan
    out = conditioned(times, positions, quaternions, dt=0.005)
    assert out.gaps == 1
    assert out.lost.any()
    assert np.isnan(out.poses[out.lost, 0, 3]).all()
    assert np.isfinite(out.poses[~out.lost]).all()
    assert np.abs(np.diff(out.poses[:, 0, 3]))[~np.isnan(np.diff(out.poses[:, 0, 3]))].max() < 1e-3
    if fault == "spike":
        assert out.lost.sum() <= 4
        assert out.dropped == 1


@pytest.mark.parametrize("wild", [1, 2])
@pytest.mark.parametrize("at", [0, 1, 50, 51])
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
    with pytest.raises(ConfigurationError, match="usable"):
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
