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
from rehab_opt.errors import ConfigurationError
from rehab_opt.measures.along_path import Projection, covered_in_order, deviation_in_order, projected
from rehab_opt.measures.path import path_length, path_ratio
from rehab_opt.measures.speed import mean_speed, peak_speed, spectral_arc_length
from rehab_opt.session.outcome import Array, finite
from rehab_opt.session.scenario.problem import THERAPY
from rehab_opt.session.trace import Trace

__all__ = ["COVERED", "deviation_of", "law_summary", "time_to_zero_force", "trial_measures"]

Ticks = NDArray[np.bool_]
Numbers = dict[str, Any]

COVERED = 0.95
"""Fraction of a path that must be covered, in order, for a trial to succeed."""
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
    """All measures of a trial.

    Parameters
    ----------
    reference : (M, 2) [m] the path, or the points to hold.
    target : (2,) [m] the point to reach; None if any point of the reference will do (stretch), or for the end of the
        reference (follow); not needed in "hold".
    within : [m] a hand within this distance is on the target, and covers a path.
    jump : [m] stretch of a path that may be skipped and still counts as covered; default twice `within`.

    Raises
    ------
    ConfigurationError : a trial of fewer than two ticks, a reference that is no path, or a tolerance that is not
        positive.
    """
    if len(trial["t_s"]) < 2:
        raise ConfigurationError("trial", f"{len(trial['t_s'])} ticks", "two ticks or more")
    path = np.asarray(reference, dtype=np.float64)
    if path.ndim != 2 or path.shape[1:] != (2,) or not len(path) or not np.isfinite(path).all():
        raise ConfigurationError("reference", path.shape, "finite points (M, 2) in metres")
    if not 0 < within < math.inf:
        raise ConfigurationError("within", within, "metres above zero")
    where = projected(trial["_hand"], path)
    covered: float | None = None
    if mode == "follow":
        target = path[-1] if target is None else target
        covered = covered_in_order(trial["_hand"], path, within=within, jump=2 * within if jump is None else jump)
    deviation, counts = deviation_of(trial, path, mode)
    return {
        "reference_covered_fraction": covered,
        **_deviations(deviation, counts, trial["inside"]),
        **_forces(trial),
        **_motion(trial, mode, counts),
        **_from_intended(trial),
        **_arrival(trial, deviation, counts, mode, target, within, covered),
        "smoothness_sparc": None if mode == "hold" else _smoothness(trial),  # it tells of one movement, not of many
        **_statuses(trial),
        **promised(trial, where, mode),
    }


def deviation_of(trial: Trace, path: Array, mode: Mode) -> tuple[Array, Ticks]:
    """(N,) [m] distance from `path` (M, 2), from its current point if the path is followed, or from the point to hold;

    and (N,) the ticks in which it counts.
    """
    if mode != "hold":
        follows, where = mode == "follow", trial["_hand"]
        far = deviation_in_order(where, path) if follows else projected(where, path).distance
        return far, np.ones(len(far), dtype=bool)
    known: Ticks = np.isfinite(trial["goal"][:, 0]) & np.isfinite(trial["goal"][:, 1])
    return np.linalg.norm(trial["_hand"] - trial["goal"], axis=1), known


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


def _forces(trial: Trace) -> Numbers:
    measured, commanded = (
        np.linalg.norm(trial["force_measured"], axis=1),
        np.linalg.norm(trial["force_commanded"], axis=1),
    )
    from_rest = np.vstack((np.zeros(2), trial["force_commanded"]))
    change = np.linalg.norm(np.diff(from_rest, axis=0), axis=1).max() / _tick(trial)
    moved = np.diff(trial["_hand"], axis=0)
    return {
        "force_measured_mean_N": float(measured.mean()),
        "force_measured_max_N": float(measured.max()),
        "force_commanded_mean_N": float(commanded.mean()),
        "force_commanded_max_N": float(commanded.max()),
        "force_change_max_N_s": finite(change),
        # A force is held until the next tick: this is its work on the hand.
        "energy_delivered_J": float((trial["force_commanded"][:-1] * moved).sum()),
    }


def _motion(trial: Trace, mode: Mode, counts: Ticks) -> Numbers:
    measured = np.linalg.norm(trial["force_measured"], axis=1)
    holds = mode == "hold" and bool(counts.any())
    return {
        "speed_mean_m_s": mean_speed(trial["velocity"], trial["t_s"]),
        "speed_max_m_s": peak_speed(trial["velocity"]),
        "speed_held_mean_m_s": float(np.linalg.norm(trial["velocity"][counts], axis=1).mean()) if holds else None,
        "force_measured_held_mean_N": float(measured[counts].mean()) if holds else None,
        "duration_s": float(trial["t_s"][-1] - trial["t_s"][0]),
        "path_length_m": path_length(trial["_hand"]),
        # Of a reach that fell short, the way to the target would flatter: the straight line ends where the hand did.
        "path_length_ratio": finite(path_ratio(trial["_hand"], None if mode in THERAPY else trial["intended"])),
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
    to_target = (
        aimed if target is None or mode == "hold" else np.linalg.norm(trial["_hand"] - np.asarray(target), axis=1)
    )
    on_target = counts & ((to_target if mode in THERAPY else aimed) <= within)
    last = float(to_target[counts][-1]) if counts.any() else math.nan
    reached_fraction = _reached_fraction(trial, on_target) if mode == "hold" else None
    first = np.flatnonzero(on_target)
    met = last <= within if reached_fraction is None else reached_fraction == 1.0
    met = met and (covered is None or covered >= COVERED)
    return {
        "success": bool(str(trial["_ended"]) == "done" and met),
        "final_distance_m": finite(last),
        "time_to_target_s": float(trial["t_s"][first[0]] - trial["t_s"][0]) if mode in THERAPY and len(first) else None,
        "time_on_target_s": float(on_target.sum() * _tick(trial)),
        "time_on_target_fraction": float(on_target.sum() / counts.sum()) if counts.any() else None,
        "goals_reached_fraction": reached_fraction,
    }


def _from_intended(trial: Trace) -> Numbers:
    """Distance of the hand from the person's intended position."""
    behind = np.linalg.norm(trial["_hand"] - trial["intended"], axis=1)
    return {"from_intended_mean_m": float(behind.mean()), "from_intended_max_m": float(behind.max())}


def _reached_fraction(trial: Trace, on_target: Ticks) -> float:
    """Fraction of the points to hold that the hand reached in time."""
    goals = {tuple(goal) for goal in trial["goal"][np.isfinite(trial["goal"]).all(axis=1)].tolist()}
    reached = {tuple(goal) for goal in trial["goal"][on_target].tolist()}
    return len(reached) / len(goals) if goals else 0.0


def _smoothness(trial: Trace) -> float | None:
    return finite(spectral_arc_length(np.linalg.norm(trial["velocity"], axis=1), 1.0 / _tick(trial)))


def _statuses(trial: Trace) -> Numbers:
    counts = Counter(trial["status"].tolist())
    let_go = np.isin(trial["status"], LETTING_GO)
    known = {status.value: counts[status.value] / len(let_go) for status in Status if counts[status.value]}
    return {
        "status_fraction": known,
        "releases": int(let_go[0]) + int((let_go[1:] & ~let_go[:-1]).sum()),
        "inside_fraction": float(trial["inside"].mean()),
    }


def _tick(trial: Trace) -> float:
    """Tick of the trial [s]."""
    return float(np.median(np.diff(trial["t_s"])))


NEAR = 0.25
"""Fraction of the reference that counts as near its end."""


def promised(trial: Trace, where: Projection, mode: Mode) -> dict[str, Any]:
    """Numbers that the controller guarantees, for one trial; `where` are its positions on the reference.

    Inside W_c the magnitude of the commanded force may not grow. The force along the reference, towards its end, counts
    only outside W_c.
    """
    desired, commanded = (
        np.linalg.norm(trial["force_desired"], axis=1),
        np.linalg.norm(trial["force_commanded"], axis=1),
    )
    growth = np.diff(np.concatenate(([0.0], commanded)))
    inside, outside = trial["inside"], ~trial["inside"]
    along = (trial["force_commanded"] * where.tangent).sum(axis=1)
    led = mode != "hold" and bool(outside.any())
    near = where.length - where.along <= NEAR * where.length
    return {
        "force_desired_inside_max_N": float(desired[inside].max()) if inside.any() else None,
        "force_growth_inside_max_N": float(growth[inside].max()) if inside.any() else None,
        "time_to_zero_force_after_entry_max_s": time_to_zero_force(trial),
        "force_along_reference_outside_min_N": float(along[outside].min()) if led else None,
        "force_along_reference_outside_max_N": float(along[outside].max()) if led else None,
        "force_along_reference_last_quarter_mean_N": _mean(along, outside & near if led else None),
        "force_along_reference_before_mean_N": _mean(along, outside & ~near if led else None),
    }


def time_to_zero_force(trial: Trace) -> float | None:
    """[s] longest time from entering W_c, or from a start inside, until the force is exactly zero.

    A stay that ends before that counts with its full length, so that it cannot hide a force that was never released.
    None if the hand was never inside.
    """
    edges = np.flatnonzero(np.diff(np.concatenate(([0], trial["inside"].astype(np.int8), [0]))))
    zero: NDArray[np.bool_] = (trial["force_commanded"] == 0).all(axis=1)
    longest: float | None = None
    for entry, left in zip(edges[::2], edges[1::2], strict=True):
        first = entry + int(np.argmax(zero[entry:left])) if zero[entry:left].any() else min(left, len(zero) - 1)
        longest = max(longest or 0.0, float(trial["t_s"][first] - trial["t_s"][entry]))
    return longest


def _mean(values: NDArray[np.float64], ticks: NDArray[np.bool_] | None) -> float | None:
    return float(values[ticks].mean()) if ticks is not None and ticks.any() else None


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
"""For all other measures the largest value is the worst."""
NEVER_IS_WORST = frozenset({"time_to_target_s"})
"""For these, a trial without the number is the worst."""


def law_summary(measures: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Mean and worst of every number over the trials, and the fraction of successful trials.

    A mean is over the trials that have the number, and None without any. The worst time is None if a trial never
    reached the event.
    """
    mean: dict[str, Any] = {}
    worst: dict[str, Any] = {}
    for key in measures[0] if measures else ():
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
    return {
        "success_rate": float(np.mean([of["success"] for of in measures])) if measures else None,
        "mean": mean,
        "worst": worst,
    }
