"""The run of `system = "scenario"`: the same person and task under each law, and what came of it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from rehab_opt.control.assistance import Assistance
from rehab_opt.control.command import Status
from rehab_opt.control.energy_tank import HAND_SPEED
from rehab_opt.control.path_assistance import PathAssistance
from rehab_opt.control.smoother import Smoother
from rehab_opt.published.field_law import FieldLaw
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.outcome import Array, Progress, told
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
from rehab_opt.session.scenario.loop import INDEX, Arrival, Scene, hand_robot_of, person_of, ran, robot_model_of
from rehab_opt.session.scenario.measures import COVERED, law_summary, trial_measures
from rehab_opt.session.scenario.outcome import Law, ScenarioOutcome, Trial
from rehab_opt.session.scenario.pair import pair_measures, pair_of
from rehab_opt.session.scenario.precomputed import Precomputed, precompute
from rehab_opt.session.scenario.problem import REACHES, THERAPY, ScenarioProblem

__all__ = ["assistance_of", "assisted_law", "law_of", "run_scenario", "scene_of"]

SHORTEST_WAY = 1e-3
"""[m] between points; a single point needs no pace."""
FAR = 0.05
"""[m] Outside the reachable workspace from which on a hand is no person's: joints give way less."""
REST = 0.5
"""[s] A reach is over when the hand has been at its goal so long."""

ASSUMPTIONS = (
    "person and robot are simulated: their masses, stiffnesses, strengths and disturbances are assumptions",
    "the field's numbers are choices of the file: S is not published for scenarios 1 to 3, sigma and k1 are suspect",
)


def run_scenario(loaded: ProblemFile[ScenarioProblem], *, solver: str | None, progress: Progress) -> ScenarioOutcome:
    """Every trial under every law of the file.

    Raises
    ------
    ProblemFileError : a value of the file or a recording cannot be used.
    ConfigurationError : `solver` cannot be used.
    """
    problem = loaded.problem
    robot_model_of(loaded)  # refused before the workspaces take their seconds
    check_bounds(loaded, solver=solver)
    ready = precompute(loaded, progress=progress)
    scene = scene_of(loaded, ready)
    task = problem.task
    trials: dict[Law, tuple[Trial, ...]] = {}
    laws: dict[Law, ForceLaw] = {}
    for name in problem.run.laws:
        law = laws[name] = law_of(name, loaded, ready, solver=solver)
        trials[name] = tuple(
            ran(scene, law, name=name, number=number, seed=task.seed + number)
            for number in told(progress, f"trials, {name}", range(task.trials))
        )
    fit = ready.fields[0].fit
    target = ready.reference[-1] if problem.mode in REACHES else None
    measures = {
        name: tuple(
            trial_measures(
                trial,
                reference=ready.reference,
                mode=problem.mode,
                target=target,
                within=1e-3 * task.within_mm,
                jump=2 * ready.numbers.width,
            )
            | pair_measures(trial)
            for trial in done
        )
        for name, done in trials.items()
    }
    return ScenarioOutcome(
        notes=(
            *_along(problem, ready, measures, trials),
            *ready.notes,
            *ASSUMPTIONS[: 2 if fit is None else 1],
            *(() if problem.plant.kind == "ideal" else (plant_note(problem.plant, ""),)),
            *_pair_notes(problem, measures),
            *_runaways(problem, ready, trials),
            *swinging_notes(laws),
        ),
        metrics={
            "laws": {name: law_summary(list(of)) | {"trials": list(of)} for name, of in measures.items()},
            "workspaces": {
                "comfortable_cm2": 1e4 * ready.comfortable.area,
                "reachable_cm2": 1e4 * ready.reachable.area,
            },
            **({} if fit is None else {"learnt": fit_metrics(fit)}),
        },
        mode=problem.mode,
        comfortable=ready.comfortable,
        reachable=ready.reachable,
        reference=ready.reference,
        demonstrated=ready.demonstrated,
        fields=ready.fields,
        shown=ready.shown,
        within=1e-3 * task.within_mm,
        force_limit=problem.assistance.force_limit_N,
        trials=trials,
        measures=measures,
    )


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
    problem: ScenarioProblem, ready: Precomputed, measures: Mapping[Law, Sequence[Mapping[str, Any]]],
    trials: Mapping[Law, tuple[Trial, ...]],
) -> Iterator[str]:  # fmt: skip
    """Along a path: what was not covered; help that was worse than none, or let a hand go."""
    if problem.mode != "follow":
        return
    for law, of in measures.items():
        shares = [each["reference_covered_share"] for each in of]
        short = sum(share < COVERED for share in shares)
        if short:
            yield (
                f"{law}: {short} of {len(of)} trials did not cover the path in order, the worst of them "
                f"{100 * min(shares):.0f} % of it"
            )
        if law == "unassisted":
            continue
        for key, sign in (("deviation_mean_m", 1), ("reference_covered_share", -1)):
            both = zip(of, measures.get("unassisted", ()), strict=False)
            worse = sum(sign * (each[key] - free[key]) > 0.01 * free[key] for each, free in both)
            if worse:
                off = "deviated more" if sign > 0 else "covered less"
                yield f"{law}: with this help the hand {off} than without any, in {worse} of {len(of)} trials"
        let_go = np.concatenate([trial.status for trial in trials[law]]) == INDEX[Status.BLOCKED]
        if let_go.any():
            yield f"{law}: a hand that stood under force was let go, for {100 * let_go.mean():.2g} % of the time"
        far = 1e3 * max(float(np.max(ready.comfortable.distance(trial.position))) for trial in trials[law])
        if far > problem.task.within_mm:
            yield f"{law}: the hand left the comfortable workspace, by up to {far:.2g} mm"


def _runaways(problem: ScenarioProblem, ready: Precomputed, trials: Mapping[Law, tuple[Trial, ...]]) -> Iterator[str]:
    """Trials that no person can have done, and a law that makes the hand run away."""
    cap = problem.assistance.speed_cap_m_s
    for law, done in trials.items():
        fast = max(float(np.hypot(*trial.velocity.T).max()) for trial in done)
        if fast > HAND_SPEED:
            yield f"{law}: the simulated hand reached {fast:.3g} m/s; no hand is faster than {HAND_SPEED:g} m/s"
        elif fast > cap and law != "unassisted":
            yield f"{law}: the hand reached {fast:.3g} m/s, beyond the speed cap of {cap:g} m/s"
        far = max(float(np.max(ready.reachable.distance(trial.position))) for trial in done)
        if far > FAR:
            yield f"{law}: the simulated hand was {far:.3g} m outside the reachable workspace; no arm goes there"


def scene_of(loaded: ProblemFile[ScenarioProblem], ready: Precomputed) -> Scene:
    """What all trials share."""
    problem = loaded.problem
    arrival = Arrival(1e-3 * problem.task.within_mm, REST) if problem.mode in REACHES else None
    return Scene(
        comfortable=ready.comfortable,
        person=person_of(problem),
        robot=hand_robot_of(loaded),
        intention=ready.intention,
        arrival=arrival,
        dt=1 / problem.run.rate_hz,
    )


def law_of(
    name: Law, loaded: ProblemFile[ScenarioProblem], ready: Precomputed, *, solver: str | None = None
) -> ForceLaw:
    """A law as the loop calls it.

    Raises
    ------
    ProblemFileError : a value of the file cannot be used.
    ConfigurationError : `solver` cannot be used.
    """
    problem = loaded.problem
    dt = 1 / problem.run.rate_hz
    if name == "unassisted":
        return Unassisted()
    if name == "published":
        return Published(_field_law(problem, ready), dt=dt)
    if name in ("together", "delayed"):
        return pair_of(loaded, ready, delay=problem.helper.delay_s if name == "delayed" else 0.0, solver=solver)
    with bounds_refusals(loaded, solver=solver, section="assistance"):
        assistance = assistance_of(problem, ready, solver=solver)
    return assisted_law(problem, ready, assistance)


def assisted_law(problem: ScenarioProblem, ready: Precomputed, assistance: Assistance | PathAssistance) -> Assisted:
    """Ours as the loop calls it: with its field where it is, or carried from point to point."""
    if problem.mode != "hold" or isinstance(assistance, PathAssistance):
        return Assisted(assistance)
    return AssistedAtPoints(assistance, ready.reference, _pace(problem, ready.reference))


def assistance_of(
    problem: ScenarioProblem, ready: Precomputed, *, solver: str | None = None, backup: str | None = None
) -> Assistance | PathAssistance:
    """Ours, of the whole field; along a path that may cross itself, by progress along it.

    Raises
    ------
    ConfigurationError : a value that cannot be used.
    """
    said, numbers = problem.assistance, ready.numbers
    bounds = bounds_of(problem, solver=solver)
    bounds["backup"] = backup
    if problem.mode == "follow" and not numbers.drag:
        return PathAssistance(
            ready.reference,
            stiffness=numbers.stiffness,
            width=numbers.width,
            damping=numbers.damping,
            comfortable=ready.comfortable,
            force_limit=said.force_limit_N,
            **bounds,
        )
    return Assistance(
        ready.fields[0],
        comfortable=ready.comfortable,
        mode=problem.mode,
        **said.arguments("force_limit_N", "onset_mm"),
        **bounds,
    )


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


def _field_law(problem: ScenarioProblem, ready: Precomputed) -> FieldLaw:
    """The paper's field of the same numbers; in "resist" k1 < 0 gives the same force where the path begins."""
    field, numbers = ready.fields[0], ready.numbers
    drag = -field.drag if problem.mode == "resist" else numbers.drag
    return FieldLaw(
        path=ready.reference if problem.mode == "hold" else field.paths[0].points,
        stiffness=numbers.stiffness,
        drag=drag,
        width=numbers.width,
        damping=numbers.damping,
        released=(lambda x: bool(ready.comfortable.contains(x))) if problem.mode in THERAPY else None,
        force_limit=problem.assistance.force_limit_N,
    )
