"""What a run of scenarios leaves behind, tick by tick, for its table, trace and figures."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.command import Relaxed, Status
from rehab_opt.control.gate import Mode
from rehab_opt.field.demonstration import Demonstration
from rehab_opt.field.potential import PotentialField
from rehab_opt.session.outcome import Array, Column, Columns, Outcome, stacked
from rehab_opt.workspace.region import Workspace

__all__ = ["LAWS", "RATE", "HelperTrace", "Law", "ScenarioOutcome", "Trial", "thinned_ticks"]

Law = Literal["unassisted", "assisted", "published", "together", "delayed"]
LAWS: tuple[Law, ...] = get_args(Law)
"""No force wanted; `Assistance`; the paper's field with a hard gate and a clip (`FieldLaw`), certified by nobody;
`Bilateral`, drawn along by a helper, without and with a delay."""


RATE = 100.0
"""[Hz] of trace.csv at most; metrics.json is made of all ticks."""


@dataclass(frozen=True, eq=False)
class HelperTrace:
    """The helper's side of a trial, in the same frame; a row for each tick.

    Attributes
    ----------
    position, intended : (N, 2) [m] of the helper's hand.
    commanded : (N, 2) [N] what the helper is to feel.
    energy_left : (N,) [J] in the helper's tank.
    """

    position: Array
    intended: Array
    commanded: Array
    energy_left: Array


@dataclass(frozen=True, eq=False)
class Trial:
    """One trial; every array has a row for each of its N ticks, in the robot's frame.

    Attributes
    ----------
    law, number : which law, and which trial from 0; the same numbers have the same person in the same mood (seed).
    time : (N,) [s] from the start.
    position, velocity : (N, 2) [m], [m/s] of the hand.
    intended : (N, 2) [m] where the person means to be.
    desired, commanded, measured : (N, 2) [N] the law's force before bounds (zero where nothing is wanted), the force
        given to the robot's loop, and the force on the hand by the sensor.
    inside : (N,) whether the hand is in the comfortable workspace.
    status, relaxed : (N,) index into `tuple(Status)`, and `Relaxed` flags; 0 for laws that have none.
    let_go : (N,) whether a hand that stood under force is let go.
    energy_left : (N,) [J] in the tank; NaN for laws that have none.
    goal : (N, 2) [m] the point that was to be reached or held; NaN where there is none.
    seen, acting : (N, 2) [m] where the law saw the hand, [N] the motors' force when the tick began; None where the hand
        is seen where it is, and the motors give what they are told.
    helper : who did it along with the participant; None where there is nobody.
    ended : "done" where the task was finished, "late" where its time was over.
    """

    law: Law
    number: int
    time: Array
    position: Array
    velocity: Array
    intended: Array
    desired_force: Array
    commanded: Array
    measured: Array
    inside: NDArray[np.bool_]
    status: NDArray[np.uint8]
    let_go: NDArray[np.bool_]
    relaxed: NDArray[np.uint8]
    energy_left: Array
    goal: Array
    ended: Literal["done", "late"]
    helper: HelperTrace | None = None
    seen: Array | None = None
    acting: Array | None = None

    @property
    def statuses(self) -> list[Status]:
        """(N,) as `Status`."""
        members = tuple(Status)
        return [members[i] for i in self.status]


@dataclass(frozen=True, eq=False)
class ScenarioOutcome(Outcome):
    """The trials of one scenario; all places in the robot's frame.

    Parameters
    ----------
    mode : of the assistance, one for each of the paper's scenarios 1 to 5.
    comfortable, reachable : W_c and W_r.
    reference : (N, 2) [m] the path to be followed, or the points to be held, one after the other.
    demonstrated : (N, 2) [m] the helper's in W_r that the reference was mapped from; None without a map.
    fields : what the assistance follows: one, or one for each point to be held.
    shown : the demonstrations that the field was learnt from; empty where it was given.
    within : [m] of the hand, up to which a place of the reference counts as covered.
    force_limit : [N].
    onset : [m] beyond W_c over which a therapy's force grows.
    spring : S [N/m] of `PathAssistance`, which leads to the path itself; None where the fields lead.
    trials : by law, all of the same numbers.
    measures : by law, for each trial its numbers, the keys of `trial_measures`.
    """

    mode: Mode = field(kw_only=True)
    comfortable: Workspace = field(kw_only=True)
    reachable: Workspace = field(kw_only=True)
    reference: Array = field(kw_only=True)
    demonstrated: Array | None = field(kw_only=True)
    fields: tuple[PotentialField, ...] = field(kw_only=True)
    shown: tuple[Demonstration, ...] = field(kw_only=True, default=())
    within: float = field(kw_only=True)
    force_limit: float = field(kw_only=True)
    onset: float = field(kw_only=True, default=0.0)
    spring: float | None = field(kw_only=True, default=None)
    trials: Mapping[Law, tuple[Trial, ...]] = field(kw_only=True)
    measures: Mapping[Law, tuple[Mapping[str, Any], ...]] = field(kw_only=True)

    @property
    def coverage(self) -> str:
        """What `reference_covered_fraction` is called, with the tolerance that it is judged with."""
        return f"covered in order, within {1e3 * self.within:g} mm"

    def trace(self) -> Iterable[Column]:
        """One row a law, trial and tick that is kept; a cell is empty where there is no such number.

        Between two rows nothing is averaged, but for `relaxed`, which holds all that gave way since the row before.
        """
        trials = [trial for of in self.trials.values() for trial in of]
        helped = any(trial.helper is not None for trial in trials)
        return stacked(_columns(trial, helped=helped) for trial in trials).items()


def _columns(trial: Trial, *, helped: bool) -> Columns:
    ticks, words = thinned_ticks(trial), tuple(status.value for status in Status)
    vectors = {
        "{}_m": trial.position, "velocity_{}_m_s": trial.velocity, "intended_{}_m": trial.intended,
        "force_desired_{}_N": trial.desired_force, "force_commanded_{}_N": trial.commanded,
        "force_measured_{}_N": trial.measured,
    }  # fmt: skip
    numbers = {
        name.format(axis): of for name, values in vectors.items() for axis, of in zip("xy", values.T, strict=True)
    }
    later = {"goal_x_m": trial.goal[:, 0], "goal_y_m": trial.goal[:, 1], "energy_left_J": trial.energy_left}
    if helped:
        by = trial.helper or HelperTrace(
            *(np.full((len(trial.time), 2), np.nan),) * 3, np.full(len(trial.time), np.nan)
        )
        later |= {"helper_x_m": by.position[:, 0], "helper_y_m": by.position[:, 1]}
        later |= {"helper_force_x_N": by.commanded[:, 0], "helper_force_y_N": by.commanded[:, 1]}
        later["helper_energy_left_J"] = by.energy_left
    return {
        "law": (trial.law,) * len(ticks),
        "trial": (trial.number,) * len(ticks),
        "t_s": trial.time[ticks],
        **{name: of[ticks] for name, of in numbers.items()},
        "inside": trial.inside[ticks].astype(int),
        **{name: of[ticks] for name, of in later.items()},
        "status": [words[i] for i in trial.status[ticks]],
        "relaxed": list(_relaxed(trial, ticks)),
    }


def thinned_ticks(trial: Trial) -> NDArray[np.intp]:
    """The ticks (K,) that are kept so that there are at most `RATE` of them; the first and the last are."""
    if len(trial.time) < 2:
        return np.arange(len(trial.time))
    stride = max(1, math.ceil(1.0 / (RATE * float(np.median(np.diff(trial.time)))) - 1e-6))
    return np.unique(np.append(np.arange(0, len(trial.time), stride), len(trial.time) - 1))


def _relaxed(trial: Trial, ticks: NDArray[np.intp]) -> Iterator[str]:
    start = 0
    for tick in ticks:
        flags = Relaxed(int(np.bitwise_or.reduce(trial.relaxed[start : tick + 1])))
        yield ", ".join(bound.name.lower() for bound in flags if bound.name)
        start = tick + 1
