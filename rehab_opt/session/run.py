"""Run a problem of any system, without writing files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from typing import Any

from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.inputs import input_files
from rehab_opt.session.live.problem import LiveProblem
from rehab_opt.session.outcome import Outcome, Progress
from rehab_opt.session.refusals import checked_solver, solver_refusals
from rehab_opt.session.schema import Problem
from rehab_opt.session.systems import SHIPPED, System, system_named, value_at


def run_problem(
    config: ProblemFile[Problem], *, progress: Progress = lambda *_: None, **options: str | None
) -> Outcome:
    """Run a problem and return its outcome.

    Parameters
    ----------
    config : problem file from `load_problem`.
    progress : callback for the progress of the run.
    options : options of the system, such as `law` and `solver` of an upper limb; None counts as not given.

    Raises
    ------
    ProblemFileError : a recording or a value of the problem file is invalid.
    ConfigurationError : an option is unknown, or its value is invalid.
    """
    with _given(config, options) as (system, on, given):
        outcome: Outcome = system.run(on, options=given, progress=progress)
    problem = on.problem
    return replace(
        outcome,
        system=problem.system,
        name=on.name,
        title=problem.title,
        metrics={**outcome.metrics, "parameters": problem.model_dump(mode="json", exclude={"title"})},
        inputs=input_files(on),
        options=given,
    )


def live_problem(config: ProblemFile[Problem], **options: str | None) -> LiveProblem:
    """A problem for `rehab-opt live`, `film` and `loop`, with `options` as for `run_problem`.

    Raises
    ------
    ProblemFileError : a recording or a value of the problem file is invalid.
    ConfigurationError : problems of this system do not run in real time, or an option or its value is invalid.
    """
    system = system_named(config.problem.system)
    if type(system).live is System.live:
        able = ", ".join(repr(each) for each in SHIPPED if type(system_named(each)).live is not System.live)
        expected = (
            f"a problem with a controller in a loop, as those of system {able} are; one of system "
            f"{config.problem.system!r} has none: rehab-opt run"
        )
        raise ConfigurationError("FILE", config.name, expected)
    with _given(config, options) as (system, on, given):
        made: LiveProblem = system.live(on, options=given)
    return made


@contextmanager
def _given(
    config: ProblemFile[Problem], options: Mapping[str, str | None]
) -> Iterator[tuple[System[Any, Any], ProblemFile[Any], dict[str, str]]]:
    """Context that gives the system, the problem (with the plant of `--plant`), and the options that are not None."""
    name = config.problem.system
    system = system_named(name)
    given = {option: value for option, value in options.items() if value is not None}
    for option, value in given.items():
        if option == "plant" and option not in system.options:
            able = " and ".join(each for each in SHIPPED if "plant" in system_named(each).options)
            expected = f"a problem with a robot in closed loop, which those of system {able} are, not {name!r}"
            raise ConfigurationError("--plant", value, expected)
        if option not in system.options:
            known = ", ".join(f"--{each}" for each in sorted(system.options)) or "none"
            raise ConfigurationError(f"--{option}", value, f"another option: system {name!r} has {known}")
    solver = checked_solver(given.get("solver"))
    if "plant" in system.options:
        from rehab_opt.session.plant import on_plant  # noqa: PLC0415  (loads what plants need)

        config = on_plant(config, given.get("plant"))
    key = system.solver_key
    named = value_at(config.problem, key) if key else None
    with solver_refusals(solver, file=config.file, key=key, value=named) if key else nullcontext():
        yield system, config, given


def checked(config: ProblemFile[Problem]) -> tuple[str, ...]:
    """Check a problem without running it, and return the notes.

    Raises
    ------
    ProblemFileError : as `run_problem`.
    """
    with _given(config, {}) as (system, on, _):
        return system.check(on)


def arms_of(config: ProblemFile[Problem]) -> dict[str, SerialChain]:
    """The arms of a problem by the name of their range of motion; empty for systems without a person's arm.

    Raises
    ------
    ProblemFileError : as `run_problem`.
    """
    return system_named(config.problem.system).arms(config)
