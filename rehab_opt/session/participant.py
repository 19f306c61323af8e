"""The participant of a problem: the arm, and the recorded path in the frame of its shoulder."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from rehab_opt.errors import ProblemFileError
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.kinematics.human_arm import human_arm
from rehab_opt.kinematics.measured_path import measured_path
from rehab_opt.recordings.reading import read_recording, resampled
from rehab_opt.recordings.recording import Recording
from rehab_opt.session.arm_keys import ArmSection, RangeOfMotion, SegmentsSection
from rehab_opt.session.files import ProblemFile, recording_path
from rehab_opt.session.outcome import Array
from rehab_opt.session.refusals import refused_as
from rehab_opt.session.schema import PlacementSection, PlanarPlacement, Problem, RecordingSection, Side
from rehab_opt.text_file import FARTHEST
from rehab_opt.workspace.used_range import UsedRange

__all__ = ["AnyRange", "arm_of", "checked_hand", "participant_arm", "placed_path", "placed_recording"]

AnyRange = str | RangeOfMotion | UsedRange
MIRROR = np.diag([-1.0, 1.0])  # sagittal plane: x to the participant's right becomes x to the left


def participant_arm(section: ArmSection, *, file: str) -> SerialChain:
    """The arm with the participant's segments and range of motion; raises as `arm_of`."""
    arm = arm_of(section.side, section.segments, section.range_of_motion, file=file)
    own = {"joint_speed_deg_s": "velocity", "joint_acceleration_deg_s2": "acceleration"}
    with refused_as(file, "arm, {}".format):
        return arm.with_limits(**section.arguments(*own, **own))


def arm_of(side: Side, segments: SegmentsSection, ranges: AnyRange, *, file: str, key: str = "arm") -> SerialChain:
    """An arm with a range of motion given by name or by limits; `key` is its key in the problem file.

    Raises
    ------
    ProblemFileError : a value of the file is not valid for the arm.
    """
    chosen = ranges.by_joint() if isinstance(ranges, RangeOfMotion) else ranges
    with refused_as(file, f"{key}, {{}}".format):
        return human_arm(range_of_motion=chosen, segments=segments.arguments(), side=side)


def checked_hand(recording: RecordingSection, *, side: Side, file: str) -> None:
    """Refuse a path of the other hand without `mirror`, and a path of the same hand with `mirror`.

    Raises
    ------
    ProblemFileError : `mirror` does not match the hands, so that the run would use the wrong side.
    """
    other = recording.hand != side
    if recording.mirror != other:
        expected = (
            f"true, since a {recording.hand} hand was recorded and the arm is a {side} one"
            if other
            else f"false, since the recorded hand and the arm are both {side} ones"
        )
        raise ProblemFileError(file, "recording.mirror", recording.mirror, expected)


def placed_path(
    recording: Recording, placement: PlanarPlacement | PlacementSection, *, mirror: bool, file: str
) -> tuple[Array, str]:
    """The path of the hand at its placement, and a sentence that describes the transformation.

    In this order, the path is turned about the vertical, mirrored if it is the other hand's, scaled, and shifted so
    that the middle of its bounding box lies at the centre. A third coordinate is dropped.

    Parameters
    ----------
    recording : points (N, 2) or (N, 3) [m]; the first two coordinates lie in the plane.

    Returns
    -------
    path : (N, 3) [m], z up (0 if the placement has no plane), y forward, x to the participant's right.
    sentence : for the notes of the result.

    Raises
    ------
    ProblemFileError : no points, `fit_m` for a path without extent, or a path out of any arm's reach.
    """
    if recording.points.shape[1] < 2:
        raise ProblemFileError(file, "recording.columns", None, "the columns that hold the hand's x and y")
    angle = math.radians(placement.turn_deg)
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    if mirror:
        turn = MIRROR @ turn
    flat = recording.points[:, :2] @ turn.T
    low, high = flat.min(axis=0), flat.max(axis=0)
    scale = _scale(placement, high - low, file=file)
    flat = (flat - (low + high) / 2) * scale + placement.centre_m
    said = [f"turned by {placement.turn_deg:g} deg"] if placement.turn_deg else []
    said += ["mirrored in the sagittal plane"] if mirror else []
    said += [f"scaled by {scale:.4g}"] if scale != 1 else ["in its true size"]
    said += projected(recording.points)
    beyond = float(np.abs(flat).max())
    if not beyond <= FARTHEST:
        raise ProblemFileError(
            file, "placement", f"a path up to {beyond:.3g} m from the shoulder", f"at most {FARTHEST:g} m"
        )
    height = placement.plane_height_m if isinstance(placement, PlacementSection) else 0.0
    path = np.column_stack((flat, np.full(len(flat), height)))
    return path, f"path {', '.join(said)}"


def projected(points: Array, forces: Array | None = None) -> list[str]:
    """A note if points (N, 2 or 3) [m] or forces [N] have a third coordinate, which the projection drops."""
    said = [f"{1e3 * float(np.ptp(points[:, 2])):.0f} mm of height"] if points.shape[1] == 3 else []
    if forces is not None and forces.shape[1] == 3:
        said.append(f"up to {float(np.abs(forces[:, 2]).max()):.3g} N along it")
    return [f"projected onto the plane ({', '.join(said)} left out)"] if said else []


def _scale(placement: PlanarPlacement, extent: Array, *, file: str) -> float:
    if placement.fit_m is None:
        return placement.scale or 1.0
    sized = extent > 1e-9
    if not sized.any():
        raise ProblemFileError(file, "placement.fit_m", placement.fit_m, "a path that is more than one point")
    return float(np.min(np.array(placement.fit_m)[sized] / extent[sized]))


def placed_recording(
    config: ProblemFile[Problem],
    source: RecordingSection,
    placement: PlanarPlacement | PlacementSection,
    *,
    side: Side,
    rate: float,
    keys: str = "",
) -> tuple[Recording, Array]:
    """The recording at `rate` [Hz] at its placement, and its path (N, 3) [m] (z is 0 without a plane).

    Parameters
    ----------
    side : side of the arm that will follow the path.
    keys : prefix of `recording` and `placement` in the problem file, with its dot.

    Raises
    ------
    ProblemFileError : the recording is missing, unreadable, or of the other hand without `mirror`.
    """
    try:
        checked_hand(source, side=side, file=config.file)
        path = recording_path(config, source.file)
        recording = resampled(_as_moved(read_recording(path, name=source.file, **source.reading())), rate)
        points, sentence = placed_path(recording, placement, mirror=source.mirror, file=config.file)
    except ProblemFileError as refused:
        if not refused.key.startswith(("recording.", "placement")):
            raise  # a line or a column of the recording itself
        raise ProblemFileError(config.file, keys + refused.key, refused.value, refused.expected) from refused
    if recording.points.shape[1] == 3 and source.up is None:
        recording = recording.noting("its z axis is taken to point up: recording.up names another")
    return replace(recording.noting(sentence), points=points[:, :2]), points


def _as_moved(recording: Recording) -> Recording:
    """The motion of the hand, reconstructed from samples that were held, rounded or noisy."""
    time, points, notes = measured_path(recording.time, recording.points)
    if not notes:
        return recording

    def then(values: Array) -> Array:
        return np.interp(time, recording.time, values)

    joints = {name: then(values) for name, values in recording.joints.items()}
    forces = np.apply_along_axis(then, 0, recording.forces) if recording.forces.size else recording.forces
    return replace(recording, time=time, points=points, joints=joints, forces=forces).noting(*notes)
