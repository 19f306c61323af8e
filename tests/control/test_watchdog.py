import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rehab_opt.control.watchdog import Watchdog, default_max_age
from tests.refusals import refuses

DT = 0.001


def faults(stamps, *, dt=DT, max_age=0.05):
    dog = Watchdog(dt=dt, max_age=max_age)
    return [dog.check(stamp) for stamp in stamps]


@pytest.mark.parametrize("origin", [0.0, 1.7e9])
def test_a_steady_stream_is_fine_from_any_origin(origin):
    assert not any(faults([origin + k * DT for k in range(2_000)]))


def test_a_stamp_that_is_missing_after_others_is_a_fault_until_stamps_come_again():
    assert faults([None, 0.0, None, None, 3 * DT]) == ["", "", "stamp is missing", "stamp is missing", ""]
    dog = Watchdog(dt=DT)
    dog.check(0.0)
    dog.reset()
    assert dog.check(None) == ""


@pytest.mark.parametrize("bad", [math.nan, 0.0, 0.1])
def test_a_steady_stream_recovers_within_two_ticks_of_one_bad_stamp(bad):
    stamps = [0.004 + k * DT for k in range(1, 200)]
    stamps[50] = bad
    found = [k for k, reason in enumerate(faults(stamps)) if reason]
    assert found
    assert set(found) <= {50, 51}  # a jump ahead by less than max_age shows only as the way back


def test_a_frozen_stream_that_goes_on_where_it_stood_is_stale():
    stamps = [k * DT for k in range(10)] + [9 * DT] * 100 + [9 * DT + k * DT for k in range(1, 10)]
    assert all("repeated" in reason for reason in faults(stamps)[10:110])
    stale = faults(stamps)[110:]
    assert all(re.search(r": 0\.(0999|1) s behind the ticks, at most 0\.05 s$", reason) for reason in stale), stale


@pytest.mark.parametrize(("slower", "dt"), [(1.6, 0.001), (45.0, 0.0005), (5.0, 0.02)])
def test_a_loop_that_is_slower_than_dt_is_told_so_before_long(dt, slower):
    """Within 50 ms, or three ticks, more than one and a half of the ticks that there were; and not for good."""
    most = default_max_age(dt)
    rng = np.random.default_rng(int(1e3 * slower))
    period = dt * slower if dt * slower < most else 0.9 * most
    every = period * np.cumsum(rng.uniform(0.9, 1.1, 2000))
    dog = Watchdog(dt=dt)
    found = [dog.check(stamp) for stamp in every.tolist()]
    first = next(k for k, reason in enumerate(found) if reason)
    assert first <= 2 + most / (0.85 * period - 1.5 * dt) if 0.85 * period > 1.5 * dt else first < 2000
    assert "the loop is slower than dt" in found[first]
    assert all(found[first:])
    after = [dog.check(every[-1] + (k + 1) * dt) for k in range(int(2 * most / dt))]
    assert not after[-1]


@pytest.mark.parametrize("seed", range(1))
def test_ticks_that_are_late_now_and_then_are_no_slow_loop(seed):
    """A fifth of the samples lost or late, and a stall of less than the largest age now and then."""
    rng = np.random.default_rng(seed)
    period = np.where(rng.random(20_000) < 0.2, rng.uniform(1.0, 3.0, 20_000), rng.uniform(0.95, 1.05, 20_000))
    period[500::1000] = 45.0
    assert not any(faults(DT * np.cumsum(period)))


def test_clocks_that_drift_apart_as_quartz_does_never_become_stale():
    assert not any(faults(k * DT * (1 - 2e-4) for k in range(60_000)))


@given(
    stamps=st.lists(st.one_of(st.none(), st.floats(), st.integers())),
    dt=st.floats(1e-4, 0.1),
    extra=st.floats(0.01, 10),
)
def test_nothing_a_stamp_can_be_raises(stamps, dt, extra):
    dog = Watchdog(dt=dt, max_age=dt + extra)
    for stamp in stamps:
        assert isinstance(dog.check(stamp), str)
        assert dog.lag >= 0.0


def test_the_default_age_is_more_than_two_lost_samples():
    assert default_max_age(0.001) == 0.05
    assert default_max_age(0.1) == pytest.approx(0.3)


def test_unusable_arguments_are_refused_by_name():
    numbers = [("dt", 0.0), ("dt", math.nan), ("dt", math.inf), ("max_age", DT), ("max_age", math.nan)]
    none = [(name, value) for name in ("dt", "max_age") for value in ("x", [1.0], {}, 1j, np.ones(2))]
    refuses(Watchdog, *(({"dt": DT, name: value}, name) for name, value in numbers + none))
