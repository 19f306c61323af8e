"""The run of `system = "scenario"`: the same person and task under each law, and what came of it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from rehab_opt.control.assistance import Assistance
from rehab_opt.control.path_assistance import PathAssistance
from rehab_opt.control.smoother import Smoother
from rehab_opt.field.samples import HAND_SPEED
from rehab_opt.published.field_law import FieldLaw
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.outcome import Array, Progress, with_progress
from rehab_opt.session.plant import plant_note
from rehab_opt.session.scenario.demonstrated import fit_metrics
from rehab_opt.session.scenario.laws import (
    Assisted,
    AssistedAtPoints,
    ForceLaw,
    Published,
    Unassisted,
    bounds_of,
    bounds_refusals,
    check_bounds,
    swinging_notes,
)
from rehab_opt.session.scenario.loop import (
    Arrival,
    Scene,
    hand_robot_of,
    person_of,
    robot_model_of,
    simulate_trial,
)
from rehab_opt.session.scenario.measures import COVERED, law_summary, trial_measures
from rehab_opt.session.scenario.outcome import Law, ScenarioOutcome, Trial
from rehab_opt.session.scenario.pair import pair_measures, pair_of
from rehab_opt.session.scenario.precomputed import Precomputed, precompute
from rehab_opt.session.scenario.problem import REACHES, THERAPY, ScenarioProblem

__all__ = ["assistance_of", "assisted_law", "law_of", "prepared", "run_scenario", "scene_of"]

SHORTEST_WAY = 1e-3
"""[m] between points; a single point needs no pace."""
FAR = 0.05
"""[m] Outside the reachable workspace from which on a hand is no person's: joints give way less."""
REST = 0.5
"""[s] A reach is over when the hand has been at its goal so long."""

WORSE = {
    "from_intended_mean_m": "was further from where the person meant to be",
    "deviation_mean_m": "deviated more",
    "reference_covered_fraction": "covered less",
}
"""Measures of a followed path, and how a note says that help made them worse."""
ASSUMPTIONS = (
    "person and robot are simulated: their masses, stiffnesses, strengths and disturbances are assumptions",
    "the field's numbers are choices of the file: S is not published for scenarios 1 to 3, sigma and k1 are suspect",
)


def run_scenario(config: ProblemFile[ScenarioProblem], *, solver: str | None, progress: Progress) -> ScenarioOutcome:
    """Every trial under every law of the file; raises as `prepared`."""
    problem = config.problem
    context, laws = prepared(config, solver=solver, progress=progress)
    scene, task = scene_of(config, context), problem.task
    trials: dict[Law, tuple[Trial, ...]] = {
        name: tuple(
            simulate_trial(scene, law, name=name, number=number, seed=task.seed + number)
            for number in with_progress(progress, f"trials, {name}", range(task.trials))
        )
        for name, law in laws.items()
    }
    fit = context.fields[0].fit
    target = context.reference[-1] if problem.mode in REACHES else None
    measures = {
        name: tuple(
            trial_measures(
                trial,
                reference=context.reference,
                mode=problem.mode,
                target=target,
                within=1e-3 * task.within_mm,
                jump=2 * context.numbers.width,
            )
            | pair_measures(trial)
            for trial in done
        )
        for name, done in trials.items()
    }
    return ScenarioOutcome(
        notes=(
            *_along(problem, context, measures, trials),
            *context.notes,
            *ASSUMPTIONS[: 2 if fit is None else 1],
            *(() if problem.plant.kind == "ideal" else (plant_note(problem.plant, ""),)),
            *_pair_notes(problem, measures),
            *_runaways(problem, context, trials),
            *swinging_notes(laws),
        ),
        metrics={
            "laws": {name: law_summary(list(of)) | {"trials": list(of)} for name, of in measures.items()},
            "workspaces": {
                "comfortable_cm2": 1e4 * context.comfortable.area,
                "reachable_cm2": 1e4 * context.reachable.area,
            },
            **({} if fit is None else {"learnt": fit_metrics(fit)}),
        },
        mode=problem.mode,
        comfortable=context.comfortable,
        reachable=context.reachable,
        reference=context.reference,
        demonstrated=context.demonstrated,
        fields=context.fields,
        shown=context.shown,
        within=1e-3 * task.within_mm,
        force_limit=problem.assistance.force_limit_N,
        onset=1e-3 * problem.assistance.onset_mm,
        spring=context.numbers.stiffness if _along_path(problem, context) else None,
        trials=trials,
        measures=measures,
    )


def prepared(
    config: ProblemFile[ScenarioProblem], *, solver: str | None, progress: Progress
) -> tuple[Precomputed, dict[Law, ForceLaw]]:
    """What the trials need, and the laws of the file.

    Raises
    ------
    ProblemFileError : a value of the file or a recording cannot be used.
    ConfigurationError : `solver` cannot be used.
    """
    robot_model_of(config)  # refused before the workspaces take their seconds
    check_bounds(config, solver=solver)
    context = precompute(config, progress=progress)
    return context, {name: law_of(name, config, context, solver=solver) for name in config.problem.run.laws}


def _pair_notes(problem: ScenarioProblem, measures: Mapping[Law, tuple[Mapping[str, Any], ...]]) -> Iterator[str]:
    """Of the helper."""
    tanks = 2 * problem.assistance.energy_budget_J
    for law, trials in measures.items():
        if "helper_force_mean_N" not in trials[0]:
            continue
        felt, most, drawn = (
            [each[key] for each in trials]
            for key in ("helper_force_mean_N", "helper_force_max_N", "pair_energy_drawn_max_J")
        )
        yield (
            f"{law}: the helper felt {np.mean(felt):.2g} N on average and {max(most):.2g} N at most; both hands "
            f"together had drawn {max(drawn):.2g} J at most, of {tanks:g} J in the tanks"
        )


def _along(
    problem: ScenarioProblem, context: Precomputed, measures: Mapping[Law, Sequence[Mapping[str, Any]]],
    trials: Mapping[Law, tuple[Trial, ...]],
) -> Iterator[str]:  # fmt: skip
    """Along a path: what was not covered; help that was worse than none, or let a hand go."""
    if problem.mode != "follow":
        return
    for law, of in measures.items():
        fractions = [each["reference_covered_fraction"] for each in of]
        short = sum(fraction < COVERED for fraction in fractions)
        if short:
            yield (
                f"{law}: {short} of {len(of)} trials did not cover the path in order, the worst of them "
                f"{100 * min(fractions):.0f} % of it"
            )
        if law == "unassisted":
            continue
        for key, off in WORSE.items():
            sign = -1 if key == "reference_covered_fraction" else 1
            both = zip(of, measures.get("unassisted", ()), strict=False)
            worse = sum(sign * (each[key] - free[key]) > 0.01 * free[key] for each, free in both)
            if worse:
                yield f"{law}: with this help the hand {off} than without any, in {worse} of {len(of)} trials"
        let_go = np.concatenate([trial.let_go for trial in trials[law]])
        if let_go.any():
            yield f"{law}: a hand that stood under force was let go, for {100 * let_go.mean():.2g} % of the time"
        far = 1e3 * max(float(np.max(context.comfortable.distance(trial.position))) for trial in trials[law])
        if far > problem.task.within_mm:
            yield f"{law}: the hand left the comfortable workspace, by up to {far:.2g} mm"


def _runaways(problem: ScenarioProblem, context: Precomputed, trials: Mapping[Law, tuple[Trial, ...]]) -> Iterator[str]:
    """Trials that no person can have done, and a law that makes the hand run away."""
    cap = problem.assistance.speed_cap_m_s
    for law, done in trials.items():
        fast = max(float(np.hypot(*trial.velocity.T).max()) for trial in done)
        if fast > HAND_SPEED:
            yield f"{law}: the simulated hand reached {fast:.3g} m/s; no hand is faster than {HAND_SPEED:g} m/s"
        elif fast > cap and law != "unassisted":
            yield f"{law}: the hand reached {fast:.3g} m/s, beyond the speed cap of {cap:g} m/s"
        far = max(float(np.max(context.reachable.distance(trial.position))) for trial in done)
        if far > FAR:
            yield f"{law}: the simulated hand was {far:.3g} m outside the reachable workspace; no arm goes there"


def scene_of(config: ProblemFile[ScenarioProblem], context: Precomputed) -> Scene:
    """What all trials share."""
    problem = config.problem
    arrival = Arrival(1e-3 * problem.task.within_mm, REST) if problem.mode in REACHES else None
    return Scene(
        comfortable=context.comfortable,
        person=person_of(problem),
        robot=hand_robot_of(config),
        intention=context.intention,
        arrival=arrival,
        dt=1 / problem.run.rate_hz,
    )


def law_of(
    name: Law, config: ProblemFile[ScenarioProblem], context: Precomputed, *, solver: str | None = None
) -> ForceLaw:
    """A law as the loop calls it.

    Raises
    ------
    ProblemFileError : a value of the file cannot be used.
    ConfigurationError : `solver` cannot be used.
    """
    problem = config.problem
    dt = 1 / problem.run.rate_hz
    if name == "unassisted":
        return Unassisted()
    if name == "published":
        return Published(_field_law(problem, context), dt=dt)
    if name in ("together", "delayed"):
        return pair_of(config, context, delay=problem.helper.delay_s if name == "delayed" else 0.0, solver=solver)
    with bounds_refusals(config, solver=solver, section="assistance"):
        assistance = assistance_of(problem, context, solver=solver)
    return assisted_law(problem, context, assistance)


def assisted_law(problem: ScenarioProblem, context: Precomputed, assistance: Assistance | PathAssistance) -> Assisted:
    """Ours as the loop calls it: with its field where it is, or carried from point to point."""
    if problem.mode != "hold" or isinstance(assistance, PathAssistance):
        return Assisted(assistance)
    return AssistedAtPoints(assistance, context.reference, _pace(problem, context.reference))


def assistance_of(
    problem: ScenarioProblem, context: Precomputed, *, solver: str | None = None, backup: str | None = None
) -> Assistance | PathAssistance:
    """Ours, of the whole field; along a path that may cross itself, by progress along it.

    Raises
    ------
    ConfigurationError : a value that cannot be used.
    """
    said, numbers = problem.assistance, context.numbers
    bounds = bounds_of(problem, solver=solver)
    bounds["backup"] = backup
    if _along_path(problem, context):
        return PathAssistance(
            context.reference,
            stiffness=numbers.stiffness,
            width=numbers.width,
            damping=numbers.damping,
            comfortable=context.comfortable,
            force_limit=said.force_limit_N,
            **bounds,
        )
    return Assistance(
        context.fields[0],
        comfortable=context.comfortable,
        mode=problem.mode,
        **said.arguments("force_limit_N", "onset_mm"),
        **bounds,
    )


def _along_path(problem: ScenarioProblem, context: Precomputed) -> bool:
    """Whether the help is `PathAssistance`, not a field."""
    return problem.mode == "follow" and not context.numbers.drag


def _pace(problem: ScenarioProblem, points: Array) -> Smoother:
    """Bounds with which the longest way between points takes about `movement_s`, each axis by itself."""
    way = max(float(np.abs(np.diff(points, axis=0)).max(initial=0.0)), SHORTEST_WAY)
    seconds = problem.task.movement_s
    # The largest speed, acceleration and jerk of the minimum-jerk motion of that length and time.
    return Smoother(
        velocity=1.875 * way / seconds,
        acceleration=5.7735 * way / seconds**2,
        jerk=60.0 * way / seconds**3,
        axes=2,
        dt=1 / problem.run.rate_hz,
    )


def _field_law(problem: ScenarioProblem, context: Precomputed) -> FieldLaw:
    """The paper's field of the same numbers; in "resist" k1 < 0 gives the same force where the path begins."""
    field, numbers = context.fields[0], context.numbers
    drag = -field.drag if problem.mode == "resist" else numbers.drag
    return FieldLaw(
        path=context.reference if problem.mode == "hold" else field.paths[0].points,
        stiffness=numbers.stiffness,
        drag=drag,
        width=numbers.width,
        damping=numbers.damping,
        released=(lambda x: bool(context.comfortable.contains(x))) if problem.mode in THERAPY else None,
        force_limit=problem.assistance.force_limit_N,
    )
