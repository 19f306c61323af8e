"""Helper and participant of a problem file as a law of the loop, and what is measured of the two together."""

from __future__ import annotations

from typing import Any

import numpy as np

from rehab_opt.control.bilateral import Bilateral, HelperSide, ParticipantSide
from rehab_opt.control.bounded_force import ForceBounds
from rehab_opt.errors import ConfigurationError, ProblemFileError
from rehab_opt.optim.ladder import FUSED
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.scenario.intention import traced
from rehab_opt.session.scenario.prepared import Prepared, robot_model_of
from rehab_opt.session.scenario.problem import ScenarioProblem
from rehab_opt.session.scenario.simulated_person import Person
from rehab_opt.session.scenario.together import Helper, Together
from rehab_opt.session.scenario.trial import Trial
from rehab_opt.session.solver_option import solver_refusals

__all__ = ["pair_measures", "pair_of"]


def pair_of(loaded: ProblemFile[ScenarioProblem], ready: Prepared, *, delay: float, solver: str | None) -> Together:
    """The pair of a mapped path, `delay` [s] apart.

    Raises
    ------
    ProblemFileError : a value of the file cannot be used.
    ConfigurationError : `solver` cannot be used.
    """
    problem, said = loaded.problem, loaded.problem.assistance
    assert ready.carry is not None  # the schema refuses a pair without a map
    assert ready.demonstrated is not None
    dt = 1 / problem.run.rate_hz
    bounds: ForceBounds = {
        "slew_limit": said.slew_limit_N_s,
        "energy_budget": said.energy_budget_J,
        "speed_cap": said.speed_cap_m_s,
        "trust_stillness": True,  # a simulated sensor does not freeze
        "solver": solver or problem.run.solver or FUSED,
        "dt": dt,
    }
    helper = problem.helper
    try:
        with solver_refusals(solver, file=loaded.file, key="run.solver", value=problem.run.solver):
            both = Bilateral(
                HelperSide(
                    ready.carry,
                    damping=helper.hand_damping_Ns_m,
                    exchange=helper.exchange_per_s,
                    force_limit=said.force_limit_N,
                    **bounds,
                ),
                ParticipantSide(
                    ready.carry,
                    comfortable=ready.comfortable,
                    stiffness=helper.stiffness_N_m,
                    damping=helper.damping_Ns_m,
                    exchange=helper.exchange_per_s,
                    force_limit=said.force_limit_N,
                    **bounds,
                ),
                delay=delay,
            )
    except ConfigurationError as refused:
        if refused.argument.startswith("--") or isinstance(refused, ProblemFileError):
            raise
        key = "run.solver" if refused.argument == "solver" else f"helper or assistance, {refused.argument}"
        raise ProblemFileError(loaded.file, key, refused.value, refused.expected) from refused
    task = problem.task
    meant = traced(ready.demonstrated, seconds=task.movement_s, rest=task.rest_s, dt=dt)
    healthy = Person(wander=1e-3 * helper.wander_mm, tremor=0.0, spasm_rate=0.0)
    return Together(both, Helper(healthy, robot_model_of(loaded), ready.reachable, meant), seed=task.seed)


def pair_measures(trial: Trial) -> dict[str, Any]:
    """What the helper felt and did, and the most energy [J] that both hands together had drawn at any time."""
    helper = trial.helper
    if helper is None:
        return {}
    felt = np.linalg.norm(helper.commanded, axis=1)
    off = np.linalg.norm(helper.position - helper.intended, axis=1)
    drawn = sum(
        np.cumsum((force[:-1] * np.diff(position, axis=0)).sum(axis=1))
        for force, position in ((trial.commanded, trial.position), (helper.commanded, helper.position))
    )
    return {
        "helper_force_mean_N": float(felt.mean()),
        "helper_force_max_N": float(felt.max()),
        "helper_deviation_mean_m": float(off.mean()),
        "pair_energy_drawn_max_J": float(max(0.0, np.max(drawn))),
        "pair_energy_left_min_J": float(min(helper.energy_left.min(), trial.energy_left.min())),
    }
