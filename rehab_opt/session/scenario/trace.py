"""The columns of trace.csv of scenarios: every trial of every law, below each other."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.command import Bound, Status
from rehab_opt.session.scenario.outcome import ScenarioOutcome
from rehab_opt.session.scenario.trial import Trial
from rehab_opt.session.systems import Column

__all__ = ["RATE", "thinned_ticks", "trial_columns"]

Array = NDArray[np.float64]

RATE = 100.0
"""[Hz] of trace.csv at most; metrics.json is made of all ticks."""


def trial_columns(outcome: ScenarioOutcome) -> Iterator[Column]:
    """One row a law, trial and tick that is kept; a cell is empty where there is no such number.

    Between two rows nothing is averaged, but for `yielded`, which holds all that gave way since the row before.
    """
    trials = [(trial, thinned_ticks(trial)) for of in outcome.trials.values() for trial in of]

    words = tuple(status.value for status in Status)

    def numbers(of: Callable[[Trial], Array]) -> list[float]:
        return [value for trial, ticks in trials for value in of(trial)[ticks].tolist()]

    def known(of: Callable[[Trial], Array]) -> tuple[str, ...]:
        return tuple("" if math.isnan(value) else f"{value:.9g}" for value in numbers(of))

    yield "law", tuple(trial.law for trial, ticks in trials for _ in ticks)
    yield "trial", [trial.number for trial, ticks in trials for _ in ticks]
    yield "t_s", numbers(lambda trial: trial.time)
    for name, unit in (("position", "m"), ("velocity", "m_s"), ("intended", "m")):
        what = "" if name == "position" else f"{name}_"
        for axis, letter in enumerate("xy"):
            yield f"{what}{letter}_{unit}", numbers(lambda of, name=name, axis=axis: getattr(of, name)[:, axis])  # type: ignore[misc]
    for name in ("wanted", "commanded", "measured"):
        for axis, letter in enumerate("xy"):
            yield f"force_{name}_{letter}_N", numbers(lambda of, name=name, axis=axis: getattr(of, name)[:, axis])  # type: ignore[misc]
    yield "inside", [int(value) for trial, ticks in trials for value in trial.inside[ticks]]
    for axis, letter in enumerate("xy"):
        yield f"goal_{letter}_m", known(lambda of, axis=axis: of.goal[:, axis])  # type: ignore[misc]
    yield "energy_left_J", known(lambda trial: trial.energy_left)
    if any(trial.helper is not None for trial, _ in trials):
        for axis, letter in enumerate("xy"):
            yield f"helper_{letter}_m", known(lambda of, axis=axis: _of_helper(of, "position")[:, axis])  # type: ignore[misc]
        for axis, letter in enumerate("xy"):
            yield f"helper_force_{letter}_N", known(lambda of, axis=axis: _of_helper(of, "commanded")[:, axis])  # type: ignore[misc]
        yield "helper_energy_left_J", known(lambda trial: _of_helper(trial, "energy_left")[:, 0])
    yield "status", tuple(words[i] for trial, ticks in trials for i in trial.status[ticks])
    yield "yielded", tuple(word for trial, ticks in trials for word in _yielded(trial, ticks))


def thinned_ticks(trial: Trial, rate: float = RATE) -> NDArray[np.intp]:
    """The ticks (K,) that are kept so that there are at most `rate` [Hz] of them; the first and the last are."""
    if len(trial.time) < 2:
        return np.arange(len(trial.time))
    stride = max(1, math.ceil(1.0 / (rate * float(np.median(np.diff(trial.time)))) - 1e-6))
    return np.unique(np.append(np.arange(0, len(trial.time), stride), len(trial.time) - 1))


def _of_helper(trial: Trial, name: str) -> Array:
    """(N, 2) or (N, 1) of the helper, NaN where there is none."""
    if trial.helper is None:
        return np.full((len(trial.time), 2), math.nan)
    values: Array = getattr(trial.helper, name)
    return values.reshape(len(trial.time), -1)


def _yielded(trial: Trial, ticks: NDArray[np.intp]) -> Iterator[str]:
    start = 0
    for tick in ticks:
        flags = Bound(int(np.bitwise_or.reduce(trial.yielded[start : tick + 1])))
        yield ", ".join(bound.name.lower() for bound in flags if bound.name)
        start = tick + 1
