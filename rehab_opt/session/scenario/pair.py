"""Helper and participant of a problem file as a law of the loop, and what is measured of the two together."""

from __future__ import annotations

from typing import Any

import numpy as np

from rehab_opt.control.bilateral import Bilateral
from rehab_opt.control.bilateral_sides import HelperSide, ParticipantSide
from rehab_opt.errors import ConfigurationError, ProblemFileError
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.scenario.bounds import bounds_of, bounds_refusals
from rehab_opt.session.scenario.intention import traced
from rehab_opt.session.scenario.plant import hand_robot_of
from rehab_opt.session.scenario.prepared import Prepared
from rehab_opt.session.scenario.problem import ScenarioProblem
from rehab_opt.session.scenario.simulated_person import Person
from rehab_opt.session.scenario.together import Helper, Together
from rehab_opt.session.scenario.trial import Trial

__all__ = ["pair_measures", "pair_of", "sides_of", "together_of"]


def pair_of(loaded: ProblemFile[ScenarioProblem], ready: Prepared, *, delay: float, solver: str | None) -> Together:
    """The pair of a mapped path, `delay` [s] apart.

    Raises
    ------
    ProblemFileError : a value of the file cannot be used.
    ConfigurationError : `solver` cannot be used.
    """
    return together_of(Bilateral(*sides_of(loaded, ready, solver=solver), delay=delay), loaded, ready)


def sides_of(
    loaded: ProblemFile[ScenarioProblem], ready: Prepared, *, solver: str | None, backup: str | None = None
) -> tuple[HelperSide, ParticipantSide]:
    """Both sides of a mapped path; raises as `pair_of`."""
    problem, said, helper = loaded.problem, loaded.problem.assistance, loaded.problem.helper
    assert ready.carry is not None  # the schema refuses a pair without a map
    bounds = bounds_of(problem, solver=solver)
    bounds["backup"] = backup
    with bounds_refusals(loaded, solver=solver, section="helper or assistance"):
        return (
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
        )


def together_of(both: Bilateral, loaded: ProblemFile[ScenarioProblem], ready: Prepared) -> Together:
    """The pair as a law, with a simulated helper.

    Raises
    ------
    ProblemFileError : a value of the file cannot be used.
    """
    task, helper, dt = loaded.problem.task, loaded.problem.helper, both.dt
    assert ready.demonstrated is not None
    meant = traced(ready.demonstrated, seconds=task.movement_s, rest=task.rest_s, dt=dt)
    healthy = Person(wander=1e-3 * helper.wander_mm, tremor=0.0, spasm_rate=0.0)
    robot = hand_robot_of(loaded)
    try:
        robot.model.check(healthy.hand_mass, dt=dt)
    except ConfigurationError as refused:
        key = f"robot.{refused.argument}"
        raise ProblemFileError(loaded.file, key, refused.value, f"{refused.expected}, the helper's") from refused
    return Together(both, Helper(healthy, robot, ready.reachable, meant), seed=task.seed)


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
