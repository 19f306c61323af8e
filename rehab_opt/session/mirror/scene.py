"""The layout of a run: the recording moved into the robot's frame, mirrored, and converted to poses of the tool."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.control.arm_path import arm_path
from rehab_opt.control.conditioning import Conditioned, conditioned
from rehab_opt.control.preview import angles_between
from rehab_opt.errors import ProblemFileError
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.kinematics.vr import FrameFit, Mirror, fit_frame, quaternions_of, robot_from_unity, rotations_of
from rehab_opt.measures.path import path_length
from rehab_opt.measures.samples import low_passed
from rehab_opt.recordings.recording import Recording, size_note, strange_sizes, unseen
from rehab_opt.session.files import ProblemFile, recording_path
from rehab_opt.session.mirror.hand_poses import HandPoses, calibration_points, read_hand_poses
from rehab_opt.session.mirror.problem import MirrorProblem, PoseRecordingSection
from rehab_opt.session.outcome import Array
from rehab_opt.session.participant import arm_of
from rehab_opt.session.pose_tracking import MAX_TICKS
from rehab_opt.session.refusals import refused_as
from rehab_opt.session.robot_file import pose_of, robot_at_start
from rehab_opt.session.schema import Side
from rehab_opt.text_file import times

UNITY_AXES = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""Rotation from Unity's axes to a robot's: p = (z, -x, y)."""
ARM_HAND = {
    "left": np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]]),
    "right": np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]),
}
"""Columns: the axes fingers, back and across of a hand, in the hand frame of `human_arm`. There, x points along the
handle
towards the thumb, and z to the fingers; -y points out of the back of a left hand, and +y of a right one."""


ARM_NEAR = 5e-3, math.radians(5.0)
"""[m, rad] Within this deviation, an arm counts as reaching a pose."""
SLOW, TREMBLES = 2.0, 0.05
"""[Hz] A reaching hand hardly moves at higher frequencies; a note reports tremor if such motion adds more than the
fraction `TREMBLES` to the path's length."""
STILL = 1e-3
"""[m] Extent below which a hand counts as at rest."""
SAME_TIME = 1e-3
"""[s] Largest difference between the stamps of a sample of the hand and the same sample of the patient."""
TOGETHER = 0.5
"""[s] Changes of posture closer in time are reported as one."""


@dataclass(frozen=True, eq=False)
class Setup:
    """The robot, person and reference of a run.

    Parameters
    ----------
    robot, start : the arm, and its starting joint positions (n,) [rad].
    mirror : mirror plane of the patient; for a moving patient, at the first sample.
    reference : poses of the tool from the mirrored recording, at equal intervals.
    recorded : (N, 3) [m] healthy hand in the robot's frame, unfiltered, without lost samples.
    person : the led arm in the robot's base frame, and the tool's pose (4, 4) in this arm's hand frame; or None.
    fit : fit of the recording's frame to calibration points.
    notes : notes for a reader of the result.
    """

    robot: SerialChain
    start: Array
    mirror: Mirror
    reference: Conditioned
    recorded: Array
    person: tuple[SerialChain, Array] | None
    fit: FrameFit | None
    notes: tuple[str, ...]

    @cached_property
    def _path(self) -> tuple[Conditioned, NDArray[np.int_]]:
        reference = self.reference
        if self.person is None:
            return reference, np.arange(len(reference.poses))
        dt, seen = float(reference.times[1] - reference.times[0]), np.flatnonzero(~reference.lost)
        path = arm_path(*self.person, reference.poses[seen], dt=dt)
        first = np.searchsorted(path.reference_index, np.arange(len(seen)))
        gaps = np.flatnonzero(reference.lost)
        where = np.append(first, len(path.reference_index))[np.searchsorted(seen, gaps)]
        twists = path.twists.copy()
        twists[first[1:][np.diff(seen) > 1]] = 0.0  # the hand's velocity after a gap is unknown
        index = np.insert(seen[path.reference_index], where, gaps)
        return reference._replace(
            times=reference.times[0] + dt * np.arange(len(index)),
            poses=np.insert(path.poses, where, math.nan, axis=0),
            twists=np.insert(twists, where, math.nan, axis=0),
            lost=np.insert(np.zeros(len(path.reference_index), dtype=bool), where, True),
        ), index

    @property
    def led(self) -> Conditioned:
        """M samples that the robot follows: the reference, limited to what the person's arm can reach (`arm_path`)."""
        return self._path[0]

    @property
    def reference_index(self) -> NDArray[np.int_]:
        """(M,) index of the reference sample for each sample of `led`; constant while the arm changes its posture."""
        return self._path[1]

    @cached_property
    def beyond(self) -> Array:
        """(M, 2) [m, rad] distance and angle from each pose of `led` to the reference; zero for a lost hand."""
        reference, led = self.reference.poses[self.reference_index], self.led.poses
        away = np.linalg.norm(led[:, :3, 3] - reference[:, :3, 3], axis=1)
        turned = angles_between(reference[:, :3, :3], led[:, :3, :3])
        return np.asarray(np.nan_to_num(np.column_stack([away, turned])))

    def reference_of(self, led: Array, seconds: ArrayLike) -> tuple[Array, Array]:
        """Two results: the reference poses (K, 4, 4) of the tracked poses `led` (K, 4, 4), and their `beyond` (K, 2).

        `seconds` (K,) [s] are the times of the tracked poses since the beginning of `self.led`.
        """
        step = float(self.led.times[1] - self.led.times[0])
        k = np.clip(np.rint(np.nan_to_num(np.asarray(seconds)) / step).astype(int), 0, len(self.reference_index) - 1)
        wanted, done, found = self.reference.poses[self.reference_index[k]], self.led.poses[k], led.copy()
        found[:, :3, 3] += wanted[:, :3, 3] - done[:, :3, 3]
        found[:, :3, :3] = wanted[:, :3, :3] @ done[:, :3, :3].transpose(0, 2, 1) @ led[:, :3, :3]
        return np.where(np.isnan(found), led, found), self.beyond[k]


def laid_out(config: ProblemFile[MirrorProblem]) -> Setup:
    """Read the recording and compute the layout."""
    problem, file = config.problem, config.file
    robot, start = robot_at_start(config)
    section = problem.recording
    seen = read_hand_poses(recording_path(config, section.file), section, file=file)
    fit = _frame(config)
    poses, moved = fit.poses(_robot_axes(seen, section)), _patient_motion(config, seen.times, fit)
    (x, y, z), facing = problem.patient.sagittal_point_m, math.radians(problem.patient.facing_deg)
    mirror = Mirror((x, y, z), (-math.sin(facing), math.cos(facing), 0.0), "z")
    grip = pose_of(problem.robot.grip_deg, problem.robot.grip_m)
    tools = moved @ mirror.poses(np.linalg.inv(moved) @ poses) @ grip
    valid = np.flatnonzero(np.all(np.isfinite(tools), axis=(1, 2)) & np.isfinite(seen.times))
    if not valid.size:
        raise ProblemFileError(section.file, "samples", 0, "at least 3 valid samples in a row")
    seconds, rate = float(np.ptp(seen.times[valid])), problem.tracker.rate_hz
    if seconds * rate > MAX_TICKS:
        expected = f"at most {MAX_TICKS} ticks in the recording's {seconds:g} s"
        raise ProblemFileError(file, "tracker.rate_hz", rate, expected)
    # The filter comes last, so that the robot's reference itself is smooth.
    with refused_as(section.file):
        reference = conditioned(
            seen.times[valid],
            tools[valid, :3, 3],
            quaternions_of(tools[valid, :3, :3]),
            dt=1.0 / rate,
            **problem.conditioning.arguments(),
        )
    notes = [*seen.notes, *robot.notes]
    if problem.placement.calibration_file is not None:
        notes.append(
            f"the recording's frame was found from {len(fit.residuals)} points, {1e3 * fit.rms:.2g} mm (rms) and at "
            f"most {1e3 * float(fit.residuals.max()):.2g} mm off"
        )
    elif problem.placement.scale != 1.0:
        notes.append(f"the recording is scaled by {problem.placement.scale:.4g}, the arms' lengths")
    if problem.patient.track_file is not None:
        turn = angles_between(moved[:1, :3, :3], moved[:, :3, :3]).max()
        notes.append(
            f"the mirror plane follows {problem.patient.track_file}: the patient turns by up to "
            f"{math.degrees(turn):.0f} deg; figures draw the plane at the first sample"
        )
    stamps = seen.times[valid]
    newest = np.maximum.accumulate(stamps)
    late = np.flatnonzero(stamps[1:] <= newest[:-1]) + 1
    if late.size:
        row = valid[late[0]] + (section.rows or [1])[0]
        notes.append(
            f"samples left out: {late.size} whose stamps are not after all before them, the first in row {row}: "
            f"{stamps[late[0]]:.9g} s after {newest[late[0]]:.9g} s (did the clock begin anew?)"
        )
    if reference.dropped > late.size or reference.gaps:
        notes.append(f"samples left out as spikes: {reference.dropped - late.size}; sight lost {times(reference.gaps)}")
    return Setup(
        robot=robot,
        start=start,
        mirror=mirror,
        reference=reference,
        recorded=poses[valid, :3, 3],
        person=_person(problem, grip, file=file),
        fit=fit if problem.placement.calibration_file is not None else None,
        notes=tuple(notes),
    )


def path_notes(scene: Setup) -> Iterator[str]:
    """Notes on the reference's size and speed, the fraction that the led arm reaches, and its posture changes."""
    seen, times = ~scene.reference.lost, scene.reference.times
    reference = Recording("the reference", times[seen], scene.reference.poses[seen, :3, 3])
    yield size_note(reference)
    yield from strange_sizes(reference)
    if np.ptp(reference.points, axis=0).max() < STILL:
        yield f"the hand stays within {1e3 * STILL:g} mm: it only turns, if at all"
    rate, whole = 1.0 / (times[1] - times[0]), path_length(reference.points)
    # A recording shorter than a second is too short for this filter.
    slow = path_length(low_passed(reference.points, rate, cutoff_hz=SLOW)) if len(reference.points) > rate else whole
    if whole - slow > TREMBLES * slow:
        longer = f"{1e2 * (whole - slow) / slow:.0f} % longer because of motion above {SLOW:g} Hz"
        yield (
            f"the hand's path is {longer}: tremor or sensor noise, which slows the led hand; a lower "
            "conditioning.cutoff_hz removes it, and lags more"
        )
    if scene.person is None:
        return
    own = np.append(True, np.diff(scene.reference_index) > 0) & ~scene.led.lost
    fraction = float((scene.beyond[own] <= ARM_NEAR).all(axis=1).mean())
    yield f"the led arm, by its range of motion, does {100 * fraction:.0f} % of it within 5 mm and 5 deg"
    waits = np.flatnonzero(np.diff(scene.reference_index) == 0)
    if waits.size:
        moments = times[scene.reference_index[waits]] - times[0]
        at = ", ".join(f"{moment:.1f}" for moment in moments[np.diff(moments, prepend=-math.inf) > TOGETHER])
        yield (
            f"that arm changes its posture at {at} s of the recording, which waits "
            f"{waits.size * (times[1] - times[0]):.1f} s in all; meanwhile the hand is led up to "
            f"{1e3 * scene.beyond[waits, 0].max():.0f} mm off its path"
        )


def hand_axes(section: PoseRecordingSection) -> Array:
    """Columns (3, 3) in the recorded hand frame, made right-handed: fingers, back, and their cross product."""
    fingers, back = (_axis(name, unity=section.frame == "unity") for name in (section.fingers, section.back))
    return np.column_stack([fingers, back, np.cross(fingers, back)])


def _robot_axes(seen: HandPoses, section: PoseRecordingSection) -> Array:
    """Hand poses (N, 4, 4) in the recording's right-handed frame; the hand's axes are fingers, back and across."""
    positions, quaternions = seen.positions, seen.quaternions
    if section.frame == "unity":
        positions, quaternions = robot_from_unity(positions, quaternions)
    lengths = np.linalg.norm(quaternions, axis=1)
    lost = unseen(positions) | ~(lengths > 1e-6)
    poses = np.tile(np.eye(4), (len(positions), 1, 1))
    poses[:, :3, :3] = rotations_of(np.where(lost[:, None], [0.0, 0.0, 0.0, 1.0], quaternions)) @ hand_axes(section)
    poses[:, :3, 3] = positions
    poses[lost] = math.nan
    return poses


def _patient_motion(config: ProblemFile[MirrorProblem], stamps: Array, fit: FrameFit) -> Array:
    """Motion (N, 4, 4) of the patient since the first sample, in the robot's frame; the identity without a track."""
    name = config.problem.patient.track_file
    if name is None:
        return np.eye(4)
    section = config.problem.recording.model_copy(update={"file": name})
    seen = read_hand_poses(recording_path(config, name, key="patient.track_file"), section, file=config.file)
    if len(seen.times) != len(stamps):
        expected = f"{len(stamps)}, as many as in {config.problem.recording.file}"
        raise ProblemFileError(name, "samples", len(seen.times), expected)
    first = (section.rows or [1])[0]
    apart = np.flatnonzero(~np.isclose(seen.times, stamps, rtol=0.0, atol=SAME_TIME, equal_nan=True))
    if apart.size:
        k = apart[0]
        expected = f"{stamps[k]:.9g} s, as in {config.problem.recording.file}"
        raise ProblemFileError(name, f"sample {first + k}, t_s", float(seen.times[k]), expected)
    poses = fit.poses(_robot_axes(seen, section))
    lost = np.flatnonzero(~np.all(np.isfinite(poses), axis=(1, 2)))
    if lost.size:
        raise ProblemFileError(name, f"sample {first + lost[0]}", "no pose", "a pose of the patient in every sample")
    return np.asarray(poses @ np.linalg.inv(poses[0]))


def _frame(config: ProblemFile[MirrorProblem]) -> FrameFit:
    placement = config.problem.placement
    if placement.calibration_file is None:
        assert placement.origin_m is not None  # the schema requires one of the two
        pose = pose_of([0.0, 0.0, placement.turn_deg], placement.origin_m)
        return FrameFit(pose, placement.scale, np.zeros(0))
    key = "placement.calibration_file"
    path = recording_path(config, placement.calibration_file, key=key)
    source, target = calibration_points(path, name=placement.calibration_file)
    if config.problem.recording.frame == "unity":
        source = source @ UNITY_AXES.T
    with refused_as(placement.calibration_file):
        return fit_frame(source, target)


def _person(problem: MirrorProblem, grip: Array, *, file: str) -> tuple[SerialChain, Array] | None:
    section = problem.patient.arm
    if section is None:
        return None
    side: Side = "left" if problem.recording.hand == "right" else "right"
    arm = arm_of(side, section.segments, section.range_of_motion, file=file, key="patient.arm")
    facing = math.radians(problem.patient.facing_deg)
    forward, left = (math.cos(facing), math.sin(facing), 0.0), (-math.sin(facing), math.cos(facing), 0.0)
    base = np.eye(4)
    base[:3, :3] = np.column_stack([-np.array(left), forward, (0.0, 0.0, 1.0)])
    base[:3, 3] = section.shoulder_m
    hand = np.eye(4)
    hand[:3, :3] = ARM_HAND[side]
    return replace(arm, base=base @ arm.base), hand @ grip


def _axis(name: str, *, unity: bool) -> Array:
    axis = np.zeros(3)
    axis["xyz".index(name[1])] = 1.0 if name[0] == "+" else -1.0
    return UNITY_AXES @ axis if unity else axis
