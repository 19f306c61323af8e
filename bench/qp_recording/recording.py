"""Sequences from runs: what the solvers of a controller met, tick after tick, as `QPSequence`."""

from __future__ import annotations

import math
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from bench.qp_recording.sequence import QPSequence, sequence_of
from rehab_opt.errors import ConfigurationError, ProblemFileError
from rehab_opt.optim.recorder import Stream, recording_qps
from rehab_opt.session.files import ProblemFile, shipped_problems
from rehab_opt.session.outcome import Progress
from rehab_opt.session.run import run_problem
from rehab_opt.session.systems import system_named, value_at

__all__ = ["file_names", "recorded_run", "sequence_of_stream"]

TICKS = 1000
"""How many are kept of each solver where nothing else is said: about 1 MB."""


def recorded_run(
    config: ProblemFile[Any],
    *,
    skip: int = 0,
    ticks: int = TICKS,
    progress: Progress = lambda *_: None,
    **options: str | None,
) -> list[QPSequence]:
    """Run a problem; the QPs of each of its solvers as a sequence, in the order in which the solvers were made.

    A solver sees only the ticks in which it is asked: what one mode of a stick leaves out, another one has.

    Parameters
    ----------
    config : from `load_problem`.
    skip, ticks : of each solver's QPs, how many are let pass first, and how many are then kept at most.
    progress, options : see `run_problem`.

    Raises
    ------
    ProblemFileError : the system solves no QPs, the run met none, or, as `run_problem`, a value cannot be used.
    ConfigurationError : numbers that are no counts, or, as `run_problem`, an option.
    """
    for argument, value, least in (("--skip", skip, 0), ("--ticks", ticks, 1)):
        if not value >= least:
            raise ConfigurationError(argument, value, f"a number of ticks, {least} or more")
    name = config.problem.system
    system = system_named(name)
    if not (system.rate_key or system.solver_key):
        raise ProblemFileError(config.file, "system", name, "one whose controllers solve a QP every tick")
    # Without ticks, as in inverse kinematics, each QP is an iteration.
    dt = 1 / value_at(config.problem, system.rate_key) if system.rate_key else math.nan
    with recording_qps(skip=skip, most=ticks) as recorder:
        run_problem(config, progress=progress, **options)
    streams = [stream for stream in recorder.streams if len(stream)]
    if not streams:
        met = max((stream.met for stream in recorder.streams), default=0)
        raise ProblemFileError(config.file, "system", name, f"a run of more QPs than --skip {skip}: it had {met}")
    command = _command(config, skip=skip, ticks=ticks, **options)
    return [
        sequence_of_stream(
            stream, name=f"{name}/{_last(config.name)}_{apart}", dt=dt if stream.ticks else math.nan, command=command,
            about=f"{config.problem.title}: {apart}, {len(stream)} of {stream.met} QPs",
        )
        for stream, apart in zip(streams, _names_apart(streams), strict=True)
    ]  # fmt: skip


def _command(config: ProblemFile[Any], *, skip: int, ticks: int, **options: str | None) -> str:
    """What records it again, on a shell."""
    file = config.name if config.name in shipped_problems() else config.file
    chosen = [f"--{name}={value}" for name, value in options.items() if value is not None]
    return shlex.join(["python", "-m", "bench.record", file, "--skip", str(skip), "--ticks", str(ticks), *chosen])


def _names_apart(streams: Sequence[Stream]) -> list[str]:
    """Each stream's name, numbered where several have it."""
    names = [stream.name for stream in streams]
    return [f"{name}_{names[: i + 1].count(name)}" if names.count(name) > 1 else name for i, name in enumerate(names)]


def sequence_of_stream(stream: Stream, *, name: str, dt: float, command: str, about: str) -> QPSequence:
    """What one solver met, as a sequence."""
    return sequence_of(
        name, stream.instances(), dt=dt, tolerance=stream.tolerance, command=command, about=about
    )  # fmt: skip


def file_names(out: Path, sequences: list[QPSequence]) -> list[Path]:
    """Where each of a run's sequences is written: `out` for one, else with what sets it apart behind the stem."""
    words = [_last(sequence.name).split("_") for sequence in sequences]
    shared = 0
    while all(len(each) > shared and each[shared] == words[0][shared] for each in words):
        shared += 1
    apart = ["_".join(["", *each[shared:]]) for each in words]
    numbers = [f"_{i + 1}" if apart.count(each) > 1 else "" for i, each in enumerate(apart)]
    return [out.with_name(out.stem + each + number + out.suffix) for each, number in zip(apart, numbers, strict=True)]


def _last(name: str) -> str:
    return name.rpartition("/")[2]
