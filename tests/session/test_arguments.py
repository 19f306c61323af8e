"""What sections of a problem file say reaches the library in its own names and units, and comes back in the file's."""

from __future__ import annotations

import math
from dataclasses import fields

import pytest
from pydantic import Field

from rehab_opt.errors import ConfigurationError, ProblemFileError, RobotFileError
from rehab_opt.plants.force_robot import RobotModel
from rehab_opt.plants.simulated_person import Person
from rehab_opt.session.files import load_problem
from rehab_opt.session.refusals import refused_as
from rehab_opt.session.scenario.loop import person_of
from rehab_opt.session.scenario.problem import PersonSection, RobotSection
from rehab_opt.session.schema import Section


class Everything(Section):
    """A key of each kind."""

    width_mm: float = 30.0
    lag_ms: float = 5.0
    tilt_deg: float = 180.0
    turning_deg_s: float = 90.0
    jerk_deg_s3: float = 360.0
    speed_m_s: float = 0.5
    force_N: float = 12.0  # noqa: N815
    stiffness_N_m: float = 300.0  # noqa: N815
    mass_kg: float = 2.0
    noise_rad: float = 1e-4
    rate_hz: float = 100.0
    most: int = 7
    ends_mm: list[float] = Field(default=[1.0, 2.0])
    nothing_m: float | None = None


def test_numbers_reach_the_library_in_si_units_by_names_without_them() -> None:
    expected = {
        "width": 0.03, "lag": 0.005, "tilt": math.pi, "turning": math.pi / 2, "jerk": 2 * math.pi, "speed": 0.5,
        "force": 12.0, "stiffness": 300.0, "mass": 2.0, "noise": 1e-4, "rate_hz": 100.0, "most": 7,
    }  # fmt: skip
    found = Everything().arguments()
    assert found.pop("ends") == (0.001, 0.002)
    assert found == pytest.approx(expected, rel=1e-15)


def test_the_person_and_the_robot_of_a_file_that_says_nothing_are_the_library_s_own() -> None:
    config = load_problem("upper_limb/scenario_5_hold")
    silent = config.problem.model_copy(update={"person": PersonSection()})
    assert person_of(silent) == Person()
    own = RobotSection().arguments(sensor_noise_N="noise")
    assert RobotModel(**own) == RobotModel(lower=(-10.0, -10.0), upper=(10.0, 10.0))
    assert set(own) == {each.name for each in fields(RobotModel)}


def test_a_refusal_names_the_file_s_key() -> None:
    with (
        pytest.raises(ProblemFileError, match=r"arm.toml: arm.tilt = 3: expected less"),
        refused_as("arm.toml", "arm.{}".format),
    ):
        raise ConfigurationError("tilt", 3, "less")
    with pytest.raises(RobotFileError), refused_as("arm.toml", error=RobotFileError):
        raise ConfigurationError("tilt", 3, "less")


def test_a_solver_that_an_option_named_is_not_refused_to_the_file() -> None:
    with pytest.raises(ConfigurationError, match="solver") as refused, refused_as("arm.toml", option="osqp"):
        raise ConfigurationError("solver", "osqp", "another")
    assert not isinstance(refused.value, ProblemFileError)
    with pytest.raises(ProblemFileError), refused_as("arm.toml"):
        raise ConfigurationError("solver", "osqp", "another")
