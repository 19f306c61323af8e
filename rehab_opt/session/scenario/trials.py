"""A trial of a scenario as a trace, tick by tick."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.control.command import Relaxed
from rehab_opt.session.outcome import Array
from rehab_opt.session.trace import Trace

Law = Literal["unassisted", "assisted", "published", "together", "delayed"]
LAWS: tuple[Law, ...] = get_args(Law)
"""The controllers: no force; `Assistance`; the paper's field with a hard gate and a clipped force (`FieldLaw`), which
is
not certified; `Bilateral`, in which a helper pulls the hand, without and with a delay."""
RATE = 100.0
"""[Hz] Largest rate of trace.csv; metrics.json uses all ticks."""
METRES, NEWTONS = ("x_m", "y_m"), ("x_N", "y_N")
PARTS: Mapping[str, Sequence[str]] = {
    "velocity": ("x_m_s", "y_m_s"), "intended": METRES, "force_desired": NEWTONS, "force_commanded": NEWTONS,
    "force_measured": NEWTONS, "goal": METRES, "helper": METRES, "helper_force": NEWTONS,
}  # fmt: skip


def trial_trace(columns: Mapping[str, ArrayLike], *, ended: str) -> Trace:
    """The trace of a trial; all positions are in the robot's frame, and trace.csv has the rows of `thinned_ticks`.

    Parameters
    ----------
    columns : `t_s`; `_hand`, `velocity`, `intended` (N, 2); `force_desired` (before bounds), `force_commanded`,
        `force_measured` (N, 2); `inside`, whether the hand is in W_c; `goal` (N, 2) to reach or hold, NaN without one;
        `energy_left_J` in the tank, NaN without one; `status`; `_relaxed`, flags of `Relaxed`; `_let_go`, whether a
        hand that stood still under force was released. With a helper also `helper`, `helper_force`, `_helper_intended`
        (N, 2) and `helper_energy_left_J`. For a robot with delays also `_seen` [m] and `_acting` [N]: the measured
        position and the motor force at the start of the tick.
    ended : "done" if the task was finished, "late" if its time was over.
    """
    x, y = np.transpose(columns["_hand"])
    trace = Trace({"t_s": columns["t_s"], "x_m": x, "y_m": y} | dict(columns) | {"_ended": ended}, PARTS)
    trace["status"] = trace.pop("status")
    trace.rows = thinned_ticks(trace["t_s"])
    trace["relaxed"] = np.full(len(x), "", dtype=object)
    trace["relaxed"][trace.rows] = list(_relaxed(trace["_relaxed"], trace.rows))
    return trace


def thinned_ticks(time: Array) -> NDArray[np.intp]:
    """The ticks (K,) of `time` (N,) [s] kept at a rate of at most `RATE`; always the first and the last."""
    if len(time) < 2:
        return np.arange(len(time))
    stride = max(1, math.ceil(1.0 / (RATE * float(np.median(np.diff(time)))) - 1e-6))
    return np.unique(np.append(np.arange(0, len(time), stride), len(time) - 1))


def _relaxed(flags: NDArray[np.uint8], ticks: NDArray[np.intp]) -> Iterator[str]:
    """For each written row, the names of the bounds that were relaxed since the row before."""
    for since in np.bitwise_or.reduceat(flags, np.concatenate(([0], ticks[:-1] + 1))):
        yield ", ".join(bound.name.lower() for bound in Relaxed(int(since)) if bound.name)
