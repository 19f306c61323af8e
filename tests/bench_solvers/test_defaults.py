"""What the comparison calls a default is what the controllers use where nothing is said."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

import pytest

from bench.solvers.entrants import entrants
from bench.solvers.recommendation import DEFAULTS, FALLBACK
from rehab_opt import ArmIK, MirrorTracker, PoseTracker, RedundancyResolver
from rehab_opt.control.bounded_force import BoundedForce
from rehab_opt.field.learning import learnt_field
from rehab_opt.optim.fallback_chain import FallbackChain
from rehab_opt.optim.qp import Statement
from rehab_opt.optim.rows import parameter, variable

TICKS = {"ardis", "assistance", "mirror", "pose_tracking"}
"""Families of capabilities that solve a QP each tick."""


def default(of: Callable[..., Any], argument: str) -> Any:
    return inspect.signature(of).parameters[argument].default


def test_a_tick_s_default_is_the_fallback_that_is_compared() -> None:
    """The entrant "fallback": fused qrqp, then the backup that it is made with."""
    (entrant,) = [each for each in entrants() if each.name == FALLBACK[0]]
    target, x = parameter("target", 1), variable("x", 1, lower=-1.0, upper=1.0)
    statement = Statement("one", parameters=[target], variables=[x], minimise=(x.symbol - target) ** 2 / 2)
    used = FallbackChain(statement, solver="qrqp", backup=None, tolerance=1e-9, compile=False)
    assert (used.solver, used.backup) == ("qrqp", entrant.solver)
    assert not TICKS & set(DEFAULTS)  # where nothing is said, the fallback is meant


@pytest.mark.parametrize("controller", [PoseTracker, RedundancyResolver, BoundedForce])
def test_a_controller_leaves_the_fallback_as_it_is(controller: type) -> None:
    assert (default(controller, "solver"), default(controller, "backup")) == ("qrqp", None)
    assert issubclass(MirrorTracker, PoseTracker)  # which has its solver


def test_the_defaults_of_programmes_and_of_learning_are_the_ones_that_are_compared() -> None:
    assert default(ArmIK, "solver") == DEFAULTS["nlp_arm_ik"][0] == DEFAULTS["nlp_boundary"][0]
    assert default(learnt_field, "solvers")[0] == DEFAULTS["field_learning"][0]
