"""`system = "scenario"`: the five scenarios of therapy and help, with the same person and task for every controller."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from rehab_opt.field.samples import HAND_SPEED
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.live.problem import LiveProblem
from rehab_opt.session.outcome import Names, Outcome, Progress
from rehab_opt.session.participant import arm_of
from rehab_opt.session.plant import plant_note
from rehab_opt.session.scenario.controllers import Task
from rehab_opt.session.scenario.demonstrated import fit_metrics
from rehab_opt.session.scenario.laws import swinging_notes
from rehab_opt.session.scenario.live import LiveScenario
from rehab_opt.session.scenario.loop import simulate_trial
from rehab_opt.session.scenario.measures import COVERED, law_summary, trial_measures
from rehab_opt.session.scenario.pair import pair_measures
from rehab_opt.session.scenario.precomputed import Precomputed
from rehab_opt.session.scenario.problem import REACHES, ScenarioProblem
from rehab_opt.session.scenario.trials import Law
from rehab_opt.session.systems import System
from rehab_opt.session.trace import Trace

Config = ProblemFile[ScenarioProblem]
FAR = 0.05
"""[m] A hand further outside the reachable workspace is not realistic, because joints cannot yield that much."""

WORSE = {
    "from_intended_mean_m": "was further from the person's intended position",
    "deviation_mean_m": "deviated more",
    "reference_covered_fraction": "covered less",
}
"""Measures of a followed path, with the words of the note if assistance made one of them worse."""
ASSUMPTIONS = (
    "person and robot are simulated: their masses, stiffnesses, strengths and disturbances are assumptions",
    "the field's numbers are choices of the file: S is not published for scenarios 1 to 3, sigma and k1 are suspect",
)


class TrialScene:
    """One trial under one controller; `number` selects the person's variability."""

    def __init__(self, task: Task, law: Law, number: int) -> None:
        self.task, self.law, self.number = task, law, number

    def run(self, progress: Progress = lambda *_: None) -> Trace:
        """Trace of the trial, see `trial_trace`."""
        task = self.task
        task.progress = progress
        law = task.laws[self.law]
        progress("", self.number, task.problem.task.trials)
        return simulate_trial(task.scene, law, number=self.number, seed=task.problem.task.seed + self.number)

    def numbers(self, trace: Trace) -> dict[str, Any]:
        """The measures of the trial."""
        context, mode = self.task.context, self.task.problem.mode
        return trial_measures(
            trace,
            reference=context.reference,
            mode=mode,
            target=context.reference[-1] if mode in REACHES else None,
            within=1e-3 * self.task.problem.task.within_mm,
            jump=2 * context.numbers["width"],
        ) | pair_measures(trace)

    def notes(self, trace: Trace) -> Iterator[str]:
        """No notes here: see `ScenarioSystem.notes`."""
        return iter(())


class ScenarioTrials(NamedTuple):
    """The trials of a file and their measures, by controller."""

    context: Precomputed
    trials: Mapping[Law, Sequence[Trace]]
    measures: Mapping[Law, Sequence[Mapping[str, Any]]]


def trials_of(outcome: Outcome) -> ScenarioTrials:
    """The trials of a run."""
    task: Task = next(iter(outcome.scenes.values())).task
    return ScenarioTrials(task.context, _by_law(outcome.traces), _by_law(outcome.table))


def _by_law(of: Mapping[Names, Any]) -> dict[Law, list[Any]]:
    found: dict[Law, list[Any]] = {}
    for (law, _), each in of.items():
        found.setdefault(law, []).append(each)
    return found


def _pair_notes(of: ScenarioTrials) -> Iterator[str]:
    tanks = 2 * of.context.problem.assistance.energy_budget_J
    for law, trials in of.measures.items():
        if "helper_force_mean_N" in trials[0]:
            keys = ("helper_force_mean_N", "helper_force_max_N", "pair_energy_drawn_max_J")
            felt, most, drawn = ([each[key] for each in trials] for key in keys)
            yield (
                f"{law}: the helper felt {np.mean(felt):.2g} N on average and {max(most):.2g} N at most; both hands "
                f"together had drawn {max(drawn):.2g} J at most, of {tanks:g} J in the tanks"
            )


def _along(of: ScenarioTrials) -> Iterator[str]:
    """Notes on uncovered parts of the path, on trials that assistance made worse, and on released hands."""
    for law, measures in of.measures.items():
        fractions = [each["reference_covered_fraction"] for each in measures]
        short = sum(fraction < COVERED for fraction in fractions)
        if short:
            yield (
                f"{law}: {short} of {len(measures)} trials did not cover the path in order, the worst of them "
                f"{100 * min(fractions):.0f} % of it"
            )
        if law == "unassisted":
            continue
        for key, off in WORSE.items():
            sign = -1 if key == "reference_covered_fraction" else 1
            both = zip(measures, of.measures.get("unassisted", ()), strict=False)
            worse = sum(sign * (each[key] - free[key]) > 0.01 * free[key] for each, free in both)
            if worse:
                yield f"{law}: with this help the hand {off} than without any, in {worse} of {len(measures)} trials"
        let_go = np.concatenate([trial["_let_go"] for trial in of.trials[law]])
        if let_go.any():
            yield f"{law}: a hand that stood under force was released, for {100 * let_go.mean():.2g} % of the time"
        far = 1e3 * max(float(np.max(of.context.comfortable.distance(trial["_hand"]))) for trial in of.trials[law])
        if far > of.context.problem.task.within_mm:
            yield f"{law}: the hand left the comfortable workspace, by up to {far:.2g} mm"


def _runaways(of: ScenarioTrials) -> Iterator[str]:
    """Notes on unrealistic trials, and on controllers that make the hand run away."""
    cap = of.context.problem.assistance.speed_cap_m_s
    for law, done in of.trials.items():
        fast = max(float(np.hypot(*trial["velocity"].T).max()) for trial in done)
        if fast > HAND_SPEED:
            yield f"{law}: the simulated hand reached {fast:.3g} m/s; no hand is faster than {HAND_SPEED:g} m/s"
        elif fast > cap and law != "unassisted":
            yield f"{law}: the hand reached {fast:.3g} m/s, beyond the speed cap of {cap:g} m/s"
        far = max(float(np.max(of.context.reachable.distance(trial["_hand"]))) for trial in done)
        if far > FAR:
            yield f"{law}: the simulated hand was {far:.3g} m outside the reachable workspace; no arm goes there"


SUCCESS = {
    "stretch": "the end on the path", "assist": "at rest at the target in time,", "hold": "each point reached",
    "resist": "at rest at the target in time,", "follow": f"{100 * COVERED:g} % covered, the end",
}  # fmt: skip


class ScenarioSystem(System[ScenarioProblem, TrialScene]):
    """The five scenarios of therapy and help."""

    schema = ScenarioProblem
    drawing = "rehab_opt.session.scenario.figures"
    labels = ("law", "trial")
    first = (
        "reference_covered", "from_intended", "success", "final_distance", "deviation", "force_measured", "speed",
        "duration", "status", "worst trial: deviation", "worst trial: force_measured",
    )  # fmt: skip
    options = frozenset({"plant", "solver"})
    rate_key = "run.rate_hz"

    def scenes(self, config: Config, options: Mapping[str, str]) -> dict[Names, TrialScene]:
        """Each trial with each controller of the file; options: `solver`, `plant`."""
        task, said = Task(config, options.get("solver")), config.problem
        return {(law, k): TrialScene(task, law, k) for law in said.run.laws for k in range(said.task.trials)}

    def nested(self, numbers: Mapping[Names, dict[str, Any]], outcome: Outcome) -> dict[str, Any]:
        """Means and worst values over the trials of each controller; areas of the workspaces; the learnt field."""
        context, _, measures = trials_of(outcome)
        fit = context.fields[0].fit
        return {
            "laws": {law: law_summary(of) | {"trials": of} for law, of in measures.items()},
            "workspaces": {
                "comfortable_cm2": 1e4 * context.comfortable.area,
                "reachable_cm2": 1e4 * context.reachable.area,
            },
            **({} if fit is None else {"learnt": fit_metrics(fit)}),
        }

    def notes(self, numbers: Mapping[Names, dict[str, Any]], outcome: Outcome) -> Iterator[str]:
        """Notes on trials that assistance made worse, on assumptions, on the helper, and on unrealistic motion."""
        task: Task = next(iter(outcome.scenes.values())).task
        of = trials_of(outcome)
        yield from _along(of) if of.context.mode == "follow" else ()
        yield from of.context.notes
        yield from ASSUMPTIONS[: 2 if of.context.fields[0].fit is None else 1]
        yield from () if task.problem.plant.kind == "ideal" else (plant_note(task.problem.plant, ""),)
        yield from _pair_notes(of)
        yield from _runaways(of)
        yield from swinging_notes(task.laws)

    def columns(self, outcome: Outcome) -> Mapping[str, Mapping[str, Any]]:
        """One column for each controller: means and worst values over its trials."""
        return {
            law: {"success_rate": of["success_rate"], **of["mean"], "worst trial": of["worst"]}
            for law, of in outcome.metrics["laws"].items()
        }

    def caption(self, outcome: Outcome) -> str:
        """Number of trials, and the criterion of success."""
        problem = trials_of(outcome).context.problem
        return (
            f"mode {problem.mode}, trials each: {problem.task.trials}; means over them; success: "
            f"{SUCCESS[problem.mode]} within {problem.task.within_mm:g} mm"
        )

    def check(self, config: Config) -> tuple[str, ...]:
        """Read recordings, learn the field, build robot, workspaces and controllers."""
        task = Task(config, None)
        laws = task.laws
        return (*task.context.notes, *swinging_notes(laws))

    def arms(self, config: Config) -> dict[str, SerialChain]:
        """The arm with its comfortable and its reachable range of motion."""
        arm = config.problem.arm
        return {
            name: arm_of(arm.side, arm.segments, getattr(arm, name), file=config.file)
            for name in ("comfortable", "reachable")
        }

    def live(self, config: Config, *, options: Mapping[str, str]) -> LiveProblem:
        """Live run with the file's simulated person, until the user selects another goal; options as for `run`."""
        return LiveScenario(Task(config, options.get("solver")))
