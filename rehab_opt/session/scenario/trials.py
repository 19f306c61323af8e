"""A trial of a scenario as a trace, tick by tick, and all trials of a run with their inputs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.control.command import Relaxed
from rehab_opt.control.gate import Mode
from rehab_opt.field.demonstration import Demonstration
from rehab_opt.field.potential import PotentialField
from rehab_opt.session.outcome import Array
from rehab_opt.session.trace import Trace
from rehab_opt.workspace.region import Workspace

__all__ = ["HELPER", "LAWS", "RATE", "Law", "ScenarioTrials", "thinned_ticks", "trial_trace"]

Law = Literal["unassisted", "assisted", "published", "together", "delayed"]
LAWS: tuple[Law, ...] = get_args(Law)
"""No force; `Assistance`; the paper's field with a hard gate and a clip (`FieldLaw`), not certified; `Bilateral`,
pulled by a helper, without and with a delay."""
RATE = 100.0
"""[Hz] Largest rate of trace.csv; metrics.json uses all ticks."""
METRES, NEWTONS = ("x_m", "y_m"), ("x_N", "y_N")
PARTS: Mapping[str, Sequence[str]] = {
    "velocity": ("x_m_s", "y_m_s"), "intended": METRES, "force_desired": NEWTONS, "force_commanded": NEWTONS,
    "force_measured": NEWTONS, "goal": METRES, "helper": METRES, "helper_force": NEWTONS,
}  # fmt: skip
HELPER = ("helper", "helper_force", "helper_energy_left_J", "_helper_intended")
"""Columns of the helper: hand, felt force, energy in the tank, intended position."""


def trial_trace(columns: Mapping[str, ArrayLike], *, ended: str) -> Trace:
    """The trace of a trial; all positions are in the robot's frame, and trace.csv has the rows of `thinned_ticks`.

    Parameters
    ----------
    columns : `t_s`; `_hand`, `velocity`, `intended` (N, 2); `force_desired` (before bounds), `force_commanded`,
        `force_measured` (N, 2); `inside`, whether the hand is in W_c; `goal` (N, 2) to reach or hold, NaN without one;
        `energy_left_J` in the tank, NaN without one; `status`; `_relaxed`, flags of `Relaxed`; `_let_go`, whether a
        hand was released that stood under force. With a helper also `HELPER`. For a robot with delays also `_seen` [m]
        and `_acting` [N]: the measured position and the motor force at the start of the tick.
    ended : "done" if the task was finished, "late" if its time was over.
    """
    hand = np.asarray(columns["_hand"])
    order = (
        "t_s",
        "x_m",
        "y_m",
        "velocity",
        "intended",
        "force_desired",
        "force_commanded",
        "force_measured",
        "inside",
    )
    known = {"x_m": hand[:, 0], "y_m": hand[:, 1], **columns, "_ended": np.array(ended)}
    trace = Trace({name: known.pop(name) for name in order} | {"goal": known.pop("goal"), **known}, PARTS)
    trace["status"] = trace.pop("status")
    trace.rows = thinned_ticks(trace["t_s"])
    trace["relaxed"] = np.full(len(hand), "", dtype=object)
    trace["relaxed"][trace.rows] = list(_relaxed(trace["_relaxed"], trace.rows))
    return trace


def thinned_ticks(time: Array) -> NDArray[np.intp]:
    """The ticks (K,) of `time` (N,) [s] kept at a rate of at most `RATE`; always the first and the last."""
    if len(time) < 2:
        return np.arange(len(time))
    stride = max(1, math.ceil(1.0 / (RATE * float(np.median(np.diff(time)))) - 1e-6))
    return np.unique(np.append(np.arange(0, len(time), stride), len(time) - 1))


def _relaxed(flags: NDArray[np.uint8], ticks: NDArray[np.intp]) -> Iterator[str]:
    """The bounds relaxed since the previous row, for each row."""
    start = 0
    for tick in ticks:
        yield ", ".join(
            bound.name.lower() for bound in Relaxed(int(np.bitwise_or.reduce(flags[start : tick + 1]))) if bound.name
        )
        start = tick + 1


@dataclass(frozen=True, eq=False)
class ScenarioTrials:
    """The trials of one scenario, for notes and figures; all positions are in the robot's frame.

    Parameters
    ----------
    mode : mode of the assistance, one for each of the paper's scenarios 1 to 5.
    comfortable, reachable : W_c and W_r.
    reference : (N, 2) [m] the path to follow, or the points to hold in order.
    demonstrated : (N, 2) [m] the helper's path in W_r, which was mapped to the reference; None without a map.
    fields : fields of the assistance: one, or one for each point to hold.
    within : [m] distance of the hand up to which a point of the reference counts as covered.
    force_limit : [N] largest force.
    trials : traces by controller, with equal parameters.
    measures : by controller, the numbers of each trial with the keys of `trial_measures`.
    shown : the demonstrations of a learnt field; else empty.
    onset : [m] distance beyond W_c over which the force grows in therapy.
    spring : S [N/m] of `PathAssistance`, which pulls to the path itself; None if the fields pull.
    """

    mode: Mode
    comfortable: Workspace
    reachable: Workspace
    reference: Array
    demonstrated: Array | None
    fields: tuple[PotentialField, ...]
    within: float
    force_limit: float
    trials: Mapping[Law, Sequence[Trace]]
    measures: Mapping[Law, Sequence[Mapping[str, Any]]]
    shown: tuple[Demonstration, ...] = ()
    onset: float = 0.0
    spring: float | None = None
