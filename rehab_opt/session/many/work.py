"""What a worker does for one person. It writes no files: it may run on another machine."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rehab_opt.session.many.participant import Participant
from rehab_opt.session.report import write_results
from rehab_opt.session.run import run_problem

__all__ = ["Answer", "Cell", "flat_numbers", "work_on"]

Cell = str | float | int | bool | None


@dataclass(frozen=True)
class Answer:
    """A person's result.

    Parameters
    ----------
    files : content by file name.
    numbers : the scalar metrics, by dotted key.
    seconds : what it took.
    """

    files: Mapping[str, bytes]
    numbers: Mapping[str, Cell]
    seconds: float


def work_on(participant: Participant) -> Answer:
    """Run a person's problem.

    Raises
    ------
    RehabOptError : it cannot be run as it is.
    """
    began = time.perf_counter()
    outcome = run_problem(participant.problem())
    with tempfile.TemporaryDirectory(prefix="rehab-opt-") as scratch:
        written = write_results(outcome, Path(scratch))
        files = {path.name: path.read_bytes() for path in written}
    numbers = dict(flat_numbers({key: value for key, value in outcome.metrics.items() if key != "parameters"}))
    return Answer(files, numbers, time.perf_counter() - began)


def flat_numbers(metrics: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Cell]]:
    """Scalars of nested tables by dotted key; lists of texts are joined, other lists left out."""
    for key, value in metrics.items():
        if isinstance(value, Mapping):
            yield from flat_numbers(value, f"{above}{key}.")
        elif isinstance(value, list | tuple):
            if all(isinstance(part, str) for part in value):
                yield f"{above}{key}", "; ".join(value)
        else:
            yield f"{above}{key}", value
