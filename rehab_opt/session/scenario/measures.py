"""Measures of a trial: deviation, force, speed, time, and the clinical measures of reaching.

Every key ends in its unit, and every value is strict JSON; None means that the number does not exist.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.control.command import Status
from rehab_opt.control.gate import Mode
from rehab_opt.measures.along_path import Projection, covered_in_order, deviation_in_order, projected
from rehab_opt.measures.path import path_length, path_ratio
from rehab_opt.measures.speed import mean_speed, peak_speed, spectral_arc_length
from rehab_opt.session.outcome import Array, finite
from rehab_opt.session.scenario.problem import THERAPY
from rehab_opt.session.trace import Trace

Ticks = NDArray[np.bool_]
Numbers = dict[str, Any]

COVERED = 0.95
"""Fraction of a path that must be covered, in order, for a trial to succeed."""
NEAR = 0.25
"""Fraction of the reference that counts as near its end."""
LETTING_GO = (Status.RELEASING.value, Status.RELEASED.value)


def trial_measures(
    trial: Trace,
    *,
    reference: ArrayLike,
    mode: Mode,
    target: ArrayLike | None,
    within: float,
    jump: float | None = None,
) -> Numbers:
    """All measures of a trial of two ticks or more.

    Parameters
    ----------
    reference : (M, 2) [m] the path, or the points to hold.
    target : (2,) [m] the point to reach. None means any point of the reference in "stretch", and its end in "follow";
        "hold" needs no target.
    within : [m] a hand within this distance of the target is on it, and within this distance of a path covers it.
    jump : [m] length of a path section that may be skipped and still counts as covered; default twice `within`.
    """
    path = np.asarray(reference, dtype=np.float64)
    where = projected(trial["_hand"], path)
    covered: float | None = None
    if mode == "follow":
        target = path[-1] if target is None else target
        covered = covered_in_order(trial["_hand"], path, within=within, jump=2 * within if jump is None else jump)
    deviation, counts = deviation_of(trial, path, mode)
    tick, hand = _tick(trial), trial["_hand"]
    speed, measured = _sizes(trial["velocity"]), _sizes(trial["force_measured"])
    held = counts & (mode == "hold")
    return {
        "reference_covered_fraction": covered,
        **_deviations(deviation, counts, trial["inside"]),
        **_forces(trial, measured, tick),
        "speed_mean_m_s": mean_speed(trial["velocity"], trial["t_s"]),
        "speed_max_m_s": peak_speed(trial["velocity"]),
        "speed_held_mean_m_s": _mean(speed, held),
        "force_measured_held_mean_N": _mean(measured, held),
        "duration_s": float(trial["t_s"][-1] - trial["t_s"][0]),
        "path_length_m": path_length(hand),
        # The straight line ends where the hand did: one to the target would make a reach that fell short look better.
        "path_length_ratio": finite(path_ratio(hand, None if mode in THERAPY else trial["intended"])),
        **_mean_and_max("from_intended", "m", _sizes(hand - trial["intended"])),
        **_arrival(trial, deviation, counts, mode, target, within, covered),
        # It is defined for one movement; holding several points has many.
        "smoothness_sparc": None if mode == "hold" else finite(spectral_arc_length(speed, 1.0 / tick)),
        **_statuses(trial),
        **promised(trial, where, mode),
    }


def deviation_of(trial: Trace, path: Array, mode: Mode) -> tuple[Array, Ticks]:
    """Two results: the deviation (N,) [m] of the hand, and whether it counts (N,) in each tick.

    The deviation is the distance from the point to hold ("hold"), from the current point of the path ("follow"), or
    from the nearest point of `path` (M, 2) (other modes).
    """
    hand = trial["_hand"]
    if mode == "hold":
        return _sizes(hand - trial["goal"]), np.isfinite(trial["goal"]).all(axis=1)
    far = deviation_in_order(hand, path) if mode == "follow" else projected(hand, path).distance
    return far, np.ones(len(far), dtype=bool)


def _deviations(deviation: Array, counts: Ticks, inside: Ticks) -> Numbers:
    numbers: Numbers = {}
    both = bool(inside[counts].any()) and not bool(inside[counts].all())
    parts = {"deviation": counts, "deviation_inside": counts & inside, "deviation_outside": counts & ~inside}
    for name, ticks in parts.items():
        of = deviation[ticks] if both or name == "deviation" else deviation[:0]
        known = len(of) > 0
        numbers |= {
            f"{name}_mean_m": float(np.mean(of)) if known else None,
            f"{name}_rms_m": float(np.sqrt(np.mean(of**2))) if known else None,
            f"{name}_p95_m": float(np.percentile(of, 95)) if known else None,
            f"{name}_max_m": float(np.max(of)) if known else None,
        }
    return numbers


def _forces(trial: Trace, measured: Array, tick: float) -> Numbers:
    commanded = trial["force_commanded"]
    changes = _sizes(np.diff(np.vstack((np.zeros(2), commanded)), axis=0))
    return {
        **_mean_and_max("force_measured", "N", measured),
        **_mean_and_max("force_commanded", "N", _sizes(commanded)),
        "force_change_max_N_s": finite(changes.max() / tick),
        # Work on the hand of a force that is constant during each tick.
        "energy_delivered_J": float((commanded[:-1] * np.diff(trial["_hand"], axis=0)).sum()),
    }


def _arrival(  # noqa: PLR0917  (what the trial was judged by)
    trial: Trace,
    aimed: Array,
    counts: Ticks,
    mode: Mode,
    target: ArrayLike | None,
    within: float,
    covered: float | None,
) -> Numbers:
    to_target = aimed if target is None or mode == "hold" else _sizes(trial["_hand"] - np.asarray(target))
    on_target = counts & ((to_target if mode in THERAPY else aimed) <= within)
    last, first = float(to_target[counts][-1]) if counts.any() else math.nan, np.flatnonzero(on_target)
    reached, met = None, last <= within
    if mode == "hold":  # each point must be reached at some time while it counts
        goals, held = ({tuple(goal) for goal in trial["goal"][ticks].tolist()} for ticks in (counts, on_target))
        reached = len(held) / len(goals) if goals else 0.0
        met = reached == 1.0
    met = met and (covered is None or covered >= COVERED)
    return {
        "success": bool(str(trial["_ended"]) == "done" and met),
        "final_distance_m": finite(last),
        "time_to_target_s": float(trial["t_s"][first[0]] - trial["t_s"][0]) if mode in THERAPY and len(first) else None,
        "time_on_target_s": float(on_target.sum() * _tick(trial)),
        "time_on_target_fraction": float(on_target.sum() / counts.sum()) if counts.any() else None,
        "goals_reached_fraction": reached,
    }


def _statuses(trial: Trace) -> Numbers:
    counts, let_go = Counter(trial["status"].tolist()), np.isin(trial["status"], LETTING_GO)
    known = {status.value: counts[status.value] / len(let_go) for status in Status if counts[status.value]}
    return {
        "status_fraction": known,
        "releases": int(let_go[0]) + int((let_go[1:] & ~let_go[:-1]).sum()),
        "inside_fraction": float(trial["inside"].mean()),
    }


def promised(trial: Trace, where: Projection, mode: Mode) -> Numbers:
    """Measures of the controller's guarantees in one trial; `where` projects the hand onto the reference.

    Inside W_c the magnitude of the commanded force may not grow. The force along the reference, towards its end, counts
    only outside W_c.
    """
    desired, commanded = _sizes(trial["force_desired"]), _sizes(trial["force_commanded"])
    growth, inside = np.diff(commanded, prepend=0.0), trial["inside"]
    along = (trial["force_commanded"] * where.tangent).sum(axis=1)
    led = ~inside & (mode != "hold")
    near = where.length - where.along <= NEAR * where.length
    return {
        "force_desired_inside_max_N": float(desired[inside].max()) if inside.any() else None,
        "force_growth_inside_max_N": float(growth[inside].max()) if inside.any() else None,
        "time_to_zero_force_after_entry_max_s": time_to_zero_force(trial),
        "force_along_reference_outside_min_N": float(along[led].min()) if led.any() else None,
        "force_along_reference_outside_max_N": float(along[led].max()) if led.any() else None,
        "force_along_reference_last_quarter_mean_N": _mean(along, led & near),
        "force_along_reference_before_mean_N": _mean(along, led & ~near),
    }


def time_to_zero_force(trial: Trace) -> float | None:
    """[s] longest time from entering W_c, or from a start inside, until the force is exactly zero.

    If the hand leaves W_c before that, the whole stay counts. None if the hand was never inside.
    """
    edges = np.flatnonzero(np.diff(np.concatenate(([0], trial["inside"].astype(np.int8), [0]))))
    zero: Ticks = (trial["force_commanded"] == 0).all(axis=1)
    longest: float | None = None
    for entry, left in zip(edges[::2], edges[1::2], strict=True):
        first = entry + int(np.argmax(zero[entry:left])) if zero[entry:left].any() else min(left, len(zero) - 1)
        longest = max(longest or 0.0, float(trial["t_s"][first] - trial["t_s"][entry]))
    return longest


def _tick(trial: Trace) -> float:
    return float(np.median(np.diff(trial["t_s"])))


def _sizes(vectors: Array) -> Array:
    return np.asarray(np.linalg.norm(vectors, axis=1))


def _mean_and_max(name: str, unit: str, of: Array) -> Numbers:
    return {f"{name}_mean_{unit}": float(of.mean()), f"{name}_max_{unit}": float(of.max())}


def _mean(values: Array, ticks: Ticks) -> float | None:
    return float(values[ticks].mean()) if ticks.any() else None


LESS_IS_WORSE = frozenset(
    {
        "smoothness_sparc",
        "time_on_target_s",
        "time_on_target_fraction",
        "goals_reached_fraction",
        "reference_covered_fraction",
        "inside_fraction",
        "pair_energy_left_min_J",
    }
)
"""Measures whose smallest value is the worst; for all others, the largest is."""
NEVER_IS_WORST = frozenset({"time_to_target_s"})
"""Measures for which a trial without a value is the worst."""


def law_summary(measures: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Mean and worst value of every measure over the trials, and the fraction of successful trials.

    The mean is over the trials that have a value, and None if no trial has one. The worst time to the target is None
    if a trial never reached it.
    """
    mean: dict[str, Any] = {}
    worst: dict[str, Any] = {}
    for key in measures[0]:
        values = [of[key] for of in measures]
        if key == "success":
            continue
        if isinstance(values[0], Mapping):
            names = dict.fromkeys(name for of in values for name in of)
            mean[key] = {name: float(np.mean([of.get(name, 0.0) for of in values])) for name in names}
            continue
        known = [float(value) for value in values if value is not None]
        mean[key] = float(np.mean(known)) if known else None
        missing = key in NEVER_IS_WORST and len(known) < len(values)
        of_worst = min if key in LESS_IS_WORSE else max
        worst[key] = of_worst(known) if known and not missing else None
    return {"success_rate": float(np.mean([of["success"] for of in measures])), "mean": mean, "worst": worst}
