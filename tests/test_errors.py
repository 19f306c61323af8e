"""An error says in one line what it is about, and survives the way back from a pool of processes."""

import copy
import pickle
from collections.abc import Callable
from multiprocessing import get_context

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rehab_opt import ConfigurationError, ProblemFileError, RehabOptError, human_arm

values = st.one_of(
    st.none(), st.text(), st.floats(allow_nan=False), st.lists(st.integers()), st.tuples(st.text()),
    st.integers(240, 260).map("x".__mul__),
)  # fmt: skip


@given(st.text(min_size=1), values, st.text(min_size=1))
def test_a_configuration_error_names_argument_value_and_expectation(name: str, value: object, expected: str) -> None:
    error, whole = ConfigurationError(name, value, expected), repr(value)
    said = whole if len(whole) <= 250 else whole[:250] + "..."
    assert str(error) == f"{name} = {said}: expected {expected}"
    assert (error.argument, error.value, error.expected) == (name, value, expected)


@given(values)
def test_a_problem_file_error_names_file_key_value_and_expectation(value: object) -> None:
    error = ProblemFileError("arm.toml", "arm.side", value, "'left' or 'right'")
    assert str(error) == f"arm.toml: arm.side = {value!r}: expected 'left' or 'right'"
    assert "\n" not in str(error)


@pytest.mark.parametrize("again", [lambda error: pickle.loads(pickle.dumps(error)), copy.copy, copy.deepcopy])
def test_an_error_survives_pickling_and_copying(again: Callable[[RehabOptError], RehabOptError]) -> None:
    configured = ConfigurationError("dt", -1.0, "a positive number")
    in_a_file = ProblemFileError("a.toml", "arm.side", "up", "'left' or 'right'")
    assert isinstance(configured, ValueError)
    for error in (configured, in_a_file, RehabOptError("something")):
        error.add_note("while reading the arm")
        twin = again(error)
        assert type(twin) is type(error)
        assert (str(twin), vars(twin)) == (str(error), vars(error))


def _arm_of(side: str) -> int:
    return human_arm(side=side).n  # type: ignore[arg-type]


def test_a_bad_argument_in_another_process_is_reported_here() -> None:
    with get_context("spawn").Pool(1) as pool, pytest.raises(ConfigurationError, match="side = 'both'"):
        pool.map(_arm_of, ["both"])
