"""Ranges of motion used in reaches by people with dyskinetic cerebral palsy and typically developing people.

    arms = {key: human_arm(range_of_motion=group.used) for key, group in reach_groups(folder).items()}

Each range is that of a typical limb of its group: the medians of the limbs' own limits. Pooled limits of all limbs
would mislead: people with cerebral palsy differ more from each other, so together they cover more than typically
developing people, although each of them uses less.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.human_arm import ARM_JOINTS, human_arm
from rehab_opt.workspace.clinical_angles import CLINICAL_ANGLES, model_scapula, model_shoulder, model_wrist
from rehab_opt.workspace.point_arguments import real_number
from rehab_opt.workspace.reach_rows import SAMPLES, TASKS, ReachAngles, Suspect, read_cp_reach, task_title
from rehab_opt.workspace.used_range import UsedRange

__all__ = ["ReachGroup", "grasp_zero", "group_range", "reach_groups"]

Array = NDArray[np.float64]

GRASP = "RGV"
"""Task that ends with the thumb upright."""
EVERY = 5
"""Step of shoulder and wrist samples, in % of the reach. Mean reaches are smooth, and there are many combinations."""

ASSUMPTIONS = (
    "the range used in one task, not the range possible",
    "limits are medians over limbs of each limb's own; a box of them reaches further than any of the limbs",
    "rows do not align across files: angles of shoulder and of wrist are combined as if independent, but elevation "
    "plane and axial rotation row by row where they have as many rows (they compensate each other as one arm's do)",
    "joint 1 is counted from the start of each reach; its median is taken from joint 2, both being about the vertical",
    "signs and zeros of clinical angles as in CLINICAL_ANGLES",
)


@dataclass(frozen=True, eq=False)
class ReachGroup:
    """Range of motion that a group used in a task.

    Parameters
    ----------
    task, group : a task's name, a member of `reach_rows.GROUPS`.
    used : limits of all eight joints for `human_arm(range_of_motion=...)`; all come from data.
    spread : by joint, spread of the lower and upper limit between limbs [rad]: half of the interval from the 16th to
        the 84th percentile, which is the standard deviation of a normal distribution.
    rows : number of limbs by clinical column.
    left_out : rows left out because of a suspected wrong sign.
    """

    task: str
    group: str
    used: UsedRange
    spread: Mapping[str, tuple[float, float]]
    rows: Mapping[str, int]
    left_out: tuple[Suspect, ...] = ()

    def __post_init__(self) -> None:
        for part in ("spread", "rows"):
            object.__setattr__(self, part, MappingProxyType(dict(getattr(self, part))))

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks for readers of a result."""
        return self.used.notes

    def __reduce__(self) -> tuple[Any, ...]:
        parts = (self.task, self.group, self.used, dict(self.spread), dict(self.rows), self.left_out)
        return type(self), parts  # a mapping proxy cannot be pickled


def reach_groups(
    folder: Path | str,
    *,
    tasks: Sequence[str] = tuple(TASKS),
    cover: float = 0.5,
    pronation_zero: float | Literal["grasp"] = 0.0,
) -> dict[tuple[str, str], ReachGroup]:
    """Range of motion that each group used in each task, by (task, group), from the files in `folder`.

    Parameters
    ----------
    tasks : names at the start of the file names.
    cover : see `group_range`.
    pronation_zero : see `group_range`; "grasp" means `grasp_zero` of the typically developing group's grasp.

    Raises
    ------
    ProblemFileError : a file is missing or invalid, see `read_cp_reach`.
    """
    folder = Path(folder)
    both = [angles for task in tasks for angles in read_cp_reach(folder, task)]
    if pronation_zero == "grasp":
        pronation_zero = grasp_zero(read_cp_reach(folder, GRASP)[0])
    ranges = [group_range(angles, cover=cover, pronation_zero=pronation_zero) for angles in both]
    return {(found.task, found.group): found for found in ranges}


def grasp_zero(reach: ReachAngles) -> float:
    """Pronation [rad] that counts as zero: with it, the median limb ends a grasp with its thumb nearest to upright.

    A grasp of a vertical object ends in such a posture, so this calibrates the zero that the files leave open. The
    result is zero if the files follow ISB and the hand grasps squarely.
    """
    end = {column: float(np.median(rows[:, -1])) for column, rows in reach.angles.items()}
    shoulder = model_shoulder(end["ShAbd"], end["ShEl"], end["ShRot"])
    arm = human_arm()

    def thumb_height(zero: float) -> float:
        wrist = model_wrist(end["ElbProSup"] - zero, end["WristFlExt"], end["WristDev"])
        return float(arm.pose(np.array([math.pi, *shoulder, end["ElbFlExt"], *wrist]))[2, 0])

    zeros = [math.radians(half / 2) for half in range(-180, 181)]
    return max(zeros, key=thumb_height)


def group_range(
    reach: ReachAngles,
    *,
    cover: float = 0.5,
    pronation_zero: float = 0.0,
) -> ReachGroup:
    """Range of the model's joints that a group used in a task.

    Parameters
    ----------
    cover : fraction of limbs whose lower limit is not below the group's, and likewise for the upper limit: 0.5 is the
        typical limb, 0.95 nearly the whole group.
    pronation_zero : [rad] the files' pronation when the palm of the hanging arm faces forward; 0 by convention.

    Raises
    ------
    ConfigurationError : `cover` outside 0.5 to 1.
    """
    if not 0.5 <= real_number(cover) <= 1:
        raise ConfigurationError("cover", cover, "a fraction from 0.5 to 1")
    if not abs(real_number(pronation_zero)) <= math.pi:
        raise ConfigurationError("pronation_zero", pronation_zero, "an angle within half a turn")
    columns = {angle.column: angle for angle in CLINICAL_ANGLES}
    rows = {column: len(reach.angles[column]) for column in columns}
    limits, spread, trials, samples = {}, {}, {}, {}
    for joint, curves in _model_curves(reach.angles, pronation_zero).items():
        lowers, uppers = curves.min(axis=-1), curves.max(axis=-1)  # rows are smooth means of several reaches
        limits[joint] = (float(np.quantile(lowers, 1 - cover)), float(np.quantile(uppers, cover)))
        spread[joint] = (_deviation(lowers), _deviation(uppers))
        trials[joint] = min(rows[column] for column, angle in columns.items() if joint in angle.joints)
        samples[joint] = trials[joint] * SAMPLES
    notes = (f"{task_title(reach.task)}, {reach.group}", *ASSUMPTIONS, *reach.notes)
    if pronation_zero:
        notes += (f"pronation counted from {math.degrees(pronation_zero):.1f} deg of the files",)
    used = UsedRange({joint: limits[joint] for joint in ARM_JOINTS}, samples, trials, {}, notes)
    return ReachGroup(reach.task, reach.group, used, spread, rows, reach.left_out)


def _model_curves(angles: Mapping[str, Array], pronation_zero: float) -> dict[str, Array]:
    """Curves (limbs, T) [rad] of each model joint; at shoulder and wrist, each combination of rows counts as a limb.

    Rows of elevation plane and axial rotation belong together: the same rows are missing from both files. At the start
    of a reach the two compensate each other. Their correlation there is -0.41 to -0.85; at most 4 % of random
    permutations of the rows are correlated as strongly.
    """
    scapula = model_scapula(angles["ScPro"])
    turn, adduction, flexion = model_shoulder(*_shoulder_rows(angles["ShAbd"], angles["ShEl"], angles["ShRot"]))
    turn = _smooth(turn) - np.median(scapula, axis=0)[::EVERY]
    pronation = angles["ElbProSup"] - pronation_zero
    bend, deviation, roll = model_wrist(*_combined(pronation, angles["WristFlExt"], angles["WristDev"]))
    curves = (
        scapula, turn, adduction, _smooth(flexion), angles["ElbFlExt"],
        _smooth(bend), deviation, _smooth(roll, around=math.pi / 2),
    )  # fmt: skip
    return dict(zip(ARM_JOINTS, curves, strict=True))


def _shoulder_rows(plane: Array, elevation: Array, axial: Array) -> list[Array]:
    """Curves (limbs, T) of the three angles: each pair of plane and axial rotation, with each row of elevation."""
    if len(plane) != len(axial):
        return _combined(plane, elevation, axial)
    pairs = np.arange(len(plane)).repeat(len(elevation))
    return [plane[pairs, ::EVERY], np.tile(elevation[:, ::EVERY], (len(plane), 1)), axial[pairs, ::EVERY]]


def _combined(first: Array, second: Array, third: Array) -> list[Array]:
    """Three arrays (n1 n2 n3, T): every combination of a row of each."""
    rows = (first[:, None, None, ::EVERY], second[None, :, None, ::EVERY], third[None, None, :, ::EVERY])
    return [combined.reshape(-1, combined.shape[-1]) for combined in np.broadcast_arrays(*rows)]


def _smooth(curves: Array, *, around: float = 0.0) -> Array:
    """Angle curves, unwrapped so that they do not jump by 2 pi.

    Each is then shifted by whole turns so that its mean is within half a turn of the angle `around` [rad].
    """
    unwrapped = np.unwrap(curves, axis=-1)
    turns = np.round((unwrapped.mean(axis=-1, keepdims=True) - around) / (2 * math.pi))
    return np.asarray(unwrapped - 2 * math.pi * turns)


def _deviation(values: Array) -> float:
    low, high = np.percentile(values, [16, 84])
    return float(high - low) / 2
