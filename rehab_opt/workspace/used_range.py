"""The range of motion that a person used in recordings, which is not all that is possible."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.human_arm import ARM_JOINTS, RANGES_OF_MOTION_DEG
from rehab_opt.workspace.joint_trials import joint_trials, one_branch
from rehab_opt.workspace.point_arguments import real_number

__all__ = ["Limits", "UsedRange", "named_ranges", "range_of_motion"]

Limits = Mapping[str, tuple[float, float]]


@dataclass(frozen=True, eq=False, repr=False)
class UsedRange(Mapping[str, tuple[float, float]]):
    """(lower, upper) [rad] by joint name: the range USED, a lower bound of the possible range.

    Valid as `human_arm(range_of_motion=...)` once it has all of `ARM_JOINTS`.

    Parameters
    ----------
    limits : (lower, upper) [rad] by name.
    samples, trials, gaps : by name, numbers of samples and trials behind a range, and number of missing samples.
    notes : remarks for readers of a result.
    """

    limits: Limits
    samples: Mapping[str, int] = field(default_factory=dict)
    trials: Mapping[str, int] = field(default_factory=dict)
    gaps: Mapping[str, int] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name, (lower, upper) in self.limits.items():
            if not -math.inf < lower <= upper < math.inf:
                raise ConfigurationError(f"limits[{name!r}]", (lower, upper), "finite (lower, upper), lower <= upper")
        for part in ("limits", "samples", "trials", "gaps"):
            object.__setattr__(self, part, MappingProxyType(dict(getattr(self, part))))

    def __getitem__(self, name: str) -> tuple[float, float]:
        return self.limits[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.limits)

    def __len__(self) -> int:
        return len(self.limits)

    def __repr__(self) -> str:
        ranges = [
            f"{name} {math.degrees(lower):.1f}..{math.degrees(upper):.1f} deg ({self.trials.get(name, 0)} trials)"
            for name, (lower, upper) in self.limits.items()
        ]
        return f"UsedRange(range used, not the range possible: {', '.join(ranges)})"

    def __reduce__(self) -> tuple[Any, ...]:
        parts = (dict(self.limits), dict(self.samples), dict(self.trials), dict(self.gaps))
        return type(self), (*parts, self.notes)  # a mapping proxy cannot be pickled


def range_of_motion(
    angles: ArrayLike | Mapping[str, object] | Sequence[ArrayLike],
    *,
    names: Sequence[str] | None = None,
    lower_percentile: float = 5.0,
    upper_percentile: float = 95.0,
    margin: float = 0.0,
    within: str | Mapping[str, Sequence[float]] | None = None,
    minimum_samples: int = 10,
) -> UsedRange:
    """Range of each joint that was used in joint-angle recordings.

    This is the range used in the recordings, not the possible range: a short reach shows little of what an arm can do.

    Parameters
    ----------
    angles : (T, n) [rad], or a list of trials (T_i, n) of any lengths, or by joint name (T,), (trials, T) or a list of
        trials (T_i,). Model joints as in `human_arm(range_of_motion=...)`: scapular_retraction relative to rest. Jumps
        by whole turns are removed, within and between trials. Samples that are masked or not finite count as gaps.
    names : the n column names of arrays; default `ARM_JOINTS` if n is 8.
    lower_percentile, upper_percentile : of all samples of all trials together, 0 <= lower < upper <= 100.
    margin : [rad] added at both ends.
    within : anatomical limits, (lower, upper) [rad] by joint or a name of `human_arm`, to which ranges are finally
        clipped, with a note.
    minimum_samples : least number of finite samples of a joint.

    Raises
    ------
    ConfigurationError : too few finite samples of a joint, angles in degrees, a range wholly outside `within`, an
        unknown name, an invalid percentile or margin.
    """
    _check_numbers(lower_percentile, upper_percentile, margin, minimum_samples)
    trials_of = joint_trials(angles, names)
    bounds = {} if within is None else named_ranges("within", within)
    for name in bounds:
        if name not in trials_of:
            raise ConfigurationError("within", name, f"joint names of the data: {', '.join(trials_of)}")
    limits: dict[str, tuple[float, float]] = {}
    samples, trials, gaps = {}, {}, {}
    notes: list[str] = []
    for name in sorted(trials_of, key=lambda name: ARM_JOINTS.index(name) if name in ARM_JOINTS else len(ARM_JOINTS)):
        seen = [trial[np.isfinite(trial)] for trial in trials_of[name]]
        gaps[name] = sum(trial.size for trial in trials_of[name]) - sum(trial.size for trial in seen)
        seen = [trial for trial in seen if trial.size]
        samples[name], trials[name] = sum(trial.size for trial in seen), len(seen)
        if samples[name] < minimum_samples:
            expected = f"at least {minimum_samples} finite samples"
            raise ConfigurationError(f"angles of {name}", f"{samples[name]} finite samples", expected)
        values = one_branch(name, seen, bounds.get(name))
        lower, upper = np.sort(np.percentile(values, [lower_percentile, upper_percentile])).tolist()
        lower, upper = lower - margin, upper + margin
        if name in bounds:
            lower, upper = _cut(name, (lower, upper), bounds[name], notes)
        limits[name] = (lower, upper)
        if gaps[name]:
            notes.append(f"{name}: {gaps[name]} of {gaps[name] + samples[name]} samples missing")
    ordered = [name for name in ARM_JOINTS if name in limits] + [name for name in limits if name not in ARM_JOINTS]
    return UsedRange({name: limits[name] for name in ordered}, samples, trials, gaps, tuple(notes))


def _check_numbers(lower: float, upper: float, margin: float, minimum_samples: int) -> None:
    if not 0 <= real_number(lower) < real_number(upper) <= 100:
        value = (lower, upper)
        raise ConfigurationError("lower_percentile, upper_percentile", value, "0 <= lower < upper <= 100")
    if not 0 <= real_number(margin) < math.inf:
        raise ConfigurationError("margin", margin, "a finite angle of 0 or more")
    if not real_number(minimum_samples) >= 1:
        raise ConfigurationError("minimum_samples", minimum_samples, "1 or more")


def named_ranges(argument: str, ranges: object) -> dict[str, tuple[float, float]]:
    """Ranges [rad] by joint name, or those of Table I if a name of the table is given; errors name `argument`."""
    if isinstance(ranges, str) and ranges in RANGES_OF_MOTION_DEG:
        table = RANGES_OF_MOTION_DEG[ranges]
        return {name: (math.radians(lower), math.radians(upper)) for name, (lower, upper) in table.items()}
    if not isinstance(ranges, Mapping):
        names = " or ".join(repr(name) for name in RANGES_OF_MOTION_DEG)
        raise ConfigurationError(argument, ranges, f"{names}, or (lower, upper) by joint name")
    return {name: _pair(f"{argument}[{name!r}]", pair) for name, pair in ranges.items()}


def _cut(name: str, limits: tuple[float, float], bound: tuple[float, float], notes: list[str]) -> tuple[float, float]:
    lower, upper = max(limits[0], bound[0]), min(limits[1], bound[1])
    if not lower <= upper:
        expected = f"a range that meets within[{name!r}] = {bound} (sign or unit?)"
        raise ConfigurationError(f"angles of {name}", limits, expected)
    if (lower, upper) != limits:
        notes.append(f"{name}: cut to its anatomical limits")
    return lower, upper


def _pair(argument: str, pair: object) -> tuple[float, float]:
    try:
        lower, upper = (float(limit) for limit in pair)  # type: ignore[attr-defined]
    except (TypeError, ValueError, OverflowError):
        lower = upper = math.nan
    if not -math.inf < lower <= upper < math.inf:
        raise ConfigurationError(argument, pair, "finite (lower, upper) with lower <= upper")
    return lower, upper
