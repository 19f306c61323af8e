"""The simulated person and robot, with the numbers of a problem file."""

from __future__ import annotations

from rehab_opt.errors import ConfigurationError, ProblemFileError
from rehab_opt.plants.force_robot import RobotModel
from rehab_opt.plants.hand_robot import MakesRobots, OnMujoco, WithoutDelay
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.plant.making import channel_of, ms
from rehab_opt.session.scenario.problem import ScenarioProblem
from rehab_opt.session.scenario.simulated_person import Person

__all__ = ["hand_robot_of", "person_of", "robot_model_of"]

STABLE = 1 + 1e-6
"""Growth a tick that rounding makes of none."""


def person_of(problem: ScenarioProblem) -> Person:
    """The simulated person's numbers."""
    said = problem.person
    return Person(
        hand_mass=said.hand_mass_kg,
        stiffness=said.stiffness_N_m,
        damping=said.damping_Ns_m,
        persistence=said.persistence_per_s,
        strength=said.strength_N,
        weak_strength=said.weak_strength_N,
        fades_over=1e-3 * said.fades_over_mm,
        passive_stiffness=said.passive_stiffness_N_m,
        passive_damping=said.passive_damping_Ns_m,
        wander=1e-3 * said.wander_mm,
        wander_time=said.wander_s,
        tremor=said.tremor_N,
        tremor_hz=said.tremor_hz,
        spasm_rate=said.spasms_per_s,
        spasm_force=said.spasm_N,
        spasm_time=said.spasm_s,
        aims=said.aims,
        ahead=1e-3 * said.ahead_mm,
    )


def robot_model_of(loaded: ProblemFile[ScenarioProblem]) -> RobotModel:
    """The simulated robot's numbers.

    Raises
    ------
    ProblemFileError : its force loop is unstable with this hand, or a simulation in ticks so long is.
    """
    said, person, rate = loaded.problem.robot, loaded.problem.person, loaded.problem.run.rate_hz
    model = RobotModel(
        mass=said.mass_kg,
        viscous=said.viscous_Ns_m,
        coulomb=said.coulomb_N,
        gain=said.gain,
        integral=said.integral_per_s,
        noise=said.sensor_noise_N,
        motor_limit=said.motor_limit_N,
        lower=(said.lower_m[0], said.lower_m[1]),
        upper=(said.upper_m[0], said.upper_m[1]),
    )
    try:
        model.check(person.hand_mass_kg, dt=1 / rate)
    except ConfigurationError as refused:
        raise ProblemFileError(loaded.file, f"robot.{refused.argument}", refused.value, refused.expected) from refused
    stiff, tough = person.stiffness_N_m, person.damping_Ns_m
    held = (
        (0.0, 0.0),
        (person.passive_stiffness_N_m, 0.0),
        (stiff, tough),
        (stiff + person.passive_stiffness_N_m, tough),
    )
    grows = max(
        model.growth(person.hand_mass_kg, stiffness=k, damping=d + person.passive_damping_Ns_m, dt=1 / rate)
        for k, d in held  # in and out of W_c, with the will saturated and not
    )
    if not grows <= STABLE:
        expected = "a higher rate, or softer robot and person (springs, dampers, viscous_Ns_m, gains; heavier masses)"
        value = f"{rate:g}, at which their simulation grows {grows:.3g}-fold a tick"
        raise ProblemFileError(loaded.file, "run.rate_hz", value, expected)
    return model


def hand_robot_of(loaded: ProblemFile[ScenarioProblem]) -> MakesRobots:
    """The simulated robot on the file's plant; raises as `robot_model_of`."""
    model, table = robot_model_of(loaded), loaded.problem.plant
    if table.kind == "ideal":
        return WithoutDelay(model)
    channel = channel_of(table, table.position_noise_m, table.position_resolution_m)
    return OnMujoco(model, channel, ms(table.force_lag_ms), ms(table.physics_step_ms), table.seed)
