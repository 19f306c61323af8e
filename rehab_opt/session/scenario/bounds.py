"""The bounds of a force as a problem file says them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from rehab_opt.control.bounded_force import BoundedForce, ForceBounds
from rehab_opt.errors import ConfigurationError, ProblemFileError
from rehab_opt.optim.ladder import FUSED
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.scenario.problem import ScenarioProblem
from rehab_opt.session.solver_option import solver_refusals

__all__ = ["bounds_of", "bounds_refusals", "check_bounds"]


def bounds_of(problem: ScenarioProblem, *, solver: str | None) -> ForceBounds:
    """What both sides of a pair and the assistance have in common; `solver` goes before the file's."""
    said = problem.assistance
    return {
        "slew_limit": said.slew_limit_N_s,
        "growth_limit": said.growth_limit_N_s,
        "energy_budget": said.energy_budget_J,
        "speed_cap": said.speed_cap_m_s,
        "trust_stillness": True,  # a simulated sensor does not freeze
        "solver": solver or problem.run.solver or FUSED,
        "dt": 1 / problem.run.rate_hz,
    }


@contextmanager
def bounds_refusals(loaded: ProblemFile[ScenarioProblem], *, solver: str | None, section: str) -> Iterator[None]:
    """Name the file's key, or `--solver`, where a law cannot be made.

    Raises
    ------
    ProblemFileError : a value of the file is refused.
    ConfigurationError : `solver` is.
    """
    try:
        with solver_refusals(solver, file=loaded.file, key="run.solver", value=loaded.problem.run.solver):
            yield
    except ConfigurationError as refused:
        if refused.argument.startswith("--") or isinstance(refused, ProblemFileError):
            raise
        key = "run.solver" if refused.argument == "solver" else f"{section}, {refused.argument}"
        raise ProblemFileError(loaded.file, key, refused.value, refused.expected) from refused


def check_bounds(loaded: ProblemFile[ScenarioProblem], *, solver: str | None) -> None:
    """Refuse solver and bounds before anything is computed; see `bounds_refusals`."""
    problem = loaded.problem
    with bounds_refusals(loaded, solver=solver, section="assistance"):
        BoundedForce(
            lambda *_: (0.0, 0.0), force_limit=problem.assistance.force_limit_N, **bounds_of(problem, solver=solver)
        )
