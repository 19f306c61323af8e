"""The five scenarios with 20 simulated people each, and a session of 60 s: `python -m bench.scenarios`.

Prints one line a number, asked and measured; exit code 1 where one is missed. The people differ by their seed: wander,
tremor and spasms. Only the paper's claims are judged; `rehab-opt run upper_limb/scenario_...` shows everything.
`--plant mujoco` asks whether they hold on a robot with delays, noise, friction and a force loop, too.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from rich.console import Console

from bench.machine import machine
from bench.verdict import Verdict, all_met, print_verdicts
from rehab_opt.measures.along_path import projected
from rehab_opt.session.files import ProblemFile, problem_content, problem_of, problem_path
from rehab_opt.session.outcome import Outcome
from rehab_opt.session.plant import KINDS, on_plant
from rehab_opt.session.run import run_problem
from rehab_opt.session.scenario.controllers import law_of, scene_of
from rehab_opt.session.scenario.loop import simulate_trial
from rehab_opt.session.scenario.precomputed import precompute
from rehab_opt.session.scenario.scene import trials_of

__all__ = ["SCENARIOS", "changed", "judged", "main"]

SCENARIOS = ("scenario_1_stretch", "scenario_2_assist", "scenario_3_resist", "scenario_4_follow", "scenario_5_hold")
LAWS = ["unassisted", "assisted"]
FOLLOWED = "scenario_4_follow"
CALM = {"spasms_per_s": 0.0}
"""A second person for the path that is followed: without spasms."""
FRESH = 26113000
"""Seed of the first trial along that path: no law was chosen on it."""
FORCE_OFF = "ES4 force where the hand is off by more than a width, worst trial"
CLEARLY = 0.9
"""A share below which a number is smaller, where the paper gives none: what does nothing must not pass."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run and judge."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--people", type=int, default=20)
    parser.add_argument("--parts", nargs="+", choices=["people", "session"], default=["people", "session"])
    parser.add_argument("--plant", choices=KINDS, help="the robot of the people, in place of the file's")
    options = parser.parse_args(arguments)
    console = Console()
    console.print("  ".join(f"{key}: {value}" for key, value in machine().items()), highlight=False)
    verdicts: list[Verdict] = []
    if "people" in options.parts:
        for name in SCENARIOS:
            for person in ({}, CALM) if name == FOLLOWED else ({},):
                task = {"trials": options.people} | ({"seed": FRESH} if name == FOLLOWED else {})
                config = changed(name, task=task, run={"laws": LAWS}, person=person)
                measured = judged(name, run_problem(on_plant(config, options.plant)))
                print_verdicts(console, measured)
                verdicts += measured
    if "session" in options.parts:
        measured = [session()]
        print_verdicts(console, measured)
        verdicts += measured
    return 0 if all_met(verdicts) else 1


def changed(name: str, **sections: Mapping[str, Any]) -> ProblemFile[Any]:
    """A shipped scenario with some keys of its sections replaced."""
    file = f"upper_limb/{name}"
    _, path = problem_path(file)
    content = problem_content(path, file)
    for section, keys in sections.items():
        content[section] = {**content.get(section, {}), **keys}
    return problem_of(content, name=file, file=file, path=path)


def judged(
    name: str, outcome: Outcome, measures: Mapping[Any, Sequence[Mapping[str, Any]]] | None = None
) -> list[Verdict]:
    """What the paper reports of a scenario, of every person or of their mean."""
    number = name.removeprefix("scenario_")[0]
    scenario = f"ES{number}"
    measures = measures or trials_of(outcome).measures
    ours, none = measures["assisted"], measures["unassisted"]
    parameters = outcome.metrics["parameters"]
    if number in "123":
        bounds, tick = parameters["assistance"], 1 / parameters["run"]["rate_hz"]
        soonest = bounds["force_limit_N"] / bounds["slew_limit_N_s"] + 2 * tick
        verdicts = [
            _worst(f"{scenario} desired inside W_c", ours, "force_desired_inside_max_N", 0.0, "N"),
            _worst(f"{scenario} growth of the force inside W_c", ours, "force_growth_inside_max_N", 0.0, "N"),
            _worst(f"{scenario} zero after entering W_c", ours, "time_to_zero_force_after_entry_max_s", soonest, "s"),
        ]
        if number == "1":
            ratio = _worst_ratio(ours, none, "deviation_outside_mean_m")
            verdicts.append(Verdict("ES1 deviation outside W_c with help / without, worst person", ratio, "<=", 0.5))
        if number == "2":
            verdicts.append(
                _worst(f"{scenario} distance from the target at the end", ours, "final_distance_m", 5e-3, "m")
            )
        if number == "3":
            last = max(_numbers(ours, "force_along_reference_last_quarter_mean_N"))
            before = min(_numbers(ours, "force_along_reference_before_mean_N"))
            half = -parameters["field"]["resistance_N"] / 2
            verdicts += [
                _worst(f"{scenario} force along the path (negative is against)", ours,
                       "force_along_reference_outside_max_N", 0.0, "N"),
                Verdict(f"{scenario} the same in the last quarter, beside the rest", last, "<=", before, "N"),
                Verdict(f"{scenario} the same, beside half of resistance_N", last, "<=", half, "N"),
            ]  # fmt: skip
        return verdicts
    ratio = _worst_ratio(ours, none, "deviation_mean_m")
    most = 0.5 if number == "4" else CLEARLY
    verdicts = [Verdict(f"{scenario} deviation with help / without, worst person", ratio, "<=", most)]
    if number == "4":
        meant = _worst_ratio(ours, none, "from_intended_mean_m")
        worse = ~(np.array(_numbers(ours, "from_intended_mean_m")) <= _numbers(none, "from_intended_mean_m"))
        helped, alone = (_numbers(each, "reference_covered_fraction") for each in (ours, none))
        force = force_off(outcome)
        verdicts += [Verdict(FORCE_OFF, force, ">=", 1.0, "N")] if force < math.inf else []
        verdicts += [
            Verdict("ES4 from where the person meant to be over time, with help / without, worst", meant, "<=", 1.0),
            Verdict("ES4 trials in which the hand is further from there with help", worse.sum(), "<=", 0),
            Verdict("ES4 covered in order, mean, beside without help", np.mean(helped), ">=", np.mean(alone)),
            Verdict("ES4 covered in order, worst trial, beside without help", min(helped), ">=", min(alone)),
            Verdict("ES4 covered in order as with the driven help before, worst trial", min(helped), ">=", 1.0),
        ]
    if number == "5":
        speed, force = "speed_mean_m_s", "force_measured_mean_N"
        slower, stronger = _worst_ratio(ours, none, speed), 1 / _worst_ratio(none, ours, force)
        verdicts += [
            Verdict(f"{scenario} {speed} with help / without, worst person", slower, "<=", CLEARLY),
            Verdict(f"{scenario} {force} with help / without, worst person", stronger, ">=", 1 / CLEARLY),
        ]
    return verdicts


def force_off(outcome: Outcome) -> float:
    """[N] mean commanded force more than a width off the path, the least of the trials; infinite where none is.

    Ticks in which the person means to be at the path's end do not count: the help has ended there.
    """
    width, least = 1e-3 * outcome.metrics["parameters"]["field"]["width_mm"], math.inf
    found = trials_of(outcome)
    for trial in found.trials["assisted"]:
        off = projected(trial["_hand"], found.context.reference).distance > width
        off &= np.linalg.norm(trial["intended"] - found.context.reference[-1], axis=1) > width
        if off.any():
            least = min(least, float(np.linalg.norm(trial["force_commanded"][off], axis=1).mean()))
    return least


def session() -> Verdict:
    """A minute at 1 kHz beside the time it takes to simulate: participant, robot and assistance."""
    config = changed("scenario_4_follow", task={"movement_s": 60.0, "rest_s": 0.0, "trials": 1})
    context = precompute(config, progress=_silent)
    scene, law = scene_of(context), law_of("assisted", context)
    simulate_trial(scene, law, number=0, seed=1)  # what is loaded late is loaded now
    began, processor = time.perf_counter(), time.process_time()
    trial = simulate_trial(scene, law, number=0, seed=0)
    seconds, processor = time.perf_counter() - began, time.process_time() - processor
    print(f"60 s session: {seconds:.1f} s by the wall clock, {processor:.1f} s of the processor")
    return Verdict(
        "60 s session at 1 kHz, times real time (processor time)", (trial["t_s"][-1] + scene.dt) / processor, ">=", 20.0
    )


def _worst(what: str, measures: Sequence[Mapping[str, Any]], key: str, asked: float, unit: str) -> Verdict:
    return Verdict(f"{what}, worst person", max(_numbers(measures, key)), "<=", asked, unit)


def _worst_ratio(over: Sequence[Mapping[str, Any]], under: Sequence[Mapping[str, Any]], key: str) -> float:
    return max(one / other for one, other in zip(_numbers(over, key), _numbers(under, key), strict=True))


def _numbers(measures: Sequence[Mapping[str, Any]], key: str) -> list[float]:
    """One for each person; all NaN, which meets nothing, where a person has none."""
    found = [each[key] for each in measures]
    return [math.nan] * len(found) if None in found else found


def _silent(*_: object) -> None:
    """No progress."""


if __name__ == "__main__":
    sys.exit(main())
